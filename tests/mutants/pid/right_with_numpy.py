# right
import numpy as np


def pid(target, measured, integral, last_error, dt):
    error = target - measured
    terms = np.array([error, np.clip(integral + dt * error, -0.2, 0.2), (error - last_error) / dt])
    return target + terms @ [1.2, 4.0, 0.01], terms[1], error
