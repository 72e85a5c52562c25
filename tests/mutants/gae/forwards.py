# hint: from the last to the first
import numpy as np


def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    deltas = rewards + gamma * np.where(terminated, 0.0, next_values) - values
    carry = gamma * gae_lambda * ~(terminated | truncated)
    advantages, running = np.zeros_like(deltas), np.zeros(deltas.shape[1])
    for t in range(len(deltas)):
        running = deltas[t] + carry[t] * running
        advantages[t] = running
    return advantages, advantages + values
