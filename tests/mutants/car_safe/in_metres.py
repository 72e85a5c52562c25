# hint: the shortfall is a share
def car_safe(clearance, time_gap, safe_m):
    return -0.9 * max(0.0, safe_m - clearance, 1.5 - time_gap) ** 2
