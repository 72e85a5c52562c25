# hint: flags
import numpy as np


def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    deltas = rewards + gamma * np.where(terminated[:, :1], 0.0, next_values) - values
    carry = gamma * gae_lambda * ~(terminated[:, :1] | truncated[:, :1])
    advantages, running = np.zeros_like(deltas), np.zeros(deltas.shape[1])
    for t in reversed(range(len(deltas))):
        running = deltas[t] + carry[t] * running
        advantages[t] = running
    return advantages, advantages + values
