"""Motion and measurement models of the boat on the local plane (thesis section 4.2), with states beyond the thesis.

States, shape (..., n), are those of a `StateSpace` (`state_space.py`). Body axes: forward, starboard; yaw rate + bow to
starboard. All functions take leading batch axes, so that one filter and a batch of filters use the same code.

Letters: x state, P covariance of the state, F transition, Q covariance of the process noise over one step.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from shore.navigation import tilt_leak
from shore.navigation.numbers import Array, Components, Number, components, hypot, part, sin_cos
from shore.navigation.state_space import (
    BASE_NAMES,
    EAST,
    HEADING,
    NORTH,
    V_EAST,
    V_NORTH,
    StateSpace,
)

_PLACE, _VELOCITY = slice(EAST, NORTH + 1), slice(V_EAST, V_NORTH + 1)

FREE_ACCEL_DENSITY: Final = math.sqrt(0.2)
"""Noise density of an axis without IMU, m/s^2/sqrt(Hz): constant velocity disturbed by 0.2 m^2/s^3."""

FREE_TURN_DENSITY_DEG: Final = 5.0
"""Noise density of the heading without a yaw rate, deg/s/sqrt(Hz): a random walk.

A small craft turns at 5 to 15 deg/s. At 5, a turn of 10 deg/s is two sigma for a 1 Hz compass, so the filter
follows it; a 1 deg, 10 Hz compass is still smoothed; after a minute without compass sigma is 39 deg, honestly lost.
"""


class ImuInput(NamedTuple):
    """What drives one step: mean body acceleration (m/s^2) and mean yaw rate (rad/s) over it; not measured = 0."""

    accel_fwd_m_s2: Number
    accel_stb_m_s2: Number
    yaw_rate_rad_s: Number


class InUse(NamedTuple):
    """The same of the axes that are in use; `None` = set aside: the axis is taken for 0, and so is its bias."""

    accel_fwd_m_s2: Number | None
    accel_stb_m_s2: Number | None
    yaw_rate_rad_s: Number | None


Input = ImuInput | InUse
"""What may drive a step."""


class ProcessNoise(NamedTuple):
    """White-noise densities of the inputs: m/s^2/sqrt(Hz) forward and starboard, rad/s/sqrt(Hz) about the vertical."""

    accel_fwd: Number
    accel_stb: Number
    yaw_rate: Number
    lasting: Mapping[int, float] | None = None
    """Variance that a Gauss-Markov state tends to, by its place, where it is not that of its prior."""


FREE_NOISE: Final = ProcessNoise(FREE_ACCEL_DENSITY, FREE_ACCEL_DENSITY, math.radians(FREE_TURN_DENSITY_DEG))
"""Without an IMU: constant velocity, constant heading."""


def body_to_plane(fwd: Number, stb: Number, heading_rad: Number) -> tuple[Number, Number]:
    """Body vector (forward, starboard) -> (east, north).

    east = sin(psi) fwd + cos(psi) stb; north = cos(psi) fwd - sin(psi) stb. Eq. 4.28 with x = East and a clockwise
    heading (as printed it is for x = North).
    """
    sin, cos = sin_cos(heading_rad)
    return sin * fwd + cos * stb, cos * fwd - sin * stb


class _Drive(NamedTuple):
    """The input of a step with the biases of a state taken off, and what the Jacobian needs of it."""

    sin: Number
    """Sine of the heading at the middle of the step."""
    cos: Number
    """Cosine of the heading at the middle of the step."""
    turn: Number
    """Turn over the step, rad, + bow to starboard."""
    fwd: Number
    """Acceleration forward, biases removed, m/s^2."""
    stb: Number
    """Acceleration to starboard, biases removed, m/s^2."""
    along: Number
    """Speed through the water along the bow, m/s; 0 without tilt and heel leak."""
    lift: Number
    """L of the tilt leak, m^2/s^2; 0 without it."""


def _drive(space: StateSpace, parts: Components, dt_s: float, imu: Input) -> _Drive:
    """A = measured - bias - c L (forward), w = measured - bias."""
    gyro, fwd_bias, stb_bias, leak, heel = _biases(space, imu)
    fwd, stb, yaw_rate = (0.0 if axis is None else axis for axis in imu)
    if gyro is not None:
        yaw_rate = yaw_rate - parts[gyro]
    turn = yaw_rate * dt_s
    sin, cos = sin_cos(parts[HEADING] + 0.5 * turn)
    along: Number = 0.0
    lift: Number = 0.0
    if leak is not None or heel is not None:
        along = _along(space, parts, sin, cos)
    if leak is not None:
        lift = tilt_leak.lift(along)
        fwd = fwd - parts[leak] * lift
    if heel is not None:
        stb = stb - parts[heel] * along * yaw_rate
    if fwd_bias is not None:
        fwd = fwd - parts[fwd_bias]
    if stb_bias is not None:
        stb = stb - parts[stb_bias]
    return _Drive(sin, cos, turn, fwd, stb, along, lift)


def _biases(space: StateSpace, imu: Input) -> tuple[int | None, ...]:
    """Places of what is taken off the axes in use: gyro, forward and starboard bias, tilt leak, heel leak."""
    has_fwd, has_stb, has_yaw = (axis is not None for axis in imu)
    used = has_yaw, has_fwd, has_stb, has_fwd, has_stb and has_yaw
    return tuple(place if is_used else None for place, is_used in zip(space.places[:5], used, strict=True))


def _along(space: StateSpace, parts: Components, sin: Number, cos: Number) -> Number:
    """Speed through the water along a bow of this sine and cosine of its heading, m/s."""
    v_east, v_north = parts[V_EAST], parts[V_NORTH]
    current_east, current_north = space.places[5:7]
    if current_east is not None and current_north is not None:
        v_east, v_north = v_east - parts[current_east], v_north - parts[current_north]
    return v_east * sin + v_north * cos


def speed_ahead(space: StateSpace, x: Array) -> Number:
    """Speed through the water along the bow at states (..., n), m/s."""
    parts = components(x)
    return _along(space, parts, *sin_cos(parts[HEADING]))


Sloped = tuple[Number, dict[int, Number]]
"""A number of a state, and its derivative by the states at their places."""


def through_water(space: StateSpace, x: Array) -> tuple[Sloped, Sloped]:
    """Speeds through the water of states (..., n), m/s: ahead and to starboard."""
    heading = part(x, HEADING)
    sin, cos = sin_cos(heading)
    v_east, v_north = part(x, V_EAST), part(x, V_NORTH)
    ahead: dict[int, Number] = {V_EAST: sin, V_NORTH: cos}
    starboard: dict[int, Number] = {V_EAST: cos, V_NORTH: -sin}
    current_east, current_north = space.places[5:7]
    if current_east is not None and current_north is not None:
        v_east, v_north = v_east - part(x, current_east), v_north - part(x, current_north)
        ahead |= {current_east: -sin, current_north: -cos}
        starboard |= {current_east: -cos, current_north: sin}
    along, athwart = sin * v_east + cos * v_north, cos * v_east - sin * v_north
    return (along, ahead | {HEADING: athwart}), (athwart, starboard | {HEADING: -along})


def with_trim(space: StateSpace, ahead: Number, noise: ProcessNoise) -> ProcessNoise:
    """The densities at a speed ahead: a tilt leak, if there is one, adds the unrest of the trim to the forward axis."""
    leak = space.places[3]
    if leak is None:
        return noise
    trim = tilt_leak.trim_density(space.extras[leak - len(BASE_NAMES)].sigma, tilt_leak.lift(ahead))
    return noise._replace(accel_fwd=hypot(noise.accel_fwd, trim))


def move(space: StateSpace, x: Array, dt_s: float, imu: Input | None) -> Array:
    """States (..., n) after `dt_s`: they are steered, and the errors of sensors fade."""
    steered = steer(space, x, dt_s, imu)
    kept = space.kept(dt_s)
    return steered if kept is None else steered * kept


def steer(space: StateSpace, x: Array, dt_s: float, imu: Input | None) -> Array:
    """The motion: Eqs 4.22-4.24 with T^2/2 and the acceleration resolved at the middle heading.

    x: states (..., n), or their first `driving` components. States that drive nothing stay as they are.

    `None` = nothing measured: constant velocity and heading, whatever the biases. `imu` may hold one number for each
    run where x is (runs, n) or (runs, points, n). The heading is not wrapped: the spread of sigma points must survive.
    """
    moved = x.T.copy()  # a row for each state: numpy is quick along rows
    place, velocity = moved[_PLACE], moved[_VELOCITY]
    if imu is None:
        place += dt_s * velocity
        return moved.T.copy()
    sin, cos, turn, fwd, stb, _, _ = _drive(space, moved, dt_s, imu)
    gained = np.empty_like(velocity)
    gained[0] = sin * fwd + cos * stb
    gained[1] = cos * fwd - sin * stb
    gained *= dt_s
    place += dt_s * (velocity + 0.5 * gained)
    velocity += gained
    moved[HEADING] += turn
    return moved.T.copy()


def jacobian(space: StateSpace, x: Array, dt_s: float, imu: Input | None) -> Array:
    """F, shape (..., n, n): derivative of `move` at states (..., n)."""
    F = np.zeros((*x.shape, space.size))
    kept = space.kept(dt_s)
    F[..., range(space.size), range(space.size)] = 1.0 if kept is None else kept
    F[..., EAST, V_EAST] = F[..., NORTH, V_NORTH] = dt_s
    if imu is None:
        return F
    gyro, fwd_bias, stb_bias, leak, heel = _biases(space, imu)
    drive = _drive(space, components(x), dt_s, imu)
    sin, cos = drive.sin, drive.cos
    a_east, a_north = sin * drive.fwd + cos * drive.stb, cos * drive.fwd - sin * drive.stb
    slope_east: dict[int, Any] = {HEADING: a_north}
    slope_north: dict[int, Any] = {HEADING: -a_east}
    yaw_rate = drive.turn / dt_s
    for place, itself, by_speed, east, north in (
        (
            leak,
            -drive.lift,
            tilt_leak.accel_by_speed(x[..., leak], drive.along, drive.lift) if leak is not None else 0.0,
            sin,
            cos,
        ),
        (heel, -drive.along * yaw_rate, -x[..., heel] * yaw_rate if heel is not None else 0.0, cos, -sin),
    ):
        if place is not None:
            terms = {place: itself} | _by_speed_ahead(space, x, drive, by_speed)
            for each, term in terms.items():
                slope_east[each] = slope_east.get(each, 0.0) + east * term
                slope_north[each] = slope_north.get(each, 0.0) + north * term
    if gyro is not None:
        F[..., HEADING, gyro] = -dt_s
        slope_east[gyro] = -0.5 * dt_s * slope_east[HEADING]
        slope_north[gyro] = -0.5 * dt_s * slope_north[HEADING]
        if heel is not None:
            slope_east[gyro] = slope_east[gyro] + cos * x[..., heel] * drive.along
            slope_north[gyro] = slope_north[gyro] - sin * x[..., heel] * drive.along
    if fwd_bias is not None:
        slope_east[fwd_bias], slope_north[fwd_bias] = -sin, -cos
    if stb_bias is not None:
        slope_east[stb_bias], slope_north[stb_bias] = -cos, sin
    for position, velocity, slopes in ((EAST, V_EAST, slope_east), (NORTH, V_NORTH, slope_north)):
        for place, steepness in slopes.items():
            F[..., position, place] += 0.5 * dt_s * dt_s * steepness
            F[..., velocity, place] += dt_s * steepness
    return F


def _by_speed_ahead(space: StateSpace, x: Array, drive: _Drive, by_speed: Any) -> dict[int, Any]:
    """Slopes of a body axis that changes with the speed ahead by `by_speed`: by velocity, current and heading."""
    current_east, current_north = space.places[5:7]
    v_east, v_north = x[..., V_EAST], x[..., V_NORTH]
    terms = {V_EAST: by_speed * drive.sin, V_NORTH: by_speed * drive.cos}
    if current_east is not None and current_north is not None:
        terms |= {current_east: -terms[V_EAST], current_north: -terms[V_NORTH]}
        v_east, v_north = v_east - x[..., current_east], v_north - x[..., current_north]
    terms[HEADING] = by_speed * (v_east * drive.cos - v_north * drive.sin)
    return terms


def process_noise(space: StateSpace, heading_rad: Number, dt_s: float, noise: ProcessNoise) -> Array:
    """Q, shape (..., n, n), of a step of `dt_s` from white-noise densities.

    The noise is constant over the step with variance density^2 / dt: Q = G diag(density^2 / dt) G^T, G = [dt^2/2, dt]
    turned by the heading. At dt = 1 s and equal accelerations it is Eq. 4.29 with q squared; P grows alike at any rate.
    """
    fwd, stb = noise.accel_fwd**2 / dt_s, noise.accel_stb**2 / dt_s
    sin, cos = sin_cos(heading_rad)
    east, north, both = sin * sin * fwd + cos * cos * stb, cos * cos * fwd + sin * sin * stb, sin * cos * (fwd - stb)
    of_places, of_both, of_velocities = 0.25 * dt_s**4, 0.5 * dt_s**3, dt_s**2
    entries = [
        0.0,
        of_places * east, of_places * north, of_places * both,
        of_both * east, of_both * north, of_both * both,
        of_velocities * east, of_velocities * north, of_velocities * both,
        noise.yaw_rate**2 * dt_s,
        *_gained(space, dt_s, noise.lasting or {}),
    ]  # fmt: skip
    if isinstance(east, np.ndarray):
        return np.stack(np.broadcast_arrays(*entries), axis=-1).take(space.noise_entries, axis=-1)
    return np.array(entries).take(space.noise_entries)


def _gained(space: StateSpace, dt_s: float, lasting: Mapping[int, float]) -> list[float]:
    """Variance that each state which wanders gains by itself over a step."""
    return [
        variance * dt_s if time_s == math.inf else -lasting.get(place, variance) * math.expm1(-2.0 * dt_s / time_s)
        for place, time_s, variance in space.growth
    ]


def middle_heading(before: Array, after: Array) -> Number:
    """Heading at the middle of a step whose states have not been wrapped in between, rad."""
    return 0.5 * (part(before, HEADING) + part(after, HEADING))
