"""Three witnesses of a turn (fault isolation by majority): compass, gyro, and course over ground or another compass.

Over 6, 15 and 30 s each says by how much the boat turned. Where a compass and the gyro contradict each other, the one
that the third witness contradicts is set aside. Without a third, a gyro that misses a large turn is set aside: without
gyro the heading is a little worse, without compass it is lost. Anything less is only doubt.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from common.units import NS_PER_S
from shore.navigation.motion_model import FREE_NOISE
from shore.navigation.trust.marks import FixMark, before

WINDOWS_S: Final = (2.0, 6.0, 15.0, 30.0)
GYRO_DOUBT_DEG_S: Final = 0.4
"""What a healthy gyro may be off by for a while, beside the doubt of its bias: a hull that rolls and pitches in waves
turns about an axis that is not the vertical."""
DIFFER_DEG: Final = 6.0
DEVIATION_SLOPE: Final = 0.38
"""A compass may show so much more or less of a turn: a deviation of 20 deg has a slope of 0.35."""
CLEARER_DEG: Final = 5.0
"""The witness must be nearer to one of the two by this much."""
WITNESS_SIGMAS: Final = 1.5
OPPOSITE_DEG: Final = 15.0
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
    unexplained: tuple[float, ...] = (0.0, 0.0)
    """Fading mean of what the gyro does not explain of the compasses' turns, for the two shortest windows, rad^2/s."""

    @property
    def density2(self) -> float:
        """Square of the density of the gyro's noise that the compasses ask for, rad^2/s."""
        return min(max(0.0, *self.unexplained), float(FREE_NOISE.yaw_rate) ** 2)


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


def looked_at(turns: Turns, marks: tuple[FixMark, ...], now: FixMark, noise: Witnesses) -> Found:
    """The verdict after a mark."""
    turns = turns._replace(unexplained=_unexplained(turns, marks, now, noise))
    doubts: dict[str, float] = {}
    agreed, is_contrary = False, False
    for name in now.turns:
        if name in turns.wrong_since_ns:
            continue
        for seconds in WINDOWS_S:
            then = before(marks, now.t_ns, seconds)
            if then is None or then.t_ns < turns.judged_from_ns or name not in then.turns:
                continue
            seen = _window(name, then, now)
            if seen is None:
                continue
            compass, gyro, T = seen
            most = max(abs(compass), abs(gyro))
            if most > math.radians(BACK_DEG):
                is_alike = abs(compass - gyro) <= BACK_SHARE * most
                agreed, is_contrary = agreed or is_alike, is_contrary or not is_alike
            if turns.gyro_wrong_since_ns is not None:
                continue
            allowed = (
                math.radians(DIFFER_DEG)
                + 2.0 * math.sqrt(2.0) * noise.compass_rad.get(name, 0.0)
                + (2.0 * noise.gyro_bias_rad_s + math.radians(GYRO_DOUBT_DEG_S)) * T
                + 2.0 * math.sqrt(min(turns.density2, math.radians(MOST_WANDER_DEG) ** 2) * T)
            )
            # of a healthy gyro's turn a deviation shows so much more or less
            over = abs(compass - gyro) - allowed
            if over <= DEVIATION_SLOPE * abs(gyro):
                continue
            witnesses = _witnesses(name, turns, then, now, noise)
            verdict = _verdict(compass, gyro, witnesses)
            if verdict != "compass" and over <= DEVIATION_SLOPE * abs(compass):
                continue
            if verdict == "compass":
                off = turns._replace(wrong_since_ns={**turns.wrong_since_ns, name: now.t_ns}, judged_from_ns=now.t_ns)
                start, (_, turned, _) = _before_fault(name, marks, now, turns) or (then, seen)
                return Found(off, compass_wrong=(name, start), turned_rad=turned)
            if verdict == "gyro":
                off = turns._replace(gyro_wrong_since_ns=now.t_ns, gyro_agreed=0, judged_from_ns=now.t_ns)
                start, (turned, _, _) = _before_fault(name, marks, now, turns) or (then, seen)
                return Found(off, gyro_wrong=start, turned_rad=turned)
            doubts[name] = max(doubts.get(name, 0.0), DOUBT_SHARE * (compass - gyro) ** 2)
    if turns.gyro_wrong_since_ns is not None:
        count = 0 if is_contrary else turns.gyro_agreed + agreed
        if count >= BACK_COUNT:
            return Found(turns._replace(gyro_wrong_since_ns=None, gyro_agreed=0, judged_from_ns=now.t_ns))
        turns = turns._replace(gyro_agreed=count)
    elif agreed and not is_contrary:
        turns = turns._replace(gyro_proven=True)
    return Found(turns, doubts=doubts)


