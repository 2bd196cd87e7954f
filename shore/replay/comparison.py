"""Bit-exact comparison of a replay's estimates and events with those that the live run recorded.

Both stand in the log behind the frame that caused them and in the order in which they were made, so one queue of what
is not found yet is enough, whatever the length of the log.
"""

import struct
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from common.events import is_of_station
from common.units import NS_PER_S
from shore.logbook.estimate_rounding import digest_of, logged
from shore.logbook.log_reader import LogRecord
from shore.logbook.schemas import ESTIMATES
from shore.watchers.watcher import Step

LONGEST: Final = 1000
"""An item that waits while this many others come is not in the log."""


@dataclass(slots=True)
class Counts:
    """Counts of items of one kind."""

    made: int = 0
    recorded: int = 0
    equal: int = 0
    """Number of items recorded and found again to the last bit."""
    different: int = 0
    missing: int = 0
    """Number of items that were recorded, but not made."""
    extra: int = 0
    """Number of items that were made, but not recorded."""

    @property
    def differs(self) -> bool:
        """True when anything is not equal."""
        return bool(self.different or self.missing or self.extra)


@dataclass(frozen=True, slots=True)
class Difference:
    """The first thing that is not as recorded."""

    what: str
    """Name of the filter, or code and source of the event."""
    t_ns: int
    t_s: float
    """Time of the difference, seconds of the log."""
    how: str

    def __str__(self) -> str:
        return f"{self.what} at {self.t_s:.3f} s: {self.how}"


Key = tuple[str, int]
"""Identity of an item: filter, or code and source of an event; boat time, ns."""
Made = tuple[Key, Any]
NOT_MADE: Final = "in the log, but not made"
NOT_RECORDED: Final = "made, but not in the log"
NOT_READ: Final = "what was recorded is not of its form"


@dataclass(slots=True)
class Kind:
    """Estimates or events."""

    counts: Counts = field(default_factory=Counts)
    waiting: deque[Made] = field(default_factory=deque)

    def make(self, key: Key, content: Any) -> None:
        """Something the replay made."""
        self.counts.made += 1
        self.waiting.append((key, content))
        if len(self.waiting) > LONGEST:
            self.counts.extra += 1
            self.waiting.popleft()

    def find(self, key: Key) -> tuple[Made | None, list[Made]]:
        """What was made under the key of something recorded; and what was made before it, so was not recorded."""
        self.counts.recorded += 1
        place = next((place for place, (made, _) in enumerate(self.waiting) if made == key), None)
        if place is None:
            self.counts.missing += 1
            return None, []
        self.counts.extra += place
        extra = [self.waiting.popleft() for _ in range(place)]
        return self.waiting.popleft(), extra


class Comparison:
    """Feed it every frame's results, then the records that follow it, and `finish`."""

    def __init__(
        self, filters: Sequence[str], content: Callable[[LogRecord], dict[str, Any] | None], *, events: bool
    ) -> None:
        """filters: those that ran live and run again; `events` are compared only when all did, in the same order.

        content: of a record, `None` when it has not the form of its channel.
        """
        self._content = content
        self._filters = frozenset(filters)
        self._with_events = events
        self._estimates, self._events = Kind(), Kind()
        self.first: Difference | None = None
        self._newest = (0, 0.0)
        """Boat time (ns) and seconds of the log of the newest frame."""

    @property
    def estimates(self) -> Counts:
        """Counts over the estimates of all filters that are compared."""
        return self._estimates.counts

    @property
    def events(self) -> Counts | None:
        """Counts of the events; `None` when they are not compared."""
        return self._events.counts if self._with_events else None

    def take(self, step: Step) -> None:
        """What one frame led to: the estimates of each filter; events of the frame and of the pipeline."""
        self._newest = step.frame.t1_ns, step.t_s
        for record in step.records:
            if record["filter"] in self._filters:
                self._estimates.make((record["filter"], record["t_ns"]), record)
        if self._with_events:
            for event in step.events:
                self._events.make((f"{event.code} of {event.source}", event.t_ns), event)

    def estimate(self, record: LogRecord) -> None:
        """Take a recorded estimate."""
        name = record.topic.removeprefix(ESTIMATES)
        if name not in self._filters:
            return
        found = self._found(self._estimates, (name, record.publish_time_ns))
        if found is None:
            return
        made = found[1]
        digest = digest_of(made)
        # Found in the bytes, the digest spares reading the JSON, which costs more than all the rest.
        recorded = None if digest.encode() in record.data else self._content(record) or {}
        if recorded is None or _digest(recorded) == digest:
            self.estimates.equal += 1
            return
        self.estimates.different += 1
        self._note(found[0], _apart(made, recorded) if recorded else NOT_READ)

    def event(self, recorded: dict[str, Any]) -> None:
        """Take a recorded event, with the fields of `Event`."""
        if not self._with_events or is_of_station(recorded["code"]):
            return
        found = self._found(self._events, (f"{recorded['code']} of {recorded['source']}", recorded["t_ns"]))
        if found is None:
            return
        made = asdict(found[1])
        apart = [name for name in ("level", "text", "evidence") if made[name] != recorded[name]]
        if not apart:
            self._events.counts.equal += 1
            return
        self._events.counts.different += 1
        self._note(found[0], _said(apart[0], made[apart[0]], recorded[apart[0]]))

    def finish(self) -> None:
        """After the last record: what still waits was not recorded."""
        for kind in (self._estimates, self._events):
            kind.counts.extra += len(kind.waiting)
            if kind.waiting and kind.counts.recorded:
                self._note(kind.waiting[0][0], NOT_RECORDED)
            kind.waiting.clear()

    def _found(self, kind: Kind, key: Key) -> Made | None:
        found, extra = kind.find(key)
        if extra:
            self._note(extra[0][0], NOT_RECORDED)
        if found is None:
            self._note(key, NOT_MADE)
        return found

    def _note(self, key: Key, how: str) -> None:
        if self.first is None:
            what, t_ns = key
            newest_ns, t_s = self._newest
            self.first = Difference(what, t_ns, t_s + (t_ns - newest_ns) / NS_PER_S, how)


def _apart(made: dict[str, Any], recorded: dict[str, Any]) -> str:
    """The first field in which two estimates differ."""
    shown = logged(made) if "digest" in recorded else made
    for name, value in shown.items():
        other = recorded.get(name)
        if name == "digest" or value == other:
            continue
        if isinstance(value, list) and isinstance(other, list) and len(value) == len(other):
            place = next(place for place, pair in enumerate(zip(value, other, strict=True)) if pair[0] != pair[1])
            inner = shown["names"][place] if name == "state" else str(place)
            return _said(f"{name} {inner}", value[place], other[place])
        return _said(name, value, other)
    return "only digits that the log does not store"


def _digest(recorded: dict[str, Any]) -> str | None:
    try:
        return digest_of(recorded)
    except (LookupError, TypeError, AttributeError, OverflowError, struct.error):  # an estimate of another version
        return None


def _said(name: str, made: Any, recorded: Any) -> str:
    return f"{name} is {made}, recorded was {recorded}"
