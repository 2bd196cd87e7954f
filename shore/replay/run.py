"""Replay: the recorded frames through the very pipeline that ran live, in order of arrival or of boat time.

    run = Replay(Path("20261122T140055Z-springer.mcap"))
    for played in run: ...                      # one frame and what it led to; nothing of it is kept
    run.comparison.estimates.equal, run.late

One pass: memory does not grow with the log, but for 40 bytes a frame in order of time.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, NamedTuple

from common.boat_start import BoatStart
from common.codec import decode_frame
from common.errors import WayfixError
from common.events import is_of_station
from common.messages import Frame
from common.sensors import BoatConfig
from common.settings import convert
from common.units import NS_PER_S
from shore.logbook.foxglove import event_of
from shore.logbook.read import LogReader, LogRecord, read_log
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, LINK, SESSION
from shore.navigation.estimate import Estimate
from shore.navigation.timeline import HORIZON_NS
from shore.pipeline import Output, Pipeline
from shore.replay.boat_order import FramesByTime
from shore.replay.comparison import Comparison
from shore.replay.smooth import smooth_log

ORDERS: Final = ("arrival", "time")
"""As live, every frame when it came; by boat time, so that late backfill is in its place."""
KEPT_KINDS: Final = ("trip", "operator")
"""Session records that a replay passes on."""


@dataclass(frozen=True, slots=True)
class Start:
    """A session record of kind `start`: what a live run begins with, and once more after a new configuration."""

    record: dict[str, Any]
    config: BoatConfig

    @property
    def options(self) -> dict[str, Any]:
        """What the live run was asked for."""
        return dict(self.record.get("options") or {})


class Span(NamedTuple):
    """A part of a log, in seconds of boat time since its first frame; a reboot of the board does not stop them."""

    from_s: float | None = None
    to_s: float | None = None


class Arrival(NamedTuple):
    """A frame, its bytes, and the session of the board that sent it."""

    data: bytes
    frame: Frame
    start: Start
    log_time_ns: int
    t_s: float
    """Seconds of the log, at the frame's end."""


class Played(NamedTuple):
    """A frame and what it led to."""

    arrival: Arrival
    output: Output
    records: list[dict[str, Any]]
    """`Estimate.as_record()` of each filter."""
    passed: tuple[LogRecord, ...]
    """What the log says since the frame before and no replay makes: trip, operator, link and the link's own events."""


class LogSeconds:
    """Seconds of boat time since the first frame; where the board's clock begins again they go on."""

    def __init__(self) -> None:
        self._begins: dict[str, tuple[int, float]] = {}
        """clock_id -> boat time of its first frame, seconds of the log then."""
        self.newest_s = 0.0

    def at(self, frame: Frame) -> float:
        """At the frame's end; negative for one from before the first."""
        first_ns, begin_s = self._begins.setdefault(frame.clock_id, (frame.t0_ns, self.newest_s))
        t_s = begin_s + (frame.t1_ns - first_ns) / NS_PER_S
        self.newest_s = max(self.newest_s, t_s)
        return t_s


def session_start(reader: LogReader, path: Path) -> Start:
    """The record a live run begins with; raises WayfixError for a log without one."""
    for record in reader.session():
        if record.get("kind") == "start":
            return _start(record, path)
    damage = f": {reader.damage}" if reader.damage else ""
    what = f"has no session record, so its sensors are unknown{damage}"
    raise WayfixError(what, str(path), "give a log of `wayfix connect`")


def _start(record: dict[str, Any], path: Path) -> Start:
    config = (record.get("connected") or {}).get("config")
    if config is None:
        what = "has no configuration of the board in its session record"
        raise WayfixError(what, str(path), "give a log of `wayfix connect` or `wayfix import`")
    return Start(record, convert(config, BoatConfig, f"configuration in {path}", strict=False))


def logged_config(reader: LogReader, path: Path) -> BoatConfig:
    """The board's configuration at the start of the log; raises WayfixError for a log without one."""
    return session_start(reader, path).config


class Frames:
    """The frames of one log in either order, counted; records beside them go to `beside`."""

    def __init__(self, reader: LogReader, order: str = "arrival", span: Span | None = None) -> None:
        """Raises WayfixError for a log without configuration."""
        self.start = session_start(reader, reader.path)
        self.bad = 0
        """Frames that could not be decoded."""
        self.late = 0
        """Frames that came later than the timeline rewinds; fused in order of time only."""
        self._reader = reader
        self._order = order
        self._span = span or Span()

    def __iter__(self) -> Iterator[Arrival]:
        return (item for item in self.read() if isinstance(item, Arrival))

    def read(self, *topics: str) -> Iterator[Arrival | LogRecord]:
        """Frames within the span, and records of `topics` between them (in order of time before all frames)."""
        items = self._in_file_order(topics) if self._order == "arrival" else self._in_order_of_time(topics)
        seconds, (from_s, to_s) = LogSeconds(), self._span
        has_begun = from_s is None
        for item in items:
            if isinstance(item, LogRecord):
                if has_begun or item.topic == SESSION:
                    yield item
                continue
            t_s = seconds.at(item.frame)
            if to_s is not None and t_s > to_s:
                return
            if from_s is None or t_s >= from_s:
                has_begun = True
                yield item._replace(t_s=t_s)

    def _in_file_order(self, topics: Iterable[str]) -> Iterator[Arrival | LogRecord]:
        start, is_first = self.start, True
        newest: Frame | None = None
        for record in self._reader.records(SESSION, FRAMES, *topics):
            if record.topic != FRAMES:
                if record.topic == SESSION:
                    session = self._reader.content(record)
                    if session is None:
                        continue
                    if session["kind"] == "start":
                        start = start if is_first else _start(session, self._reader.path)
                        is_first = False
                yield record
                continue
            frame = self._reader.frame(record)
            if frame is None:
                self.bad += 1
                continue
            if newest is None or _is_newer(frame, newest):
                newest = frame
            self.late += frame.clock_id != newest.clock_id or frame.t1_ns < newest.t1_ns - HORIZON_NS
            yield Arrival(record.data, frame, start, record.log_time_ns, 0.0)

    def _in_order_of_time(self, topics: Iterable[str]) -> Iterator[Arrival | LogRecord]:
        """A start of the daemon has one configuration: the one under which its first frame came."""
        sessions: dict[str, int] = {}
        starts: list[Start] = []
        with closing(FramesByTime()) as sorter:
            first_ns: int | None = None
            for item in self._in_file_order(topics):
                if isinstance(item, LogRecord):
                    yield item
                    continue
                first_ns = item.log_time_ns if first_ns is None else first_ns
                if item.frame.boot_id not in sessions:
                    sessions[item.frame.boot_id] = len(starts)
                    same = (start for start in starts if start.config == item.start.config)
                    starts.append(next(same, item.start))
                sorter.add(item.data, item.frame, sessions[item.frame.boot_id])
            seconds = LogSeconds()
            for data, group in sorter:
                frame = decode_frame(data)
                # As if it had come at once: its own time of arrival would not grow along the log.
                log_time_ns = (first_ns or 0) + round(seconds.at(frame) * NS_PER_S)
                yield Arrival(data, frame, starts[group], log_time_ns, 0.0)


