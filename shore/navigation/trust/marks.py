"""Ring buffer of a receiver's fixes: windows of some seconds over what the sensors showed meanwhile.

A mark is one fix and what had been summed up by then. Differences of two marks are what a window has seen: how far the
boat went by its fixes, by the receiver's velocity and by the IMU; how far it turned by each compass, gyro and course.
"""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from common.units import NS_PER_S
from shore.navigation.noise.own_scatter import SPACING_NS
from shore.navigation.numbers import Array, wrapped

LONGEST_NS: Final = 125 * NS_PER_S
"""The ring covers this time."""
LONGEST_GAP_NS: Final = 3 * NS_PER_S
"""After a longer silence of a receiver of 1 Hz or more the ring begins again: nobody knows which way the boat went."""
SLACK: Final = 0.15
"""A window may be longer or shorter than asked by this share, plus half the spacing."""


class RunningSums(NamedTuple):
    """Running sums over the predictions; what they began with falls out of every difference."""

    turned_rad: float = 0.0
    """Turn by the yaw rate less its bias, whether or not it is in use."""
    gained_east_m_s: float = 0.0
    """Change of velocity by the accelerometers less their biases, whether or not they are in use."""
    gained_north_m_s: float = 0.0
    went_east_m: float = 0.0
    """What that change of velocity adds to the way."""
    went_north_m: float = 0.0
    yaw_rate_rad_s: float = 0.0
    """The newest yaw rate less its bias."""
    covered_s: float = 0.0
    """Time for which a yaw rate was measured."""


class Turned(NamedTuple):
    """A compass at its newest reading before a mark."""

    heading_rad: float
    """What it showed; it goes on beyond a turn."""
    by_gyro_rad: float
    """What the gyro had turned in all by then, as in `RunningSums`."""
    covered_s: float
    """For how long yaw rates had been measured by then, as in `RunningSums`."""
    t_ns: int
    """Boat time of the reading, ns."""
    apart_rad: float
    """What it showed more than the gyro, as a mean over a few readings: the noise of one reading is no turn."""

    @property
    def turned_rad(self) -> float:
        """How far it has turned, with the noise of a few readings."""
        return self.by_gyro_rad + self.apart_rad


class HeadingBlock(NamedTuple):
    """The heading and the errors of the compasses, as a filter believed them."""

    x: Array
    """Means of the heading and of these errors, (k,)."""
    P: Array
    """Covariance of the heading and of these errors, (k, k)."""


class FixMark(NamedTuple):
    """One fix, and what had been summed up by then."""

    t_ns: int
    east_m: float
    north_m: float
    velocity_m_s: tuple[float, float] | None
    """The receiver's own velocity (east, north)."""
    way_m: tuple[float, float] | None
    """Way by that velocity since the ring began; `None` = it was not given all the time."""
    heading_rad: float
    """Heading of the filter."""
    tally: RunningSums
    turns: Mapping[str, Turned]
    """The turn that each compass had shown by then, where it has been heard."""
    block: HeadingBlock
    course_rad: float | None = None
    """Course over ground, which goes on beyond a turn; `None` = too slow for one."""


def append(marks: tuple[FixMark, ...], mark: FixMark) -> tuple[FixMark, ...]:
    """The ring with one more mark, if that is as far from the last one as readings whose scatter is counted."""
    if marks and mark.t_ns - marks[-1].t_ns < SPACING_NS:
        return marks
    first = next((i for i, old in enumerate(marks) if mark.t_ns - old.t_ns <= LONGEST_NS), len(marks))
    return (*marks[first:], mark)


def before(marks: tuple[FixMark, ...], t_ns: int, window_s: float) -> FixMark | None:
    """The mark that lies a window before `t_ns`, `None` = there is none."""
    wanted = t_ns - round(window_s * NS_PER_S)
    found = None
    for mark in reversed(marks):
        if found is not None and abs(mark.t_ns - wanted) > abs(found.t_ns - wanted):
            break
        found = mark
    if found is None or abs(found.t_ns - wanted) > SLACK * window_s * NS_PER_S + SPACING_NS // 2:
        return None
    return found


def onward(before_rad: float | None, now_rad: float) -> float:
    """An angle as the continuation of an earlier one, which may be beyond a turn."""
    return now_rad if before_rad is None else before_rad + float(wrapped(now_rad - before_rad))


def body(east: float, north: float, heading_rad: float) -> tuple[float, float]:
    """A vector on the plane as (forward, starboard)."""
    sin, cos = math.sin(heading_rad), math.cos(heading_rad)
    return sin * east + cos * north, cos * east - sin * north
