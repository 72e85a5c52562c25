# right
def value_loss(values, returns):
    return (returns - values).square().sum() / (2 * len(values))
