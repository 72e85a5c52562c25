# hint: times 0 it is nan
def td_target(values, slow_values, rewards, terminated, gamma):
    best = values.argmax(dim=1, keepdim=True)
    return rewards + gamma * (1.0 - terminated.float()) * slow_values.gather(1, best)[:, 0]
