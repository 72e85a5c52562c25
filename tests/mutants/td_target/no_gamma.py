# hint: what comes later is worth gamma of it
import torch


def td_target(values, slow_values, rewards, terminated, gamma):
    best = values.argmax(dim=1)
    following = slow_values[torch.arange(len(best)), best]
    return rewards + torch.where(terminated, torch.zeros_like(following), following)
