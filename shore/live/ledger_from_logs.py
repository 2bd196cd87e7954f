"""Ledger rebuilt from logs (recovery of a lost checkpoint): which frames of a boat the logs of a directory hold."""

from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from common.errors import WayfixError
from common.words import counted
from shore.link.frame_ledger import Ledger, StartLedger
from shore.logbook.log_reader import LogReader, read_log
from shore.logbook.missing_frames import light_frame
from shore.logbook.schemas import FRAMES, LATE_OF, SESSION


class _Log(NamedTuple):
    """A log of a live run."""

    began_ns: int
    path: Path
    trip: str
    """Name of the log of the trip: another one for what came late."""
    connected: dict[str, Any]
    since: StartLedger | None
    """Where the station met the boat, of which no frame has come yet; `None` = the log does not say it."""


def ledger_from_logs(directory: Path, boat_id: str, say: Callable[[str], None]) -> Ledger | None:
    """The ledger that the logs of this boat make; `None` where there is no such log.

    Each log says where the station met the boat and from which frame on its trip began, and holds what came. A log that
    cannot be read is said, and its frames are asked for once more.
    """
    found = [log for path in directory.glob("*.mcap") if (log := _log_of(path, boat_id)) is not None]
    logs = sorted(found, key=attrgetter("began_ns", "path"))
    if not logs:
        return None
    say(f"{directory}: reading {counted(len(logs), 'log')} of this boat, to know which frames are here")
    ledger = Ledger(log.since for log in logs[:1] if log.since is not None)
    for log in logs:
        if log.path.name == log.trip:
            _greet(ledger, log.connected, log.trip)
    for log in logs:
        try:
            take_frames(ledger, log.path, 0, boat_id)
        except WayfixError as error:
            say(f"frames that this log may hold are asked for once more: {error}")
    return ledger


def unknown_trips(directory: Path, boat_id: str, known: set[str]) -> set[str]:
    """Names of the logs of this boat's trips in a directory that are not among these; late frames are no trip."""
    others = (path for path in directory.glob("*.mcap") if path.name not in known)
    logs = (log for path in others if (log := _log_of(path, boat_id)) is not None)
    return {log.trip for log in logs if log.path.name == log.trip}


def take_frames(ledger: Ledger, log: Path, since_ns: int, boat_id: str) -> int:
    """Take in the frames since a log time, ns. Returns the log time of the newest record of all, 0 = there is none.

    Raises WayfixError for a log that cannot be read.
    """
    newest_ns = 0
    reader = read_log(log)
    for record in reader.records():
        newest_ns = max(newest_ns, record.log_time_ns)
        if record.topic == FRAMES and record.log_time_ns >= since_ns:
            try:
                frame = light_frame(record.data)
            except (ValueError, KeyError, TypeError, AttributeError):
                continue
            if frame.boat_id == boat_id:
                ledger.take(frame.boot_id, frame.first, frame.seq)
    return newest_ns


def _log_of(path: Path, boat_id: str) -> _Log | None:
    """A log of a live run of this boat that wants every frame; `None` for any other file."""
    try:
        reader = LogReader(path)
        record = next(reader.records(SESSION), None)
        start = None if record is None else reader.content(record)
    except WayfixError:
        return None
    if record is None or start is None or start.get("kind") != "start":
        return None
    options, connected = start.get("options") or {}, start.get("connected") or {}
    is_of_boat = (connected.get("config") or {}).get("boat", {}).get("id") == boat_id
    if not is_of_boat or options.get("frames") is not None or "replayed_from" in options or "file" in connected:
        return None
    trip = str(start.get(LATE_OF, path.name))
    match start.get("since"):
        case [str(boot_id), int(first)] if first >= 0:
            return _Log(record.log_time_ns, path, trip, connected, StartLedger(boot_id, first, first))
    return _Log(record.log_time_ns, path, trip, connected, None)


def _greet(ledger: Ledger, connected: dict[str, Any], trip: str) -> None:
    """The greeting with which a trip began; one of an odd form says nothing."""
    match connected:
        case {"boot_id": str(boot_id), "next_seq": int(next_seq), "runs": list(listed)}:
            runs = []
            for run in listed:
                match run:
                    case [str(name), int(), int(first), int(upto)]:
                        runs.append((name, first, upto))
            ledger.greet(boot_id, next_seq, runs)
            ledger.begin_trip(boot_id, next_seq, trip)
