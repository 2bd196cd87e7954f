"""Trust in a receiver's velocity (Doppler velocity aiding): its scatter, a guard against wrong ones, its latency.

The velocity is held against the fixes over 5 to 120 s: e = way by the fixes - way by the velocity. Beyond 4.5 sigma the
velocity is set aside; it is taken back when it has agreed for a while.
"""

import math
from typing import Final, NamedTuple

from common.units import M_S_PER_KN, NS_PER_S
from shore.navigation.measurements import COURSE_FROM_KN, Position
from shore.navigation.noise.own_scatter import Scatter
from shore.navigation.trust.marks import LONGEST_GAP_NS, FixMark, before

SLOW_M_S: Final = COURSE_FROM_KN * M_S_PER_KN
"""Below this speed the velocity of a cheap receiver follows its wandering position, and its course is held."""
FIRST_SIGMA_M_S: Final = 0.15
"""1-sigma of the velocity on each axis before anything is known of its scatter."""
LEAST_SIGMA_M_S: Final = 0.05
"""The velocity is never held for better: sentences of real receivers are off by 0.025 to 0.048 m/s against RTK."""
SLOW_SIGMA_M_S: Final = 0.5
"""At least this below `SLOW_M_S`."""
SHARE_OF_SPEED: Final = 0.01
"""Error of the velocity in proportion to the speed: rounded courses, an antenna that swings."""
WANDERS_S: Final = 30.0
"""Time within which the guard expects the lasting error of a fix to change: multipath is quicker than the rest."""
WINDOWS_S: Final = (5.0, 10.0, 20.0, 60.0, 120.0)
WRONG_SIGMAS: Final = 3.5
"""A window beyond this sets the velocity aside."""
BEYOND_COUNT: Final = 3
"""So many marks in a row must be beyond it, on the same side: fixes whose noise has grown scatter to both."""
LEAST_JUMP_M: Final = 5.0
"""From one mark to the next, an error beyond the guard and beyond this is a jump of the position."""
JUMP_NS: Final = 5 * NS_PER_S // 2
"""A jump is over within this; an error to the same side that is not is the velocity's."""
RIGHT_SIGMAS: Final = 2.5
"""The windows up to 20 s must be within this for the velocity to be taken back."""
RETURN_NS: Final = 20 * NS_PER_S
"""A velocity stays set aside for at least this time."""
HELD_COUNT: Final = 3
"""So many identical pairs of speed and course in a row are a receiver that repeats itself."""
HELD_FROM_M_S: Final = 0.3
LATENCY_SIGMA_S: Final = 0.3
"""1-sigma of the latency of the velocity against the position before anything is known."""
LATENCY_WINDOW_S: Final = 8.0
LATENCY_MEMORY_S: Final = 300.0
LEAST_LATENCY_S: Final = 0.15
"""A smaller latency counts as none: it would only spoil a good receiver."""


MOST_LATENCY_S: Final = 2.0
LONGEST_GAP_INTERVALS: Final = 2.5
"""A silence of so many usual intervals is a gap."""


class Jump(NamedTuple):
    """A jump of the position, or what looks like one."""

    ways: frozenset[tuple[int, bool]]
    """The axes on which the error is, each with its side: True = to the east, or north."""
    since_ns: int
    newest_ns: int


