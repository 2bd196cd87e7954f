"""Late frames (backfill) of earlier trips: kept beside each trip while they come, then put into its log.

Whose trip a frame is the ledger decides (`shore/link/frame_ledger.py`). What is of an earlier one goes past filters and
screen into `<trip>-late.mcap`, a log like any other. Where the program dies, the next session finds it there.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from common.errors import WayfixError
from common.link_messages import FrameRange
from common.seqset import SeqSet
from common.words import counted
from shore.logbook.lock import is_being_written, turn_in
from shore.logbook.log_reader import late_logs, read_log
from shore.logbook.log_writer import LogWriter, late_log
from shore.pipeline import Output
from shore.terminal import every_end_is_ctrl_c
from shore.trips.complete import complete
from shore.watchers.log import LogWatcher
from shore.watchers.watcher import Arrival, Step

LONG_BYTES: Final = 5_000_000
"""A log that is larger takes some ten seconds to be written once more, bytes."""


class EarlierTrips:
    """Writes the late frames of one session."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._logs = {path.name: path.name for path in directory.glob("*.mcap")}
        """The trip of each log that was there at the begin, by the log's name."""
        self._logs |= {late.name: trip.name for trip, late in late_logs(directory)}
        self._writers: dict[str, LogWriter] = {}
        self._took: dict[str, dict[str, SeqSet]] = {}
        """Numbers of the frames in each log that is written, by trip and boot_id."""
        self._greeting: dict[str, Any] | None = None
        """The board's last greeting, as a log keeps it: in it stand the starts whose frames come."""

    def greeted(self, record: dict[str, Any], t_ns: int) -> None:
        """The board greeted (`greeted_record`). Raises WayfixError."""
        self._greeting = record
        for writer in self._writers.values():
            writer.write_session(record, t_ns)

    def take(self, trip: str, arrival: Arrival) -> None:
        """Keep a frame of the trip whose log has this name. Raises WayfixError."""
        writer = self._writers.get(trip)
        if writer is None:
            log = self._directory / trip
            start = _start_of(log) or arrival.start.record
            writer = self._writers[trip] = late_log(log, start, arrival.log_time_ns)
            if self._greeting is not None:
                writer.write_session(self._greeting, arrival.log_time_ns)
        LogWatcher(lambda action: action(writer)).take(Step.of(arrival, Output()))
        frame = arrival.frame
        self._took.setdefault(trip, {}).setdefault(frame.boot_id, SeqSet()).add(frame.first, frame.seq)

    def drop_gone(self) -> set[str]:
        """Give up the logs that were removed while they were written; returns the trips whose frames are gone."""
        gone = {trip for trip, writer in self._writers.items() if writer.is_gone}
        for trip in gone:
            self._writers.pop(trip).abandon()
            self._took.pop(trip, None)
        removed = [name for name in self._logs if not (self._directory / name).exists()]
        return gone.union(self._logs.pop(name) for name in removed)

    @property
    def held(self) -> Iterator[FrameRange]:
        """The frames in the logs that are written."""
        for starts in self._took.values():
            yield from (FrameRange(boot_id, *seqs) for boot_id, took in starts.items() for seqs in took)

    def flush(self) -> list[int]:
        """What came so far is the system's; the descriptors to be synced. Raises WayfixError."""
        return [writer.flush() for writer in self._writers.values()]

    def end(self, holes_of: Callable[[str], dict[str, Any]], t_ns: int) -> None:
        """End the logs with what each trip lacks still and what of it is lost. Raises WayfixError."""
        for trip, writer in self._writers.items():
            writer.write_session({"kind": "end", **holes_of(trip)}, t_ns)
            writer.close()
        self._writers.clear()


def complete_trips(directory: Path, say: Callable[[str], None]) -> None:
    """Put what lies beside trips into their logs, also what a station that died left there.

    What cannot be put there (the log is gone, is damaged or is being written) stays a log of its own, and that is said;
    so does all after Ctrl-C, until the next session ends.
    """
    waits = "another station puts what came late into trips here; waiting for it (Ctrl-C leaves it for the next time)"
    with suppress(OSError, KeyboardInterrupt), every_end_is_ctrl_c(), turn_in(directory, lambda: say(waits)):
        for trip, late in late_logs(directory):
            if not is_being_written(late):
                _complete(trip, late, say)


def _complete(trip: Path, late: Path, say: Callable[[str], None]) -> None:
    try:
        if trip.exists() and trip.stat().st_size > LONG_BYTES:
            say(f"{trip}: what came late is put into it, which takes a while (Ctrl-C leaves it for the next time)")
        count = complete(trip, late)
    except (WayfixError, OSError) as error:
        say(f"{late} stays a log of its own: {error}")
    except KeyboardInterrupt:
        say(f"{late} stays a log of its own until the next `wayfix connect` ends")
        raise
    else:
        say(f"{trip}: {counted(count, 'frame')} that came late {'is' if count == 1 else 'are'} in it now")


def _start_of(trip: Path) -> dict[str, object] | None:
    """The first session record of a log, where there is one."""
    with suppress(WayfixError):
        return read_log(trip).start()
    return None
