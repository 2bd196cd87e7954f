"""Log of a live run: synced to the disk each second, with a checkpoint (the cursor) of the frames that it holds."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.errors import WayfixError
from shore.live.cursor import Cursor
from shore.logbook.background_writer import LogRecorder
from shore.watchers.log import LogWatcher
from shore.watchers.watcher import Start


class LiveLog(LogWatcher):
    """A log whose disk may be full or slow without harm to the run. Without a directory nothing is kept."""

    def __init__(self, directory: Path | None, boat_id: str, cursor: Cursor | None, say: Callable[[str], None]) -> None:
        """Raises WayfixError when the directory cannot be written."""
        self._recorder = LogRecorder(directory, boat_id, say)
        self._cursor = cursor
        super().__init__(self._recorder.write)

    @property
    def path(self) -> Path | None:
        """The file, when one is written."""
        return self._recorder.path

    @property
    def fault(self) -> WayfixError | None:
        """Why the log ended before the run, if it did."""
        return self._recorder.fault

    @property
    def behind_s(self) -> float:
        """How long the disk has been busy with what it was given last; 0.0 when it is done."""
        return self._recorder.behind_s

    def begin(self, start: Start, t_ns: int) -> None:
        """Write the session record and the first checkpoint."""
        super().begin(start, t_ns)
        self.checkpoint()

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """Write the `end` record, wait for the disk, and close."""
        super().end(tally, t_ns)
        self.checkpoint(wait=True)
        self._recorder.close()
        if self._cursor is not None:
            self._cursor.close()

    def checkpoint(self, *, wait: bool = False) -> None:
        """Sync the log beside the run, then write the cursor; `wait` for both.

        A cursor that cannot be written costs frames that are sent twice.
        """
        if self._cursor is None or self._recorder.path is None:
            self._recorder.sync(lambda: None, wait=wait)
        else:
            self._recorder.sync(self._cursor.saver(self._recorder.path, self._recorder.log_time_ns), wait=wait)
