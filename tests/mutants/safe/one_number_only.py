# hint: np.where
def safe(clearance):
    if clearance < 0.3:
        return -10.0 * (0.3 - max(0.0, clearance)) ** 2
    return 0.0
