"""Claims about the LSTM predictor as the environment uses it: frames, bits, fillings, what it refuses."""

import subprocess
import sys

import numpy as np
import pytest

from dualnav_lite.config import Config, UnusableInput, with_overrides
from dualnav_lite.env import DynamicNavVectorEnv
from dualnav_lite.forecast import OUTPUTS, SHIPPED, WEIGHTS, LstmPredictor, describe
from dualnav_lite.geometry import beam_directions
from dualnav_lite.kernels import forecast as kernel
from dualnav_lite.kernels.tracking import AGE, COLUMNS, MISSES, P_VEL, RADIUS, VX, VY, X, Y
from dualnav_lite.motion import STEPS
from dualnav_lite.tracking import ConstantVelocityPredictor, Tracker, constant_velocity, follow
from tests.kernels_in_python import in_python
from tests.stage import Stage, arc

BUSY_ROOM = str(SHIPPED.parent.parent / "training" / "scenarios" / "busy_room.yaml")


def random_weights(hidden=8, middle=6, seed=0):
    rng = np.random.default_rng(seed)
    shapes = [(kernel.SEQUENCE, 4 * hidden), (hidden, 4 * hidden), (4 * hidden,), (hidden + kernel.CONTEXT, middle)]
    shapes += [(middle,), (middle, OUTPUTS), (OUTPUTS,)]
    return {name: rng.normal(0, 0.4, shape).astype(np.float32) for name, shape in zip(WEIGHTS, shapes, strict=True)}


def walkers(steps=10, worlds=1, turn=0.0):
    """Scans (n, steps, beams, 2) and poses of robots that drive past two walkers; `turn` moves the odometry frame."""
    scans, poses = [], []
    for world in range(worlds):
        stage = Stage(size=(12.0, 10.0), seed=world)
        path = arc([2.0, 4.0 + 0.2 * world, 0.1], 0.6, 0.3, steps)
        people = [[[5.0 - 0.03 * k, 3.0 + 0.07 * k, 0.27], [4.0, 6.5 - 0.08 * k, 0.25]] for k in range(steps)]
        scans.append(np.stack([stage.scan(pose, people=who)[0] for pose, who in zip(path, people, strict=True)]))
        poses.append(path)
    poses = np.array(poses)
    c, s = np.cos(turn), np.sin(turn)
    moved = [c * poses[..., 0] - s * poses[..., 1] + turn, s * poses[..., 0] + c * poses[..., 1] - 2 * turn]
    return np.array(scans), np.stack([*moved, poses[..., 2] + turn], axis=-1)


def test_a_network_that_says_nothing_is_constant_velocity():
    weights = random_weights()
    weights["w_last"][:], weights["b_last"][:] = 0, 0
    drive = walkers(worlds=2)
    for ours, wanted in zip(LstmPredictor(weights)(*drive), ConstantVelocityPredictor()(*drive), strict=True):
        np.testing.assert_array_equal(ours, wanted)
    assert ConstantVelocityPredictor()(*drive)[2].sum() == 4


def test_forecasts_have_the_same_bits_for_any_number_of_worlds():
    predictor, (scans, poses) = LstmPredictor(random_weights()), walkers(worlds=5)
    together = predictor(scans, poses)
    for world in range(5):
        alone = predictor(scans[world : world + 1], poses[world : world + 1])
        for one, all_of_them in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[0], all_of_them[world])


def test_turning_and_moving_the_odometry_frame_changes_no_forecast():
    predictor = LstmPredictor(random_weights())
    for plain, turned in zip(predictor(*walkers()), predictor(*walkers(turn=2.2)), strict=True):
        np.testing.assert_allclose(plain, turned, atol=1e-4)


def test_a_memory_that_is_not_full_is_no_walker_who_stood():
    scans, poses = walkers(steps=6)
    rows = np.maximum(np.arange(10) - 4, 0)
    tracker = Tracker(1)
    for step in range(6):
        plain = tracker.update(poses[:, step], scans[:, step])
    tracks, past = follow(scans[:, rows], poses[:, rows])
    assert plain.valid.sum() == 2
    for name, values in vars(plain).items():
        np.testing.assert_array_equal(getattr(tracks, name), values)
    np.testing.assert_array_equal(past[0, :2, :, AGE], [[0, 0, 0, 0, 1, 2, 3, 4, 5, 6]] * 2)


