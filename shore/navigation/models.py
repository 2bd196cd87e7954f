"""Motion and measurement models of the boat on the local plane (thesis section 4.2).

State, shape (..., n), n = 5: `[east_m, north_m, v_east_m_s, v_north_m_s, heading_rad]`, heading clockwise from true
north. Body axes: forward, starboard; yaw rate + bow to starboard. All functions take leading batch axes, so that one
filter and a batch of filters use the same code.

Letters: x state, P covariance of the state, Q covariance of the process noise over one step.
"""

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from common.angles import wrap_rad

Array = npt.NDArray[np.float64]
Number = float | Array
"""A scalar, or one value for each member of a batch."""

STATE_NAMES: Final = ("east_m", "north_m", "v_east_m_s", "v_north_m_s", "heading_rad")
STATE_SIZE: Final = len(STATE_NAMES)
EAST, NORTH, V_EAST, V_NORTH, HEADING = range(STATE_SIZE)

FREE_ACCEL_DENSITY: Final = math.sqrt(0.2)
"""m/s^2/sqrt(Hz): an axis without IMU moves at constant velocity disturbed by 0.2 m^2/s^3."""

FREE_TURN_DENSITY_DEG: Final = 5.0
"""deg/s/sqrt(Hz): without a yaw rate the heading is a random walk.

A small craft turns at 5 to 15 deg/s. At 5, a turn of 10 deg/s is two sigma for a 1 Hz compass, so the filter
follows it; a 1 deg, 10 Hz compass is still smoothed; after a minute without compass sigma is 39 deg, honestly lost.
"""


class ImuInput(NamedTuple):
    """What drives one step: mean body acceleration (m/s^2) and mean yaw rate (rad/s) over it; not measured = 0."""

    accel_fwd_m_s2: Number
    accel_stb_m_s2: Number
    yaw_rate_rad_s: Number


STILL: Final = ImuInput(0.0, 0.0, 0.0)


class ProcessNoise(NamedTuple):
    """White-noise densities of the inputs: m/s^2/sqrt(Hz) forward and starboard, rad/s/sqrt(Hz) about the vertical."""

    accel_fwd: Number
    accel_stb: Number
    yaw_rate: Number


FREE_NOISE: Final = ProcessNoise(FREE_ACCEL_DENSITY, FREE_ACCEL_DENSITY, math.radians(FREE_TURN_DENSITY_DEG))
"""Without an IMU: constant velocity, constant heading."""


def wrapped(angle_rad: float) -> float:
    """The same direction in (-pi, pi]; NaN for infinity, so that a filter's guard reports it without an exception."""
    return wrap_rad(angle_rad) if math.isfinite(angle_rad) else math.nan


def body_to_plane(fwd: Number, stb: Number, heading_rad: Number) -> tuple[Number, Number]:
    """Body vector (forward, starboard) -> (east, north).

    east = sin(psi) fwd + cos(psi) stb; north = cos(psi) fwd - sin(psi) stb. Eq. 4.28 with x = East and a clockwise
    heading (as printed it is for x = North).
    """
    sin, cos = np.sin(heading_rad), np.cos(heading_rad)
    return sin * fwd + cos * stb, cos * fwd - sin * stb


def move(x: Array, dt_s: float, imu: ImuInput) -> Array:
    """States (..., 5) after `dt_s`: Eqs 4.22-4.24 with T^2/2 and the acceleration resolved at the middle heading.

    The heading is not wrapped here: the spread of sigma points must survive the step.
    """
    turn = imu.yaw_rate_rad_s * dt_s
    a_east, a_north = body_to_plane(imu.accel_fwd_m_s2, imu.accel_stb_m_s2, x[..., HEADING] + 0.5 * turn)
    moved = np.empty_like(x)
    moved[..., EAST] = x[..., EAST] + dt_s * x[..., V_EAST] + (0.5 * dt_s * dt_s) * a_east
    moved[..., NORTH] = x[..., NORTH] + dt_s * x[..., V_NORTH] + (0.5 * dt_s * dt_s) * a_north
    moved[..., V_EAST] = x[..., V_EAST] + dt_s * a_east
    moved[..., V_NORTH] = x[..., V_NORTH] + dt_s * a_north
    moved[..., HEADING] = x[..., HEADING] + turn
    return moved


def transition(dt_s: float) -> Array:
    """F, shape (5, 5): the linear part of `move`, heading taken as known (Eq. 4.26)."""
    F = np.eye(STATE_SIZE)
    F[EAST, V_EAST] = F[NORTH, V_NORTH] = dt_s
    return F


def process_noise(heading_rad: Number, dt_s: float, noise: ProcessNoise) -> Array:
    """Q, shape (..., 5, 5), of a step of `dt_s` from white-noise densities.

    The noise is constant over the step with variance density^2 / dt: Q = G diag(density^2 / dt) G^T, G = [dt^2/2, dt]
    turned by the heading. At dt = 1 s and equal accelerations it is Eq. 4.29 with q squared; P grows alike at any rate.
    """
    fwd, stb = noise.accel_fwd**2 / dt_s, noise.accel_stb**2 / dt_s
    sin, cos = np.sin(heading_rad), np.cos(heading_rad)
    Q = np.zeros((*np.shape(heading_rad), STATE_SIZE, STATE_SIZE))
    entries = (
        (0, 0, sin * sin * fwd + cos * cos * stb),
        (1, 1, cos * cos * fwd + sin * sin * stb),
        (0, 1, sin * cos * (fwd - stb)),
        (1, 0, sin * cos * (fwd - stb)),
    )
    for row, column, variance in entries:
        Q[..., row, column] = 0.25 * dt_s**4 * variance
        Q[..., row, V_EAST + column] = Q[..., V_EAST + row, column] = 0.5 * dt_s**3 * variance
        Q[..., V_EAST + row, V_EAST + column] = dt_s**2 * variance
    Q[..., HEADING, HEADING] = noise.yaw_rate**2 * dt_s
    return Q
