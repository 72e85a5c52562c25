# hint: Phi is minus the way
def goal(before, after, reached, gamma):
    return gamma * 10.0 * after - 10.0 * before
