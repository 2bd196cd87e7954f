"""First pass over a log (survey): what is in it, its clocks and its events. Estimates are counted, not read."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from common.messages import Frame
from common.units import NS_PER_S
from shore.exports.utc import BoardClock, Clocks
from shore.logbook.foxglove import event_of
from shore.logbook.log_reader import LogReader, LogRecord
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, SESSION
from shore.navigation.timeline import HORIZON_NS

LOOK_NS: Final = NS_PER_S
"""A frame within this boat time after a decoded one is taken to be of the same start and clock, ns."""
SHOWN_EACH: Final = 2048


class Happened(NamedTuple):
    """An event of the log and the clock of its time."""

    clock: BoardClock
    event: dict[str, Any]
    """The event as a dict of the fields of `Event`."""


@dataclass
class Survey:
    """What one pass finds."""

    start: dict[str, Any] | None = None
    """The first `start` record of `/session`."""
    trip: dict[str, Any] = field(default_factory=dict)
    """Name, place and note of the trip."""
    clocks: Clocks = field(default_factory=lambda: Clocks(None))
    events: list[Happened] = field(default_factory=list)
    estimates: Counter[str] = field(default_factory=Counter)
    """Number of estimates of each filter."""
    frames: int = 0
    late: int = 0
    """Number of frames that came later than a newer one by more than the timeline's horizon."""

    @property
    def live_filters(self) -> tuple[str, ...]:
        """Filters that ran live and have estimates, in the order of the session's options, else in the order found."""
        named = ((self.start or {}).get("options") or {}).get("filters") or ()
        return tuple(dict.fromkeys(name for name in (*named, *self.estimates) if self.estimates[name]))

    @property
    def boat(self) -> str | None:
        """Id of the boat."""
        boat = self.config.get("boat") or {}
        return boat.get("id")

    @property
    def config(self) -> dict[str, Any]:
        """The board's configuration, as it came."""
        return ((self.start or {}).get("connected") or {}).get("config") or {}

    def sensors(self, role: str) -> tuple[dict[str, Any], ...]:
        """Sensors of a role, in the order of the configuration."""
        return tuple(table for table in self.config.get("sensor") or () if table.get("role") == role)


def survey_of(reader: LogReader, shown: Callable[[float], None]) -> Survey:
    """Read the log once; `shown` is called with seconds of the log now and then."""
    pass_ = _Pass(reader)
    for count, record in enumerate(reader.records()):
        pass_.take(record)
        if count % SHOWN_EACH == 0:
            shown(pass_.found.clocks.newest_s)
    return pass_.finish()


class _Pass:
    def __init__(self, reader: LogReader) -> None:
        self._reader = reader
        self.found = Survey()
        self._clock: BoardClock | None = None
        """Clock of the frame that was decoded last."""
        self._looked_ns = 0
        self._newest_ns: dict[int, int] = {}
        """Boat time of the newest frame of each clock, ns, by the clock's number."""
        self._early: list[dict[str, Any]] = []
        """Events from before the first frame."""

    def take(self, record: LogRecord) -> None:
        if record.topic == FRAMES:
            self._frame(record)
        elif record.topic.startswith(ESTIMATES):
            self.found.estimates[record.topic.removeprefix(ESTIMATES)] += 1
        elif record.topic in (EVENTS, SESSION) and (content := self._reader.content(record)) is not None:
            if record.topic == SESSION:
                self._session(content)
            else:
                self._event(event_of(content))

    def finish(self) -> Survey:
        found = self.found
        found.events += [Happened(found.clocks.any(event["t_ns"]), event) for event in self._early]
        found.clocks.settle()
        return found

    def _session(self, record: dict[str, Any]) -> None:
        if record.get("kind") == "start" and self.found.start is None:
            self.found.start = record
            if not self.found.clocks.all:
                self.found.clocks = Clocks(record)
        elif record.get("kind") == "trip":
            self.found.trip |= {name: value for name, value in record.items() if name != "kind"}

    def _frame(self, record: LogRecord) -> None:
        self.found.frames += 1
        t_ns = record.publish_time_ns
        if self._clock is None or not 0 <= t_ns - self._looked_ns < LOOK_NS:
            frame = self._reader.frame(record)
            if frame is None:
                return
            self._look(frame)
        clock = self._clock
        assert clock is not None
        newest_ns = self._newest_ns.get(clock.number, t_ns)
        if t_ns >= newest_ns:
            self._newest_ns[clock.number] = t_ns
            self.found.clocks.came(clock, t_ns, record.log_time_ns)
        self.found.late += t_ns < newest_ns - HORIZON_NS or clock is not self.found.clocks.all[-1]

    def _look(self, frame: Frame) -> None:
        self._clock = self.found.clocks.of_frame(frame)
        self._clock.told(frame)
        self._looked_ns = frame.t1_ns
        for event in self._early:
            self._event(event)
        self._early.clear()

    def _event(self, event: dict[str, Any]) -> None:
        if self._clock is None:
            self._early.append(event)
        else:
            self.found.events.append(Happened(self._clock, event))
