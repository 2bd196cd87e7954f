"""Log of a live run: synced to the disk each second, with a checkpoint (the cursor) of the frames that it holds."""

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from common.errors import WayfixError
from common.link_messages import FrameRange
from shore.live.cursor import Cursor
from shore.live.earlier_trips import EarlierTrips
from shore.logbook.background_writer import LogRecorder
from shore.logbook.greetings import GREETED, greeted_record
from shore.logbook.schemas import SESSION
from shore.watchers.log import LogWatcher
from shore.watchers.watcher import Arrival, Start


class LiveLog(LogWatcher):
    """A log whose disk may be full or slow without harm to the run. Without a directory nothing is kept."""

    def __init__(self, directory: Path | None, boat_id: str, cursor: Cursor | None, say: Callable[[str], None]) -> None:
        """Raises WayfixError when the directory cannot be written."""
        self._recorder = LogRecorder(directory, boat_id, say)
        self._say = say
        self._cursor = cursor
        self._earlier = None if directory is None else EarlierTrips(directory)
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
        self._greeted(greeted_record(start.record["connected"]), t_ns)
        self.checkpoint()

    def note(self, topic: str, record: dict[str, Any], t_ns: int) -> None:
        """Write a record; a greeting of the board also beside the frames of earlier trips."""
        super().note(topic, record, t_ns)
        if topic == SESSION and record.get("kind") == GREETED:
            self._greeted(record, t_ns)

    def _greeted(self, record: dict[str, Any], t_ns: int) -> None:
        if (earlier := self._earlier) is not None:
            self._recorder.write(lambda _own: earlier.greeted(record, t_ns))

    @property
    def is_gone(self) -> bool:
        """True when the log or its directory was removed or moved while it is written."""
        return self._recorder.is_gone

    @property
    def wants_another(self) -> bool:
        """True when it is time for another log: this one is gone, or has ended some seconds ago."""
        return self._recorder.wants_another

    def begin_again(self, start: Start, t_ns: int) -> set[str]:
        """Begin another log in place of one that is gone, or has ended; returns the earlier trips that are gone too.

        There is no checkpoint before the ledger has forgotten these trips: it would claim frames that no log holds.
        """
        self._recorder.begin_again()
        if self._earlier is None or self.fault is not None:
            return set()
        gone = self._earlier.drop_gone()
        if (cursor := self._cursor) is not None:
            self._recorder.write(lambda _own: cursor.claim())
        super().begin(start, t_ns)
        return gone

    @property
    def held_late(self) -> Iterable[FrameRange]:
        """Frames of earlier trips that came in this session, and lie beside these."""
        return () if self._earlier is None else self._earlier.held

    def complete(self, trip: str, arrival: Arrival) -> None:
        """Keep a frame of an earlier trip, the one whose log has this name."""
        if (earlier := self._earlier) is not None:
            self._recorder.write(lambda _own: earlier.take(trip, arrival))

    def end(self, tally: dict[str, Any], t_ns: int) -> None:
        """Write the `end` record, wait for the disk, and close."""
        super().end(tally, t_ns)
        if (earlier := self._earlier) is not None and (cursor := self._cursor) is not None:
            self._recorder.write(lambda _own: earlier.end(cursor.ledger.holes_of, t_ns))
        if (names := self._recorder.name_by_boat()) is not None:
            self._say(f"this station's clock is not the boat's UTC: the log is {names[1]}")
            if self._cursor is not None:  # it is written before the log has that name: whatever happens, it says enough
                self._cursor.ledger.rename_trip(*names)
        self.checkpoint(wait=True)
        self._recorder.close()
        if self._cursor is not None:
            self._cursor.close()

    def checkpoint(self, *, wait: bool = False) -> None:
        """Sync the log beside the run, then write the cursor; `wait` for both.

        A cursor that cannot be written costs frames that are sent twice.
        """
        self._recorder.sync(None if self._cursor is None else self._saver, wait=wait)

    def _saver(self) -> Callable[[], None]:
        """What writes the cursor, behind the late frames that it claims."""
        assert self._cursor is not None
        assert self._earlier is not None
        assert self._recorder.path is not None
        save = self._cursor.saver(self._recorder.path, self._recorder.log_time_ns)
        late = self._earlier.flush()

        def save_behind_late() -> None:
            for descriptor in late:
                os.fsync(descriptor)
            save()

        return save_behind_late
