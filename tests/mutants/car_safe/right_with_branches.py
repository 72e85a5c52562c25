# right
def car_safe(clearance, time_gap, safe_m):
    missing = 0.0
    if clearance < safe_m:
        missing = (safe_m - clearance) / safe_m
    if time_gap < 1.5 and (1.5 - time_gap) / 1.5 > missing:
        missing = (1.5 - time_gap) / 1.5
    return -0.9 * missing * missing
