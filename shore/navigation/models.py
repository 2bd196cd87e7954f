"""Motion and measurement models of the boat on the local plane (thesis section 4.2), with states beyond the thesis.

State, shape (..., n): `[east_m, north_m, v_east_m_s, v_north_m_s, heading_rad]`, heading clockwise from true north,
then the extra states of a `StateSpace`. Body axes: forward, starboard; yaw rate + bow to starboard. All functions take
leading batch axes, so that one filter and a batch of filters use the same code.

Letters: x state, P covariance of the state, F transition, Q covariance of the process noise over one step.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from shore.navigation.numbers import Array, Number, column, part

BASE_NAMES: Final = ("east_m", "north_m", "v_east_m_s", "v_north_m_s", "heading_rad")
EAST, NORTH, V_EAST, V_NORTH, HEADING = range(len(BASE_NAMES))

EXTRA_NAMES: Final = (
    "gyro_bias_rad_s",
    "accel_bias_fwd_m_s2",
    "accel_bias_stb_m_s2",
    "tilt_leak_per_m",
    "current_east_m_s",
    "current_north_m_s",
    "compass_bias_rad",
)
"""Biases are what the sensor shows too much; `tilt_leak_per_m` = c: the bow rises with speed, so the forward
accelerometer shows A tanh(c u |u| / A) of gravity too much, u = speed through the water along the bow, A = the most
that tilt can show; the current is where the water flows to."""

FREE_ACCEL_DENSITY: Final = math.sqrt(0.2)
"""m/s^2/sqrt(Hz): an axis without IMU moves at constant velocity disturbed by 0.2 m^2/s^3."""

LARGEST_TILT_ACCEL_M_S2: Final = 9.81 * math.sin(math.radians(15.0))
"""Gravity that the tilt of a hull can show: 15 deg. Without this end a wrong sign of c feeds on itself: the faster the
boat is thought to be, the harder it is thought to accelerate."""

TRIM_UNREST: Final = 0.5
"""sqrt(s): where the bow rises with speed, the forward axis is by this times (1-sigma of c) u^2 noisier. The bow does
not follow the speed at once: for half a second after each change of thrust the leak is wrong by about half of what is
expected of it, and half x sqrt(2 x 0.5 s) = 0.5."""

FREE_TURN_DENSITY_DEG: Final = 5.0
"""deg/s/sqrt(Hz): without a yaw rate the heading is a random walk.

A small craft turns at 5 to 15 deg/s. At 5, a turn of 10 deg/s is two sigma for a 1 Hz compass, so the filter
follows it; a 1 deg, 10 Hz compass is still smoothed; after a minute without compass sigma is 39 deg, honestly lost.
"""


class Extra(NamedTuple):
    """A state beyond the thesis' five."""

    name: str
    """One of `EXTRA_NAMES`."""
    sigma: float
    """1-sigma of its prior, whose mean is 0."""
    walk: float = 0.0
    """Density of its random walk, unit / sqrt(s)."""
    limit: float = math.inf
    """Its magnitude is kept within this."""


@dataclass(frozen=True)
class StateSpace:
    """Which states a filter has, in the order of `EXTRA_NAMES`; a prior sigma of 0 = known, no such state."""

    extras: tuple[Extra, ...] = ()
    names: tuple[str, ...] = field(init=False)
    """Of all states."""

    def __post_init__(self) -> None:
        unknown = [extra.name for extra in self.extras if extra.name not in EXTRA_NAMES]
        if unknown:
            raise ValueError(f"no such state: {', '.join(unknown)}")
        used = sorted((extra for extra in self.extras if extra.sigma > 0.0), key=lambda e: EXTRA_NAMES.index(e.name))
        object.__setattr__(self, "extras", tuple(used))
        object.__setattr__(self, "names", (*BASE_NAMES, *(extra.name for extra in used)))

    @property
    def size(self) -> int:
        """N."""
        return len(self.names)

    def index(self, name: str) -> int | None:
        """Place of a state, `None` when it is left out."""
        return self.names.index(name) if name in self.names else None

    @cached_property
    def places(self) -> tuple[int | None, ...]:
        """Places of all `EXTRA_NAMES`."""
        return tuple(self.index(name) for name in EXTRA_NAMES)

    @cached_property
    def walk_variances(self) -> Array:
        """Variance that each state's own random walk gains in a second, (n,)."""
        return np.array([0.0] * len(BASE_NAMES) + [extra.walk**2 for extra in self.extras])

    @cached_property
    def limits(self) -> tuple[tuple[int, float], ...]:
        """(place, magnitude) of the bounded states."""
        bounded = ((len(BASE_NAMES) + i, extra.limit) for i, extra in enumerate(self.extras))
        return tuple(item for item in bounded if math.isfinite(item[1]))


FIVE: Final = StateSpace()
"""The thesis' state."""


class Gaussian(NamedTuple):
    """What a filter believes."""

    space: StateSpace
    x: Array
    """Mean (..., n)."""
    P: Array
    """Covariance (..., n, n)."""


