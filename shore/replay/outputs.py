"""What a replay is for beside its counts: a show at the boat's own pace, and a new log."""

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from common.events import line_of
from common.messages import Event, Frame
from common.seqset import SeqSet
from shore.live.status import StatusLine
from shore.logbook.foxglove import event_of
from shore.logbook.read import LogRecord
from shore.logbook.record import LogWriter
from shore.logbook.schemas import LINK, SESSION
from shore.logbook.session import start_record
from shore.replay.run import Played, Replay, Start

LONGEST_SLEEP_S: Final = 0.2


class Missing:
    """Frames between the first and the newest of each start of the daemon that have not come."""

    def __init__(self) -> None:
        self._seen: dict[str, SeqSet] = {}
        self._first: dict[str, int] = {}
        self._last: dict[str, int] = {}
        self._came: dict[str, int] = {}

    def take(self, frame: Frame) -> None:
        """One frame, in any order."""
        boot_id, last = frame.boot_id, frame.seq
        first = last if frame.first_seq is None else frame.first_seq
        if self._seen.setdefault(boot_id, SeqSet()).add(first, last):
            self._came[boot_id] = self._came.get(boot_id, 0) + last - first + 1
        self._first[boot_id] = min(first, self._first.get(boot_id, first))
        self._last[boot_id] = max(last, self._last.get(boot_id, last))

    def count(self) -> int:
        """So far; a backfill takes them away again."""
        return sum(max(0, self._last[boot] - self._first[boot] + 1 - came) for boot, came in self._came.items())


class Show:
    """Lets a replay run at `speed` times the boat's time, and says each second what a live run would say."""

    def __init__(
        self,
        shown_filter: str,
        speed: float,
        say: Callable[[str], None],
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._filter = shown_filter
        self._speed = speed
        self._say = say
        self._now_s, self._sleep = now_s, sleep
        self._start: Start | None = None
        self._status: StatusLine | None = None
        self._begun: tuple[float, float] | None = None
        """Clock and seconds of the log at the first frame."""
        self._next_s = 0.0
        self._received = 0
        self._missing = Missing()

    def take(self, played: Played) -> None:
        """Wait until the frame is due, then show it; late frames wait for nothing."""
        frame, t_s = played.arrival.frame, played.arrival.t_s
        self._wait_for(t_s)
        if self._status is None or played.arrival.start is not self._start:
            self._start = played.arrival.start
            self._status = StatusLine(self._start.config, self._filter)
        self._received += 1
        self._missing.take(frame)
        self._status.take(frame, played.output)
        for happening in (*frame.events, *played.output.events):
            if happening.level != "debug":
                self._say(f"{happening.level}: {line_of(happening)}")

    def _wait_for(self, t_s: float) -> None:
        if self._begun is None:
            self._begun = self._now_s(), t_s
            self._next_s = self._begun[0] + 1.0
        due_s = self._begun[0] + (t_s - self._begun[1]) / self._speed
        while True:
            now_s = self._now_s()
            if now_s >= self._next_s:
                self._next_s = max(self._next_s + 1.0, now_s)
                self._each_second()
            if now_s >= due_s:
                return
            self._sleep(min(due_s - now_s, self._next_s - now_s, LONGEST_SLEEP_S))

    def _each_second(self) -> None:
        if self._status is not None:
            self._say(self._status.text(self._received, self._missing.count()))


class NewLog:
    """Writes a replay as a log like any other: the same frames and sessions, new estimates and events.

    with NewLog(path, run) as log: ... log.take(played) ... log.finish()
    Without `finish` nothing is left behind.
    """

    def __init__(self, path: Path, run: Replay) -> None:
        """Raises WayfixError when `path` exists or cannot be written."""
        self._run = run
        self._writer = LogWriter.at(path)
        self._start: Start | None = None
        self._t_ns = 0
        self._is_finished = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._is_finished:
            self._writer.abandon()

    def take(self, played: Played) -> None:
        """One frame and what it led to. Raises WayfixError when the disk is full."""
        arrival = played.arrival
        frame, self._t_ns = arrival.frame, arrival.log_time_ns
        if arrival.start is not self._start:
            self._start = arrival.start
            self._writer.write_session(self._session(arrival.start), self._t_ns)
        self._pass_on(played.passed)
        self._writer.write_frame(arrival.data, frame, self._t_ns)
        for record in played.records:
            self._writer.write_estimate(record, self._t_ns)
        for event in (*frame.events, *played.output.events):
            self._writer.write_event(event, self._t_ns)

    def finish(self) -> None:
        """The end of the log; it appears under its name."""
        self._pass_on(self._run.take_passed())
        end = {"kind": "end", "received": self._run.frames, "reason": "replayed", "damage": self._run.damage}
        self._writer.write_session(end, self._t_ns)
        self._writer.close()
        self._is_finished = True

    def _session(self, start: Start) -> dict[str, Any]:
        asked = {
            **start.options,
            "filters": list(self._run.filters),
            "step_s": self._run.step_s,
            "order": self._run.order,
            "replayed_from": self._run.reader.path.name,
        }
        return start_record(start.record["connected"], asked, start.record.get("utc_ns", self._t_ns))

    def _pass_on(self, records: tuple[LogRecord, ...]) -> None:
        for record in records:
            t_ns = min(record.log_time_ns, self._t_ns)
            if record.topic == LINK:
                self._writer.write_link(record.json(), t_ns)
            elif record.topic == SESSION:
                self._writer.write_session(record.json(), t_ns)
            else:
                self._writer.write_event(Event(**event_of(record.json())), t_ns)
