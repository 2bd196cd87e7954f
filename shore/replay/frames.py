"""Frame source of a replay: the frames of a log, in order of arrival or of boat time, each with its session.

One pass: memory does not grow with the log, but for 40 bytes a frame in order of time.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Final, NamedTuple

from common.boat_config import BoatConfig
from common.boat_start import BoatStart, StartOrder
from common.codec import decode_frame
from common.errors import WayfixError
from common.messages import Frame
from common.settings import convert
from common.units import NS_PER_S
from shore.logbook.greetings import COMPLETED, take_greeting
from shore.logbook.log_reader import LogReader, LogRecord
from shore.logbook.schemas import FRAMES, SESSION
from shore.navigation.timeline import HORIZON_NS
from shore.replay.boat_time_order import FramesByTime
from shore.replay.injection import Injection
from shore.watchers.watcher import Arrival, RunSeconds, Start

ORDERS: Final = ("arrival", "time")
"""Orders of the frames: by arrival, as live, or by boat time, so that late backfill is in its place."""


class Span(NamedTuple):
    """A part of a log, in seconds of boat time since its first frame; a reboot of the board does not stop them."""

    from_s: float | None = None
    to_s: float | None = None


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

    def __init__(
        self, reader: LogReader, order: str = "arrival", span: Span | None = None, inject: Sequence[str] = ()
    ) -> None:
        """inject: faults of sensors that the log did not have.

        Raises WayfixError for a log without configuration, and for a fault that does not fit the boat.
        """
        self.start = session_start(reader, reader.path)
        self.bad = 0
        """Number of frames that could not be decoded."""
        self.late = 0
        """Number of frames later than the timeline can rewind; they are fused in order of time only."""
        self._reader = reader
        self._order = order
        self._span = span or Span()
        self.starts = StartOrder()
        """Order of the board's starts, as far as the log has been read."""
        self._injection = Injection(inject, self.start.config) if inject else None

    @property
    def injected(self) -> dict[str, int]:
        """Number of readings that each injected fault has changed so far, by its sentence."""
        return {} if self._injection is None else self._injection.counts

    def __iter__(self) -> Iterator[Arrival]:
        return (item for item in self.read() if isinstance(item, Arrival))

    def read(self, *topics: str) -> Iterator[Arrival | LogRecord]:
        """Frames within the span, and records of `topics` between them (in order of time before all frames)."""
        items = self._in_file_order(topics) if self._order == "arrival" else self._in_order_of_time(topics)
        seconds, (from_s, to_s) = RunSeconds(), self._span
        has_begun = from_s is None
        for item in items:
            if isinstance(item, LogRecord):
                if has_begun or item.topic == SESSION:
                    yield item
                continue
            t_s = seconds.at(item.frame)
            if to_s is not None and t_s > to_s:
                return
            timed = item._replace(t_s=t_s)
            given = timed if self._injection is None else self._injection.spoil(timed)
            if from_s is None or t_s >= from_s:
                has_begun = True
                yield given

    def _in_file_order(self, topics: Iterable[str]) -> Iterator[Arrival | LogRecord]:
        start, is_first, is_live = self.start, True, True
        newest: Frame | None = None
        for record in self._reader.records(SESSION, FRAMES, *topics):
            if record.topic != FRAMES:
                if record.topic == SESSION:
                    session = self._reader.content(record)
                    if session is None:
                        continue
                    take_greeting(self.starts, session)
                    if session["kind"] == "start":
                        start = start if is_first else _start(session, self._reader.path)
                        is_first = False
                    is_live = is_live and session["kind"] != COMPLETED
                yield record
                continue
            frame = self._reader.frame(record)
            if frame is None:
                self.bad += 1
                continue
            if newest is None or self._is_newer(frame, newest):
                newest = frame
            is_late = frame.clock_id != newest.clock_id or frame.t1_ns < newest.t1_ns - HORIZON_NS
            self.late += is_late or not is_live
            yield Arrival(record.data, frame, start, record.log_time_ns, 0.0, is_live)

    def _is_newer(self, frame: Frame, newest: Frame) -> bool:
        if frame.clock_id == newest.clock_id:
            return frame.t1_ns > newest.t1_ns
        return not self.starts.is_before(BoatStart.of(frame), BoatStart.of(newest))

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
            seconds = RunSeconds()
            for data, group in sorter.sorted(self.starts):
                frame = decode_frame(data)
                # As if it had come at once: its own time of arrival would not grow along the log.
                log_time_ns = (first_ns or 0) + round(seconds.at(frame) * NS_PER_S)
                yield Arrival(data, frame, starts[group], log_time_ns, 0.0)
