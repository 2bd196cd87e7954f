"""Burst detection: which lines of a recording a receiver sent in one go, and the time they carry."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Final, NamedTuple

from onboard.devices.nmea_fields import FieldFault, time_of_day_ms
from onboard.devices.nmea_sentence import address, check_sentence

TIME_FIELD: Final = {"RMC": 1, "GGA": 1, "GNS": 1, "ZDA": 1, "GLL": 5}
"""Sentences with a UTC time of day, and which field after the address it is."""
UNTIMED: Final = frozenset({"VTG", "GSA", "GSV", "GST", "GBS", "GRS", "DTM"})
"""Formatters that a receiver sends along; the time that some of them carry is not needed."""
_NO_FIX: Final = {"RMC": (2, "V"), "GGA": (6, "0"), "GLL": (6, "V")}
"""Which field of a sentence says that there is no fix, and how."""

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
    _keys: set[tuple[str, str]] = field(default_factory=set)
    _since_timed: set[tuple[str, str]] = field(default_factory=set)

    def takes(self, item: "ReceiverLine") -> bool:
        """Does the sentence belong to this epoch? Each timed one comes once; several GSA or GSV follow each other."""
        if item.timed:
            differs = item.tod_ms is not None and self.tod_ms is not None and item.tod_ms != self.tod_ms
            return not differs and item.key not in self._keys
        return item.key not in self._keys or item.key in self._since_timed

    def add(self, line: int, item: "ReceiverLine") -> None:
        """Take line number `line` in."""
        self.last = line
        self.void |= item.void
        self._keys.add(item.key)
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
    tod_ms: int | None
    void: bool


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
        return ReceiverLine(found, timed=False, tod_ms=None, void=False)
    fields = sentence.text[:-3].split(",")
    place, word = _NO_FIX.get(formatter, (0, ""))
    void = place > 0 and _at(fields, place) == word
    try:
        tod_ms = time_of_day_ms(_at(fields, TIME_FIELD[formatter]))
    except FieldFault:
        tod_ms = None
    return ReceiverLine(found, timed=True, tod_ms=tod_ms, void=void)


def _at(fields: Sequence[str], place: int) -> str:
    return fields[place] if place < len(fields) else ""


def bursts(lines: Sequence[bytes]) -> list[Burst]:
    """The receivers' bursts among the lines (line ends removed), in order and without overlap.

    A burst ends before a sentence of another time, or one that it has already. Lines of other devices belong to it
    when another of its sentences follows. An untimed sentence belongs to the burst before it, unless the recording
    begins with its kind: then it leads the burst.
    """
    found: list[Burst] = []
    between: Counter[tuple[str, str]] = Counter()
    items = [receiver_line(data) for data in lines]
    leaders = {item.key for item in takewhile(lambda item: not item.timed, filter(None, items))}
    for line, (data, item) in enumerate(zip(lines, items, strict=True)):
        burst = found[-1] if found else None
        if item is None:
            if not data.startswith(b"!"):  # AIS comes in heaps of its own
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
