# right
import numpy as np


def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    advantages = np.empty(rewards.shape)
    for t in range(len(rewards) - 1, -1, -1):
        for world in range(rewards.shape[1]):
            future = gamma * next_values[t, world] * (not terminated[t, world])
            advantages[t, world] = rewards[t, world] + future - values[t, world]
            if t + 1 < len(rewards) and not terminated[t, world] and not truncated[t, world]:
                advantages[t, world] += gamma * gae_lambda * advantages[t + 1, world]
    return advantages, values + advantages
