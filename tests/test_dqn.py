"""Deep Q-learning: its target by hand, its memory, its masks, and that it finds the best way where that is known."""

import gymnasium
import numpy as np
import pytest
import torch

from dualnav_lite.dqn import DQN, QNetwork, ReplayBuffer, explore, td_target, train_dqn


class Table(QNetwork):
    """A network whose values are given: one row a state, the state being the observation's first number."""

    def __init__(self, values, mask=None):
        super().__init__((1,), len(values[0]), mask, hidden=4)
        self.values = torch.tensor(values)

    def forward(self, observations):
        values = self.values[observations[:, 0].long()]
        return values if self._mask is None else values.masked_fill(~self._mask(observations), -torch.inf)


def test_the_target_is_chosen_by_one_network_and_valued_by_the_other():
    values = torch.tensor([[1.0, 5.0], [2.0, 1.0], [2.0, 1.0]])
    slow = torch.tensor([[10.0, 20.0], [30.0, 40.0], [30.0, 40.0]])
    wanted = td_target(values, slow, torch.ones(3), torch.tensor([False, False, True]), 0.5)
    # State 0: action 1 is best, worth 20. State 1: action 0 is best, worth 30 though 40 stands beside. Then the end.
    assert wanted.tolist() == [1.0 + 0.5 * 20.0, 1.0 + 0.5 * 30.0, 1.0]


def test_an_action_that_does_not_exist_is_neither_taken_nor_believed():
    def mask(observations):
        return torch.tensor([[True, False]]).expand(len(observations), 2)

    network = Table([[1.0, 9.0]], mask)
    state = np.zeros((50, 1), np.float32)
    assert set(network.best(state)) == {0}
    assert set(explore(network, state, 1.0, np.random.default_rng(0), mask)) == {0}
    values, slow = network(torch.zeros(1, 1)), Table([[3.0, 100.0]], mask)(torch.zeros(1, 1))
    assert td_target(values, slow, torch.zeros(1), torch.tensor([False]), 1.0).item() == 3.0


def test_epsilon_is_the_share_of_free_choices():
    network = Table([[0.0, 0.0, 1.0, 0.0]])
    state = np.zeros((20_000, 1), np.float32)
    taken = explore(network, state, 0.4, np.random.default_rng(0))
    assert (taken == 2).mean() == pytest.approx(0.6 + 0.4 / 4, abs=0.01)


def test_the_buffer_forgets_the_oldest_first():
    buffer = ReplayBuffer(5, (1,))
    for k in range(4):
        values = np.full((2, 1), k, np.float32)
        buffer.add(values, np.zeros(2), np.zeros(2), values + 0.5, np.zeros(2, bool))
    assert buffer.count == 5
    assert sorted(buffer.observations[:, 0]) == [1, 2, 2, 3, 3]
    observations, _, _, after, _ = buffer.draw(64, np.random.default_rng(0))
    assert torch.equal(after, observations + 0.5)


class Corridor(gymnasium.vector.VectorEnv):
    """Five cells; right ends after the last with +1, left ends before the first with +0.2, a step costs 0.01."""

    def __init__(self, num_envs):
        self.num_envs, self.single_action_space = num_envs, gymnasium.spaces.Discrete(2)
        self.at = np.zeros(num_envs, int)

    def observe(self):
        return np.eye(5, dtype=np.float32)[np.clip(self.at, 0, 4)]

    def reset(self, *, seed=None, options=None):
        self.at[:] = 1
        return self.observe(), {}

    def step(self, actions):
        self.at += 2 * np.asarray(actions) - 1
        terminated = (self.at < 0) | (self.at > 4)
        rewards = np.where(self.at > 4, 1.0, np.where(self.at < 0, 0.2, -0.01))
        infos = {"final_obs": np.array([row for row in self.observe()] + [None], dtype=object)[:-1]}
        self.at[terminated] = 1
        return self.observe(), rewards, terminated, np.zeros(self.num_envs, bool), infos


def test_it_learns_to_walk_past_the_small_reward_to_the_large_one():
    settings = DQN(learning_rate=3e-3, learning_starts=100, gamma=0.9, buffer=2_000, minibatch=32, target_rate=0.05)
    network = train_dqn(Corridor(4), settings, 2_400, seed=1, hidden=16)
    assert network.best(np.eye(5, dtype=np.float32)).tolist() == [1, 1, 1, 1, 1]
    worth = network(torch.eye(5)).max(dim=1).values.detach().numpy()
    by_hand = [1.0]  # from the last cell on, backwards: r + gamma V
    for _ in range(3):
        by_hand.insert(0, -0.01 + 0.9 * by_hand[0])
    assert worth[1:] == pytest.approx(by_hand, abs=0.06)
