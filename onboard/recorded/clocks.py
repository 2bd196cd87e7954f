"""Time base of a recording: a clock for each talker and formatter, the one that leads, and the offsets of the others.

Receivers, plotters and multiplexers on one wire each have a clock of their own: UTC, local time, GPS time, the time of
transmission, or a fix repeated for seconds. A recording goes by one of them.

1. The clock with a date and most fixes at different times leads, one of a satellite talker before all others; of those
   with nearly as many the one whose times come first in the file, unless another is behind it by the leap seconds: then
   it has GPS time. A recording without a date goes by the clock with most fixes.
2. A clock that gives the same times, or times of its own between them by the same talker, is one with it. Where it is
   another device's (both talkers give the same times) it only stands in where the leading clock is silent.
3. A clock less than half a period off is used, but not for the time: a receiver may write the time of transmission.
4. Every other clock has a name and an offset. Its sentences say nothing of the time, and make no fix. A clock that
   gives each of its times again and again is such a one too, whatever it repeats.
"""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median
from typing import Final

from onboard.devices.gps.epoch_times import SATELLITE_TALKERS
from onboard.devices.nmea_fields import DAY_MS, tod_step_ms
from onboard.recorded.bursts import ReceiverLine

LEAST_SHARE: Final = 0.9
"""Share of the most fixes from which on the place in the file decides who leads: a recording may end in an epoch."""
RECEIVER_SHARE: Final = 0.1
"""Share of the most fixes from which on a satellite talker leads before a plotter or another device that repeats it."""
SAME_SHARE: Final = 0.5
NEAR_SHARE: Final = 0.8
"""Least share of times that are equal to, or less than half a period off, those of the leading clock."""
OWN_SHARE: Final = 0.2
"""Largest share of a talker's times that the leading talker has too, where both are one device: a receiver changes its
talker with the satellites that it uses."""
BETWEEN: Final = 0.125
"""Part of a period from which on a time between two of the leading clock is one of its own, not late to be written."""
REPEATED: Final = 0.7
"""A clock repeats when fewer of its sentences than this give a time that is new."""
REACHED: Final = 8
"""Number of times ahead among which the next one of the same clock is looked for."""
REACH: Final = 5
"""Most wrong times in a row that are recognised."""
SHUFFLED: Final = 20
"""The times of a clock are in disorder when one in so many, and more than `REACH`, lies before the one before it."""
MOST_STRANDS: Final = 4
"""Most devices of one talker and formatter that are told apart."""
ZONE_MS: Final = 15 * 60_000
"""Time zones differ by multiples of this."""
ZONE_NEAR_MS: Final = 30_000
LATE_MS: Final = 10_000
"""Most that a repeated time is old, ms."""
GPS_LEAP_MS: Final = (12_500, 19_500)
"""GPS time is ahead of UTC by 13 s (1999) to 18 s (since 2017)."""
MOST_LEAP_MS: Final = 18_000
TOLD_NEAR_MS: Final = 5
"""Smaller offsets are rounding."""

Key = tuple[str, str]


