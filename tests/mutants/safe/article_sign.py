# hint: the sign of the article's 2.3
def safe(clearance):
    return -10.0 * clearance