class Receiver(NamedTuple):
    """What is remembered of one receiver; immutable."""

    quality: int | None = None
    claimed_m: tuple[float, float] = (0.0, 0.0)
    """1-sigma that it claims in all, east and north."""
    lasting_m2: tuple[float, float] = (0.0, 0.0)
    """Variance of what lasts in it, east and north."""
    scatters: tuple[Scatter, Scatter] | None = None
    """Own scatter of the velocity, east and north, m/s."""
    marks: tuple[FixMark, ...] = ()
    newest: FixMark | None = None
    """The newest fix, be it a mark or not."""
    interval_ns: int = 0
    """Time from the fix before the newest one to that, ns."""
    repeated: int = 0
    """How many fixes in a row had the same velocity as the one before."""
    wrong_since_ns: int | None = None
    """Boat time since which the velocity is set aside, ns; `None` = it is in use."""
    judged_from_ns: int = 0
    """Windows that begin earlier are not judged."""
    jump: Jump | None = None
    """The newest jump of the position."""
    beyond: frozenset[tuple[int, bool]] = frozenset()
    """Axes, and their sides, on which windows have been beyond the guard without a break."""
    beyond_count: int = 0
    """For how many marks."""
    latency_sums: tuple[float, float] = (0.0, 0.0)
    """Fading sums of e dv and dv dv, in units of the noise of e."""

    @property
    def latency_s(self) -> float:
        """How much later than the position the velocity is, s; negative = the position is the later one."""
        product, square = self.latency_sums
        # successive windows share their fixes
        found = product / (square + LATENCY_WINDOW_S / LATENCY_SIGMA_S**2)
        return math.copysign(min(abs(found), MOST_LATENCY_S), found) if abs(found) >= LEAST_LATENCY_S else 0.0

    @property
    def latency_sigma_s(self) -> float:
        """1-sigma of a latency that is taken into account, s; 0 = none is."""
        if not self.latency_s:
            return 0.0
        return math.sqrt(LATENCY_WINDOW_S / (self.latency_sums[1] + LATENCY_WINDOW_S / LATENCY_SIGMA_S**2))

    @property
    def sigma_m_s(self) -> float:
        """1-sigma of the velocity on each axis by its own scatter, m/s."""
        if self.scatters is None:
            return FIRST_SIGMA_M_S
        variance = sum(float(each.variance) for each in self.scatters) / 2.0
        return max(math.sqrt(variance), LEAST_SIGMA_M_S)

    @property
    def is_held(self) -> bool:
        """The receiver repeats its velocity."""
        return self.repeated >= HELD_COUNT - 1

    @property
    def gives_velocity(self) -> bool:
        """The newest fix has a velocity that may be used."""
        has_one = self.newest is not None and self.newest.velocity_m_s is not None
        return has_one and not self.is_held and self.wrong_since_ns is None

    def hears(self, fix: Position) -> "Receiver":
        """The velocity of a fix is heard: its scatter, and whether it is repeated."""
        if fix.velocity_m_s is None:
            return self._replace(repeated=0)
        first = Scatter.first(FIRST_SIGMA_M_S**2, is_angle=False, is_white=True)
        scatters = self.scatters or (first, first)
        speed = math.hypot(*fix.velocity_m_s)
        known = self.newest.velocity_m_s if self.newest else None
        same = fix.velocity_m_s == known and speed > HELD_FROM_M_S
        repeated = self.repeated + 1 if same else 0
        if repeated == 0:
            pairs = zip(scatters, fix.velocity_m_s, strict=True)
            east, north = (each.then((fix.t_ns, value)) for each, value in pairs)
            scatters = (east, north)
        return self._replace(scatters=scatters, repeated=repeated)

    def way_to(self, fix: Position) -> tuple[float, float] | None:
        """Way by the velocity up to a fix, m (trapezoids); `None` where it breaks off."""
        last = self.newest
        if fix.velocity_m_s is None:
            return None
        if last is None or last.velocity_m_s is None or last.way_m is None:
            return 0.0, 0.0
        dt_s = (fix.t_ns - last.t_ns) / NS_PER_S
        east, north = (
            way + 0.5 * dt_s * (a + b)
            for way, a, b in zip(last.way_m, last.velocity_m_s, fix.velocity_m_s, strict=True)
        )
        return east, north

    def is_broken_by(self, fix: Position) -> bool:
        """Between the newest fix and this one, or in its velocity, is a gap."""
        last = self.newest
        if last is None:
            return False
        longest_ns = max(LONGEST_GAP_NS, LONGEST_GAP_INTERVALS * self.interval_ns)
        return fix.t_ns - last.t_ns > longest_ns or (fix.velocity_m_s is None) != (last.velocity_m_s is None)


class Window(NamedTuple):
    """The velocity against the fixes over one window."""

    error_m: tuple[float, float]
    variance_m2: float

    @property
    def sigmas(self) -> float:
        """The worse axis, in sigmas."""
        return max(abs(each) for each in self.error_m) / math.sqrt(self.variance_m2)

    @property
    def ways(self) -> frozenset[tuple[int, bool]]:
        """Axes that are beyond the guard, and whether to their positive side."""
        limit = WRONG_SIGMAS * math.sqrt(self.variance_m2)
        return frozenset((axis, each > 0.0) for axis, each in enumerate(self.error_m) if abs(each) > limit)


