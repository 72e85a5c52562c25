# hint: not a sum
def value_loss(values, returns):
    return 0.5 * ((values - returns) ** 2).sum()
