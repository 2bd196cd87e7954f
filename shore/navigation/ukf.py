"""The unscented prediction of the thesis (Eqs 4.44-4.53): alpha 1, kappa 0, beta 2, additive process noise.

Letters as in `kalman`. Sigma points are rows: numpy's Cholesky factor L is *lower* (P = L L^T), so offset i is column i
of L, that is row i of L^T. The measurement model is linear, so the update is `kalman.update_scalar`.
"""

import math
from typing import Final

import numpy as np

from shore.navigation.kalman import symmetric
from shore.navigation.models import HEADING, STATE_SIZE, Array, ImuInput, ProcessNoise, move, process_noise, wrapped

ALPHA: Final = 1.0
BETA: Final = 2.0
KAPPA: Final = 0.0
JITTERS: Final = (0.0, 1e-12, 1e-9, 1e-6)
"""Tried in turn, relative to each variance, until the Cholesky factor exists."""


def weights(n: int) -> tuple[Array, Array, float]:
    """Mean weights and covariance weights, each (2n+1,), and the spread sqrt(n + lambda) (Eqs 4.48-4.50)."""
    lam = ALPHA**2 * (n + KAPPA) - n
    mean_weights = np.full(2 * n + 1, 0.5 / (n + lam))
    cov_weights = mean_weights.copy()
    mean_weights[0] = lam / (n + lam)
    cov_weights[0] = mean_weights[0] + 1.0 - ALPHA**2 + BETA
    return mean_weights, cov_weights, math.sqrt(n + lam)


MEAN_WEIGHTS, COV_WEIGHTS, SPREAD = weights(STATE_SIZE)


def factor(P: Array) -> tuple[Array, int]:
    """Lower Cholesky factor of P and 0, or of P with its variances raised by the least jitter that works, and 1.

    Without any factor the result is NaN: the filter's guard reports it.
    """
    for jitter in JITTERS:
        try:
            raised = P if jitter == 0.0 else P + np.diag(jitter * np.abs(np.diag(P)) + 1e-15)
            return np.asarray(np.linalg.cholesky(raised), dtype=np.float64), int(jitter > 0.0)
        except np.linalg.LinAlgError:
            continue
    return np.full_like(P, math.nan), 1


def sigma_points(x: Array, L: Array) -> Array:
    """The 2n+1 points, one per row: x, x + spread L_i, x - spread L_i (Eqs 4.45-4.47)."""
    n = x.shape[0]
    offsets = SPREAD * L.T
    points = np.empty((2 * n + 1, n))
    points[0] = x
    np.add(x, offsets, out=points[1 : n + 1])
    np.subtract(x, offsets, out=points[n + 1 :])
    return points


def mean_of_points(points: Array) -> Array:
    """Weighted mean of the points (Eq. 4.52), circular for the heading, on the unwrapped branch of the first point."""
    mean: Array = MEAN_WEIGHTS @ points
    centre = points[0, HEADING]
    apart = points[:, HEADING] - centre
    mean[HEADING] = centre + math.atan2(MEAN_WEIGHTS @ np.sin(apart), MEAN_WEIGHTS @ np.cos(apart))
    return mean


def predict_unscented(x: Array, P: Array, dt_s: float, imu: ImuInput, noise: ProcessNoise) -> tuple[Array, Array, int]:
    """Return x and P after `dt_s`, and 1 if P had to be repaired before a Cholesky factor existed, else 0.

    Deviations are taken before the heading is wrapped: a spread beyond 180 deg is not folded into false certainty.
    """
    L, repairs = factor(P)
    points = move(sigma_points(x, L), dt_s, imu)
    mean = mean_of_points(points)
    apart = points - mean
    middle = 0.5 * (float(x[HEADING]) + float(mean[HEADING]))
    spread = symmetric((apart.T * COV_WEIGHTS) @ apart + process_noise(middle, dt_s, noise))
    mean[HEADING] = wrapped(float(mean[HEADING]))
    return mean, spread, repairs
