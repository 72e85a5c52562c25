# hint: Phi is 0 at arrival
def goal(before, after, reached, gamma):
    return 10.0 * before - gamma * 10.0 * after
