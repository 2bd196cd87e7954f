"""Comparison of a replay with the live run: bit-exact, or within a tolerance in another floating-point environment.

Both stand in the log behind the frame that caused them and in the order in which they were made, so one queue of what
is not found yet is enough, whatever the length of the log.
"""

import struct
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from common.events import is_of_station
from common.units import NS_PER_S
from shore.logbook.estimate_rounding import as_before, digest_of, is_near, is_stored_in, logged
from shore.logbook.log_reader import LogRecord
from shore.logbook.schemas import ESTIMATES
from shore.watchers.watcher import Step

LONGEST: Final = 1000
"""An item that waits while this many others come is not in the log."""
LISTED: Final = 100
"""Most verdicts that are kept for a list; the others are counted."""


@dataclass(slots=True)
class Counts:
    """Counts of items of one kind."""

    made: int = 0
    recorded: int = 0
    equal: int = 0
    """Number of items recorded and found again to the last bit."""
    near: int = 0
    """Number of estimates found again within `TOLERANCE`, where the arithmetic is another."""
    different: int = 0
    missing: int = 0
    """Number of items that were recorded, but not made."""
    extra: int = 0
    """Number of items that were made, but not recorded."""

    @property
    def differs(self) -> bool:
        """True when anything is neither equal nor near."""
        return bool(self.different or self.missing or self.extra)


@dataclass(frozen=True, slots=True)
class Difference:
    """Something that is not as recorded."""

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
        self,
        filters: Sequence[str],
        content: Callable[[LogRecord], dict[str, Any] | None],
        *,
        events: bool,
        same_arithmetic: bool = True,
    ) -> None:
        """filters: those that ran live and run again; `events` are compared only when all did, in the same order.

        content: of a record, `None` when it has not the form of its channel. same_arithmetic: every bit must be equal;
        else estimates may be near.
        """
        self._same_arithmetic = same_arithmetic
        self._content = content
        self._filters = frozenset(filters)
        self._with_events = events
        self._estimates, self._events = Kind(), Kind()
        self.first: Difference | None = None
        self.verdicts: list[Difference] = []
        """The first `LISTED` events, and changes of what an estimate waits for, that are not as recorded."""
        self.verdict_count = 0
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

    @property
    def differs(self) -> bool:
        """True when any estimate or event is not as recorded."""
        return any(kind.counts.recorded and kind.counts.differs for kind in (self._estimates, self._events))

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
        if is_stored_in(record.data, made):
            self.estimates.equal += 1
        elif (recorded := self._content(record)) is None:
            self.estimates.different += 1
            self._note(found[0], NOT_READ)
        else:
            self._compare(found[0], made, recorded)

    def _compare(self, key: Key, made: dict[str, Any], recorded: dict[str, Any]) -> None:
        if recorded.get("position_from") is None:  # a log of before
            made = as_before(made)
        stored = logged(made) if "digest" in recorded else made
        apart = _apart(stored, recorded)
        if apart is None and _digest(recorded) == digest_of(made):
            self.estimates.equal += 1
        elif not self._same_arithmetic and (apart is None or is_near(made, recorded)):
            self.estimates.near += 1
        else:
            self.estimates.different += 1
            self._note(key, apart or "only digits that the log does not store")
            if recorded.get("waiting") != made["waiting"]:
                self._list(key, _said("what it waits for", _waits(made), _waits(recorded)))

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
        self._list(found[0], _said(apart[0], made[apart[0]], recorded[apart[0]]))

    def finish(self) -> None:
        """After the last record: what still waits was not recorded."""
        for kind in (self._estimates, self._events):
            kind.counts.extra += len(kind.waiting)
            if kind.counts.recorded:
                self._extra(kind, kind.waiting)
            kind.waiting.clear()

    def _found(self, kind: Kind, key: Key) -> Made | None:
        found, extra = kind.find(key)
        self._extra(kind, extra)
        if found is None:
            self._note(key, NOT_MADE)
            if kind is self._events:
                self._list(key, NOT_MADE)
        return found

    def _extra(self, kind: Kind, extra: Iterable[Made]) -> None:
        for key, _ in extra:
            self._note(key, NOT_RECORDED)
            if kind is self._events:
                self._list(key, NOT_RECORDED)

    def _note(self, key: Key, how: str) -> None:
        if self.first is None:
            self.first = self._difference(key, how)

    def _list(self, key: Key, how: str) -> None:
        self.verdict_count += 1
        if len(self.verdicts) < LISTED:
            self.verdicts.append(self._difference(key, how))

    def _difference(self, key: Key, how: str) -> Difference:
        what, t_ns = key
        newest_ns, t_s = self._newest
        return Difference(what, t_ns, t_s + (t_ns - newest_ns) / NS_PER_S, how)


def _waits(estimate: dict[str, Any]) -> str:
    return ", ".join(map(str, estimate.get("waiting") or ())) or "nothing"


def _apart(shown: dict[str, Any], recorded: dict[str, Any]) -> str | None:
    """The first field in which two estimates differ, as they are stored; `None` when only the digest may."""
    for name, value in shown.items():
        other = recorded.get(name)
        if name == "digest" or value == other:
            continue
        if name == "names" and isinstance(other, list):
            return f"it has {len(value)} states, recorded were {len(other)}: another version of Wayfix made the log"
        if isinstance(value, list) and isinstance(other, list) and len(value) == len(other):
            place = next(place for place, pair in enumerate(zip(value, other, strict=True)) if pair[0] != pair[1])
            inner = shown["names"][place] if name == "state" else str(place)
            return _said(f"{name} {inner}", value[place], other[place])
        return _said(name, value, other)
    return None


def _digest(recorded: dict[str, Any]) -> str | None:
    try:
        return digest_of(recorded)
    except (LookupError, TypeError, AttributeError, OverflowError, struct.error):  # an estimate of another version
        return None


def _said(name: str, made: Any, recorded: Any) -> str:
    return f"{name} is {made}, recorded was {recorded}"