class ImuInput(NamedTuple):
    """What drives one step: mean body acceleration (m/s^2) and mean yaw rate (rad/s) over it; not measured = 0."""

    accel_fwd_m_s2: Number
    accel_stb_m_s2: Number
    yaw_rate_rad_s: Number


class ProcessNoise(NamedTuple):
    """White-noise densities of the inputs: m/s^2/sqrt(Hz) forward and starboard, rad/s/sqrt(Hz) about the vertical."""

    accel_fwd: Number
    accel_stb: Number
    yaw_rate: Number


FREE_NOISE: Final = ProcessNoise(FREE_ACCEL_DENSITY, FREE_ACCEL_DENSITY, math.radians(FREE_TURN_DENSITY_DEG))
"""Without an IMU: constant velocity, constant heading."""


def body_to_plane(fwd: Number, stb: Number, heading_rad: Number) -> tuple[Number, Number]:
    """Body vector (forward, starboard) -> (east, north).

    east = sin(psi) fwd + cos(psi) stb; north = cos(psi) fwd - sin(psi) stb. Eq. 4.28 with x = East and a clockwise
    heading (as printed it is for x = North).
    """
    sin, cos = np.sin(heading_rad), np.cos(heading_rad)
    return sin * fwd + cos * stb, cos * fwd - sin * stb


class _Drive(NamedTuple):
    """The input of a step with the biases of a state taken off, and what the Jacobian needs of it."""

    middle: Number
    """Heading at the middle of the step, rad."""
    turn: Number
    """Turn over the step, rad."""
    fwd: Number
    """m/s^2."""
    stb: Number
    along: Number
    """Speed through the water along the bow, m/s; 0 without tilt leak."""
    leak: Number
    """Gravity in the forward accelerometer, as a share of the most there can be."""


def _drive(space: StateSpace, x: Array, dt_s: float, imu: ImuInput) -> _Drive:
    """A = measured - bias - c u |u| (forward), w = measured - bias."""
    gyro, fwd_bias, stb_bias, leak = space.places[:4]
    fwd, stb, yaw_rate = imu
    if column_wise(x, yaw_rate):
        fwd, stb, yaw_rate = (column(value) for value in imu)
    if gyro is not None:
        yaw_rate = yaw_rate - x[..., gyro]
    turn = yaw_rate * dt_s
    middle = x[..., HEADING] + 0.5 * turn
    along: Number = 0.0
    share: Number = 0.0
    if leak is not None:
        along = _along(space, x, middle)
        share = np.tanh(x[..., leak] * along * np.abs(along) / LARGEST_TILT_ACCEL_M_S2)
        fwd = fwd - share * LARGEST_TILT_ACCEL_M_S2
    if fwd_bias is not None:
        fwd = fwd - x[..., fwd_bias]
    if stb_bias is not None:
        stb = stb - x[..., stb_bias]
    return _Drive(middle, turn, fwd, stb, along, share)


def _along(space: StateSpace, x: Array, heading_rad: Number) -> Number:
    """Speed through the water along the bow, m/s."""
    v_east, v_north = x[..., V_EAST], x[..., V_NORTH]
    current_east, current_north = space.places[4:6]
    if current_east is not None and current_north is not None:
        v_east, v_north = v_east - x[..., current_east], v_north - x[..., current_north]
    return v_east * np.sin(heading_rad) + v_north * np.cos(heading_rad)


def with_trim(state: Gaussian, noise: ProcessNoise) -> ProcessNoise:
    """The densities for a state: its tilt leak, if it has one, adds the unrest of the trim to the forward axis."""
    space, x, _ = state
    leak = space.places[3]
    if leak is None:
        return noise
    along = _along(space, x, part(x, HEADING))
    expected = space.extras[leak - len(BASE_NAMES)].sigma * along * along
    trim = TRIM_UNREST * LARGEST_TILT_ACCEL_M_S2 * np.tanh(expected / LARGEST_TILT_ACCEL_M_S2)
    return noise._replace(accel_fwd=np.hypot(noise.accel_fwd, trim))


def column_wise(x: Array, value: Number) -> bool:
    """True when `value` is one number per run and `x` holds several points of each run, (runs, points, n)."""
    return isinstance(value, np.ndarray) and value.ndim == x.ndim - 2


def move(space: StateSpace, x: Array, dt_s: float, imu: ImuInput | None) -> Array:
    """States (..., n) after `dt_s`: Eqs 4.22-4.24 with T^2/2 and the acceleration resolved at the middle heading.

    `None` = nothing measured: constant velocity and heading, whatever the biases. `imu` may hold one number for each
    run where x is (runs, n) or (runs, points, n). The heading is not wrapped: the spread of sigma points must survive.
    """
    moved = x.copy()
    moved[..., EAST] += dt_s * x[..., V_EAST]
    moved[..., NORTH] += dt_s * x[..., V_NORTH]
    if imu is None:
        return moved
    drive = _drive(space, x, dt_s, imu)
    a_east, a_north = body_to_plane(drive.fwd, drive.stb, drive.middle)
    half = 0.5 * dt_s * dt_s
    moved[..., EAST] += half * a_east
    moved[..., NORTH] += half * a_north
    moved[..., V_EAST] += dt_s * a_east
    moved[..., V_NORTH] += dt_s * a_north
    moved[..., HEADING] += drive.turn
    return moved


