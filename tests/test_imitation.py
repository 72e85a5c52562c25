import numpy as np
import pytest
import torch

from dualnav_lite import streams
from dualnav_lite.config import Config, Hardware, with_overrides
from dualnav_lite.encoder import BANDS
from dualnav_lite.env import DynamicNavVectorEnv, split_infos
from dualnav_lite.imitation import Imitation, fit, imitate, imitation_loss
from dualnav_lite.kernels import sampling as kernels
from dualnav_lite.labels import MIRRORED_BANDS, Labels, Noise, Teacher, collect, mirrored, pack, unpack
from dualnav_lite.planners.sampling import Ceiling, command_grid
from dualnav_lite.policy import make_actor
from dualnav_lite.trunks import Seen, split_observations
from dualnav_lite.weights import load_weights, save_weights

DRAWN = with_overrides(Config(), {"preference": "drawn"})
SMALL = Imitation(
    rounds=2, first_round_shards=1, round_shards=2, worlds=4, shard_labels=64, updates=3, last_updates=4, batch=32
)


def student(seed=0):
    torch.manual_seed(seed)
    return make_actor((4, 64, 64), "commands", [0.8, 1.2])


@pytest.fixture(scope="module")
def labels():
    return collect(None, SMALL, DRAWN, ["navigation", "crowd_crossing"], seed=3)


def test_packed_observations_come_back_within_half_a_step():
    rng = np.random.default_rng(0)
    observations = rng.random((5, 4, 64, 64)).astype(np.float32)
    observations[:, 1] = 2 * observations[:, 1] - 1
    images, bands = unpack(*pack(observations))
    expected, numbers = split_observations(torch.from_numpy(observations))
    assert (images - expected).abs().max() <= 0.5 / 127 + 1e-6
    assert torch.equal(bands, numbers)


def test_loss_is_least_where_the_student_chooses_as_softly_as_the_teacher():
    costs = torch.tensor([[0.0, 0.1, 5.0]])
    target = torch.softmax(-costs / 0.1, dim=1)
    entropy = float(-(target * target.log()).sum())
    assert float(imitation_loss(target.log(), costs, 0.1)) == pytest.approx(entropy, rel=1e-5)
    for other in ([0.4, 0.4, 0.2], [0.98, 0.01, 0.01]):
        assert float(imitation_loss(torch.tensor([other]).log(), costs, 0.1)) > entropy


@pytest.mark.parametrize(("caution", "chosen"), [(0.0, 1), (1.0, 0)])
def test_caution_leaves_alone_what_is_now_and_then_a_collision(caution, chosen):
    # Two situations that look alike: command 1 is best in three of four and a collision in the other one.
    costs = torch.tensor([[0.2, 0.0, 3.0]] * 3 + [[0.2, 3.0, 3.0]])
    logits = torch.zeros(1, 3, requires_grad=True)
    optimizer = torch.optim.Adam([logits], lr=0.05)
    for _ in range(500):
        optimizer.zero_grad()
        imitation_loss(torch.log_softmax(logits, dim=1).expand(4, 3), costs, 0.1, caution).backward()
        optimizer.step()
    found = torch.softmax(logits.detach(), dim=1)[0]
    mean_of_choices = torch.softmax(-costs / 0.1, dim=1).mean(dim=0)
    choice_of_mean = torch.softmax(-costs.mean(dim=0) / 0.1, dim=0)
    assert torch.allclose(found, choice_of_mean if caution else mean_of_choices, atol=2e-2)
    assert int(found.argmax()) == chosen


def test_swapping_left_and_right_twice_changes_nothing_and_once_swaps_the_bands_and_turns(labels):
    grid = command_grid(Hardware())
    once = mirrored(labels.images, labels.bands, labels.costs, grid.shape[:2])
    twice = mirrored(*once, grid.shape[:2])
    for original, back in zip((labels.images, labels.bands, labels.costs), twice, strict=True):
        assert np.array_equal(original, back)
    assert [BANDS[k] for k in MIRRORED_BANDS] == ["omega", "goal_sin", "guide_sin"]
    flat = grid.reshape(-1, 2)
    turn = [int(np.abs(flat - command * [1, -1]).sum(axis=1).argmin()) for command in flat]
    assert np.array_equal(once[2], labels.costs[:, turn])


