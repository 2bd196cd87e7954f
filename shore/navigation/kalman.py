"""Kalman filters: linear and extended prediction, and the update by one scalar at a time that all filters share.

Letters: x state (..., n), P its covariance (..., n, n), F transition, Q process noise of the step, R variance of one
measured number, h its observation row, K gain. All functions return new arrays and leave their inputs alone.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from shore.navigation.motion_model import Input, ProcessNoise, jacobian, middle_heading, move, process_noise
from shore.navigation.numbers import Array, Number, clip, column, part, square, wrapped
from shore.navigation.state_space import HEADING, V_NORTH, Gaussian

Row = tuple[tuple[int, Number], ...]
"""An observation row h as (place, weight) pairs; all other weights are 0."""


class Predicted(NamedTuple):
    """The state after a step."""

    x: Array
    """Mean of the state after the step, (..., n)."""
    P: Array
    """Covariance of the state after the step, (..., n, n)."""
    covary: Callable[[], Array]
    """Calculates `cross`, which only the smoother needs."""
    repairs: int = 0
    """Number of factors of P that needed jitter."""

    @property
    def cross(self) -> Array:
        """Covariance between the state before and the state after, (..., n, n)."""
        return self.covary()


def symmetric(P: Array) -> Array:
    """P without the asymmetry that rounding leaves; shape (..., n, n)."""
    return 0.5 * (P + P.swapaxes(-1, -2))


def predict_linear(before: Gaussian, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
    """The thesis' Kalman filter, Eqs 4.12-4.13: the heading that rotates the acceleration is taken as exact."""
    space = before.space
    F = jacobian(space, before.x, dt_s, imu)
    F[..., : V_NORTH + 1, HEADING] = 0.0
    if (gyro := space.index("gyro_bias_rad_s")) is not None:
        F[..., : V_NORTH + 1, gyro] = 0.0
    return _predicted(before, F, dt_s, imu, noise)


def predict_extended(before: Gaussian, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
    """The extended Kalman filter: F is the derivative of the motion model at the estimate."""
    return _predicted(before, jacobian(before.space, before.x, dt_s, imu), dt_s, imu, noise)


def _predicted(before: Gaussian, F: Array, dt_s: float, imu: Input | None, noise: ProcessNoise) -> Predicted:
    space, x, P = before
    moved = move(space, x, dt_s, imu)
    Q = process_noise(space, middle_heading(x, moved), dt_s, noise)
    cross = P @ F.swapaxes(-1, -2)
    return Predicted(wrap_heading(moved), symmetric(F @ cross + Q), lambda: cross)


def wrap_heading(x: Array) -> Array:
    """The state with its heading in (-pi, pi]; changes `x`, which must be new."""
    x[..., HEADING] = wrapped(part(x, HEADING))
    return x


def times_row(matrix: Array, row: Row) -> Array:
    """Matrix times h^T: (..., n, n) -> (..., n)."""
    product = _weighted(matrix, row[0])
    for entry in row[1:]:
        product = product + _weighted(matrix, entry)
    return product


def _weighted(matrix: Array, entry: tuple[int, Number]) -> Array:
    place, weight = entry
    is_one = isinstance(weight, float) and weight == 1.0
    return matrix[..., place] if is_one else column(weight) * matrix[..., place]


def prior_variance(P: Array, row: Row) -> Number:
    """Variance h P h^T of the measured number before it is measured."""
    return _along_row(times_row(P, row), row)


def _along_row(Ph: Array, row: Row) -> Number:
    """H times P h^T."""
    total: Number = 0.0
    for place, weight in row:
        total = total + weight * part(Ph, place)
    return total


def update_scalar(
    before: Gaussian,
    row: Row,
    innovation: Number,
    R: Number,
    spread: Number = 0.0,
    *,
    considered: Sequence[int] = (),
) -> tuple[Array, Array]:
    """Return x and P after measuring the number h x with variance `R`.

    `innovation` = measured - h x, wrapped if an angle. Joseph's form (I - K h) P (I - K h)^T + K R K^T (Eqs 4.14-4.17):
    stays positive definite for any R > 0. `spread` adds spread (P h)(P h)^T: the scatter of a bank's gains about their
    mean. `considered`: places of states whose doubt counts and which are not estimated (S. F. Schmidt, 1966): their
    gain is 0, and Joseph's form holds for any gain.
    """
    space, x, P = before
    Ph = times_row(P, row)
    K = Ph / column(_along_row(Ph, row) + R)
    for place in considered:
        K[..., place] = 0.0
    left = P - K[..., :, np.newaxis] * Ph[..., np.newaxis, :]
    gained = column(R) * K - times_row(left, row)
    updated = left + gained[..., :, np.newaxis] * K[..., np.newaxis, :]
    if isinstance(spread, np.ndarray) or spread > 0.0:
        updated = updated + square(spread) * (Ph[..., :, np.newaxis] * Ph[..., np.newaxis, :])
    x = wrap_heading(x + K * column(innovation))
    for place, limit in space.limits:
        x[..., place] = clip(part(x, place), -limit, limit)
    return x, symmetric(updated)