def test_the_past_of_a_mover_is_that_of_its_track():
    scans, poses = walkers()
    tracks, past = follow(scans, poses)
    now = past[0, :2, -1]
    c, s = np.cos(poses[0, -1, 2]), np.sin(poses[0, -1, 2])
    away = now[:, [X, Y]] - poses[0, -1, :2]
    seen = np.stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0]], axis=1)
    np.testing.assert_allclose(seen, tracks.positions[0, :2], atol=1e-9)
    walked = np.diff(past[0, :2, 4:, [X, Y]], axis=-1)
    np.testing.assert_allclose(np.hypot(*walked), 0.078, atol=0.03)  # 0.076 and 0.080 m a scan
    assert not past[0, 2:].any()


def test_an_environments_tracker_remembers_as_one_that_reads_the_scans_again():
    scans, poses = walkers(steps=14)
    tracker = Tracker(1, depth=10)
    for step in range(14):
        tracks = tracker.update(poses[:, step], scans[:, step])
    past, again = tracker.past(tracks), follow(scans, poses)[1]
    np.testing.assert_array_equal(past, again[:, :, -10:])
    tracker.reset([0])
    assert not tracker.past(tracks).any()


def test_what_stands_is_left_to_the_tracker():
    stage, tracker, pose = Stage(), Tracker(1, depth=10), np.array([3.0, 4.0, 0.0])
    for step in range(40):
        y = 2.5 + 0.08 * min(step, 22)
        scan = stage.scan(pose, people=[[5.5, y, 0.27]])
        tracks = tracker.update(pose[None], scan)
    assert tracks.valid[0, 0]
    poses = np.tile(pose, (1, 10, 1))
    told = LstmPredictor(random_weights()).correct(tracks, tracker.past(tracks), poses, scan)
    wanted = constant_velocity(tracks)
    np.testing.assert_array_equal(told.positions, wanted.positions)
    assert not told.velocities.any()


def one_mover(seed=3, depth=10, beams=1080):
    """States, poses and a scan with nothing behind them."""
    rng = np.random.default_rng(seed)
    states = np.zeros((depth, COLUMNS))
    states[2:, AGE] = np.arange(1, depth - 1)
    states[2:, [X, Y]] = np.array([1.5, 0.7]) + np.cumsum(rng.normal(0.05, 0.02, (depth - 2, 2)), axis=0)
    states[2:, [VX, VY]] = rng.normal([0.5, 0.4], 0.1, (depth - 2, 2))
    states[2:, P_VEL], states[2:, RADIUS], states[4, MISSES] = 0.04, 0.27, 1.0
    poses = arc([0.2, -0.1, 0.4], 0.6, -0.5, depth)
    scan = np.stack([rng.uniform(0.4, 5.0, beams), rng.random(beams) > 0.1], axis=1).astype(np.float32)
    return states, poses, scan


def described(states, poses, scan, call=kernel.describe_mover):
    out = np.zeros((len(states), kernel.SEQUENCE), np.float32), np.zeros(kernel.CONTEXT, np.float32), np.zeros(4)
    call(states, poses, scan, *out)
    return out


def test_the_room_around_a_mover_equals_the_reference():
    states, poses, scan = one_mover()
    room = described(states, poses, scan)[1][7:]
    directions = np.stack(beam_directions(len(scan)), axis=1)
    c, s = np.cos(poses[-1, 2]), np.sin(poses[-1, 2])
    points = scan[:, :1] * directions @ np.array([[c, s], [-s, c]]) + poses[-1, :2] - states[-1, [X, Y]]
    points = points[::2][scan[::2, 1] > 0]
    distances, heading = np.hypot(*points.T), np.arctan2(states[-1, VY], states[-1, VX])
    bearings = np.arctan2(points[:, 1], points[:, 0]) - heading
    others = distances >= 0.27 + 0.12
    for sector in range(kernel.SECTORS):
        off = (bearings - 2 * np.pi * sector / kernel.SECTORS + np.pi) % (2 * np.pi) - np.pi
        found = distances[others & (np.abs(off) < np.pi / kernel.SECTORS)]
        assert room[1 + sector] == pytest.approx(min(3.0, found.min(initial=3.0)) / 3.0, abs=1e-6)
    ahead, left = distances * np.cos(bearings), distances * np.sin(bearings)
    found = ahead[others & (distances < 3.0) & (ahead > 0) & (np.abs(left) < 0.35)]
    assert room[0] == pytest.approx(found.min(initial=3.0) / 3.0, abs=1e-6)
    assert (room < 1).sum() > 6


