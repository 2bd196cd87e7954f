"""Timestamp repair: from the records' own times to one boat clock that never goes back.

Pure. A record's time is UTC, or counts from anywhere; some have none, some are wrong:

- A time that lies back by more than `LATE_NS`, or is passed by the records behind it (a year ahead, and back again), is
  wrong: the record is left out and counted.
- A step that lasts, back (a clock that was set) or ahead by more than `LONGEST_GAP_NS` (a receiver before its first
  fix: 1980), moves boat time on by one ordinary step, and UTC against it; the frames show it by `clk_epoch`. A shorter
  step ahead that lasts is a gap of the recording.
- So the records fall into stretches between steps. The date of all is that of the longest one, by records, of those
  after 1999 if there is any; what another stretch says of UTC counts only where it differs by less than a minute.
- Records without time lie evenly between those before and behind them; in a gap, and at the end, one ordinary step
  holds them. Before the first time there is nothing to go by: they are left out.
- Where no record has a time, they follow each other at a pace that is given.
"""

from array import array
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import Final

from common.clock import whole_us
from common.units import NS_PER_S

NO_TIME: Final = -(2**63)
"""Value that stands for a record without a time, and for one that is left out."""
LATE_NS: Final = NS_PER_S
"""Most that a time may lie back, ns: several sources of a recording are seldom in order to the millisecond."""
JUMP_NS: Final = 60 * NS_PER_S
"""A step ahead that is longer than this, ns, and the first time of all, are checked against the records behind them."""
ASKED: Final = 4
"""Number of records behind it that are asked: at least half of them must not lie before it."""
LONGEST_GAP_NS: Final = 366 * 86_400 * NS_PER_S
"""Longest gap, a year in ns: no recording is interrupted for longer."""
EARLIEST_UTC_NS: Final = 946_684_800 * NS_PER_S
"""1 January 2000, ns since 1970: clocks that were never set give 1970 or 1980."""
LATEST_NS: Final = 2**62
"""Latest boat time, the year 2116, ns: a later time cannot be right."""
BELIEVED: Final = 3
"""Number of records in a row that must agree before a step is accepted."""
LONGEST_STEP_NS: Final = 10 * NS_PER_S
"""Longest span over which records without time are spread, ns; five ordinary steps limit it too."""
LONGEST_SPREAD_NS: Final = 60 * NS_PER_S
"""The same where rows of one stamp are meant to be spread: stamps of whole minutes."""


