# hint: from 0.3 m on nothing is missing
def safe(clearance):
    return -10.0 * (0.3 - clearance) ** 2