@pytest.mark.parametrize(("layout", "flat_beams"), [("image", 0), ("flat", 1080)])
def test_mirrored_worlds_look_mirrored_to_the_encoder(layout, flat_beams):
    # A thing on the left in one world and on the right in the other: columns of the image count to the right.
    from dualnav_lite.encoder import Ego, encode_states

    ranges = np.full((2, 3, 1080, 2), 9.0, np.float32)
    ranges[..., 1] = 0.5
    ranges[0, :, 800] = ranges[1, :, (1080 - 800) % 1080] = [1.5, 0.9]
    point = np.array([[2.0, 1.0], [2.0, -1.0]])
    twist = np.array([[0.3, 0.4], [0.3, -0.4]])
    ego = Ego(twist, np.full(2, 0.5), point, point, np.zeros(2), np.full(2, 0.5))
    changes = {"observation.motion.method": "none", "observation.layout": layout}
    config = with_overrides(Config(), changes).observation
    left, right = encode_states(ranges, np.zeros((2, 3, 3)), np.zeros((2, 64, 64)), ego, config)
    images, bands = pack(np.stack([left, right]))
    flipped, swapped, _ = mirrored(images[:1], bands[:1], np.zeros((1, 99)), (9, 11), flat_beams)
    assert np.array_equal(flipped[0], images[1])
    assert not np.array_equal(flipped[0], images[0])
    assert np.allclose(swapped[0], bands[1])


def test_collected_labels_have_a_best_command_and_follow_from_the_seed(labels):
    assert len(labels) == 64
    assert (labels.costs.min(axis=1) == 0).all()
    assert labels.costs.max() <= Labels.CAP_M
    again = collect(None, SMALL, DRAWN, ["navigation", "crowd_crossing"], seed=3)
    other = collect(None, SMALL, DRAWN, ["navigation", "crowd_crossing"], seed=4)
    assert np.array_equal(labels.images, again.images)
    assert np.array_equal(labels.costs, again.costs)
    assert not np.array_equal(labels.bands, other.bands)


def test_a_student_gets_into_states_of_its_own(labels):
    own = collect(student(), SMALL, DRAWN, ["navigation", "crowd_crossing"], seed=3)
    assert len(own) == 64
    assert not np.array_equal(own.bands, labels.bands)


def test_labels_on_disk_are_whole_or_absent(labels, tmp_path):
    stem = tmp_path / "标签 0"
    assert not Labels.exists(stem)
    labels.save(stem)
    assert Labels.exists(stem)
    for name in Labels.PARTS:
        assert np.array_equal(getattr(Labels.load(stem), name), getattr(labels, name))


def test_fitting_brings_the_student_to_the_labels(labels):
    actor = student()
    optimizer = torch.optim.AdamW(actor.parameters(), lr=1e-3)

    def loss():
        with torch.no_grad():
            log_probabilities = actor(Seen.of(*unpack(labels.images, labels.bands), False))
            return float(imitation_loss(log_probabilities, torch.from_numpy(labels.costs).float(), 0.08))

    before = loss()
    fit(actor, optimizer, [labels], SMALL, streams.stream(0, "test"), 30)
    assert loss() < 0.8 * before


def test_more_thrift_means_a_slower_teacher():
    freedoms = [Teacher.freedom(preference, 0.6) for preference in (0.0, 0.25, 0.5, 1.0)]
    assert freedoms[0] == 1.0
    assert freedoms == sorted(freedoms, reverse=True)
    assert Teacher.freedom(0.5, 0.15) < Teacher.freedom(0.5, 1.0)
    assert Teacher.freedom(1.0, 0.15) == pytest.approx(0.0, abs=1e-3)


def test_thrift_turns_less_and_drives_slower():
    env, teacher = DynamicNavVectorEnv(1, DRAWN, "navigation", truth=True), Teacher(DRAWN)
    costs = {}
    for preference in (0.0, 1.0):
        _, infos = env.reset(seed=11, options={"preference": preference})
        infos["battery"][0] = 0.2
        costs[preference] = teacher.costs_of([0], infos)[0].reshape(9, 11)
    teacher.SPEEDING_COST = teacher.TURNING_COST = 0.0
    plain = teacher.costs_of([0], infos)[0].reshape(9, 11)
    added = costs[1.0] - plain
    assert added[2] == pytest.approx(Teacher.TURNING_COST * np.abs(teacher.grid[2, :, 1]), abs=1e-3)
    assert added[8, 5] == pytest.approx(Teacher.SPEEDING_COST * (0.8 - Teacher.THRIFTY_M_S), abs=1e-3)


@pytest.mark.parametrize(("walkers", "is_fast"), [(Teacher.CROWD - 1, False), (Teacher.CROWD, True)])
def test_thrift_waits_while_a_crowd_walks_by(walkers, is_fast):
    env = DynamicNavVectorEnv(1, DRAWN, "navigation", truth=True)
    _, infos = env.reset(seed=11, options={"preference": 1.0})
    truth = infos["truth"]
    truth["num_circles"][0] = 5
    truth["circles"][0, :5] = [*truth["pose"][0, :2] + [0.0, 2.5], 0.3]
    truth["circle_velocities"][0, :5] = 0.0
    truth["circle_velocities"][0, :walkers] = [0.0, 0.8]  # away: no danger
    teacher = Teacher(DRAWN)
    command = teacher.grid.reshape(-1, 2)[teacher.costs_of([0], infos)[0].argmin()]
    assert (abs(command[0]) > Teacher.THRIFTY_M_S) == is_fast


