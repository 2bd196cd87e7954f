"""Asynchronous log writer of a live run: a disk that is full or slow harms the log, never the run."""

import os
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Final

from common.clock import boottime_ns
from common.errors import WayfixError
from common.units import NS_PER_S
from shore.logbook.log_writer import LogWriter, new_log

RETRY_S: Final = 5.0
"""Time after which a log that has ended is followed by another one, s: a disk may have a moment of weakness."""
LONGEST_RETRY_S: Final = 60.0


class LogRecorder:
    """Writes records at once, and syncs to the disk beside the run. Without a directory it keeps nothing."""

    def __init__(self, directory: Path | None, boat_id: str, say: Callable[[str], None]) -> None:
        """Raises WayfixError when the directory cannot be written."""
        self.path: Path | None = None
        self.fault: WayfixError | None = None
        """Why the log ended before the run; `None` while it has not."""
        self._say = say
        self._writer: LogWriter | None = None
        self._failed: LogWriter | None = None
        """The writer of the log that ended before the run."""
        self._before: tuple[Path, LogWriter | None] | None = None
        """The log before this one, and its writer if it had ended; `None` = this is the first."""
        self._worker = ThreadPoolExecutor(1, "log-sync")
        self._delay_s = RETRY_S
        self._retry_ns = 0
        self._syncing: Future[None] | None = None
        self._since_ns = boottime_ns()
        self._boat_id = boat_id
        self._began_ns = time.time_ns()
        if directory is not None:
            self._writer = new_log(directory, boat_id, self._began_ns)
            self.path = self._writer.path

    @property
    def log_time_ns(self) -> int:
        """Log time of the newest record, ns; 0 without a log."""
        return 0 if self._writer is None else self._writer.log_time_ns

    @property
    def is_gone(self) -> bool:
        """True when what is, or was, written has no name any more: the log or its directory was removed or moved."""
        writer = self._writer or self._failed
        return writer is not None and writer.is_gone

    @property
    def wants_another(self) -> bool:
        """True when it is time for another log: this one is gone, or has ended some seconds ago."""
        return self.is_gone if self._failed is None else boottime_ns() >= self._retry_ns

    def begin_again(self) -> None:
        """Begin another log in the directory of one that is gone, or has ended; where that cannot be, the log ends.

        Of a log that has ended (a disk that was pulled out) that is tried without a word.
        """
        assert self.path is not None
        self.write(self._finish_sync)
        began_ns = time.time_ns()
        self._wait_longer()
        try:
            writer = new_log(self.path.parent, self._boat_id, began_ns)
        except WayfixError as error:
            if self._writer is not None:
                self._fail(error)
            return
        if self._writer is None:
            self._worker = ThreadPoolExecutor(1, "log-sync")
        else:
            self._writer.abandon()
        self._before = self.path, self._failed
        self._writer, self._failed, self.fault = writer, None, None
        self._began_ns, self.path = began_ns, writer.path

    @property
    def behind_s(self) -> float:
        """How long the disk has been working on what `sync` gave it; 0.0 when it is done."""
        if self._syncing is None or self._syncing.done():
            return 0.0
        return (boottime_ns() - self._since_ns) / NS_PER_S

    def write(self, action: Callable[[LogWriter], None]) -> None:
        """Do something with the writer, while there is one."""
        if self._writer is None:
            return
        try:
            action(self._writer)
        except WayfixError as error:
            self._fail(error)

    def sync(self, then: Callable[[], Callable[[], None]] | None = None, *, wait: bool = False) -> None:
        """Put on the disk what is written so far.

        then: is asked for what to do behind that, in another thread, where its OSError is no matter. Returns at once,
        and does nothing while the disk still works on the sync before, unless it is to wait for that.
        """
        if wait or self._syncing is None or self._syncing.done():
            self.write(lambda writer: self._sync(writer, then))

    def name_by_boat(self) -> tuple[str, str] | None:
        """Let `close` name the log by the boat's UTC where the station's is wrong; returns the old and new name."""
        if self._writer is None or self.path is None:
            return None
        named = self._writer.name_by_boat(self._boat_id, self._began_ns)
        if named is None:
            return None
        before, self.path = self.path.name, named
        return before, named.name

    def close(self) -> None:
        """Wait for the disk and close the log; safe to call twice."""
        self.write(self._finish_sync)
        self.write(LogWriter.close)
        self._writer = self._failed = None
        self._worker.shutdown()

    def _sync(self, writer: LogWriter, then: Callable[[], Callable[[], None]] | None) -> None:
        self._finish_sync(writer)
        flushed, after = writer.flush(), then() if then is not None else None
        self._since_ns = boottime_ns()

        def work() -> None:
            os.fsync(flushed)
            if after is not None:
                with suppress(OSError):
                    after()

        self._syncing = self._worker.submit(work)

    def _finish_sync(self, writer: LogWriter) -> None:
        if self._syncing is not None:
            writer.guarded(self._syncing.result)
            self._syncing, self._delay_s = None, RETRY_S

    def _fail(self, error: WayfixError) -> None:
        self.fault = error
        self._say(f"error: log: {error}; the run goes on without a log")
        self._failed, self._writer, self._syncing = self._writer, None, None
        self._worker.shutdown()  # the file stays open while the worker uses it
        self._wait_longer()
        if self._failed is not None:
            with suppress(WayfixError):
                self._failed.close()
            if self._failed.remove_without_frames() and self._before is not None:
                self.path, self._failed = self._before  # it is still that one which has ended

    def _wait_longer(self) -> None:
        self._retry_ns = boottime_ns() + round(self._delay_s * NS_PER_S)
        self._delay_s = min(LONGEST_RETRY_S, 2.0 * self._delay_s)