class Plan:
    """The boat time of each record, by its number in the recording."""

    def __init__(self, times_ns: "array[int]", pace_hz: float, *, spread: bool = False, is_utc: bool = True) -> None:
        """Times of every record, in order, `NO_TIME` where it has none; the array becomes the plan's own.

        pace_hz: records a second, where no record has a time. spread: a record of the same time as the one before has
        none of its own. is_utc: what is no UTC is counted from the first record.
        """
        self._at = times_ns
        self._longest_step_ns = LONGEST_SPREAD_NS if spread else LONGEST_STEP_NS
        self._is_spread = spread
        if spread:
            _drop_repeats(self._at)
        self.timed = any(t_ns != NO_TIME for t_ns in self._at)
        """True when any record has a time."""
        self._steps = [(0, 0)]
        """Clock steps: number of the first record behind each, and what its clock is behind boat time from there on,
        ns."""
        self.doubted: set[int] = set()
        """Numbers of the records whose own time was wrong."""
        self.shift_of_date_ns = 0
        """Shift of the longest stretch, ns: boat time less this is the UTC of the recording."""
        self.misdated = 0
        """Number of records whose own time is more than a minute off that UTC."""
        if self.timed:
            self._put_in_order()
            self._place_between()
            if not is_utc:
                self._count_from_zero()
        else:
            self._at = array("q", (whole_us(round(number * NS_PER_S / pace_hz)) for number in range(len(self._at))))

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last boat time, ns; there must be one."""
        return min(t_ns for t_ns in self._at if t_ns != NO_TIME), max(self._at)

    def at(self, number: int) -> int | None:
        """Boat time of a record (ns, whole us), `None` = left out."""
        t_ns = self._at[number]
        return None if t_ns == NO_TIME else t_ns

    def shift_ns(self, number: int) -> int:
        """Shift at that record, ns: boat time less this is the record's own clock."""
        return self._steps[bisect_right(self._steps, number, key=lambda step: step[0]) - 1][1]

    def epoch(self, number: int) -> int:
        """How many times the clock was set before that record."""
        return bisect_right(self._steps, number, key=lambda step: step[0]) - 1

    def _put_in_order(self) -> None:
        """Times -> boat times; what is wrong becomes `NO_TIME` and is doubted."""
        numbers = [number for number, t_ns in enumerate(self._at) if t_ns != NO_TIME]
        times_ns = [self._at[number] for number in numbers]
        step_ns = _ordinary_step_ns(times_ns)
        shift_ns, newest_ns = 0, None
        placed, dated = Counter[int](), Counter[int]()
        for place, (number, t_ns) in enumerate(zip(numbers, times_ns, strict=True)):
            believed, was_set = _judged(t_ns, newest_ns, times_ns[place + 1 : place + 1 + ASKED])
            if was_set and newest_ns is not None:
                shift_ns += newest_ns - t_ns + step_ns
                self._steps.append((number, shift_ns))
                newest_ns = t_ns
            if believed and t_ns + shift_ns <= LATEST_NS:
                newest_ns = t_ns if newest_ns is None else max(newest_ns, t_ns)
                self._at[number] = whole_us(t_ns + shift_ns)
                placed[shift_ns] += 1
                dated[shift_ns] += t_ns >= EARLIEST_UTC_NS
            else:
                self._at[number] = NO_TIME
                self.doubted.add(number)
        longest = +dated or placed
        self.shift_of_date_ns = max(longest, key=longest.__getitem__, default=0)
        self.misdated = sum(n for shift, n in placed.items() if abs(shift - self.shift_of_date_ns) > JUMP_NS)

    def _place_between(self) -> None:
        """Place records without time evenly between their neighbours (interpolation)."""
        anchors = [number for number, t_ns in enumerate(self._at) if t_ns != NO_TIME]
        step_ns = _ordinary_step_ns([self._at[number] for number in anchors], self._longest_step_ns)
        longest_ns = max(self._longest_step_ns, 5 * step_ns)
        sizes = [b - a for a, b in pairwise(anchors)] if self._is_spread else []
        usual = median(sizes[1:] or sizes) if sizes else 0.0
        for before, behind in [*pairwise(anchors), *((last, len(self._at)) for last in anchors[-1:])]:
            free = [number for number in range(before + 1, behind) if number not in self.doubted]
            start_ns = self._at[before]
            long_ns = self._at[behind] - start_ns if behind < len(self._at) else step_ns
            long_ns = max(0, long_ns if long_ns <= longest_ns else step_ns)
            if len(free) + 1 < usual and before in (anchors[0], anchors[-1]):
                # The recording began, or ended, within a stamp: its rows are as far apart as the others.
                late_ns = round(long_ns * (1.0 - (len(free) + 1) / usual))
                long_ns -= late_ns
                start_ns += late_ns if before == anchors[0] else 0
                self._at[before] = whole_us(start_ns)
            for place, number in enumerate(free, 1):
                self._at[number] = whole_us(start_ns + long_ns * place // (len(free) + 1))

    def _count_from_zero(self) -> None:
        first_ns = next((t_ns for t_ns in self._at if t_ns != NO_TIME), 0)
        self._at = array("q", (t_ns if t_ns == NO_TIME else max(0, t_ns - first_ns) for t_ns in self._at))


def _judged(t_ns: int, newest_ns: int | None, behind: Sequence[int]) -> tuple[bool, bool]:
    """Whether a time is right, and whether the clock was set there, by the newest before it and `ASKED` behind."""
    if newest_ns is None or t_ns > newest_ns + JUMP_NS:
        right = 2 * sum(later >= t_ns - LATE_NS for later in behind) >= len(behind)
        return right, right and newest_ns is not None and t_ns > newest_ns + LONGEST_GAP_NS
    if t_ns >= newest_ns - LATE_NS:
        return True, False
    near = behind[: BELIEVED - 1]
    lasting = len(near) == BELIEVED - 1 and all(t_ns - LATE_NS <= later < newest_ns - LATE_NS for later in near)
    return lasting, lasting


def _drop_repeats(times_ns: "array[int]") -> None:
    before = NO_TIME
    for number, t_ns in enumerate(times_ns):
        if t_ns == before:
            times_ns[number] = NO_TIME
        before = t_ns


def _ordinary_step_ns(times_ns: Sequence[int], longest_ns: int = LONGEST_STEP_NS) -> int:
    """Median distance of records with different times, at most `longest_ns`; a second where there is none."""
    steps = [b - a for a, b in pairwise(times_ns) if b > a]
    return min(round(median(steps)), longest_ns) if steps else NS_PER_S
