# right
import torch


def gae(rewards, values, next_values, terminated, truncated, gamma=0.99, gae_lambda=0.95):
    rewards, values, next_values = (torch.as_tensor(one, dtype=torch.float32) for one in (rewards, values, next_values))
    goes_on, lives = (1.0 - torch.as_tensor(one, dtype=torch.float32) for one in (terminated | truncated, terminated))
    errors = rewards + gamma * lives * next_values - values
    advantages, last = torch.zeros_like(rewards), torch.zeros(rewards.shape[1])
    for t in range(len(rewards) - 1, -1, -1):
        last = errors[t] + gamma * gae_lambda * goes_on[t] * last
        advantages[t] = last
    return advantages.numpy(), (advantages + values).numpy()
