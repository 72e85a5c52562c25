# hint: before you use it
def pid(target, measured, integral, last_error, dt):
    error = target - measured
    before = integral
    integral = min(max(integral + error * dt, -0.2), 0.2)
    slope = (error - last_error) / dt
    asked = target + 1.2 * error + 4.0 * before + 0.01 * slope
    return asked, integral, error
