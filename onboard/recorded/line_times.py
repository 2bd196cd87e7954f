"""Timestamp reconstruction: when each line was sent, from times inside its sentences. Pure; for player and `convert`.

1. A burst with a new UTC (`bursts`) is an anchor. Anchors lie apart as their times of day do.
2. Lines between two anchors are spread evenly, by their number.
3. The lines of one burst go out together, at the time of its first. Spread evenly too, the GGA, GSA and RMC of a 1 Hz
   receiver would lie 333 ms apart, and a decoder, which takes 150 ms of quiet for the end of an epoch, would make its
   Fix of the GGA alone.
4. Before the first anchor, after the last one and into a gap, lines follow each other as in the rest of the file.

A step of more than 12 h is taken for one the other way (midnight). What wrong times do:

- A time that the times around it do not agree with is no anchor; up to `REACH` in a row are passed over.
- A step back that lasts (a clock that was set) is one ordinary step forward. So is a jump ahead of a receiver that had
  no fix, because its clock was never right. Between fixes a jump ahead is a gap of the recording, however long.
- A clock that stands still makes no anchor; its lines are spread up to where it goes on.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Final

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_fields import DAY_MS
from onboard.recorded.bursts import Burst, bursts

LONGEST_STEP_MS: Final = 10_000
"""Longest step between two anchors, ms: a longer one (and longer than five ordinary ones) is a gap or a wrong time."""
REACH: Final = 5
"""Most wrong times in a row that are recognised."""
DEFAULT_STEP_MS: Final = 1_000
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
    """UTC time of day of the first line; `None` = no time can be found in the recording, and `at_ns` is all 0."""
    gaps: tuple[RecordingGap, ...] = ()


Anchor = tuple[int, int]
"""Index of a line, and its time in milliseconds after the first anchor's."""


def sentence_times(lines: Sequence[bytes]) -> Schedule:
    """The schedule of the lines (line ends removed) of a recording."""
    found = bursts(lines)
    steps = _Steps(_changes(found))
    anchors = steps.anchors()
    if len(anchors) < 2 or anchors[-1][1] == 0:
        return Schedule([0] * len(lines))
    at_ns, gaps = _spread(anchors, len(lines), steps.longest_ms)
    for burst in found:
        for line in range(burst.first, burst.last + 1):
            at_ns[line] = at_ns[burst.first]
    first_tod_ms = (steps.first_tod_ms - (at_ns[anchors[0][0]] - at_ns[0]) // NS_PER_MS) % DAY_MS
    return Schedule([t_ns - at_ns[0] for t_ns in at_ns], first_tod_ms, gaps)


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


def _changes(found: Iterable[Burst]) -> list[tuple[Burst, int]]:
    """The bursts whose time differs from the one before, with that time."""
    changes: list[tuple[Burst, int]] = []
    for burst in found:
        if burst.tod_ms is not None and (not changes or burst.tod_ms != changes[-1][1]):
            changes.append((burst, burst.tod_ms))
    return changes


class _Steps:
    """Which of the times are right, and how far they lie apart."""

    def __init__(self, changes: list[tuple[Burst, int]]) -> None:
        self._bursts = [burst for burst, _ in changes]
        self._tods = [tod_ms for _, tod_ms in changes]
        forward = [step for a, b in pairwise(self._tods) if (step := tod_step_ms(a, b)) > 0]
        self._ordinary_ms = round(median(forward)) if forward else DEFAULT_STEP_MS
        if self._ordinary_ms > LONGEST_STEP_MS and len(forward) <= REACH:
            self._ordinary_ms = min(forward)  # too few to tell a gap from the rule
        self.longest_ms = max(LONGEST_STEP_MS, 5 * self._ordinary_ms)
        self.first_tod_ms = 0

    def anchors(self) -> list[Anchor]:
        """The anchors, as far apart as their times say or, where that cannot be, as an ordinary step."""
        kept: list[tuple[int, int]] = []  # index, step from the one before
        for index in range(len(self._tods)):
            if not kept:
                kept.append((index, 0))
                continue
            step_ms = tod_step_ms(self._tods[kept[-1][0]], self._tods[index])
            if not 0 <= step_ms <= self.longest_ms:
                if self._is_outlier(kept[-1][0], index, step_ms):
                    continue
                back = self._outliers_before(kept, index, step_ms)
                if back:
                    del kept[-back:]
                    step_ms = tod_step_ms(self._tods[kept[-1][0]], self._tods[index]) if kept else 0
                elif step_ms < 0 or self._bursts[kept[-1][0]].void:
                    step_ms = self._ordinary_ms
            kept.append((index, step_ms))
        if kept:
            self.first_tod_ms = self._tods[kept[0][0]]
        elapsed_ms = 0
        anchors = []
        for index, step_ms in kept:
            elapsed_ms += step_ms
            anchors.append((self._bursts[index].first, elapsed_ms))
        return anchors

    def _is_outlier(self, before: int, index: int, step_ms: int) -> bool:
        """The times after `index` carry on from `before`, or none of them carries on from `index`."""
        reach = REACH if abs(step_ms) > self.longest_ms else 1
        after = range(index + 1, min(index + 1 + reach, len(self._tods)))
        if any(self._carries_on(before, later) for later in after):
            return True
        near = range(index + 1, min(index + 1 + REACH, len(self._tods)))
        return abs(step_ms) > self.longest_ms and not any(self._carries_on(index, later) for later in near)

    def _outliers_before(self, kept: list[tuple[int, int]], index: int, step_ms: int) -> int:
        """How many of the newest anchors are wrong, because `index` carries on from the one before them."""
        far = abs(step_ms) > self.longest_ms
        for back in range(1, min(REACH if far else 1, len(kept) - 1) + 1):
            if self._carries_on(kept[-1 - back][0], index):
                return back
        # A first time that nothing confirms is no beginning to wait hours from.
        return 1 if far and len(kept) == 1 else 0

    def _carries_on(self, before: int, after: int) -> bool:
        return 0 < tod_step_ms(self._tods[before], self._tods[after]) <= self.longest_ms


def tod_step_ms(before_ms: int, after_ms: int) -> int:
    """Step from one time of day to another, ms, -12 h to +12 h."""
    return (after_ms - before_ms + DAY_MS // 2) % DAY_MS - DAY_MS // 2


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
