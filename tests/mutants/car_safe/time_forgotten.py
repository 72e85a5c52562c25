# hint: the time gap counts as well
def car_safe(clearance, time_gap, safe_m):
    return -0.9 * max(0.0, 1.0 - clearance / safe_m) ** 2