def ordinary_step_ms(tods: Sequence[int], default_ms: int = 1_000) -> int:
    """The usual step from a time to the next one of the same clock, ms, whatever stands between them."""
    steps = []
    for index in range(0, len(tods), max(1, len(tods) // 2_000)):
        ahead = (tod_step_ms(tods[index], tod_ms) for tod_ms in tods[index + 1 : index + 1 + REACHED])
        nearest = min((step for step in ahead if step > 0), default=0)
        if nearest:
            steps.append(nearest)
    return round(median(steps)) if steps else default_ms


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherClock:
    """A clock of a recording that does not lead it."""

    names: tuple[str, ...]
    """Talker and formatter of each of its sentences (IIRMC)."""
    lead: str
    """Talker and formatter of the sentence that leads."""
    kind: str
    """What is known of its time: `repeats`, `local-time`, `gps-time`, `transmission`, `whole-seconds` or `offset`."""
    offset_s: float
    """How far it is ahead of the leading clock (median), s."""
    oldest_s: float
    """How far it is behind at worst, s."""
    sentences: int
    used: bool
    """True when its sentences are used, though not for the time."""

    def words(self) -> str:
        """What a person should know of it."""
        who, ahead_s = " and ".join(self.names), abs(self.offset_s)
        match self.kind:
            case "repeats":
                what = f"repeats times of {self.lead}, up to {self.oldest_s:g} s old"
            case "local-time":
                what = f"gives local time, {_hours(self.offset_s)} {self.lead}"
            case "gps-time":
                what = f"gives GPS time, without leap seconds, {ahead_s:g} s ahead of {self.lead}"
            case "transmission":
                what = f"gives the time of transmission, {ahead_s:g} s after the fix of {self.lead}"
            case "whole-seconds":
                what = f"gives whole seconds only, {self.lead} has more of them"
            case _:
                what = f"is {ahead_s:g} s {'ahead of' if self.offset_s > 0 else 'behind'} {self.lead}"
        return f"{who} {what}" + ("" if self.used else f": its {self.sentences} sentences are not used")


@dataclass(slots=True)
class _Voice:
    """One clock: the times of one talker and formatter."""

    key: Key
    lines: list[int] = field(default_factory=list)
    tods: list[int] = field(default_factory=list)
    fixed: set[int] = field(default_factory=set)
    """Times of day with a fix."""
    dated: int = 0
    number: int = 0
    """Number of devices before it that send the same."""

    def part(self, places: Container[int], number: int) -> "_Voice":
        """Some of its times as a clock of their own; number: 0 = the first device's."""
        lines = [line for place, line in enumerate(self.lines) if place in places]
        tods = [tod_ms for place, tod_ms in enumerate(self.tods) if place in places]
        return _Voice(self.key, lines, tods, self.fixed.intersection(tods), min(self.dated, len(lines)), number)

    @property
    def name(self) -> str:
        return "another " * (self.number > 0) + "".join(self.key)


@dataclass(frozen=True, slots=True)
class Clocks:
    """What the clocks of a recording are to its time."""

    items: list[ReceiverLine | None]
    """Each line as bursts are made of it: `None` = not a receiver's, or of another clock."""
    others: tuple[OtherClock, ...]
    unused: frozenset[int]
    """Numbers of the lines of other clocks."""
    lead: Key | None
    anchors: frozenset[Key]
    """Sentences whose times count everywhere; other same ones stand in for them."""
    dates: tuple[tuple[int, int], ...] = ()
    """Lines of other clocks that give a date, with their UTC less the offset of their clock, ms since 1970."""


def clocks_of(items: Sequence[ReceiverLine | None]) -> Clocks:
    """Which clock leads, and what the others are. items: what each line is to the clock (`receiver_line`)."""
    voices = _voices(items)
    if not voices:
        return Clocks(list(items), (), frozenset(), None, frozenset())
    lead = _in_utc(_leading(voices), voices)
    period_ms = ordinary_step_ms(lead.tods)
    same, near, others = [lead], list[_Voice](), list[_Voice]()
    for voice in voices:
        if voice is lead:
            continue
        match _Apart(voice, lead, period_ms).relation():
            case "same":
                same.append(voice)
            case "near":
                near.append(voice)
            case _:
                others.append(voice)
    unused = frozenset(line for voice in others for line in voice.lines)
    late = {line for voice in near if voice.key[0] == lead.key[0] for line in voice.lines}
    silent = unused.union(line for voice in near if voice.key[0] != lead.key[0] for line in voice.lines)
    kept = [
        None if line in silent else item._replace(timed=False, tod_ms=None) if item and line in late else item
        for line, item in enumerate(items)
    ]
    base = sorted((line, tod_ms) for voice in same for line, tod_ms in zip(voice.lines, voice.tods, strict=True))
    told, dates = list[OtherClock](), list[tuple[int, int]]()
    for voice in (*others, *near):
        ahead = _ahead_ms(voice, base)
        clock = _told(voice, lead, ahead, used=voice in near)
        dates += _dates(voice, round(1_000 * clock.offset_s), items)
        if not clock.used or abs(1_000 * clock.offset_s) > TOLD_NEAR_MS:
            told.append(clock)
    return Clocks(kept, tuple(_joined(told)), unused, lead.key, frozenset(_anchoring(same, lead)), tuple(dates))


def _dates(voice: _Voice, ahead_ms: int, items: Sequence[ReceiverLine | None]) -> Iterable[tuple[int, int]]:
    for line, tod_ms in zip(voice.lines, voice.tods, strict=True):
        item = items[line]
        if item is not None and item.day is not None:
            yield line, item.day * DAY_MS + tod_ms - ahead_ms


def _ahead_ms(voice: _Voice, base: Sequence[tuple[int, int]]) -> list[int]:
    """How far each time is ahead of the newest one that the recording goes by, ms; base: line and time of these."""
    lines = [line for line, _ in base]
    places = (max(0, bisect_left(lines, line) - 1) for line in voice.lines)
    return [tod_step_ms(base[place][1], tod_ms) for place, tod_ms in zip(places, voice.tods, strict=True)]


def _voices(items: Iterable[ReceiverLine | None]) -> list[_Voice]:
    voices: dict[Key, _Voice] = {}
    for line, item in enumerate(items):
        if item is None or item.tod_ms is None:
            continue
        voice = voices.setdefault(item.key, _Voice(item.key))
        voice.lines.append(line)
        voice.tods.append(item.tod_ms)
        voice.dated += item.day is not None
        if item.has_fix:
            voice.fixed.add(item.tod_ms)
    return [strand for voice in voices.values() for strand in _strands(voice)]


def steps_back(tods: Sequence[int]) -> int:
    """How many times lie before the one before; 0 = no more than those of single clocks that were set."""
    back = sum(tod_step_ms(a, b) < 0 for a, b in pairwise(tods))
    return back if back > REACH and SHUFFLED * back > len(tods) else 0


def _strands(voice: _Voice) -> list[_Voice]:
    """The clocks of devices that send the same talker and formatter: each carries on from its own time before.

    One clock where the times are in order, or shuffled: then no strand is long.
    """
    if not steps_back(voice.tods):
        return [voice]
    longest_ms = 3 * ordinary_step_ms(voice.tods) // 2
    strands: list[list[int]] = []
    for place, tod_ms in enumerate(voice.tods):
        steps = [(tod_step_ms(voice.tods[strand[-1]], tod_ms), strand) for strand in strands[-MOST_STRANDS:]]
        fitting = [pair for pair in steps if 0 <= pair[0] <= longest_ms]
        if fitting:
            min(fitting, key=lambda pair: pair[0])[1].append(place)
        else:
            strands.append([place])
    long = [strand for strand in strands if MOST_STRANDS * len(strand) >= len(voice.tods)]
    if len(long) < 2 or sum(map(len, long)) < LEAST_SHARE * len(voice.tods):
        return [voice]
    if any(steps[0] > len(voice.tods) // 4 or steps[-1] < 3 * len(voice.tods) // 4 for steps in long):
        return [voice]
    own = {place: number for number, strand in enumerate(long) for place in strand}
    places = range(len(voice.tods))
    return [voice.part({place for place in places if own.get(place, 0) == n}, n) for n in range(len(long))]


def _leading(voices: Sequence[_Voice]) -> _Voice:
    dated = [voice for voice in voices if voice.dated and voice.fixed]
    among = dated or voices
    most = max(len(voice.fixed) for voice in among)
    receivers = [voice for voice in among if voice.key[0] in SATELLITE_TALKERS]
    if most and max((len(voice.fixed) for voice in receivers), default=0) >= RECEIVER_SHARE * most:
        among, most = receivers, max(len(voice.fixed) for voice in receivers)
    if not most:
        return max(among, key=lambda voice: len(set(voice.tods)))
    nearly = [voice for voice in among if len(voice.fixed) >= LEAST_SHARE * most]
    first = [voice.lines[0] for voice in nearly]
    for voice in voices:
        owner = _owner(voice, nearly)
        first[owner] = min(first[owner], voice.lines[0])
    return nearly[first.index(min(first))]


def _in_utc(lead: _Voice, voices: Sequence[_Voice]) -> _Voice:
    """Another receiver with nearly as many fixes, where it is behind by the leap seconds: the first has GPS time."""
    base = list(zip(lead.lines, lead.tods, strict=True))
    for voice in voices:
        is_equal = voice.dated and len(voice.fixed) >= LEAST_SHARE * len(lead.fixed)
        if is_equal and voice.key[0] in SATELLITE_TALKERS and lead.fixed:
            behind_ms = -median(_ahead_ms(voice, base))
            whole_ms = 1_000 * round(behind_ms / 1_000)
            if GPS_LEAP_MS[0] <= behind_ms <= GPS_LEAP_MS[1] and abs(behind_ms - whole_ms) <= TOLD_NEAR_MS:
                return voice
    return lead


def _owner(voice: _Voice, leaders: Sequence[_Voice]) -> int:
    """Whose device a clock is of: of its talker if there is one, for a receiver may have several; by shared times."""
    pool = [n for n, leader in enumerate(leaders) if leader.key[0] == voice.key[0]] or range(len(leaders))
    own = set(voice.tods)
    return max(pool, key=lambda n: len(own.intersection(leaders[n].tods)))


class _Apart:
    """How far the times of a clock are from those of the leading one."""

    def __init__(self, voice: _Voice, lead: _Voice, period_ms: int) -> None:
        self._voice, self._lead, self._period_ms = voice, lead, period_ms
        self._least_ms: list[int] = []
        """Distance of each time from the leading clock's nearest time, ms."""
        self._between = 0
        for line, tod_ms in zip(voice.lines, voice.tods, strict=True):
            place = bisect_left(lead.lines, line)
            if 0 < place < len(lead.lines):
                self._compare(place, tod_ms)

    def _compare(self, place: int, tod_ms: int) -> None:
        tods = self._lead.tods
        behind, ahead = tod_step_ms(tods[place - 1], tod_ms), tod_step_ms(tods[place], tod_ms)
        self._between += behind >= 0 >= ahead
        was_silent = behind >= 0 >= ahead and 2 * (behind - ahead) > 3 * self._period_ms
        self._least_ms.append(0 if was_silent else min(behind, ahead, key=abs))

    def relation(self) -> str:
        """`same`, `near` or `other`."""
        voice, compared = self._voice, len(self._least_ms)
        if compared <= len(voice.lines) // 10:
            return "same"  # Before or behind it in the file: there is nothing to compare.
        if self.repeats():
            return "other"
        near = sum(2 * abs(step) <= self._period_ms for step in self._least_ms) >= NEAR_SHARE * compared
        if near and self._least_ms.count(0) >= SAME_SHARE * compared:
            return "same"
        if self._between >= NEAR_SHARE * compared and (self._has_own_times() or self._is_finer()):
            return "same"
        return "near" if near else "other"

    def _has_own_times(self) -> bool:
        """A sentence of the same talker has its turn between those of the leading clock."""
        is_off = median(map(abs, self._least_ms)) >= BETWEEN * self._period_ms
        return self._voice.key[0] == self._lead.key[0] and is_off

    def _is_finer(self) -> bool:
        """It gives the times of the leading clock, and others between them."""
        leading = set(self._lead.tods)
        return len(leading & set(self._voice.tods)) >= NEAR_SHARE * len(leading)

    def repeats(self) -> bool:
        """It gives most of its times more than once, and the leading clock does not."""
        voice, lead = self._voice, self._lead
        return len(set(voice.tods)) < REPEATED * len(voice.tods) and len(set(lead.tods)) >= REPEATED * len(lead.tods)


def _anchoring(same: Sequence[_Voice], lead: _Voice) -> Iterable[Key]:
    """The leading talker's sentences, and those of talkers that give times of their own."""
    by_talker: dict[str, set[int]] = defaultdict(set)
    for voice in same:
        by_talker[voice.key[0]].update(voice.tods)
    leading = by_talker[lead.key[0]]
    for voice in same:
        own = by_talker[voice.key[0]]
        if own is leading or (len(own) > REACH and len(own & leading) <= OWN_SHARE * len(own)):
            yield voice.key


def _told(voice: _Voice, lead: _Voice, ahead: Sequence[int], *, used: bool) -> OtherClock:
    middle_ms = round(median(ahead))
    zone_ms = round(middle_ms / ZONE_MS) * ZONE_MS
    if used:
        kind = "transmission" if middle_ms > 0 else "offset"
    elif zone_ms and abs(middle_ms - zone_ms) <= ZONE_NEAR_MS:
        kind = "local-time"
    elif GPS_LEAP_MS[0] <= middle_ms <= GPS_LEAP_MS[1]:
        kind = "gps-time"
        middle_ms = min(middle_ms, MOST_LEAP_MS)  # a clock that comes first in each burst seems a second further ahead
    elif -1_000 < middle_ms <= 0 and all(tod_ms % 1_000 == 0 for tod_ms in voice.tods) and _has_parts(lead):
        kind = "whole-seconds"
    else:
        kind = "repeats" if -LATE_MS <= middle_ms <= 0 else "offset"
    return OtherClock(
        names=(voice.name,),
        lead=lead.name,
        kind=kind,
        offset_s=middle_ms / 1_000,
        oldest_s=max(0, -min(ahead)) / 1_000,
        sentences=len(voice.lines),
        used=used,
    )


def _has_parts(voice: _Voice) -> bool:
    return any(tod_ms % 1_000 for tod_ms in voice.tods)


def _joined(told: Iterable[OtherClock]) -> Iterable[OtherClock]:
    """Clocks of one kind and offset as one."""
    groups: dict[tuple[str, int, bool], list[OtherClock]] = defaultdict(list)
    for clock in told:
        groups[clock.kind, round(clock.offset_s), clock.used].append(clock)
    for group in groups.values():
        first = group[0]
        yield OtherClock(
            names=tuple(name for clock in group for name in clock.names),
            lead=first.lead,
            kind=first.kind,
            offset_s=first.offset_s,
            oldest_s=max(clock.oldest_s for clock in group),
            sentences=sum(clock.sentences for clock in group),
            used=first.used,
        )


def _hours(offset_s: float) -> str:
    hours, minutes = divmod(round(abs(offset_s) / 60), 60)
    return f"{hours} h {minutes:02} min {'ahead of' if offset_s > 0 else 'behind'}"
