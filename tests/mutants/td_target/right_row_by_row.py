# right
import torch


def td_target(values, slow_values, rewards, terminated, gamma):
    targets = []
    for row, slow, reward, ended in zip(values, slow_values, rewards, terminated, strict=True):
        targets.append(reward if ended else reward + gamma * slow[int(row.argmax())])
    return torch.stack(targets)
