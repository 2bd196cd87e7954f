"""Three witnesses of a turn (fault isolation by majority): compass, gyro, and course over ground or another compass.

Over 6, 15 and 30 s each says by how much the boat turned. Where a compass and the gyro contradict each other, the one
that the third witness contradicts is set aside. Without a third, a gyro that misses a large turn is set aside: without
gyro the heading is a little worse, without compass it is lost. Anything less is only doubt.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from common.units import NS_PER_S
from shore.navigation.motion_model import FREE_NOISE
from shore.navigation.trust.marks import FixMark, before

WINDOWS_S: Final = (2.0, 6.0, 15.0, 30.0)
GYRO_DOUBT_DEG_S: Final = 0.4
"""What a healthy gyro may be off by for a while, beside the doubt of its bias: a hull that rolls and pitches in waves
turns about an axis that is not the vertical."""
WAVES_LAST_S: Final = 15.0
"""What waves make of the gyro grows for so long, then it comes back: roll and pitch beat."""
DIFFER_DEG: Final = 6.0
DEVIATION_SLOPE: Final = 0.38
"""A compass may show so much more or less of a turn: a deviation of 20 deg has a slope of 0.35."""
CLEARER_DEG: Final = 5.0
"""The witness must be nearer to one of the two by this much."""
WITNESS_SIGMAS: Final = 1.5
OPPOSITE_DEG: Final = 25.0
"""Turns to opposite sides speak against the gyro from here on: no disturbance of less than twice this feigns it."""
ALONE_DEG: Final = 60.0
"""From this turn on, a compass is believed against the gyro without witness: far above magnetic disturbances."""
BACK_DEG: Final = 20.0
BACK_SHARE: Final = 0.25
BACK_COUNT: Final = 8
"""So many windows with a turn beyond `BACK_DEG`, alike within `BACK_SHARE`, take the gyro back."""
RETURN_DEG: Final = 8.0
RETURN_NS: Final = 5 * NS_PER_S
"""A compass that is within `RETURN_DEG` of the heading for this time is taken back."""
LONGEST_NS: Final = 120 * NS_PER_S
"""After this time a compass is taken back whatever it shows: its errors are unknown again then."""
MOST_WANDER_DEG: Final = 1.0
"""What the gyro does not explain excuses it up to this density, deg/sqrt(s): more is a fault."""
LARGEST_WANDER_DEG_S: Final = 2.0
"""A window counts for no more than a gyro that is off by this, deg/s: a compass that jumps is no gyro that wanders."""
SUSPECT_NS: Final = 4 * NS_PER_S
"""A compass must be contradicted at two marks within this time: the noise of a reading is gone at the next one."""
MEMORY_S: Final = 30.0
"""What the gyro does not explain is remembered for this time."""
RESUME_S: Final = 6.0
"""The heading goes on from so long before a verdict: until then the fault has spoilt it."""
DOUBT_SHARE: Final = 0.1
LEAST_COVERED: Final = 0.9
"""Share of a window that must be covered by yaw rates."""
COURSE_FROM_M_S: Final = 0.7
LARGEST_COURSE_SIGMA_RAD: Final = 0.17


class Turns(NamedTuple):
    """What is remembered of compasses and gyro; immutable."""

    gyro_wrong_since_ns: int | None = None
    gyro_agreed: int = 0
    gyro_proven: bool = False
    """The gyro has shown a turn as a compass did; what was learned beside one that never did is void."""
    wrong_since_ns: Mapping[str, int] = {}
    """Compasses that are set aside, and since when."""
    agrees_since_ns: Mapping[str, int] = {}
    """Compasses that are set aside and agree with the heading, and since when."""
    judged_from_ns: int = 0
    """Windows that begin earlier are not judged."""
    suspects: Mapping[str, int] = {}
    """Compasses that the witnesses have contradicted, and the boat time of the last time, ns."""
    unexplained: tuple[float, ...] = (0.0, 0.0)
    """Fading mean of what the gyro does not explain of the compasses' turns, for the two shortest windows, rad^2/s."""

    @property
    def density2(self) -> float:
        """Square of the density of the gyro's noise that the compasses ask for, rad^2/s."""
        return min(max(0.0, *self.unexplained), float(FREE_NOISE.yaw_rate) ** 2)

    @property
    def wander2(self) -> float:
        """Square of the density up to which the gyro is excused: all windows show it, so it is no single jump."""
        return min(max(0.0, min(self.unexplained)), math.radians(MOST_WANDER_DEG) ** 2)


