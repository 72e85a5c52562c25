# right
def goal(before, after, reached, gamma):
    return 10.0 * (before - gamma * after * (1 - reached))