def jacobian(space: StateSpace, x: Array, dt_s: float, imu: ImuInput | None) -> Array:
    """F, shape (..., n, n): derivative of `move` at states (..., n)."""
    F = np.zeros((*x.shape, space.size))
    F[..., range(space.size), range(space.size)] = 1.0
    F[..., EAST, V_EAST] = F[..., NORTH, V_NORTH] = dt_s
    if imu is None:
        return F
    gyro, fwd_bias, stb_bias, leak, current_east, current_north, _ = space.places
    drive = _drive(space, x, dt_s, imu)
    sin: Number = np.sin(drive.middle)
    cos: Number = np.cos(drive.middle)
    a_east, a_north = sin * drive.fwd + cos * drive.stb, cos * drive.fwd - sin * drive.stb
    slope_east: dict[int, Any] = {HEADING: a_north}
    slope_north: dict[int, Any] = {HEADING: -a_east}
    if leak is not None:
        speed: Number = np.abs(drive.along)
        # d fwd: by the leak itself, by the velocity along the bow, by the heading that resolves it
        v_east, v_north = x[..., V_EAST], x[..., V_NORTH]
        slope = 1.0 - drive.leak * drive.leak
        terms: dict[int, Any] = {leak: -slope * drive.along * speed}
        by_speed = -2.0 * slope * x[..., leak] * speed
        terms[V_EAST], terms[V_NORTH] = by_speed * sin, by_speed * cos
        if current_east is not None and current_north is not None:
            terms[current_east], terms[current_north] = -terms[V_EAST], -terms[V_NORTH]
            v_east, v_north = v_east - x[..., current_east], v_north - x[..., current_north]
        terms[HEADING] = by_speed * (v_east * cos - v_north * sin)
        for place, term in terms.items():
            slope_east[place] = sin * term + slope_east.get(place, 0.0)
            slope_north[place] = cos * term + slope_north.get(place, 0.0)
    if gyro is not None:
        F[..., HEADING, gyro] = -dt_s
        slope_east[gyro] = -0.5 * dt_s * slope_east[HEADING]
        slope_north[gyro] = -0.5 * dt_s * slope_north[HEADING]
    if fwd_bias is not None:
        slope_east[fwd_bias], slope_north[fwd_bias] = -sin, -cos
    if stb_bias is not None:
        slope_east[stb_bias], slope_north[stb_bias] = -cos, sin
    for position, velocity, slopes in ((EAST, V_EAST, slope_east), (NORTH, V_NORTH, slope_north)):
        for place, steepness in slopes.items():
            F[..., position, place] += 0.5 * dt_s * dt_s * steepness
            F[..., velocity, place] += dt_s * steepness
    return F


def process_noise(space: StateSpace, heading_rad: Number, dt_s: float, noise: ProcessNoise) -> Array:
    """Q, shape (..., n, n), of a step of `dt_s` from white-noise densities.

    The noise is constant over the step with variance density^2 / dt: Q = G diag(density^2 / dt) G^T, G = [dt^2/2, dt]
    turned by the heading. At dt = 1 s and equal accelerations it is Eq. 4.29 with q squared; P grows alike at any rate.
    """
    fwd, stb = noise.accel_fwd**2 / dt_s, noise.accel_stb**2 / dt_s
    sin, cos = np.sin(heading_rad), np.cos(heading_rad)
    Q = np.zeros((*np.shape(heading_rad), space.size, space.size))
    across = sin * cos * (fwd - stb)
    entries = (
        (0, 0, sin * sin * fwd + cos * cos * stb),
        (1, 1, cos * cos * fwd + sin * sin * stb),
        (0, 1, across),
        (1, 0, across),
    )
    for row, place, variance in entries:
        Q[..., row, place] = 0.25 * dt_s**4 * variance
        Q[..., row, V_EAST + place] = Q[..., V_EAST + row, place] = 0.5 * dt_s**3 * variance
        Q[..., V_EAST + row, V_EAST + place] = dt_s**2 * variance
    Q[..., HEADING, HEADING] = noise.yaw_rate**2 * dt_s
    for place in range(len(BASE_NAMES), space.size):
        Q[..., place, place] = space.walk_variances[place] * dt_s
    return Q


def middle_heading(before: Array, after: Array) -> Number:
    """Heading at the middle of a step whose states have not been wrapped in between, rad."""
    return 0.5 * (part(before, HEADING) + part(after, HEADING))
