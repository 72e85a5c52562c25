# hint: braking gives nothing back
def power(v, omega, acceleration):
    return 5.0 + 8.0 * abs(v) + 20.0 * v**2 + 6.0 * abs(omega) + 4.0 * omega**2 + 15.0 * v * acceleration
