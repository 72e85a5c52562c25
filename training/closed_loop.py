"""The article's closed loop (3.2), mended: five values a step, `break` at the end, updates that happen.

Run from the repository: python training/closed_loop.py [episodes]
"""

import sys

import numpy as np

from dualnav_lite.agent import PPOAgent
from dualnav_lite.env import DynamicNavEnv
from dualnav_lite.rewards import TERMS

env = DynamicNavEnv(scenario="navigation")
agent = PPOAgent(
    state_dim=env.observation_space.shape,
    action_dim=2,
    lr_actor=0.0003,
    lr_critic=0.001,
    gamma=0.99,
    K_epochs=10,
    eps_clip=0.15,
    terms=len(TERMS),
)
episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
for episode in range(episodes):
    state, info = env.reset(seed=episode)
    for t in range(500):
        action, log_prob = agent.select_action(state)
        next_state, reward, terminated, truncated, info = env.step(action)
        truncated = truncated or (t == 499 and not terminated)
        terms = info["vector_reward"] * info["reward_weights"]
        agent.buffer.push(state, action, log_prob, terms, terminated, truncated, next_state)
        state = next_state
        if len(agent.buffer) >= 512:
            numbers = agent.update()
        if terminated or truncated:
            break
    if episode % 100 == 99 or episode == episodes - 1:
        safe_dist = np.mean(env.episode_safe_dists[-100:])
        energy = np.mean(env.episode_energy_costs[-100:])
        print(f"Ep {episode + 1}: SafeDist={safe_dist:.2f}m | Energy={energy:.2f}J")
