# hint: gamma belongs before Phi(s')
def goal(before, after, reached, gamma):
    return 10.0 * (before - after)