def test_mirroring_everything_mirrors_what_is_told():
    torch = pytest.importorskip("torch")
    from dualnav_lite.predictor import mirrored

    states, poses, scan = one_mover()
    plain = [torch.tensor(values[None]) for values in described(states, poses, scan)[:2]]
    states[:, [Y, VY]] *= -1
    poses[:, 1:] *= -1
    flipped = described(states, poses, np.roll(scan[::-1], 1, axis=0))
    sequences, contexts, _ = mirrored(*plain, torch.zeros(1, OUTPUTS))
    np.testing.assert_allclose(flipped[0], sequences[0], atol=1e-6)
    np.testing.assert_allclose(flipped[1], contexts[0], atol=1e-6)


def test_kernels_equal_their_python_source(monkeypatch):
    scene, weights = one_mover(), random_weights()
    states, poses, scan = scene
    valid = np.array([[True, False]])
    results = []
    for is_python in (False, True):
        if is_python:
            in_python(monkeypatch, kernel)
        told = np.zeros((1, 2, 10, kernel.SEQUENCE), np.float32), np.zeros((1, 2, kernel.CONTEXT), np.float32)
        frames, outputs = np.zeros((1, 2, 4)), np.ones((1, 2, OUTPUTS), np.float32)
        kernel.describe_movers(np.stack([states, states])[None], poses[None], scan[None], valid, *told, frames)
        kernel.run_network_on_movers(*told, valid, *(weights[name] for name in WEIGHTS), outputs)
        results.append((*told, frames, outputs))
    for compiled, plain in zip(*results, strict=True):
        np.testing.assert_allclose(compiled, plain, atol=2e-6)
        assert compiled[0, 0].any()
        assert not compiled[0, 1].any()


def test_a_missing_or_foreign_file_is_one_clear_line(tmp_path):
    with pytest.raises(UnusableInput, match=r"no such predictor; `train .*constant_velocity"):
        LstmPredictor.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("not weights", encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"text\.npz: not a predictor"):
        LstmPredictor.load(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", w_input=np.zeros((2, 2)))
    with pytest.raises(UnusableInput, match="'w_hidden' is missing"):
        LstmPredictor.load(tmp_path / "other.npz")
    np.savez(tmp_path / "shape.npz", **{**random_weights(), "b_last": np.zeros(3, np.float32)})
    with pytest.raises(UnusableInput, match=r"'b_last' has shape \(3,\), expected \(42,\)"):
        LstmPredictor.load(tmp_path / "shape.npz")


def drive(env, steps=15):
    env.reset(seed=3)
    for _ in range(steps):
        observations, rewards, *_ = env.step(np.tile([0.5, 0.1], (env.num_envs, 1)))
    return observations, rewards, env.percept.prediction


def test_the_config_puts_the_lstm_in_the_place_of_constant_velocity():
    named = drive(DynamicNavVectorEnv(2, with_overrides(Config(), {"predictor": "lstm"}), BUSY_ROOM))
    usual = drive(DynamicNavVectorEnv(2, Config(), BUSY_ROOM))
    assert named[2].valid.any()
    assert named[2].positions.shape[-2] == STEPS
    np.testing.assert_array_equal(named[2].valid, usual[2].valid)
    np.testing.assert_array_equal(named[2].radii, usual[2].radii)
    off = np.linalg.norm(named[2].positions - usual[2].positions, axis=-1)[usual[2].valid]
    assert (off[:, 0] < 0.1).all()
    assert off[:, -1].max() > 0.02
    assert (named[0][:, 1] != usual[0][:, 1]).any()  # the forecast channel
    np.testing.assert_array_equal(named[0][:, 0], usual[0][:, 0])


def test_no_environment_imports_torch_for_it():
    code = (
        "import sys; from dualnav_lite.config import Config, with_overrides;"
        "from dualnav_lite.env import DynamicNavEnv;"
        "DynamicNavEnv(config=with_overrides(Config(), {'predictor': 'lstm'})); sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=300).returncode == 0


def test_describe_reads_a_copy_of_nothing():
    scans, poses = walkers()
    kept = scans.copy(), poses.copy()
    describe(*follow(scans, poses), poses, scans[:, -1])
    np.testing.assert_array_equal(scans, kept[0])
    np.testing.assert_array_equal(poses, kept[1])
