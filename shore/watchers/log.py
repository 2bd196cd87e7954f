"""Log watchers: every frame with its bytes, estimates, events and sessions, in the order in which they came."""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from common.messages import Event
from shore.logbook.foxglove import event_of
from shore.logbook.log_writer import LogWriter, log_at
from shore.logbook.schemas import EVENTS, LINK, SESSION
from shore.watchers.watcher import Start, Step, Watcher

Write = Callable[[Callable[[LogWriter], None]], None]
"""Does something with the writer of a log; raises WayfixError, or keeps a fault of the disk from the run."""


class LogWatcher(Watcher):
    """Writes all it sees."""

    def __init__(self, write: Write) -> None:
        self._write = write

    def begin(self, start: Start, t_ns: int) -> None:
        """Write the session record, which is on the disk when this returns."""
        self._write(lambda writer: writer.write_session(start.record, t_ns))

    def take(self, step: Step) -> None:
        """Write the frame's bytes first, then what it led to."""
        self._write(lambda writer: _write_step(writer, step))

    def happened(self, event: Event, t_ns: int) -> None:
        """Write an event of the source."""
        self._write(lambda writer: writer.write_event(event, t_ns))

    def note(self, topic: str, record: dict[str, Any], t_ns: int) -> None:
        """Write a record of `/session`, `/link` or (events that were recorded before) `/events`."""
        if topic == SESSION:
            self._write(lambda writer: writer.write_session(record, t_ns))
        elif topic == LINK:
            self._write(lambda writer: writer.write_link(record, t_ns))
        elif topic == EVENTS:
            self.happened(Event(**event_of(record)), t_ns)

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """Write the `end` record."""
        self._write(lambda writer: writer.write_session({"kind": "end", **tally}, t_ns))


class WholeLog(LogWatcher):
    """A log that appears under its name only when the run has ended in order.

    with WholeLog(path) as log: source.run(Watchers(log, ...))
    A run that ends in any other way leaves nothing behind.
    """

    def __init__(self, path: Path) -> None:
        """Raises WayfixError when `path` exists or cannot be written."""
        self._writer = log_at(path)
        super().__init__(lambda action: action(self._writer))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.abandon()  # harmless to a log that is closed

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """End the log, which then appears under its name. Raises WayfixError when the disk is full."""
        super().end(tally, t_ns)
        self._writer.close()


def _write_step(writer: LogWriter, step: Step) -> None:
    writer.write_frame(step.data, step.frame, step.log_time_ns)
    for record in step.records:
        writer.write_estimate(record, step.log_time_ns)
    for event in step.events:
        writer.write_event(event, step.log_time_ns)