def _is_newer(frame: Frame, newest: Frame) -> bool:
    if frame.clock_id == newest.clock_id:
        return frame.t1_ns > newest.t1_ns
    return not BoatStart.of(frame).is_before(BoatStart.of(newest))


class Replay:
    """One replay of a log: iterate over it once, then read what was counted."""

    def __init__(
        self,
        path: Path,
        filters: Sequence[str] | None = None,
        step_s: float | None = None,
        order: str = "arrival",
        span: Span | None = None,
    ) -> None:
        """Filters and step default to those of the live run. Raises WayfixError: no log, no configuration, filters."""
        self.reader = read_log(path)
        self.source = Frames(self.reader, order, span)
        options = self.source.start.options
        live, live_step_s = tuple(options.get("filters") or ()), options.get("step_s")
        self.filters = tuple(filters or live)
        self.step_s = live_step_s if step_s is None else step_s
        self.order = order
        self.frames = 0
        self.estimates = 0
        self.why_not: str | None = None
        """Why nothing is compared with what was recorded."""
        if order == "time":
            self.why_not = "no live run could have made estimates in order of boat time"
        elif self.step_s != live_step_s:
            self.why_not = "the step is another"
        elif span is not None and span.from_s:
            self.why_not = "the filters began at --from"
        elif not set(self.filters) & set(live):
            self.why_not = "other filters ran"
        both = tuple(name for name in self.filters if name in live)
        self.comparison: Comparison | None = None
        if self.why_not is None:
            self.comparison = Comparison(both, self.reader.content, events=self.filters == live)
        self._pipeline = self._new_pipeline(self.source.start)
        self._passed: list[LogRecord] = []

    @property
    def start(self) -> Start:
        """What the log begins with."""
        return self.source.start

    @property
    def damage(self) -> str | None:
        """Why the log ends early, if it does; complete after the last frame."""
        return self.reader.damage

    def __iter__(self) -> Iterator[Played]:
        start = self.start
        estimates = [f"{ESTIMATES}{name}" for name in self.filters] if self.comparison else []
        for item in self.source.read(EVENTS, LINK, *estimates):
            if isinstance(item, LogRecord):
                self._beside(item)
                continue
            if item.start is not start:
                # A board that came back with another configuration: the live run began anew there.
                start, self._pipeline = item.start, self._new_pipeline(item.start)
            output = self._pipeline.push(item.frame)
            records = [estimate.as_record() for estimate in output.estimates]
            self.frames += 1
            self.estimates += len(records)
            if self.comparison:
                self.comparison.take(item.frame, item.t_s, records, (*item.frame.events, *output.events))
            yield Played(item, output, records, self.take_passed())
        if self.comparison:
            self.comparison.finish()

    def take_passed(self) -> tuple[LogRecord, ...]:
        """What the log says and no replay makes, since the last call; after the last frame there may be some more."""
        passed = tuple(self._passed)
        self._passed.clear()
        return passed

    def _new_pipeline(self, start: Start) -> Pipeline:
        return Pipeline(start.config, self.filters, self.step_s)

    def _beside(self, record: LogRecord) -> None:
        if record.topic.startswith(ESTIMATES):
            if self.comparison:
                self.comparison.estimate(record)
        elif (content := self.reader.content(record)) is not None and self._is_passed(record.topic, content):
            self._passed.append(record)

    def _is_passed(self, topic: str, content: dict[str, Any]) -> bool:
        if topic == SESSION:
            return content["kind"] in KEPT_KINDS
        if topic == LINK:
            return self.order == "arrival"
        event = event_of(content)
        if self.comparison:
            self.comparison.event(event)
        return self.order == "arrival" and is_of_station(event["code"])


def smoothed(path: Path, name: str, span: Span | None = None) -> Iterator[Estimate]:
    """The log's track by filter `name` with every estimate knowing the whole log; frames in order of boat time.

    All states of a session are in memory at once. Raises: WayfixError for a log without configuration or an unknown
    filter.
    """
    arrivals = Frames(read_log(path), "time", span)
    for start, group in groupby(arrivals, key=attrgetter("start")):
        yield from smooth_log(start.config, (arrival.frame for arrival in group), name)