class Found(NamedTuple):
    """What one look at the windows has found."""

    turns: Turns
    gyro_wrong: FixMark | None = None
    """The gyro is to be set aside: the heading goes on from this mark as the compass turned."""
    compass_wrong: tuple[str, FixMark] | None = None
    """A compass is to be set aside: the heading goes on from this mark as the gyro turned."""
    turned_rad: float = 0.0
    """Turn since that mark by the one that is believed."""
    doubts: Mapping[str, float] = {}
    """Compass -> variance (rad^2) that heading and compass gain against each other: nobody knows which of compass and
    gyro is right."""


class Witnesses(NamedTuple):
    """1-sigmas of the witnesses."""

    compass_rad: Mapping[str, float]
    gyro_bias_rad_s: float
    course_rad: float | None
    """1-sigma of a course over ground at the present speed; `None` = too slow."""
    waves_rad_s: float = 0.0
    """1-sigma of what waves make of the gyro for a few seconds."""


class _Seen(NamedTuple):
    """A window of one compass."""

    name: str
    then: FixMark
    compass_rad: float
    gyro_rad: float
    seconds: float


def looked_at(turns: Turns, marks: tuple[FixMark, ...], now: FixMark, noise: Witnesses) -> Found:
    """The verdict after a mark."""
    turns = turns._replace(unexplained=_unexplained(turns, marks, now, noise))
    windows = list(_windows(turns, marks, now))
    alike = {
        abs(each.compass_rad - each.gyro_rad) <= BACK_SHARE * most
        for each in windows
        if (most := max(abs(each.compass_rad), abs(each.gyro_rad))) > math.radians(BACK_DEG)
    }
    if turns.gyro_wrong_since_ns is not None:
        return Found(_gyro_heard(turns, alike, now.t_ns))
    doubts: dict[str, float] = {}
    suspects = dict(turns.suspects)
    for each in windows:
        name, verdict = each.name, _verdict(turns, each, now, noise)
        if verdict == "gyro":
            off = turns._replace(gyro_wrong_since_ns=now.t_ns, gyro_agreed=0, judged_from_ns=now.t_ns)
            start = _before_fault(each, marks, now, turns)
            return Found(off, gyro_wrong=start.then, turned_rad=start.compass_rad)
        if verdict == "compass":
            before_ns = turns.suspects.get(name)
            suspects[name] = now.t_ns
            if before_ns is not None and now.t_ns - before_ns <= SUSPECT_NS:
                wrong = {**turns.wrong_since_ns, name: now.t_ns}
                start = _before_fault(each, marks, now, turns)
                off = turns._replace(wrong_since_ns=wrong, judged_from_ns=now.t_ns, suspects={})
                return Found(off, compass_wrong=(name, start.then), turned_rad=start.gyro_rad)
        if verdict is not None:
            doubts[name] = max(doubts.get(name, 0.0), DOUBT_SHARE * (each.compass_rad - each.gyro_rad) ** 2)
    is_proven = turns.gyro_proven or alike == {True}
    return Found(turns._replace(gyro_proven=is_proven, suspects=suspects), doubts=doubts)


def _windows(turns: Turns, marks: tuple[FixMark, ...], now: FixMark) -> Iterator[_Seen]:
    """All windows of the compasses in use that may be judged, the shortest of each first."""
    for name in now.turns:
        if name not in turns.wrong_since_ns:
            found = (_window(name, turns, marks, now, seconds) for seconds in WINDOWS_S)
            yield from (each for each in found if each is not None)


def _window(name: str, turns: Turns, marks: tuple[FixMark, ...], now: FixMark, seconds: float) -> _Seen | None:
    """One window of one compass; `None` = there is none, or yaw rates do not cover it."""
    then = before(marks, now.t_ns, seconds)
    if then is None or then.t_ns < turns.judged_from_ns or name not in then.turns:
        return None
    first, last = then.turns[name], now.turns[name]
    T = (last.t_ns - first.t_ns) / NS_PER_S
    if T <= 0.0 or last.covered_s - first.covered_s < LEAST_COVERED * T:
        return None
    return _Seen(name, then, last.turned_rad - first.turned_rad, last.by_gyro_rad - first.by_gyro_rad, T)


def _gyro_heard(turns: Turns, alike: set[bool], t_ns: int) -> Turns:
    """A gyro that is set aside is taken back once it has shown enough turns as the compasses did."""
    count = 0 if False in alike else turns.gyro_agreed + len(alike)
    if count >= BACK_COUNT:
        return turns._replace(gyro_wrong_since_ns=None, gyro_agreed=0, judged_from_ns=t_ns)
    return turns._replace(gyro_agreed=count)


