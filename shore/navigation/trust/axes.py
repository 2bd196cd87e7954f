"""Trust in an accelerometer axis (adaptive process noise): how much of the change of velocity it explains.

Over 1 and 4 s the change of the receiver's velocity, less what the accelerometers say of it, is what they do not
explain. Its square a second is the density of the process noise of that axis. An axis that explains less than nothing
at all does is set aside: waves, a heel, a unit that is mounted wrongly.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from common.units import NS_PER_S
from shore.navigation.motion_model import FREE_ACCEL_DENSITY
from shore.navigation.noise.own_scatter import SPACING_NS
from shore.navigation.trust.marks import FixMark, before, body

WINDOWS_S: Final = (1.0, 4.0)
BEND_S: Final = 8.0
"""Without a velocity, the bend of the track over this time stands for it."""
LEAST_FITTED: Final = 5
MOST_FITTED: Final = 10
UNSURE: Final = 1.7
"""A mean over 30 s holds some four bends that share no fix, so 1 + sqrt(2 / 4) times the noise is taken off: else the
noise of the fixes alone would be taken for that of the accelerometers."""
MEMORY_S: Final = 30.0
LEAST_SHARE: Final = 0.25
"""A single window counts for at least this share at once."""
LEAST_NOISES: Final = 9.0
"""That share is of what exceeds so many times the variance of the noise: a gust of noise is no fault."""
NOTABLE: Final = 6.0
"""A window shows something when it exceeds its noise by this factor."""
WORSE_BY: Final = 1.5


FREE_DENSITY2: Final = FREE_ACCEL_DENSITY**2
MOST_FREE_DENSITY2: Final = 2.0**2
"""Most of it: a fast boat that changes its velocity by 2 m/s within a second."""
LEAST_FREE_DENSITY2: Final = 0.2**2
"""Least density squared of an axis that is not in use, m^2/s^3: a boat that has kept its speed may change it."""


NIS_MEMORY: Final = 40.0
NIS_HIGH, NIS_LOW = 1.3, 1.1
"""Above the one the noise of an axis grows by a tenth with each fix, below the other it falls by a fiftieth."""
LARGEST_NIS: Final = 16.0
MOST_RAISED: Final = 1e4


class Axis(NamedTuple):
    """What is remembered of one accelerometer axis; immutable."""

    unexplained: tuple[float, ...] = (0.0, 0.0)
    """Fading mean of what it does not explain, for each window, m^2/s^3."""
    changes: tuple[float, ...] = (FREE_DENSITY2, FREE_DENSITY2)
    """The same of the whole change of velocity."""
    with_it: float = 0.0
    """E1, fading mean of the square of what is left with the accelerometers, in units of its noise."""
    without: float = 0.0
    """E0, the same of the whole change of velocity."""
    density2: float = 0.0
    """Square of the density of the process noise while it is in use, m^2/s^3; 0 = nothing is known."""
    free_density2: float = FREE_DENSITY2
    """The same while it is not."""
    is_off: bool = False
    by_velocity: bool = True
    """What it was judged by: the velocity or the bend of the track, whose figures cannot be compared."""
    nis: float = 1.0
    """Fading mean of the normalised innovation squared of the fixes along this axis; without velocity only."""
    raised: float = 1.0
    """Factor on the square of the configured density that this mean asks for."""


Axes = tuple[Axis, Axis]
"""The forward axis and the starboard axis."""


def judged(axes: Axes, marks: tuple[FixMark, ...], now: FixMark, *, sigma_m_s: float, white_m2: float) -> Axes:
    """The axes after a mark.

    sigma_m_s: 1-sigma of the receiver's velocity on one axis. white_m2: white variance of its fix on one axis.
    """
    if not marks:
        return axes
    by_velocity = now.velocity_m_s is not None
    if by_velocity != axes[0].by_velocity:
        axes = (Axis(by_velocity=by_velocity), Axis(by_velocity=by_velocity))
    dt_s = (now.t_ns - marks[-1].t_ns) / NS_PER_S
    if now.velocity_m_s is not None:
        shown = [_by_velocity(marks, now, T, sigma_m_s) for T in WINDOWS_S]
    else:
        shown = [None, _by_bend(marks, now, white_m2)]
    forward, starboard = (_axis(axes[k], k, shown, dt_s) for k in range(2))
    return forward, starboard


class _Shown(NamedTuple):
    """One window, in body axes."""

    left: tuple[float, float]
    """What the accelerometers do not explain."""
    whole: tuple[float, float]
    """What there was to explain."""
    noise: float
    """Variance of either by the noise of the receiver."""
    to_density: float
    """Factor from a square to a density squared, m^2/s^3."""
    counted: float = 1.0
    """How many times the noise is taken off a square."""


def _by_velocity(marks: tuple[FixMark, ...], now: FixMark, seconds: float, sigma_m_s: float) -> _Shown | None:
    then = before(marks, now.t_ns, seconds)
    if then is None or then.velocity_m_s is None or now.velocity_m_s is None:
        return None
    T = (now.t_ns - then.t_ns) / NS_PER_S
    east, north = now.velocity_m_s[0] - then.velocity_m_s[0], now.velocity_m_s[1] - then.velocity_m_s[1]
    middle = then.heading_rad + 0.5 * math.remainder(now.heading_rad - then.heading_rad, math.tau)
    gained = (
        now.tally.gained_east_m_s - then.tally.gained_east_m_s,
        now.tally.gained_north_m_s - then.tally.gained_north_m_s,
    )
    left = body(east - gained[0], north - gained[1], middle)
    return _Shown(left, body(east, north, middle), 2.0 * sigma_m_s**2, 1.0 / T)


def _by_bend(marks: tuple[FixMark, ...], now: FixMark, white_m2: float) -> _Shown | None:
    """Acceleration of the parabola through the fixes of the last seconds, by least squares."""
    since_ns = now.t_ns - round(BEND_S * NS_PER_S) - SPACING_NS // 2
    fitted = [mark for mark in marks[-MOST_FITTED:] if mark.t_ns >= since_ns]
    if len(fitted) < LEAST_FITTED - 1 or now.t_ns - fitted[0].t_ns < 0.75 * BEND_S * NS_PER_S:
        return None
    fitted.append(now)
    t_s = np.array([(mark.t_ns - now.t_ns) / NS_PER_S for mark in fitted])
    # the row of the pseudo-inverse that gives the second derivative
    weights = 2.0 * np.linalg.pinv(np.vander(t_s, 3))[0]
    places = np.array([(mark.east_m, mark.north_m) for mark in fitted])
    went = np.array([(mark.tally.went_east_m, mark.tally.went_north_m) for mark in fitted])
    east, north = (weights @ places).tolist()
    went_east, went_north = (weights @ went).tolist()
    heading = fitted[len(fitted) // 2].heading_rad
    left = body(east - went_east, north - went_north, heading)
    noise = white_m2 * float(weights @ weights)
    # a lasting acceleration a is as much as white noise of density a sqrt(T / 2)
    return _Shown(left, body(east, north, heading), noise, 0.5 * BEND_S, UNSURE)


def _axis(axis: Axis, k: int, windows: list[_Shown | None], dt_s: float) -> Axis:
    share = min(1.0, dt_s / MEMORY_S)
    left, left_at_once = _means(axis.unexplained, [each and each.left[k] for each in windows], windows, share)
    whole, whole_at_once = _means(axis.changes, [each and each.whole[k] for each in windows], windows, share)
    with_it, without = axis.with_it, axis.without
    longest = windows[-1]
    if longest is not None:
        seen, there = longest.left[k] ** 2 / longest.noise, longest.whole[k] ** 2 / longest.noise
        if max(seen, there) > NOTABLE:
            with_it += share * (seen - with_it)
            without += share * (there - without)
    most = max(*left, left_at_once)
    if axis.is_off:
        is_off = not (most < 0.5 * FREE_DENSITY2 and with_it < 0.7 * without + 0.5)
    else:
        is_off = most > FREE_DENSITY2 or with_it > without + WORSE_BY
    density2 = min(max(most, 0.0), FREE_DENSITY2)
    free_density2 = min(max(*whole, whole_at_once, LEAST_FREE_DENSITY2), MOST_FREE_DENSITY2)
    return axis._replace(
        unexplained=left,
        changes=whole,
        with_it=with_it,
        without=without,
        density2=density2,
        free_density2=free_density2,
        is_off=is_off,
    )


def density_of(axis: Axis, configured: float) -> float:
    """Noise density of an axis in use, m/s^2/sqrt(Hz): the configured one, raised by what the sensors say of it."""
    raised2 = min(axis.raised * configured**2, max(FREE_DENSITY2, configured**2))
    return math.sqrt(max(raised2, axis.density2))


def surprised(axes: Axes, nis: tuple[float, float]) -> Axes:
    """The axes after a fix without velocity: innovations that are larger than expected ask for more noise.

    nis: normalised innovation squared of the fix along each axis. R is bounded, so it cannot hide them.
    """
    forward, starboard = (_surprised(axis, value) for axis, value in zip(axes, nis, strict=True))
    return forward, starboard


def _surprised(axis: Axis, nis: float) -> Axis:
    mean = axis.nis + (min(nis, LARGEST_NIS) - axis.nis) / NIS_MEMORY
    factor = 1.1 if mean > NIS_HIGH else 0.98 if mean < NIS_LOW else 1.0
    return axis._replace(nis=mean, raised=min(max(axis.raised * factor, 1.0), MOST_RAISED))


def _means(
    means: tuple[float, ...], shown: list[float | None], windows: list[_Shown | None], share: float
) -> tuple[tuple[float, ...], float]:
    """The fading means after these windows, and what one of them alone demands, m^2/s^3."""
    found, at_once = list(means), 0.0
    for i, (value, window) in enumerate(zip(shown, windows, strict=True)):
        if value is not None and window is not None:
            square = value**2
            found[i] += share * ((square - window.counted * window.noise) * window.to_density - found[i])
            at_once = max(at_once, LEAST_SHARE * (square - LEAST_NOISES * window.noise) * window.to_density)
    return tuple(found), at_once
