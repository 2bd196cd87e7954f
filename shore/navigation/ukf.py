"""Unscented transform of the thesis' prediction (Eqs 4.44-4.53): alpha 1, kappa 0, beta 2, additive process noise.

Letters as in `kalman`. Sigma points are rows: numpy's Cholesky factor L is *lower* (P = L L^T), so offset i is column i
of L, that is row i of L^T. The measurement model is linear, so the update is `kalman.update_scalar`.
"""

import math
from functools import cache
from typing import Final

import numpy as np

from shore.navigation.kalman import Predicted, symmetric, wrap_heading
from shore.navigation.motion_model import Input, ProcessNoise, middle_heading, process_noise, steer
from shore.navigation.numbers import Array, product
from shore.navigation.state_space import Gaussian

ALPHA: Final = 1.0
BETA: Final = 2.0
KAPPA: Final = 0.0
JITTERS: Final = (0.0, 1e-12, 1e-9, 1e-6)
"""Tried in turn, relative to each variance, until the Cholesky factor exists."""


@cache
def weights(n: int) -> tuple[Array, Array, float]:
    """Mean weights and covariance weights, each (2n+1,), and the spread sqrt(n + lambda) (Eqs 4.48-4.50)."""
    lam = ALPHA**2 * (n + KAPPA) - n
    mean_weights = np.full(2 * n + 1, 0.5 / (n + lam))
    cov_weights = mean_weights.copy()
    mean_weights[0] = lam / (n + lam)
    cov_weights[0] = mean_weights[0] + 1.0 - ALPHA**2 + BETA
    return mean_weights, cov_weights, math.sqrt(n + lam)


@cache
def _directions(n: int) -> Array:
    """Directions of the sigma points from the mean in steps of the factor's columns, (2n+1, n)."""
    spread = weights(n)[2]
    return np.vstack((np.zeros(n), spread * np.eye(n), -spread * np.eye(n)))


def factor(P: Array) -> tuple[Array, int]:
    """Lower Cholesky factor of P and 0, or of P with its variances raised by the least jitter that works, and 1.

    Of a batch only the members that need it are raised, and counted. Without any factor the result is NaN: the filter's
    guard reports it.
    """
    try:
        return np.asarray(np.linalg.cholesky(P), dtype=np.float64), 0
    except np.linalg.LinAlgError:
        if P.ndim == 2:
            return _repaired(P), 1
    factors = [factor(member) for member in P]
    return np.stack([L for L, _ in factors]), sum(repairs for _, repairs in factors)


def _repaired(P: Array) -> Array:
    for jitter in JITTERS[1:]:
        try:
            raised = P + np.diag(jitter * np.abs(np.diag(P)) + 1e-15)
            return np.asarray(np.linalg.cholesky(raised), dtype=np.float64)
        except np.linalg.LinAlgError:
            continue
    return np.full_like(P, math.nan)


def sigma_points(x: Array, L: Array) -> Array:
    """The 2n+1 points, shape (..., 2n+1, n), one per row: x, x + spread L_i, x - spread L_i (Eqs 4.45-4.47)."""
    points: Array = x[..., np.newaxis, :] + product(_directions(x.shape[-1]), L.swapaxes(-1, -2))
    return points


def predict_unscented(before: Gaussian, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
    """The unscented transform of `move`; `repairs` counts factors of P that needed jitter.

    Mean and deviations (Eqs 4.52, 4.53) are taken before the heading is wrapped, on one branch that the points share:
    a spread beyond 180 deg is not folded into false certainty. Points are needed in the `driving` states alone: of a
    lower factor of the whole P, the other columns move states that only fade, which is exact without points.
    """
    space, x, P = before
    n, m = space.size, space.driving
    mean_weights, cov_weights, spread = weights(m)
    L, repairs = factor(P)
    points = steer(space, sigma_points(x[..., :m], L[..., :m, :m]), dt_s, imu)
    mean = product(mean_weights, points)
    apart = points - mean[..., np.newaxis, :]
    scatter = product(apart.swapaxes(-1, -2) * cov_weights, apart)
    weight = spread * float(cov_weights[1])

    def followed() -> Array:
        """Covariance of the states before, (..., n), with the driving states after, (..., m)."""
        both: Array = L[..., :m] @ (apart[..., 1 : m + 1, :] - apart[..., m + 1 :, :])
        return weight * both

    if m == n:
        Q = process_noise(space, middle_heading(x, mean), dt_s, noise)
        return Predicted(wrap_heading(mean), symmetric(scatter + Q), followed, repairs)
    shares = space.kept(dt_s)
    kept = np.ones(n) if shares is None else shares
    whole = np.concatenate((mean, x[..., m:] * kept[m:]), axis=-1)
    spreads = P * (kept[:, np.newaxis] * kept)
    spreads[..., :m, :m] = scatter
    aside = followed()
    spreads[..., m:, :m] = kept[m:, np.newaxis] * aside[..., m:, :]
    spreads[..., :m, m:] = spreads[..., m:, :m].swapaxes(-1, -2)
    Q = process_noise(space, middle_heading(x, whole), dt_s, noise)

    def cross() -> Array:
        return np.concatenate((aside, P[..., m:] * kept[m:]), axis=-1)

    return Predicted(wrap_heading(whole), symmetric(spreads + Q), cross, repairs)
