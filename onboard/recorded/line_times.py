"""Timestamp reconstruction: when each line was sent, from times inside its sentences. Pure; for player and `convert`.

1. A burst with a new UTC (`bursts`) is an anchor. Anchors lie apart as their times of day do.
2. Lines between two anchors are spread evenly, by their number.
3. The lines of one burst go out together, at the time of its first. Spread evenly too, the GGA, GSA and RMC of a 1 Hz
   receiver would lie 333 ms apart, and a decoder, which takes 150 ms of quiet for the end of an epoch, would make its
   Fix of the GGA alone.
4. Before the first anchor, after the last one and into a gap, lines follow each other as in the rest of the file.

Which clock of several the recording goes by: `onboard.recorded.clocks`; what wrong times do: `onboard.recorded.steps`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import median
from typing import Final

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_fields import DAY_MS, tod_step_ms
from onboard.recorded.bursts import Burst, bursts, receiver_line
from onboard.recorded.clocks import Clocks, OtherClock, clocks_of, ordinary_step_ms
from onboard.recorded.stamps import HostStamp, StampedTimes, stamped_times
from onboard.recorded.steps import LONGEST_STEP_MS, Anchor, ClockSet, Steps

WANDER_SHARE: Final = 20
"""Time stamps wander when one step in so many is wrong."""
LEAST_WANDER_MS: Final = 100
BITS_PER_BYTE: Final = 10
"""Bits on the wire for each byte, 8N1: a start bit, eight data bits and a stop bit."""


@dataclass(frozen=True, slots=True)
class RecordingGap:
    """The recording was interrupted."""

    line: int
    """Index of the first line after the gap."""
    seconds: float


@dataclass(frozen=True, slots=True)
class Schedule:
    """When the lines of a recording were sent."""

    at_ns: list[int]
    """Time of each line after the first one, ns; never decreasing."""
    first_tod_ms: int | None = None
    """UTC time of day of the first line; `None` = no time of day can be found in the recording."""
    gaps: tuple[RecordingGap, ...] = ()
    first_utc_ms: int | None = None
    """UTC of the first line, ms since 1970; `None` = there is no date in it."""
    order: tuple[int, ...] | None = None
    """Where each line, in order of time, stands in the file; `None` = the file is in that order."""
    clocks: tuple[OtherClock, ...] = ()
    """The clocks that the recording does not go by."""
    unused: frozenset[int] = frozenset()
    """Indices (in order of time) of the lines of other clocks whose sentences are not used."""
    sets: tuple[ClockSet, ...] = ()
    """Where the clock was set while it recorded."""
    stamped: bool = False
    """True when time stamps beside the lines say when they came."""
    stamp_ahead_s: float | None = None
    """How far the stamps are ahead of the UTC in the sentences, s; `None` = there is one of them only."""

    stamps_wander: bool = False
    """True when there are time stamps that say less of when a line came than the sentences do."""
    dated_by_stamps: bool = False
    """True when the date is that of the time stamps: no sentence has one."""

    @property
    def utc_less_boat_ns(self) -> int | None:
        """UTC less the boat clock of a recording, which counts from midnight UTC, ns; `None` = there is no date."""
        return None if self.first_utc_ms is None else (self.first_utc_ms - (self.first_tod_ms or 0)) * NS_PER_MS

    @property
    def timed(self) -> bool:
        """There are times in the recording."""
        return self.stamped or self.first_tod_ms is not None


def sentence_times(lines: Sequence[bytes]) -> Schedule:
    """The schedule of the lines (line ends removed) of a recording, by the times in its sentences."""
    clocks, found, steps = _steps_of(lines)
    order = steps.order(len(lines))
    if order is None:
        return _scheduled(len(lines), found, steps, clocks)
    clocks, found, steps = _steps_of([lines[line] for line in order])
    return replace(_scheduled(len(lines), found, steps, clocks), order=order)


def _steps_of(lines: Sequence[bytes]) -> tuple[Clocks, list[Burst], Steps]:
    clocks = clocks_of([receiver_line(data) for data in lines])
    found = bursts(lines, clocks.items, clocks.unused)
    return clocks, found, Steps(found, clocks)


def recorded_times(lines: Sequence[bytes], stamps: Sequence[HostStamp | None]) -> Schedule:
    """The schedule of the lines by the stamps beside them, where they have some, else by the times in their sentences.

    A stamp says when a line came, for lines without a time too. What UTC that was the sentences say; without any the
    stamps are believed. Stamps that wander against the sentences by more than half of their period are not used.
    """
    by_stamp = stamped_times(stamps)
    if by_stamp is None:
        return sentence_times(lines)
    order = by_stamp.order
    clocks, found, steps = _steps_of(lines if order is None else [lines[line] for line in order])
    at_ns = by_stamp.at_ns
    if by_stamp.is_whole:
        _join(at_ns, found)
    first_tod_ms, first_utc_ms = by_stamp.tod_ms, by_stamp.utc_ms
    ahead_ms = [said_ms - at_ns[line] // NS_PER_MS for line, said_ms in steps.anchors]
    if _wanders(ahead_ms, steps.ordinary_ms):
        return replace(sentence_times(lines), stamps_wander=True)
    if ahead_ms:
        first_ms = round(median(ahead_ms))
        first_tod_ms = (steps.first_tod_ms + first_ms) % DAY_MS
        if steps.first_utc_ms is not None:
            first_utc_ms = steps.first_utc_ms + first_ms
        elif first_utc_ms is not None:  # the date of the stamps, the time of day of the sentences
            first_utc_ms += tod_step_ms(first_utc_ms % DAY_MS, first_tod_ms)
    longest_ms = max(LONGEST_STEP_MS, 5 * ordinary_step_ms([t_ns // NS_PER_MS for t_ns in at_ns]))
    gaps = tuple(
        RecordingGap(line, (b - a) / NS_PER_S)
        for line, (a, b) in enumerate(pairwise(at_ns), 1)
        if b - a > longest_ms * NS_PER_MS
    )
    return Schedule(
        at_ns,
        first_tod_ms,
        gaps,
        first_utc_ms,
        order,
        clocks.others,
        clocks.unused,
        stamped=True,
        dated_by_stamps=steps.first_utc_ms is None and first_utc_ms is not None,
        stamp_ahead_s=_stamp_ahead_s(by_stamp, first_utc_ms, first_tod_ms),
    )


def _wanders(ahead_ms: Sequence[int], period_ms: int) -> bool:
    """True when the distance of two clocks often changes by more than half a period of one from a time to the next."""
    most_ms = max(LEAST_WANDER_MS, period_ms // 2)
    return WANDER_SHARE * sum(abs(b - a) > most_ms for a, b in pairwise(ahead_ms)) > len(ahead_ms)


def _stamp_ahead_s(by_stamp: StampedTimes, first_utc_ms: int | None, first_tod_ms: int | None) -> float | None:
    """How far the stamps are ahead of the sentences, s; `None` = the sentences have no time."""
    if by_stamp.utc_ms is not None and first_utc_ms is not None:
        return (by_stamp.utc_ms - first_utc_ms) / 1_000
    if by_stamp.tod_ms is not None and first_tod_ms is not None:
        return tod_step_ms(first_tod_ms, by_stamp.tod_ms) / 1_000
    return None


def _join(at_ns: list[int], found: Sequence[Burst]) -> None:
    """The lines of one burst go out together, at the time of its first."""
    for burst in found:
        for line in range(burst.first, burst.last + 1):
            at_ns[line] = at_ns[burst.first]


def _scheduled(count: int, found: Sequence[Burst], steps: Steps, clocks: Clocks) -> Schedule:
    anchors = steps.anchors
    if len(anchors) < 2 or anchors[-1][1] == 0:
        return Schedule([0] * count, clocks=clocks.others, unused=clocks.unused)
    at_ns, gaps = _spread(anchors, count, steps.longest_ms)
    _join(at_ns, found)
    head_ms = (at_ns[anchors[0][0]] - at_ns[0]) // NS_PER_MS
    first_utc_ms = None if steps.first_utc_ms is None else steps.first_utc_ms - head_ms
    return Schedule(
        [t_ns - at_ns[0] for t_ns in at_ns],
        (steps.first_tod_ms - head_ms) % DAY_MS,
        gaps,
        first_utc_ms,
        clocks=clocks.others,
        unused=clocks.unused,
        sets=steps.sets,
    )


def without_long_gaps(at_ns: Sequence[int], longest_ns: int) -> list[int]:
    """The same times with every pause between two lines shortened to `longest_ns`."""
    cut_ns = 0
    times = list(at_ns[:1])
    for before, after in pairwise(at_ns):
        cut_ns += max(0, after - before - longest_ns)
        times.append(after - cut_ns)
    return times


def at_line_rate(count: int, lines_per_second: float) -> list[int]:
    """Times for a recording that has none."""
    return [round(index * NS_PER_S / lines_per_second) for index in range(count)]


def on_the_wire(at_ns: Sequence[int], sizes: Iterable[int], baud: int) -> list[int]:
    """When the first byte of each line goes out, if a line of `sizes[i]` bytes is wanted at `at_ns[i]`.

    No line overtakes the one before it, and none begins before that has gone out at `baud`.
    """
    free_ns = at_ns[0] if at_ns else 0
    times = []
    for wanted_ns, size in zip(at_ns, sizes, strict=True):
        start_ns = max(wanted_ns, free_ns)
        times.append(start_ns)
        free_ns = start_ns + time_on_wire_ns(size, baud)
    return times


def time_on_wire_ns(size: int, baud: int) -> int:
    """How long so many bytes take."""
    return size * BITS_PER_BYTE * NS_PER_S // baud


def _spread(anchors: list[Anchor], count: int, longest_ms: int) -> tuple[list[int], tuple[RecordingGap, ...]]:
    """Nanoseconds for each of `count` lines, in time order (the first may be negative), and the gaps."""
    parts = list(pairwise(anchors))
    apart = [((b[1] - a[1]) * NS_PER_MS / (b[0] - a[0]), b[1] - a[1]) for a, b in parts]
    ordinary = [line_ns for line_ns, step_ms in apart if step_ms <= longest_ms]
    usual_ns = median(ordinary or [line_ns for line_ns, _ in apart])
    at_ns = [0] * count
    gaps = []
    for (a, b), (line_ns, step_ms) in zip(parts, apart, strict=True):
        if step_ms > longest_ms and line_ns > 2 * usual_ns:
            pace_ns = usual_ns
            gaps.append(RecordingGap(b[0], step_ms / 1000 - (b[0] - 1 - a[0]) * usual_ns / NS_PER_S))
        else:
            pace_ns = line_ns
        for line in range(a[0], b[0]):
            at_ns[line] = a[1] * NS_PER_MS + round((line - a[0]) * pace_ns)
    first, (last, last_ms) = anchors[0][0], anchors[-1]
    for line in range(first):
        at_ns[line] = -round((first - line) * usual_ns)
    for line in range(last, count):
        at_ns[line] = last_ms * NS_PER_MS + round((line - last) * usual_ns)
    return at_ns, tuple(gaps)
