"""Wheel loop, motors and power of a differential drive, on 20 ms physics steps."""

import numpy as np
from numba import njit

# Columns of the wheel state.
REFERENCE_V, REFERENCE_OMEGA, LEFT, RIGHT, INTEGRAL_LEFT, INTEGRAL_RIGHT, ERROR_LEFT, ERROR_RIGHT = range(8)
WHEEL_STATE = 8

# Columns of the parameter row built by `robot.drive_parameters`.
(
    MAX_V,
    MAX_OMEGA,
    MAX_ACC,
    MAX_ANG_ACC,
    TRACK,
    LAG,
    KP,
    KI,
    KD,
    MASS,
    IDLE,
    LINEAR,
    QUADRATIC,
    TURN,
    TURN_QUADRATIC,
) = range(15)


@njit(cache=True)
def power(v, omega, acceleration, p):
    """Power drawn [W]: P = idle + a|v| + b v^2 + c|omega| + d omega^2 + mass max(0, v dv/dt) (SPEC 8)."""
    return (
        p[IDLE]
        + p[LINEAR] * abs(v)
        + p[QUADRATIC] * v * v
        + p[TURN] * abs(omega)
        + p[TURN_QUADRATIC] * omega * omega
        + p[MASS] * max(0.0, v * acceleration)
    )


@njit(cache=True)
def _clip(value, limit):
    return min(max(value, -limit), limit)


@njit(cache=True)
def drive(wheels, headings, commands, p, dt, substeps, displacement, energy, acceleration_square):
    """Motion of each robot over one control step, wheels turning freely.

    Each physics step: the reference follows the command within the acceleration limits, a PID loop a wheel with
    feed-forward asks the motor for a speed, the motor follows with a first-order lag.

    Args:
        wheels: (n, 8) wheel state, changed in place; columns as named above, wheel speeds at the rim [m/s].
        headings: (n,) [rad], world frame.
        commands: (n, 2) v [m/s], omega [rad/s], already inside the hardware limits.
        p: (15,) parameters, columns as named above.
        dt: physics step [s].
        substeps: physics steps in the control step.
        displacement: (n, 3) out: dx, dy [m] (world frame) and turn [rad] over the control step.
        energy: (n,) out: energy drawn [J].
        acceleration_square: (n,) out: mean of (dv/dt)^2 [m2/s4].
    """
    blend = 1.0 - np.exp(-dt / p[LAG]) if p[LAG] > 0.0 else 1.0
    for i in range(wheels.shape[0]):
        w = wheels[i]
        heading = headings[i]
        dx = dy = joules = square = turn = 0.0
        for _ in range(substeps):
            before = 0.5 * (w[LEFT] + w[RIGHT])
            w[REFERENCE_V] += _clip(commands[i, 0] - w[REFERENCE_V], p[MAX_ACC] * dt)
            w[REFERENCE_OMEGA] += _clip(commands[i, 1] - w[REFERENCE_OMEGA], p[MAX_ANG_ACC] * dt)
            for side in range(2):
                sign = -1.0 if side == 0 else 1.0
                target = w[REFERENCE_V] + sign * 0.5 * p[TRACK] * w[REFERENCE_OMEGA]
                error = target - w[LEFT + side]
                w[INTEGRAL_LEFT + side] = _clip(w[INTEGRAL_LEFT + side] + error * dt, 0.2)
                slope = (error - w[ERROR_LEFT + side]) / dt
                w[ERROR_LEFT + side] = error
                asked = target + p[KP] * error + p[KI] * w[INTEGRAL_LEFT + side] + p[KD] * slope
                w[LEFT + side] += blend * (asked - w[LEFT + side])
            v = _clip(0.5 * (w[LEFT] + w[RIGHT]), p[MAX_V])
            omega = _clip((w[RIGHT] - w[LEFT]) / p[TRACK], p[MAX_OMEGA])
            w[LEFT] = v - 0.5 * p[TRACK] * omega
            w[RIGHT] = v + 0.5 * p[TRACK] * omega
            middle = heading + turn + 0.5 * omega * dt
            dx += v * np.cos(middle) * dt
            dy += v * np.sin(middle) * dt
            turn += omega * dt
            acceleration = (v - before) / dt
            joules += power(v, omega, acceleration, p) * dt
            square += acceleration * acceleration
        displacement[i, 0] = dx
        displacement[i, 1] = dy
        displacement[i, 2] = turn
        energy[i] = joules
        acceleration_square[i] = square / substeps
