# hint: the target itself comes first
def pid(target, measured, integral, last_error, dt):
    error = target - measured
    integral = min(max(integral + error * dt, -0.2), 0.2)
    slope = (error - last_error) / dt
    asked = 1.2 * error + 4.0 * integral + 0.01 * slope
    return asked, integral, error
