"""Segmentation of a recording's time base: which times are right, how far they lie apart, the order of its parts.

A recording falls into parts in which each time carries on from the one before. Where two parts have dates, these say
how far they lie apart, and which is the earlier: files may stand one behind the other in any order. A step of more than
12 h between undated parts is taken for one the other way (midnight). What wrong times do:

- A time that the times around it do not agree with is no anchor; up to `REACH` in a row are passed over.
- A step back that lasts (a clock that was set) is one ordinary step forward. So is a jump ahead of a receiver that had
  no fix, because its clock was never right. Between fixes a jump ahead is a gap of the recording, however long.
- A clock that stands still makes no anchor; its lines are spread up to where it goes on.
- Where the leading clock steps back at every twentieth time, the lines are shuffled: each goes to its own time.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from statistics import median
from typing import Final, NamedTuple

from onboard.devices.nmea_fields import DAY_MS, tod_step_ms
from onboard.recorded.bursts import Burst
from onboard.recorded.clocks import REACH, Clocks, steps_back

LONGEST_STEP_MS: Final = 10_000
"""Longest step between two anchors, ms: a longer one (and longer than five ordinary ones) is a gap or a wrong time."""
DEFAULT_STEP_MS: Final = 1_000
SET_MS: Final = 20_000
"""A clock is corrected by up to this, ms (leap seconds learned at the first almanac); what lies further back was
recorded earlier."""
LONGEST_GAP_MS: Final = 366 * DAY_MS
"""No recording is interrupted for longer; the clock was set."""

Anchor = tuple[int, int]
"""Index of a line, and its time in milliseconds after the first anchor's."""


@dataclass(frozen=True, slots=True)
class ClockSet:
    """The leading clock was set while it recorded."""

    line: int
    """Index of the first line with the new time."""
    seconds: float
    """How far it jumped, s; negative = back."""


class _Beat(NamedTuple):
    """A time of the leading clock."""

    line: int
    tod_ms: int
    void: bool
    day: int | None


@dataclass(slots=True)
class _Part:
    """A part of the recording whose times carry on."""

    beats: list[_Beat]
    elapsed_ms: list[int] = field(default_factory=lambda: [0])
    """Time of each beat after the first, ms."""
    utc_ms: int | None = None
    """UTC of the first beat by most of its dates, ms since 1970; `None` = it has no date."""

    @property
    def fixes(self) -> int:
        return sum(not beat.void for beat in self.beats)

    def add(self, beat: _Beat) -> None:
        self.elapsed_ms.append(self.elapsed_ms[-1] + tod_step_ms(self.beats[-1].tod_ms, beat.tod_ms))
        self.beats.append(beat)

    def date(self, said: Iterable[int]) -> None:
        """Take the date that most say; said: UTC of the first beat, ms."""
        counts = Counter(said)
        self.utc_ms = max(counts, key=counts.__getitem__) if counts else None


class _Join(NamedTuple):
    """How two parts that follow each other in the file lie in time."""

    step_ms: int
    """Step from the last time of the first to the first time of the second, ms."""
    was_set: bool
    """True when the clock was set there: how long it took is not known."""

    @property
    def is_earlier(self) -> bool:
        """True when the second part was recorded before the first."""
        return not self.was_set and self.step_ms < 0


def _join(before: _Part, part: _Part) -> _Join:
    step_ms = tod_step_ms(before.beats[-1].tod_ms, part.beats[0].tod_ms)
    are_dated = before.utc_ms is not None and part.utc_ms is not None
    if before.utc_ms is not None and part.utc_ms is not None:
        step_ms = part.utc_ms - before.utc_ms - before.elapsed_ms[-1]
    is_correction = -SET_MS <= step_ms <= 0 or (step_ms < 0 and not are_dated)
    return _Join(step_ms, before.beats[-1].void or is_correction or abs(step_ms) > LONGEST_GAP_MS)


