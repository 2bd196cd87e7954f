"""What an estimate rests on: a fix, or dead reckoning since the last one; a compass, or the course over ground.

It is read off the moment of which the estimate is made, and changes nothing in the filter.
"""

from typing import Final, NamedTuple

from common.boat_config import BoatConfig, stale_after_s
from common.messages import Frame
from common.units import NS_PER_S
from shore.navigation.filter_bank import Moment
from shore.navigation.filters import FilterState
from shore.navigation.measurements import Course, TrueHeading

FIX: Final = "fix"
COASTING: Final = "coasting"
"""Dead reckoning: the estimate is carried on without what it should rest on."""
COMPASS: Final = "compass"
COURSE: Final = "course"
"""No compass gives the heading: it is carried on by the yaw rate and taken from the course over ground."""


class Basis(NamedTuple):
    """What one estimate rests on."""

    position_from: str
    """`FIX`, or `COASTING` when the newest one is too old, or its receiver has lost it."""
    position_since_ns: int
    """Boat time: of the first fix of an unbroken row; while coasting, of the last fix."""
    heading_from: str
    """`COMPASS`; without one `COURSE`, or `COASTING` in a filter that takes no heading from the course."""


class Bases:
    """The bases of the estimates over one clock of the board."""

    def __init__(self, config: BoatConfig) -> None:
        self._compass_ns = stale_after_ns(config, "compass")
        self._has_water = config.boat.leeway_m_s > 0.0
        self.lost_after_ns: Final = stale_after_ns(config, "gps")
        """A silence of the receivers from which on no fix carries the estimate, ns."""
        self._void_ns: dict[str, int] = {}
        """Boat time of the newest fix of each receiver that is none, ns."""

    def see(self, frame: Frame) -> None:
        """Note the fixes of which their receiver says that they are none; one that it repeats is as good as silence."""
        for fix in frame.fixes:
            if not (fix.usable or fix.held):
                self._void_ns[fix.sensor] = max(fix.t_ns, self._void_ns.get(fix.sensor, fix.t_ns))

    def of(self, moment: Moment, state: FilterState) -> Basis:
        """The basis of the estimate that `state` gives at `moment`."""
        fix = moment.position
        assert fix is not None  # a filter starts from one
        assert moment.fixed_since_ns is not None
        is_void = fix.t_ns < self._void_ns.get(fix.sensor, fix.t_ns) <= moment.t_ns
        if is_void or moment.t_ns - fix.t_ns > self.lost_after_ns:
            return Basis(COASTING, fix.t_ns, self._heading_from(moment, state))
        return Basis(FIX, moment.fixed_since_ns, self._heading_from(moment, state))

    def _heading_from(self, moment: Moment, state: FilterState) -> str:
        trust, newest = state.trust, moment.heading
        if trust is None:
            if newest is None or moment.t_ns - newest.t_ns > self._compass_ns:
                return COASTING
            return COURSE if isinstance(newest, Course) else COMPASS
        since_ns, aside = moment.t_ns - self._compass_ns, trust.turns.wrong_since_ns
        if isinstance(newest, TrueHeading) and newest.t_ns >= since_ns and newest.sensor not in aside:
            return COMPASS
        if any(turned.t_ns >= since_ns and name not in aside for name, turned in trust.compasses.items()):
            return COMPASS
        return COURSE if self._has_water else COASTING


def stale_after_ns(config: BoatConfig, role: str) -> int:
    """Silence of all sensors of a role after which the newest value is stale, ns."""
    rates_hz = [sensor.rate_hz for sensor in config.with_role(role)] or [None]
    return round(max(stale_after_s(role, rate_hz) for rate_hz in rates_hz) * NS_PER_S)
