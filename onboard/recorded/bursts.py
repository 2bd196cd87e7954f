"""Burst detection: which lines of a recording a receiver sent in one go, and the time they carry."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from datetime import date
from itertools import takewhile
from typing import Final, NamedTuple

from onboard.devices.gps.dates import long_date, short_date
from onboard.devices.nmea_fields import FieldFault, time_of_day_ms
from onboard.devices.nmea_sentence import address, check_sentence

TIME_FIELD: Final = {"RMC": 1, "GGA": 1, "GNS": 1, "ZDA": 1, "GLL": 5}
"""Sentences with a UTC time of day, and which field after the address it is."""
UNTIMED: Final = frozenset({"VTG", "GSA", "GSV", "GST", "GBS", "GRS", "DTM"})
"""Formatters that a receiver sends along; the time that some of them carry is not needed."""
_NO_FIX: Final = {"RMC": (2, "V"), "GGA": (6, "0"), "GLL": (6, "V")}
"""Which field of a sentence says that there is no fix, and how."""
_LATITUDE: Final = {"RMC": 3, "GGA": 2, "GNS": 2, "GLL": 1}
_FIRST_DAY: Final = date(1970, 1, 1)

BRIDGE_LINES: Final = 12
"""Most lines of other devices that lie inside a burst."""
TOGETHER: Final = 2
"""Most times that another device's sentence comes inside a burst: `MWV` comes relative and true. A third means that
time has passed (a 10 Hz compass): the receiver has paused itself."""


@dataclass(slots=True)
class Burst:
    """Lines `first` to `last` (indices) of one receiver epoch, lines of other devices between them included."""

    first: int
    last: int
    tod_ms: int | None = None
    """UTC time of day, ms; `None` = no time in it (cold start)."""
    void: bool = False
    """True when the receiver said that it has no fix."""
    day: int | None = None
    """Date that a sentence in it gives, days since 1970."""
    keys: set[tuple[str, str]] = field(default_factory=set)
    """Addresses of its sentences: talker and formatter."""
    _since_timed: set[tuple[str, str]] = field(default_factory=set)

    def takes(self, item: "ReceiverLine") -> bool:
        """Does the sentence belong to this epoch? Each timed one comes once; several GSA or GSV follow each other."""
        if item.timed:
            differs = item.tod_ms is not None and self.tod_ms is not None and item.tod_ms != self.tod_ms
            return not differs and item.key not in self.keys
        return item.key not in self.keys or item.key in self._since_timed

    def add(self, line: int, item: "ReceiverLine") -> None:
        """Take line number `line` in."""
        self.last = line
        self.void |= item.void
        self.day = item.day if self.day is None else self.day
        self.keys.add(item.key)
        if not item.timed:
            self._since_timed.add(item.key)
            return
        self._since_timed.clear()
        if self.tod_ms is None:
            self.tod_ms = item.tod_ms


class ReceiverLine(NamedTuple):
    """A receiver's sentence with a right checksum."""

    key: tuple[str, str]
    """Address of the sentence: talker and formatter."""
    timed: bool
    """True for a kind of sentence that carries a time, filled in or not."""
    tod_ms: int | None = None
    void: bool = False
    day: int | None = None
    """Date, days since 1970; `None` = it gives none, or one that a receiver without fix made up."""
    has_fix: bool = False
    """True when it gives a position and does not take it back."""


def receiver_line(data: bytes) -> ReceiverLine | None:
    """What a line (line end removed) is to the clock of a recording; `None` = another device's, or damaged."""
    found = address(data)
    if found is None or (found[1] not in TIME_FIELD and found[1] not in UNTIMED):
        return None
    sentence = check_sentence(data)
    if isinstance(sentence, str):
        return None
    formatter = sentence.formatter
    if formatter in UNTIMED:
        return ReceiverLine(found, timed=False)
    fields = sentence.text[:-3].split(",")
    place, word = _NO_FIX.get(formatter, (0, ""))
    void = place > 0 and _at(fields, place) == word
    try:
        tod_ms = time_of_day_ms(_at(fields, TIME_FIELD[formatter]))
    except FieldFault:
        tod_ms = None
    has_fix = not void and _at(fields, _LATITUDE.get(formatter, len(fields))) != ""
    return ReceiverLine(found, True, tod_ms, void, None if void else _day(formatter, fields), has_fix)


def _day(formatter: str, fields: Sequence[str]) -> int | None:
    try:
        if formatter == "RMC":
            day = short_date(_at(fields, 9))
        elif formatter == "ZDA":
            day = long_date(*(_at(fields, place) for place in (2, 3, 4)))
        else:
            return None
    except FieldFault:
        return None
    return None if day is None else (day - _FIRST_DAY).days


def _at(fields: Sequence[str], place: int) -> str:
    return fields[place] if place < len(fields) else ""


def bursts(lines: Sequence[bytes], items: Sequence[ReceiverLine | None], others: Collection[int] = ()) -> list[Burst]:
    """The receivers' bursts among the lines (line ends removed), in order and without overlap.

    A burst ends before a sentence of another time, or one that it has already. Lines of other devices belong to it
    when another of its sentences follows. An untimed sentence belongs to the burst before it, unless the recording
    begins with its kind: then it leads the burst. items: what each line is to the clock; others: numbers of lines of
    other clocks, which say nothing of a pause.
    """
    found: list[Burst] = []
    between: Counter[tuple[str, str]] = Counter()
    leaders = {item.key for item in takewhile(lambda item: not item.timed, filter(None, items))}
    for line, (data, item) in enumerate(zip(lines, items, strict=True)):
        burst = found[-1] if found else None
        if item is None:
            if line not in others and not data.startswith(b"!"):  # AIS comes in heaps of its own
                between[address(data) or ("", "")] += 1
            continue
        followed = burst is not None and line == burst.last + 1
        bridged = burst is not None and _bridged(burst, line, item, between)
        leads = burst is not None and burst.tod_ms is not None and item.key in leaders
        if burst is not None and (followed or bridged) and not leads and burst.takes(item):
            burst.add(line, item)
        else:
            found.append(Burst(line, line))
            found[-1].add(line, item)
        between.clear()
    return found


def _bridged(burst: Burst, line: int, item: ReceiverLine, between: Counter[tuple[str, str]]) -> bool:
    same_time = burst.tod_ms is not None and (not item.timed or item.tod_ms == burst.tod_ms)
    return same_time and line - burst.last <= BRIDGE_LINES and max(between.values(), default=0) <= TOGETHER