def test_teacher_wants_the_ways_it_would_drive_and_forgets_nothing_of_its_own():
    env = DynamicNavVectorEnv(3, DRAWN, "navigation", truth=True)
    _, infos = env.reset(seed=11, options={"preference": 0.0})
    teacher = Teacher(DRAWN)
    before = teacher._parameters.copy()
    costs = teacher.costs_of([2, 0], infos)
    assert np.array_equal(teacher._parameters, before)
    alone = Teacher(DRAWN).costs_of([0], infos)
    assert np.array_equal(costs[1], alone[0])
    # Without thrift it is the ceiling planner with wider margins.
    ceiling = Ceiling(DRAWN)
    ceiling.margins = 1.6
    ceiling._parameters[[kernels.STATIC_SOFT, kernels.MOVING_SOFT]] *= ceiling.margins
    worlds = split_infos(infos, 3)
    assert np.allclose([ceiling.costs(i, worlds[i]) for i in (2, 0)], costs)


def test_rounds_go_on_where_they_were_stopped_and_end_with_the_same_weights(tmp_path):
    def run(folder, rounds):
        folder.mkdir(exist_ok=True)
        actor = student()
        imitate(
            actor,
            student,
            SMALL.model_copy(update={"rounds": rounds}),
            DRAWN,
            ["navigation"],
            5,
            folder,
            log=lambda numbers: None,
        )
        return torch.cat([p.detach().ravel() for p in actor.parameters()])

    whole = run(tmp_path / "whole", 2)
    folder = tmp_path / "stopped"
    run(folder, 2)
    (folder / "student_01.state").unlink()  # as if it had been killed while fitting the last round
    (folder / "student_01.pth").unlink()
    for part in folder.glob("round_01_01.*"):  # and one of its shards had not been written
        part.unlink()
    assert torch.equal(run(folder, 2), whole)


def test_a_loss_that_is_no_number_stops_the_fit(labels):
    actor = student()
    with torch.no_grad():
        actor.head.linear.bias[0] = float("nan")
    with pytest.raises(FloatingPointError, match="imitation loss is nan in batch 0"):
        fit(actor, torch.optim.AdamW(actor.parameters()), [labels], SMALL, streams.stream(0, "test"), 1)


def test_the_state_of_a_last_round_can_be_read_again(labels, tmp_path):
    # Its falling learning rate goes into the optimiser's state, which is read without running code.
    actor = student()
    optimizer = torch.optim.AdamW(actor.parameters(), lr=1e-3)
    fit(actor, optimizer, [labels], SMALL, streams.stream(0, "fit"), updates=2, rates=(1e-3, 1e-4))
    save_weights(tmp_path / "state.pth", optimizer.state_dict())
    assert load_weights(tmp_path / "state.pth")["param_groups"][0]["lr"] == pytest.approx(5.5e-4)


def test_two_halves_on_two_cores_descend_as_one_batch_does(labels):
    def weights_after(descend):
        actor = student()
        optimizer = torch.optim.SGD(actor.parameters(), lr=0.1)
        descend(actor, optimizer)
        return torch.cat([p.detach().ravel() for p in actor.parameters()])

    def halved(actor, optimizer):
        fit(actor, optimizer, [labels], SMALL, streams.stream(0, "fit"), updates=1)

    def whole(actor, optimizer):
        # The batch that `fit` draws, once more by hand: chosen rows, shuffled, the first half mirrored.
        rng = streams.stream(0, "fit")
        rows = np.sort(rng.integers(len(labels), size=SMALL.batch))[rng.permutation(SMALL.batch)]
        images, bands, costs = labels.images[rows], labels.bands[rows], labels.costs[rows]
        half = SMALL.batch // 2
        flipped = mirrored(images[:half], bands[:half], costs[:half], actor.head.grid_shape)
        images, bands, costs = (
            np.concatenate([a, b[half:]]) for a, b in zip(flipped, (images, bands, costs), strict=True)
        )
        log_probabilities = actor(Seen.of(*unpack(images, bands), False))
        imitation_loss(log_probabilities, torch.from_numpy(costs).float(), SMALL.temperature_m).backward()
        torch.nn.utils.clip_grad_norm_(actor.parameters(), 1.0)
        optimizer.step()

    assert torch.allclose(weights_after(halved), weights_after(whole), atol=1e-6)


def test_noise_has_the_wheel_for_its_share_of_the_steps_and_turns_on_the_spot_in_half_of_its_turns():
    commands = command_grid(Hardware()).reshape(-1, 2)
    noise, wanted = Noise(commands, 50, 0.1, np.random.default_rng(0)), np.full((50, 2), 0.123)
    steps = np.array([noise(wanted) for _ in range(4000)])
    taken = (steps != 0.123).any(axis=2)
    assert 0.08 < taken.mean() < 0.12
    turns = taken & (steps[..., 0] == 0.0) & ~np.isin(steps[..., 1], commands[:, 1])
    assert 0.5 < turns.sum() / taken.sum() < 0.8  # longer than the random commands
    assert np.abs(steps[..., 1]).max() <= commands[:, 1].max()
