"""Clock alignment of the sources of one recording: devices in local time or GPS time are put on the clock of the fixes.

Pure. The source with most fixes leads; of equals the first. Another source whose times stay `LEAST_NS` or more from
those of the leading one, by always the same, has a clock of its own: its times are moved by that, and it is named. Less
is nothing unusual, because devices and servers deliver late.
"""

from array import array
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from statistics import median
from typing import Final

from common.units import NS_PER_S
from shore.imports.reader import ForeignRecord
from shore.imports.record_times import NO_TIME

LEAST_NS: Final = 1_500_000_000
"""Least offset of a clock, ns."""
STEADY_NS: Final = 5 * NS_PER_S
STEADY_SHARE: Final = 0.8
"""Least share of times that are within `STEADY_NS`, and half of it, of the median offset where that is a clock's."""
ZONE_NEAR_NS: Final = 10 * NS_PER_S
LEAST_COMPARED: Final = 5
ZONE_NS: Final = 900 * NS_PER_S
"""Time zones differ by multiples of this, ns."""


@dataclass(slots=True)
class SourceClocks:
    """The times of the records of each source; they are noted in a first pass."""

    names: list[str] = field(default_factory=list)
    """Names of the sources, in the order in which they first speak."""
    of_record: "array[int]" = field(default_factory=lambda: array("H"))
    """Number of the source of each record."""
    fixes: Counter[str] = field(default_factory=Counter)
    """Number of fixes of each source."""
    ahead_ns: dict[str, int] = field(default_factory=dict)
    """How far the clock of a source is ahead of the leading one's, ns; only those that are put right."""
    _numbers: dict[str, int] = field(default_factory=dict)

    def note(self, source: str, fixes: int) -> None:
        """Note the next record, and how many fixes it holds."""
        if source not in self._numbers:
            self._numbers[source] = min(len(self.names), 0xFFFF)
            self.names.append(source)
        self.of_record.append(self._numbers[source])
        self.fixes[source] += fixes

    def align(self, times_ns: "array[int]") -> None:
        """Move the times of all records (`NO_TIME` = none) onto one clock, in place."""
        if len(self.names) < 2:
            return
        lead = max(range(len(self.names)), key=lambda number: self.fixes[self.names[number]])
        apart: dict[int, list[int]] = defaultdict(list)
        newest_ns = NO_TIME
        for number, t_ns in zip(self.of_record, times_ns, strict=True):
            if t_ns == NO_TIME:
                continue
            if number == lead:
                newest_ns = t_ns
            elif newest_ns != NO_TIME:
                apart[number].append(t_ns - newest_ns)
        counts = Counter(self.of_record)
        ahead = {number: offset_ns(found) for number, found in apart.items() if 2 * len(found) >= counts[number]}
        moved = {number: ahead_ns for number, ahead_ns in ahead.items() if ahead_ns}
        self.ahead_ns = {self.names[number]: ahead_ns for number, ahead_ns in moved.items()}
        for place, number in enumerate(self.of_record):
            if number in moved and times_ns[place] != NO_TIME:
                times_ns[place] -= moved[number]

    def aligned(self, record: ForeignRecord) -> ForeignRecord:
        """The record with its time on the one clock."""
        ahead_ns = self.ahead_ns.get(record.source, 0)
        return record._replace(t_ns=record.t_ns - ahead_ns) if ahead_ns and record.t_ns is not None else record

    def words(self) -> Iterator[str]:
        """What a person should know, a sentence for each source that was put right."""
        lead = max(self.names, key=lambda name: self.fixes[name], default="")
        for name, ahead_ns in self.ahead_ns.items():
            way = "ahead of" if ahead_ns > 0 else "behind"
            yield f"the clock of {name or 'one source'} is {_long(ahead_ns)} {way} that of {lead}: it is put right"


def offset_ns(apart_ns: list[int]) -> int:
    """Offset of a clock whose times are so far from the newest of another, ns; 0 = it is not another clock."""
    middle_ns = round(median(apart_ns))
    steady = sum(abs(step - middle_ns) <= min(STEADY_NS, abs(middle_ns) // 2) for step in apart_ns)
    if len(apart_ns) < LEAST_COMPARED or abs(middle_ns) < LEAST_NS or steady < STEADY_SHARE * len(apart_ns):
        return 0
    zone_ns = round(middle_ns / ZONE_NS) * ZONE_NS
    if zone_ns and abs(middle_ns - zone_ns) <= ZONE_NEAR_NS:
        return zone_ns
    return round(middle_ns / NS_PER_S) * NS_PER_S


def _long(span_ns: int) -> str:
    seconds = abs(span_ns) // NS_PER_S
    if seconds < 600:
        return f"{seconds} s"
    return f"{seconds // 3600} h {seconds // 60 % 60:02} min"
