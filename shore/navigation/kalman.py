"""The linear Kalman filter of the thesis: prediction (Eqs 4.12-4.13) and update by one scalar at a time (4.14-4.17).

Letters: x state (n,), P its covariance (n, n), F transition (n, n), Q process noise of the step (n, n), R variance of
one measured number, K gain (n,). All functions return new arrays and leave their inputs alone.
"""

from shore.navigation.models import (
    HEADING,
    Array,
    ImuInput,
    ProcessNoise,
    move,
    process_noise,
    transition,
    wrapped,
)


def symmetric(P: Array) -> Array:
    """P without the asymmetry that rounding leaves; shape (..., n, n)."""
    return 0.5 * (P + P.swapaxes(-1, -2))


def predict_linear(x: Array, P: Array, dt_s: float, imu: ImuInput, noise: ProcessNoise) -> tuple[Array, Array, int]:
    """Return x and P after `dt_s`; the acceleration is rotated by the estimate's heading, taken as exact (Eq. 4.26).

    The third value is the number of repairs of P, always 0 here (see `predict_unscented`).
    """
    F = transition(dt_s)
    moved = move(x, dt_s, imu)
    middle = 0.5 * (float(x[HEADING]) + float(moved[HEADING]))
    moved[HEADING] = wrapped(float(moved[HEADING]))
    return moved, symmetric(F @ P @ F.T + process_noise(middle, dt_s, noise)), 0


def update_scalar(x: Array, P: Array, index: int, innovation: float, R: float) -> tuple[Array, Array]:
    """Return x and P after measuring state `index` with variance `R`.

    `innovation` = measured - x[index], wrapped if an angle.

    Joseph's form (I - K h) P (I - K h)^T + K R K^T, h = unit vector: stays positive definite for any R > 0.
    """
    K = P[:, index] / (P[index, index] + R)
    left = P - K[:, None] * P[index]
    updated = left - left[:, index, None] * K + (R * K)[:, None] * K
    x = x + K * innovation
    x[HEADING] = wrapped(float(x[HEADING]))
    return x, symmetric(updated)
