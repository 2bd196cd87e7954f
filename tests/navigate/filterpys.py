"""filterpy's UKF on our models, for tests and benchmarks: another implementation of the same filter."""

import math
from functools import partial
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from common.angles import wrap_rad
from shore.navigation.motion_model import move
from shore.navigation.numbers import Array
from shore.navigation.state_space import FIVE


def filterpy_ukf(x: Array, P: Array, R: Array) -> Any:
    """Begins at x (5,), P (5, 5) and measures east, north and heading with R (3, 3); our angle arithmetic injected."""

    def residual(a: Array, b: Array) -> Array:
        apart = a - b
        apart[-1] = wrap_rad(apart[-1])
        return apart

    def mean(points: Array, weights: Array) -> Array:
        result = weights @ points
        result[-1] = math.atan2(weights @ np.sin(points[:, -1]), weights @ np.cos(points[:, -1]))
        return result

    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)
    theirs = UnscentedKalmanFilter(
        5, 3, 1.0, hx=lambda state: state[[0, 1, 4]], fx=partial(move, FIVE), points=points,
        x_mean_fn=mean, z_mean_fn=mean, residual_x=residual, residual_z=residual,
    )  # fmt: skip
    theirs.x, theirs.P, theirs.R = x.copy(), P.copy(), R
    return theirs
