import numpy as np
import pytest
import torch

from dualnav_lite.command_reader import CommandReader
from dualnav_lite.config import Hardware, Observation
from dualnav_lite.encoder import BANDS, EGO, MOTION, STATIC, Ego, encode_states, read_bands
from dualnav_lite.planners.sampling import command_grid
from dualnav_lite.policy import Actor, CommandGridHead, Critic, GaussianHead, make_actor
from dualnav_lite.trunks import HIDDEN, ImageTrunk, Seen, joined, split_observations, trunk_for

GRID = command_grid(Hardware())


@pytest.fixture(autouse=True)
def _same_draws():
    torch.manual_seed(0)


def observations(n=3, channels=4, seed=0):
    rng = np.random.default_rng(seed)
    ego = Ego(
        rng.uniform(-1, 1, (n, 2)),
        rng.random(n),
        rng.uniform(-5, 5, (n, 2)),
        rng.uniform(-2, 2, (n, 2)),
        rng.random(n),
        rng.random(n),
    )
    scans = np.full((n, 3, 1080, 2), 2.0, np.float32)
    layout = Observation(intensity=channels == 4, motion={"method": "none"})
    return encode_states(scans, np.zeros((n, 3, 3)), rng.random((n, 64, 64)), ego, layout)


def test_network_reads_the_bands_exactly_as_the_encoder_does():
    batch = observations()
    images, bands = split_observations(torch.from_numpy(batch))
    assert bands.shape == (3, len(BANDS))
    assert np.array_equal(bands.numpy(), [read_bands(row) for row in batch])
    assert np.array_equal(images.numpy(), np.delete(batch, EGO, axis=1))


@pytest.mark.parametrize("grain", ["fine", "coarse"])
@pytest.mark.parametrize("channels", [3, 4])
def test_every_band_and_every_image_channel_reaches_the_action(channels, grain):
    actor = Actor(ImageTrunk(channels, grain), CommandGridHead(HIDDEN, GRID))
    batch = torch.from_numpy(observations(1, channels)).requires_grad_()
    (actor(batch) ** 2).sum().backward()
    images, bands = split_observations(batch.grad)
    assert (images.abs().amax(dim=(0, 2, 3)) > 0).all()
    assert (bands.abs() > 0).all()


@pytest.mark.parametrize("grain", ["fine", "coarse", "flat"])
def test_what_a_trunk_has_looked_at_once_gives_the_same_features_row_by_row(grain):
    actor = make_actor((4, 64, 64), "commands", [0.8, 1.2], grain)
    batch = torch.from_numpy(observations(8))
    seen = actor.trunk.look(batch)
    assert len(seen) == 8
    assert torch.equal(actor(seen), actor(batch))
    rows = torch.tensor([5, 0, 6])
    np.testing.assert_allclose(actor(seen[rows]).detach(), actor(batch[rows]).detach(), atol=1e-6)
    assert torch.equal(joined(seen.split(3)).images, seen.images)


def test_the_coarse_network_sees_means_of_four_cells():
    images = torch.rand(2, 3, 64, 64)
    seen = Seen.of(images, torch.zeros(2, 10), halve=True)
    assert seen.images.shape == (2, 32, 32, 3)
    assert float(seen.images[1, 4, 7, 2]) == pytest.approx(float(images[1, 2, 8:10, 14:16].mean()))


def test_memory_layout_changes_no_result():
    trunk = ImageTrunk(4)
    batch = torch.from_numpy(observations(8))
    last = trunk(batch.contiguous(memory_format=torch.channels_last))
    np.testing.assert_allclose(trunk(batch).detach(), last.detach(), atol=1e-5)


def test_each_reward_term_has_a_value_head_of_its_own():
    critic = Critic(trunk_for((4, 64, 64)), 5)
    values = critic(torch.from_numpy(observations()))
    assert values.shape == (3, 5)
    values[:, 2].sum().backward()
    rows = critic.heads.weight.grad.abs().sum(dim=1)
    assert [bool(row > 0) for row in rows] == [False, False, True, False, False]


def test_drawn_commands_come_as_often_as_their_probabilities_say():
    head = CommandGridHead(HIDDEN, GRID)
    probabilities = torch.softmax(torch.randn(1, 99), dim=1)
    actions, log_probs = head.sample(probabilities.log().expand(200_000, 99), torch.Generator().manual_seed(1))
    shares = torch.bincount(actions, minlength=99) / len(actions)
    assert (shares - probabilities[0]).abs().max() < 0.003
    assert torch.equal(log_probs, probabilities.log()[0, actions])


def test_grid_actions_are_the_physical_commands_of_the_grid():
    head = CommandGridHead(HIDDEN, GRID)
    assert np.allclose(head.physical(torch.arange(99)).numpy(), GRID.reshape(-1, 2))