def _before_fault(
    name: str, marks: tuple[FixMark, ...], now: FixMark, turns: Turns
) -> tuple[FixMark, tuple[float, float, float]] | None:
    """A mark from before what a short window shows began to spoil the heading, and its window."""
    then = before(marks, now.t_ns, RESUME_S)
    if then is None or then.t_ns < turns.judged_from_ns or name not in then.turns:
        return None
    seen = _window(name, then, now)
    return None if seen is None else (then, seen)


def _unexplained(turns: Turns, marks: tuple[FixMark, ...], now: FixMark, noise: Witnesses) -> tuple[float, ...]:
    """Fading means of (compass - gyro)^2 a second, less the compass' noise and what a deviation shows of a turn."""
    name = next((each for each in now.turns if each not in turns.wrong_since_ns), None)
    if name is None or not marks:
        return turns.unexplained
    share = min(1.0, (now.t_ns - marks[-1].t_ns) / NS_PER_S / MEMORY_S)
    means = list(turns.unexplained)
    for i, seconds in enumerate(WINDOWS_S[:2]):
        then = before(marks, now.t_ns, seconds)
        seen = _window(name, then, now) if then is not None and name in then.turns else None
        if seen is not None:
            compass, gyro, T = seen
            left = max(0.0, abs(compass - gyro) - DEVIATION_SLOPE * max(abs(compass), abs(gyro)))
            # the mean of so few windows is unsure: by that much the noise of the compass is not taken for the gyro's
            counted = 1.0 + 2.0 * math.sqrt(2.0 * T / MEMORY_S)
            square = left**2 - counted * 2.0 * noise.compass_rad.get(name, 0.0) ** 2
            means[i] += share * (square / T - means[i])
    return tuple(means)


def _window(name: str, then: FixMark, now: FixMark) -> tuple[float, float, float] | None:
    """Turn by the compass, turn by the gyro, and the time between the compass' readings; `None` = not covered."""
    first, last = then.turns[name], now.turns[name]
    T = (last.t_ns - first.t_ns) / NS_PER_S
    if T <= 0.0 or last.covered_s - first.covered_s < LEAST_COVERED * T:
        return None
    return last.heading_rad - first.heading_rad, last.by_gyro_rad - first.by_gyro_rad, T


def _witnesses(name: str, turns: Turns, then: FixMark, now: FixMark, noise: Witnesses) -> list[tuple[float, float]]:
    """Turn and 1-sigma by the course and by the other compasses in use."""
    found = []
    if noise.course_rad is not None and now.course_rad is not None and then.course_rad is not None:
        found.append((now.course_rad - then.course_rad, noise.course_rad))
    for other, last in now.turns.items():
        if other != name and other not in turns.wrong_since_ns and other in then.turns:
            found.append((last.heading_rad - then.turns[other].heading_rad, noise.compass_rad.get(other, 0.0)))
    return found


def _verdict(compass: float, gyro: float, witnesses: Sequence[tuple[float, float]]) -> str | None:
    """Who is wrong: "compass", "gyro" or nobody can say."""
    margin = math.radians(CLEARER_DEG)
    for_compass = any(abs(w - compass) + margin + WITNESS_SIGMAS * s < abs(w - gyro) for w, s in witnesses)
    for_gyro = any(abs(w - gyro) + margin + WITNESS_SIGMAS * s < abs(w - compass) for w, s in witnesses)
    if for_compass != for_gyro:
        return "gyro" if for_compass else "compass"
    least, most = sorted((abs(compass), abs(gyro)))
    if compass * gyro < 0.0 and least > math.radians(OPPOSITE_DEG):
        return "gyro"
    if not witnesses and most > math.radians(ALONE_DEG):
        return "gyro"
    return None
