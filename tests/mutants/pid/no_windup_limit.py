# hint: it winds up
def pid(target, measured, integral, last_error, dt):
    error = target - measured
    integral = integral + error * dt
    slope = (error - last_error) / dt
    asked = target + 1.2 * error + 4.0 * integral + 0.01 * slope
    return asked, integral, error
