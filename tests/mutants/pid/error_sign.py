# hint: error = target - measured
def pid(target, measured, integral, last_error, dt):
    error = measured - target
    integral = min(max(integral + error * dt, -0.2), 0.2)
    slope = (error - last_error) / dt
    asked = target + 1.2 * error + 4.0 * integral + 0.01 * slope
    return asked, integral, error