def window(receiver: Receiver, now: FixMark, seconds: float, white_m2: float) -> Window | None:
    """What a window of the guard shows; `None` = there is no such window yet.

    white_m2: variance of the white part of a fix on one axis.
    """
    then = before(receiver.marks, now.t_ns, seconds)
    if then is None or then.t_ns < receiver.judged_from_ns:
        return None
    if now.velocity_m_s is None or now.way_m is None or then.velocity_m_s is None or then.way_m is None:
        return None
    T = (now.t_ns - then.t_ns) / NS_PER_S
    latency = receiver.latency_s
    change = now.velocity_m_s[0] - then.velocity_m_s[0], now.velocity_m_s[1] - then.velocity_m_s[1]
    error = (
        now.east_m - then.east_m - (now.way_m[0] - then.way_m[0]) - latency * change[0],
        now.north_m - then.north_m - (now.way_m[1] - then.way_m[1]) - latency * change[1],
    )
    speed = math.hypot(*now.velocity_m_s)
    lasting = max(receiver.lasting_m2)
    variance = (
        2.0 * white_m2
        - 2.0 * lasting * math.expm1(-T / WANDERS_S)
        + 0.15**2 * T
        + (0.05 * T) ** 2
        + (0.1 * speed) ** 2
        + ((0.4 * T) ** 2 if speed < SLOW_M_S else 0.0)
    )
    return Window(error, variance)


def guarded(receiver: Receiver, now: FixMark, white_m2: float) -> Receiver:
    """The receiver after the guard has looked at its velocity."""
    receiver = _jumped(receiver, now, white_m2)
    shown = [each for T in WINDOWS_S if (each := window(receiver, now, T, white_m2)) is not None]
    if receiver.wrong_since_ns is None:
        ways: frozenset[tuple[int, bool]] = frozenset().union(*(each.ways for each in shown))
        still = ways & receiver.beyond if receiver.beyond_count else ways
        count = receiver.beyond_count + 1 if still else len(ways) and 1
        receiver = receiver._replace(beyond=still or ways, beyond_count=count)
        if receiver.beyond_count >= BEYOND_COUNT:
            return receiver._replace(
                wrong_since_ns=now.t_ns, judged_from_ns=now.t_ns, latency_sums=(0.0, 0.0), beyond_count=0
            )
        return receiver
    is_long_ago = now.t_ns - receiver.wrong_since_ns >= RETURN_NS
    if is_long_ago and len(shown) >= 3 and all(each.sigmas < RIGHT_SIGMAS for each in shown[:3]):
        return receiver._replace(wrong_since_ns=None, judged_from_ns=now.t_ns)
    return receiver


def _jumped(receiver: Receiver, now: FixMark, white_m2: float) -> Receiver:
    """The receiver after a look whether the position has jumped, which says nothing about the velocity."""
    last = window(receiver._replace(judged_from_ns=0), now, 1.0, white_m2)
    if last is None or not last.ways or max(map(abs, last.error_m)) <= LEAST_JUMP_M:
        return receiver
    jump = receiver.jump
    if jump is None or now.t_ns - jump.newest_ns > JUMP_NS or not last.ways & jump.ways:
        jump = Jump(last.ways, now.t_ns, now.t_ns)
    receiver = receiver._replace(jump=jump._replace(newest_ns=now.t_ns))
    if now.t_ns - jump.since_ns > JUMP_NS:
        return receiver
    return receiver._replace(judged_from_ns=now.t_ns, beyond=frozenset(), beyond_count=0)


def timed(receiver: Receiver, now: FixMark, white_m2: float) -> Receiver:
    """The receiver with one more window in the regression of its latency: e = L dv."""
    then = before(receiver.marks, now.t_ns, LATENCY_WINDOW_S)
    shown = window(receiver._replace(latency_sums=(0.0, 0.0)), now, LATENCY_WINDOW_S, white_m2)
    if shown is None or then is None or then.velocity_m_s is None or now.velocity_m_s is None:
        return receiver
    last_ns = receiver.marks[-1].t_ns if receiver.marks else now.t_ns
    kept = math.exp(-(now.t_ns - last_ns) / NS_PER_S / LATENCY_MEMORY_S)
    product, square = (kept * each for each in receiver.latency_sums)
    noise = 2.0 * white_m2 + 0.15**2 * LATENCY_WINDOW_S
    for axis in range(2):
        dv = now.velocity_m_s[axis] - then.velocity_m_s[axis]
        product += shown.error_m[axis] * dv / noise
        square += dv * dv / noise
    return receiver._replace(latency_sums=(product, square))