@pytest.mark.parametrize(
    ("head", "parameters", "twin"),
    [
        (
            CommandGridHead(8, GRID),
            torch.log_softmax(torch.randn(2, 6, 99, generator=torch.Generator().manual_seed(3)), dim=2),
            lambda p: torch.distributions.Categorical(logits=p),
        ),
        (
            GaussianHead(8, [-1.0, -2.0], [1.0, 2.0]),
            torch.randn(2, 6, 4, generator=torch.Generator().manual_seed(4)),
            lambda p: torch.distributions.Independent(
                torch.distributions.Normal(p[:, :2], p[:, 2:].exp()), reinterpreted_batch_ndims=1
            ),
        ),
    ],
)
def test_log_probability_entropy_and_divergence_agree_with_torch(head, parameters, twin):
    old, new = parameters
    actions, log_probs = head.sample(old, torch.Generator().manual_seed(2))
    torch.testing.assert_close(log_probs, twin(old).log_prob(actions))
    judged, entropies = head.judge(new, actions)
    torch.testing.assert_close(judged, twin(new).log_prob(actions))
    torch.testing.assert_close(entropies, twin(new).entropy())
    torch.testing.assert_close(head.divergence(old, new), torch.distributions.kl_divergence(twin(old), twin(new)))


def test_gaussian_actions_are_scaled_to_the_space_not_clipped_into_it():
    head = GaussianHead(8, [-0.8, -1.2], [0.8, 1.2])
    assert np.allclose(head.physical(torch.tensor([[1.0, 1.0], [-0.5, 0.0]])), [[0.8, 1.2], [-0.4, 0.0]])


def test_unfit_observation_shapes_are_refused():
    with pytest.raises(ValueError, match="observations must be"):
        trunk_for((5, 64, 64))


def peaks(*points):
    """A distribution with its mass on some points (row, column) of the grid."""
    votes = np.zeros((9, 11))
    for (row, column), mass in points:
        votes[row, column] = mass
    return votes.reshape(1, -1)


def test_two_ways_round_are_never_averaged_into_the_middle():
    reader = CommandReader(GRID, memory=0.0)
    command = reader(peaks(((6, 1), 0.49), ((6, 9), 0.51)))[0]
    assert np.allclose(command, GRID[6, 9])


def test_neighbours_of_the_peak_pull_the_command_off_the_grid():
    command = CommandReader(GRID, memory=0.0)(peaks(((6, 5), 0.6), ((6, 6), 0.4)))[0]
    assert np.allclose(command, 0.6 * GRID[6, 5] + 0.4 * GRID[6, 6])


def test_commands_stay_inside_the_grid_at_its_corners():
    for corner in ((0, 0), (8, 10)):
        assert np.allclose(CommandReader(GRID, memory=0.0)(peaks((corner, 1.0)))[0], GRID[corner])


def test_one_odd_step_does_not_turn_the_robot_around_but_two_do():
    reader = CommandReader(GRID, memory=0.6)
    left, right = peaks(((6, 9), 1.0)), peaks(((6, 1), 1.0))
    reader(left)
    assert reader(right)[0, 1] > 0
    assert reader(right)[0, 1] < 0


def test_a_reset_world_forgets_and_its_neighbour_does_not():
    reader = CommandReader(GRID, memory=0.6)
    left, right = (np.repeat(peaks((point, 1.0)), 2, axis=0) for point in ((6, 9), (6, 1)))
    reader(left)
    reader.reset([1])
    commands = reader(right)
    assert commands[0, 1] > 0 > commands[1, 1]


def test_a_flat_observation_is_read_as_three_scans_and_the_bands():
    rng = np.random.default_rng(0)
    scans = rng.uniform(0.1, 10.0, (2, 3, 1080, 2)).astype(np.float32)
    ego = Ego(np.zeros((2, 2)), np.ones(2), np.ones((2, 2)), np.ones((2, 2)), np.zeros(2), np.zeros(2))
    layout = Observation(layout="flat", intensity=False)
    batch = encode_states(scans, np.zeros((2, 3, 3)), np.ones((2, 64, 64)), ego, layout)
    assert np.allclose(batch[:, STATIC].reshape(2, -1)[:, :3240], scans[..., 0].reshape(2, -1) / 10.0)
    assert not batch[:, MOTION].any()
    trunk = trunk_for(batch.shape[1:], "flat")
    state = torch.from_numpy(batch).requires_grad_()
    (trunk(state) ** 2).sum().backward()
    images, bands = split_observations(state.grad)
    seen = images[:, STATIC].flatten(1)[:, :3240].abs().amax(dim=0) > 0
    assert seen.float().mean() > 0.99
    assert (bands.abs().amax(dim=0) > 0).all()
