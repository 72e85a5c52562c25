# hint: accelerating costs
def power(v, omega, acceleration):
    return 5.0 + 8.0 * abs(v) + 20.0 * v**2 + 6.0 * abs(omega) + 4.0 * omega**2 + 0.0 * acceleration
