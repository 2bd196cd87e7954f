"""Observer interface between a source of frames and all that looks at them.

    source (live run, replay, import) -> pipeline -> Step -> watchers (log, status line, score, ...)

A source is a loop: it takes frames where they come from, pushes each through the pipeline, and hands the step to its
watchers, which know nothing of each other or of the source. They are called in one thread, in their order.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple, Self

from common.boat_config import BoatConfig
from common.messages import Event, Frame
from common.units import NS_PER_S
from shore.link.catching_up import CatchingUp
from shore.logbook.holes import Holes
from shore.pipeline import Output


@dataclass(frozen=True, slots=True)
class Start:
    """Session under which frames come: its `start` record, which comes again with a new configuration."""

    record: dict[str, Any]
    config: BoatConfig

    @property
    def options(self) -> dict[str, Any]:
        """What the run was asked for."""
        return dict(self.record.get("options") or {})


class RunSeconds:
    """Seconds of boat time since the first frame; where the board's clock begins again they go on."""

    def __init__(self) -> None:
        self._begins: dict[str, tuple[int, float]] = {}
        """Boat time (ns) of the first frame of each clock and the seconds of the run then, by clock_id."""
        self.newest_s = 0.0

    def at(self, frame: Frame) -> float:
        """Seconds of the run at the frame's end; negative for a frame from before the first."""
        first_ns, begin_s = self._begins.setdefault(frame.clock_id, (frame.t0_ns, self.newest_s))
        t_s = begin_s + (frame.t1_ns - first_ns) / NS_PER_S
        self.newest_s = max(self.newest_s, t_s)
        return t_s


class Arrival(NamedTuple):
    """A frame that came."""

    data: bytes
    """The frame's bytes exactly as they were sent."""
    frame: Frame
    start: Start
    """The session that the frame belongs to."""
    log_time_ns: int
    """Time of arrival, the station's UTC, ns."""
    t_s: float = 0.0
    """Seconds of the run at the frame's end."""
    is_live: bool = True
    """False for a frame that came after the end of its trip: no filter of the live run was given it."""


class Step(NamedTuple):
    """One frame and what it led to: the first fields of `Arrival`, and the pipeline's output."""

    data: bytes
    frame: Frame
    start: Start
    log_time_ns: int
    t_s: float
    output: Output
    records: tuple[dict[str, Any], ...]
    """Records of the estimates, `Estimate.as_record()` of each filter."""

    @classmethod
    def of(cls, arrival: Arrival, output: Output) -> Self:
        """The step that a frame and the pipeline's output make."""
        return cls(*arrival[:5], output, tuple(estimate.as_record() for estimate in output.estimates))

    @property
    def events(self) -> tuple[Event, ...]:
        """Events of the board and the pipeline that come with this frame."""
        return *self.frame.events, *self.output.events


class BoardNow(NamedTuple):
    """The clock of the board as it runs now."""

    clock_id: str
    t_ns: int | None
    """What it shows now at least, ns; `None` = not known."""


@dataclass(frozen=True, slots=True)
class SourceState:
    """How the source itself is doing, once a second."""

    received: int
    """Number of frames received so far."""
    missing: int
    """Number of frames that are still to come."""
    lost: int = 0
    """Number of frames that never come."""
    lost_s: float | None = None
    """How long the link has been lost, s; `None` = it is not lost."""
    refusal: str | None = None
    """Why the station's handshake is refused, while the link is lost."""
    round_trip_ms: float | None = None
    has_log: bool = True
    """False once the log has ended before the run."""
    catching_up: CatchingUp | None = None
    """What is missing, and how long it takes to come; `None` = nothing is, or nobody knows."""
    not_stored: int = 0
    """Number of frames that came when the log had ended."""
    board_now: BoardNow | None = None
    """The board's clock; `None` = it is not known which one runs."""

    @property
    def holes(self) -> Holes:
        """What is not here, or not in the log."""
        return Holes(self.missing, self.lost, self.not_stored)


class Watcher:
    """What looks at a run. A watcher derives from this and overrides what it cares for; the rest does nothing."""

    def begin(self, start: Start, t_ns: int) -> None:
        """A session begins: before its first step, and once more with another configuration. t_ns: station's UTC."""

    def take(self, step: Step) -> None:
        """One frame and what it led to, in order of arrival."""

    def happened(self, event: Event, t_ns: int) -> None:
        """The source says something of itself (the link was lost). t_ns: station's UTC."""

    def note(self, topic: str, record: dict[str, Any], t_ns: int) -> None:
        """Something beside the frames that a log keeps: the trip's words, the link's end. topic: of the log."""

    def each_second(self, now: SourceState) -> None:
        """Once a second of a live run or of a replay at a speed, whether frames come or not."""

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """The run is over. tally: counts and reason, as the log's `end` record holds them."""


class Watchers(Watcher):
    """Composite watcher: several watchers as one, in their order."""

    def __init__(self, *watchers: Watcher) -> None:
        self._watchers = watchers

    def begin(self, start: Start, t_ns: int) -> None:
        """Call `begin` of each watcher."""
        for watcher in self._watchers:
            watcher.begin(start, t_ns)

    def take(self, step: Step) -> None:
        """Call `take` of each watcher."""
        for watcher in self._watchers:
            watcher.take(step)

    def happened(self, event: Event, t_ns: int) -> None:
        """Call `happened` of each watcher."""
        for watcher in self._watchers:
            watcher.happened(event, t_ns)

    def note(self, topic: str, record: dict[str, Any], t_ns: int) -> None:
        """Call `note` of each watcher."""
        for watcher in self._watchers:
            watcher.note(topic, record, t_ns)

    def each_second(self, now: SourceState) -> None:
        """Call `each_second` of each watcher."""
        for watcher in self._watchers:
            watcher.each_second(now)

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """Call `end` of each watcher."""
        for watcher in self._watchers:
            watcher.end(tally, t_ns)
