# right
def ticks_to_answer(driven, twin, seen):
    for step in range(seen, len(driven)):
        (v, omega), (twin_v, twin_omega) = driven[step], twin[step]
        if abs(v - twin_v) > 0.05 or abs(omega - twin_omega) > 0.1:
            return step - seen + 1.0
    return float("nan")
