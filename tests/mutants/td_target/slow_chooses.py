# hint: the slow network chose as well
import torch


def td_target(values, slow_values, rewards, terminated, gamma):
    following = slow_values.max(dim=1).values
    return rewards + gamma * torch.where(terminated, torch.zeros_like(following), following)