def _before_fault(seen: _Seen, marks: tuple[FixMark, ...], now: FixMark, turns: Turns) -> _Seen:
    """A window from before what a short one shows began to spoil the heading; else that one."""
    return _window(seen.name, turns, marks, now, RESUME_S) or seen


def _unexplained(turns: Turns, marks: tuple[FixMark, ...], now: FixMark, noise: Witnesses) -> tuple[float, ...]:
    """Fading means of (compass - gyro)^2 a second, less the compass' noise and what a deviation shows of a turn."""
    name = next((each for each in now.turns if each not in turns.wrong_since_ns), None)
    if name is None or not marks:
        return turns.unexplained
    share = min(1.0, (now.t_ns - marks[-1].t_ns) / NS_PER_S / MEMORY_S)
    means = list(turns.unexplained)
    for i, seconds in enumerate(WINDOWS_S[:2]):
        seen = _window(name, turns, marks, now, seconds)
        if seen is not None:
            # of single readings, whose noise is known
            compass = now.turns[name].heading_rad - seen.then.turns[name].heading_rad
            gyro, T = seen.gyro_rad, seen.seconds
            left = max(0.0, abs(compass - gyro) - DEVIATION_SLOPE * max(abs(compass), abs(gyro)))
            left = min(left, math.radians(LARGEST_WANDER_DEG_S) * T)
            # the mean of so few windows is unsure: by that much the noise of the compass is not taken for the gyro's
            counted = 1.0 + 2.0 * math.sqrt(2.0 * T / MEMORY_S)
            square = left**2 - counted * 2.0 * noise.compass_rad.get(name, 0.0) ** 2
            means[i] += share * (square / T - means[i])
    return tuple(means)


def _witnesses(name: str, turns: Turns, then: FixMark, now: FixMark, noise: Witnesses) -> list[tuple[float, float]]:
    """Turn and 1-sigma by the course and by the other compasses in use."""
    found = []
    if noise.course_rad is not None and now.course_rad is not None and then.course_rad is not None:
        found.append((now.course_rad - then.course_rad, noise.course_rad))
    for other, last in now.turns.items():
        if other != name and other not in turns.wrong_since_ns and other in then.turns:
            found.append((last.turned_rad - then.turns[other].turned_rad, noise.compass_rad.get(other, 0.0)))
    return found


def _verdict(turns: Turns, seen: _Seen, now: FixMark, noise: Witnesses) -> str | None:
    """Who is wrong in a window: "compass", "gyro", "either" = nobody can say; `None` = they agree."""
    _, then, compass, gyro, T = seen
    allowed = (
        math.radians(DIFFER_DEG)
        + 2.0 * math.sqrt(2.0) * noise.compass_rad.get(seen.name, 0.0)
        + (2.0 * noise.gyro_bias_rad_s + math.radians(GYRO_DOUBT_DEG_S)) * T
        + 2.0 * math.sqrt(turns.wander2 * T)
        + 2.0 * noise.waves_rad_s * min(T, WAVES_LAST_S)
    )
    over = abs(compass - gyro) - allowed
    # of a healthy gyro's turn a deviation shows so much more or less
    if over <= DEVIATION_SLOPE * abs(gyro):
        return None
    wrong = _contradicted(compass, gyro, _witnesses(seen.name, turns, then, now, noise))
    return None if wrong != "compass" and over <= DEVIATION_SLOPE * abs(compass) else wrong


def _contradicted(compass: float, gyro: float, witnesses: Sequence[tuple[float, float]]) -> str:
    """Which of two turns, rad, the others contradict; witnesses: turn and 1-sigma of each."""
    margin = math.radians(CLEARER_DEG)
    for_compass = any(abs(w - compass) + margin + WITNESS_SIGMAS * s < abs(w - gyro) for w, s in witnesses)
    for_gyro = any(abs(w - gyro) + margin + WITNESS_SIGMAS * s < abs(w - compass) for w, s in witnesses)
    if for_compass != for_gyro:
        return "gyro" if for_compass else "compass"
    least, most = sorted((abs(compass), abs(gyro)))
    is_opposite = compass * gyro < 0.0 and least > math.radians(OPPOSITE_DEG)
    is_missed = not witnesses and most > math.radians(ALONE_DEG)
    return "gyro" if is_opposite or is_missed else "either"
