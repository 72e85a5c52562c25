# right
import torch


def policy_loss(log_probs, old_log_probs, advantages, clip_range):
    ratio = (log_probs - old_log_probs).exp()
    bound = torch.where(advantages > 0, 1.0 + clip_range, 1.0 - clip_range)
    gain = torch.where(advantages > 0, torch.minimum(ratio, bound), torch.maximum(ratio, bound)) * advantages
    return -gain.sum() / len(gain)
