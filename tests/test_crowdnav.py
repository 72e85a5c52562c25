"""CrowdNav's protocol: the published row comes out again, and the judge sees what really happened."""

import numpy as np
import pytest

pytest.importorskip("pyrvo")

from dualnav_lite.beyond import tables
from dualnav_lite.beyond.crowdnav import (
    GOAL,
    KNOWN,
    START,
    STEP_S,
    TEST_CASES,
    TEST_SEED,
    Case,
    Seen,
    draw_starts,
    make_case,
    orca_arm,
    run_holonomic,
    sampling_arm,
)
from dualnav_lite.beyond.crowdnav_robot import CrowdWorlds, crowdnav_table
from dualnav_lite.config import Config, UnusableInput
from dualnav_lite.lidar import Lidar


def walkers(place, velocity, steps=98):
    """A case with one person who walks straight on."""
    times = np.arange(steps)[:, None, None] * STEP_S
    motion = np.broadcast_to(np.array(velocity, float), (steps, 1, 2))
    return Case(np.array(place, float) + times * motion, motion.copy())


def test_orca_row_of_the_paper_comes_out_within_two_points():
    results = [run_holonomic(make_case(TEST_SEED + k, 5), orca_arm) for k in range(TEST_CASES)]
    kinds = [kind for kind, _ in results]
    success, collision, time_s = KNOWN["orca", 5]
    assert kinds.count("success") / TEST_CASES == pytest.approx(success, abs=0.02)
    assert kinds.count("collision") / TEST_CASES == pytest.approx(collision, abs=0.02)
    assert np.mean([time for kind, time in results if kind == "success"]) == pytest.approx(time_s, abs=0.2)


def test_starts_keep_their_distance_and_walk_to_the_other_side():
    for seed in (TEST_SEED, TEST_SEED + 7):
        starts = draw_starts(seed, 5)
        everything = np.concatenate([[START, GOAL], starts, -starts])
        gaps = np.hypot(*(everything[:, None] - everything[None]).transpose(2, 0, 1))
        assert gaps[~np.eye(len(gaps), dtype=bool)].min() >= 0.8
        assert (np.abs(np.hypot(*starts.T) - 4.0) < 0.75).all()
    case = make_case(TEST_SEED, 5)
    assert np.hypot(*(case.positions[-1] + case.positions[0]).T).max() < 0.3


def test_sampling_arm_steps_aside_for_somebody_who_comes_straight_at_it():
    assert run_holonomic(walkers([[0.0, 3.5]], [[0.0, -1.0]]), sampling_arm)[0] == "success"
    free = sampling_arm(Seen(START, np.zeros(2), np.array([[9.0, 9.0]]), np.zeros((1, 2))))
    assert free == pytest.approx([0.0, 1.0])


def test_nobody_moves_out_of_the_way_of_the_robot():
    kind, time_s = run_holonomic(walkers([[0.0, 0.0]], [[0.0, 0.0]]), lambda seen: np.array([0.0, 1.0]))
    assert kind == "collision"
    assert time_s == pytest.approx(3.25)  # 4 m at 1 m/s less two radii, at the start of the step


def test_the_robot_is_judged_between_its_steps():
    """Somebody crosses at 20 m/s between two control steps; fine sampling in time says whether they met."""
    for offset in np.linspace(-3.0, 3.0, 13):
        case = walkers([[offset, -3.8]], [[20.0, 0.0]])
        worlds = CrowdWorlds([case], Config())
        track = [worlds.poses[0, :2].copy()]
        for _ in range(3):
            worlds.advance([[0.8, 0.0]])
            track.append(worlds.poses[0, :2].copy())
        times = np.linspace(0.0, 0.3, 3001)
        path = np.stack([np.interp(times, np.arange(4) * 0.1, np.array(track)[:, k]) for k in range(2)], axis=1)
        gap = min(np.hypot(*(case.positions[0, 0] + [20.0 * t, 0.0] - p)) for t, p in zip(times, path, strict=True))
        assert np.isfinite(worlds.contact_s[0]).tolist() == [gap < 0.6, gap < 0.5]


def test_walls_stand_where_they_were_asked_for():
    case = walkers([[0.0, 30.0]], [[0.0, 0.0]])
    worlds, open_plane = CrowdWorlds([case], Config(), walls_m=6.0), CrowdWorlds([case], Config())
    lidar = Lidar(Config().lidar, 1)
    ranges = lidar.cast(worlds.poses, worlds.scene)[0][0]
    assert ranges[0] == pytest.approx(2.0)  # behind: from (0, -4), heading up, to the wall at y = -6
    assert ranges[270] == pytest.approx(6.0)  # to the right
    assert ranges[810] == pytest.approx(6.0)
    assert lidar.cast(open_plane.poses, open_plane.scene)[0].min() == 10.0


def test_table_holds_a_row_an_arm_and_hull():
    table = crowdnav_table((2,), ("cv_sampling",), ("straight",), cases=2)
    assert table.arm.tolist() == [
        "orca",
        "constant_velocity_sampling",
        *["cv_sampling"] * 2,
        *["straight"] * 2,
    ]
    assert table.setting.tolist() == ["protocol"] * 4 + ["walls added"] * 2
    assert table.judged_with_m.tolist() == [0.3, 0.3, 0.3, 0.2, 0.3, 0.2]
    assert (table.success_rate + table.collision_rate + table.timeout_rate).to_numpy() == pytest.approx(np.ones(6))
    assert ((table.exact_low <= table.success_rate) & (table.success_rate <= table.exact_high)).all()


def test_an_unknown_table_is_named(tmp_path):
    with pytest.raises(UnusableInput, match="known: crowdnav"):
        tables.run("atlantis", tmp_path)