class Steps:
    """Which of the times are right, how far they lie apart, and in which order."""

    def __init__(self, found: Sequence[Burst], clocks: Clocks) -> None:
        """found: all bursts of the recording, in the order of the file."""
        self._beats = _beats(found, clocks)
        self._tods = [beat.tod_ms for beat in self._beats]
        leading = (item for item in clocks.items if item is not None and item.key == clocks.lead)
        self._is_shuffled = steps_back([item.tod_ms for item in leading if item.tod_ms is not None]) > 0
        forward = [step for a, b in pairwise(self._tods) if (step := tod_step_ms(a, b)) > 0]
        self.ordinary_ms = round(median(forward)) if forward else DEFAULT_STEP_MS
        """The usual step between two times, ms."""
        if self.ordinary_ms > LONGEST_STEP_MS and len(forward) <= REACH:
            self.ordinary_ms = min(forward)  # too few to tell a gap from the rule
        self.longest_ms = max(LONGEST_STEP_MS, 5 * self.ordinary_ms)
        self.sets: tuple[ClockSet, ...] = ()
        """Where the clock was set."""
        self._parts = self._dated(_in_parts(self._beats, self._kept()), clocks)
        self._joins = [_join(a, b) for a, b in pairwise(self._parts)]
        self.first_tod_ms = 0
        """Time of day of the first anchor by the part with a date and most fixes, ms."""
        self.first_utc_ms: int | None = None
        self.anchors: list[Anchor] = []
        """The anchors, as far apart as their times say or, where that cannot be, as an ordinary step."""
        if self._parts:
            self._place()

    def order(self, count: int) -> tuple[int, ...] | None:
        """The lines (their number is `count`) in order of time; `None` = they are, as far as is known."""
        if self._is_shuffled:
            at = [(beat.line, utc_ms) for beat, utc_ms in zip(self._beats, _each_utc_ms(self._beats), strict=True)]
        elif any(join.is_earlier for join in self._joins):
            at = list(self._by_part())
        else:
            return None
        lines = [line for line, _ in at]
        ordered = sorted(range(count), key=lambda line: at[max(0, bisect_right(lines, line) - 1)][1])
        return None if ordered == list(range(count)) else tuple(ordered)

    def _by_part(self) -> Iterator[tuple[int, int]]:
        """The UTC, or what stands for it, of each beat: a part without a date stays behind the one before it."""
        known_ms = next(part.utc_ms for part in self._parts if part.utc_ms is not None)
        for part in self._parts:
            start_ms = known_ms if part.utc_ms is None else part.utc_ms
            for beat, elapsed_ms in zip(part.beats, part.elapsed_ms, strict=True):
                if part.utc_ms is not None:
                    known_ms = start_ms + elapsed_ms
                yield beat.line, known_ms

    def _place(self) -> None:
        starts_ms = [0]
        sets = []
        for (before, part), join in zip(pairwise(self._parts), self._joins, strict=True):
            if join.was_set:
                sets.append(ClockSet(part.beats[0].line, join.step_ms / 1_000))
            taken_ms = self.ordinary_ms if join.was_set or join.step_ms <= 0 else join.step_ms
            starts_ms.append(starts_ms[-1] + before.elapsed_ms[-1] + taken_ms)
        self.sets = tuple(sets)
        self.anchors = [
            (beat.line, start_ms + elapsed_ms)
            for part, start_ms in zip(self._parts, starts_ms, strict=True)
            for beat, elapsed_ms in zip(part.beats, part.elapsed_ms, strict=True)
        ]
        best = max(range(len(self._parts)), key=lambda place: _weight(self._parts[place]))
        part = self._parts[best]
        self.first_tod_ms = (part.beats[0].tod_ms - starts_ms[best]) % DAY_MS
        self.first_utc_ms = None if part.utc_ms is None else part.utc_ms - starts_ms[best]

    def _dated(self, parts: list[_Part], clocks: Clocks) -> list[_Part]:
        for part in parts:
            beats = zip(part.beats, part.elapsed_ms, strict=True)
            part.date(beat.day * DAY_MS + beat.tod_ms - elapsed for beat, elapsed in beats if beat.day is not None)
        if parts and all(part.utc_ms is None for part in parts):
            for part in parts:
                part.date(_from_others(part, clocks.dates))
        return parts

    def _kept(self) -> list[tuple[int, bool]]:
        """Index of each beat that is right, and whether a part begins with it."""
        kept: list[tuple[int, bool]] = []
        for index in range(len(self._tods)):
            if not kept:
                kept.append((index, True))
                continue
            step_ms = tod_step_ms(self._tods[kept[-1][0]], self._tods[index])
            begins = not 0 <= step_ms <= self.longest_ms
            if begins:
                if self._is_outlier(kept[-1][0], index, step_ms):
                    continue
                back = self._outliers_before(kept, index, step_ms)
                if back:
                    del kept[-back:]
                    begins = not kept
            kept.append((index, begins))
        return kept

    def _is_outlier(self, before: int, index: int, step_ms: int) -> bool:
        """The times after `index` carry on from `before`, or none of them carries on from `index`."""
        reach = REACH if abs(step_ms) > self.longest_ms else 1
        after = range(index + 1, min(index + 1 + reach, len(self._tods)))
        if any(self._carries_on(before, later) for later in after):
            return True
        near = range(index + 1, min(index + 1 + REACH, len(self._tods)))
        return abs(step_ms) > self.longest_ms and not any(self._carries_on(index, later) for later in near)

    def _outliers_before(self, kept: list[tuple[int, bool]], index: int, step_ms: int) -> int:
        """How many of the newest anchors are wrong, because `index` carries on from the one before them."""
        far = abs(step_ms) > self.longest_ms
        for back in range(1, min(REACH if far else 1, len(kept) - 1) + 1):
            if self._carries_on(kept[-1 - back][0], index):
                return back
        # A first time that nothing confirms is no beginning to wait hours from.
        return 1 if far and len(kept) == 1 else 0

    def _carries_on(self, before: int, after: int) -> bool:
        return 0 < tod_step_ms(self._tods[before], self._tods[after]) <= self.longest_ms


