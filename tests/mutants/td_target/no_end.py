# hint: home is the end
import torch


def td_target(values, slow_values, rewards, terminated, gamma):
    best = values.argmax(dim=1)
    return rewards + gamma * slow_values[torch.arange(len(best)), best]