def _beats(found: Iterable[Burst], clocks: Clocks) -> list[_Beat]:
    """The bursts whose time differs from the one before; another device's where the leading one is silent."""
    beats: list[_Beat] = []
    timed = (burst for burst in found if burst.tod_ms is not None)
    for leads, group in groupby(timed, key=lambda burst: bool(burst.keys & clocks.anchors)):
        bursts = list(group)
        if not leads and len({burst.tod_ms for burst in bursts}) <= REACH:
            continue
        for burst in bursts:
            if burst.tod_ms is None:
                continue
            if not beats or burst.tod_ms != beats[-1].tod_ms:
                beats.append(_Beat(burst.first, burst.tod_ms, burst.void, burst.day))
            elif beats[-1].day is None:  # the rest of a burst that lines of another device cut in two
                beats[-1] = beats[-1]._replace(day=burst.day)
    return beats


def _in_parts(beats: Sequence[_Beat], kept: Iterable[tuple[int, bool]]) -> list[_Part]:
    parts: list[_Part] = []
    for index, begins in kept:
        if begins:
            parts.append(_Part([beats[index]]))
        else:
            parts[-1].add(beats[index])
    return parts


def _from_others(part: _Part, dates: Iterable[tuple[int, int]]) -> Iterator[int]:
    """UTC of the part's first beat by the dates of other clocks, ms."""
    lines = [beat.line for beat in part.beats]
    for line, utc_ms in dates:
        place = bisect_right(lines, line) - 1
        if place >= 0:
            tod_ms = part.beats[place].tod_ms
            yield round((utc_ms - tod_ms) / DAY_MS) * DAY_MS + tod_ms - part.elapsed_ms[place]


def _weight(part: _Part) -> tuple[bool, int]:
    return part.utc_ms is not None, part.fixes


def _each_utc_ms(beats: Sequence[_Beat]) -> Iterator[int]:
    """UTC of each beat by itself, with the date of the nearest that has one; without any, of one day."""
    dated = [place for place, beat in enumerate(beats) if beat.day is not None]
    for place, beat in enumerate(beats):
        if not dated:
            yield tod_step_ms(beats[0].tod_ms, beat.tod_ms)
            continue
        near = bisect_right(dated, place)
        known = beats[dated[max(0, near - 1)]]
        assert known.day is not None
        known_ms = known.day * DAY_MS + known.tod_ms
        yield known_ms + tod_step_ms(known.tod_ms, beat.tod_ms)
