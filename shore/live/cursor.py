"""Checkpoint (cursor) beside a directory of logs: which frames of a boat it holds, so that each is stored once.

`<boat>.cursor` is written after the log is on the disk, so it never claims a frame that no log holds; what a killed
station wrote after its last cursor is read from the log it names. A log that ends before that has lost what the cursor
claims (a damaged card, an older copy): then the log alone says which frames are here.
"""

import json
import re
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any, Final

from common.atomic_file import whole_file
from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from shore.link.frame_ledger import Ledger, StartLedger
from shore.logbook.lock import is_being_written, lock
from shore.logbook.log_reader import late_logs, read_log
from shore.logbook.schemas import FRAMES

FORM: Final = 1


class Cursor:
    """Owns the ledger of one boat in one directory; `close` it at the end."""

    def __init__(self, directory: Path, boat_id: str, say: Callable[[str], None]) -> None:
        """Raises WayfixError when another station writes logs of this boat here, or the directory cannot be written."""
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", boat_id)
        self._path = directory / f"{stem}.cursor"
        self._boat_id = boat_id
        self._lock_path = directory / f".{stem}.cursor.lock"
        if is_being_written(self._lock_path):
            cure = "give another --log directory, or stop it"
            raise WayfixError("another station writes logs of this boat here", str(directory), cure)
        self._lock: FileIO | None = None
        self.claim()
        self.ledger = self._load(say)

    def claim(self) -> None:
        """Keep other stations from writing here, once more where the directory was removed. Raises WayfixError."""
        self.close()
        try:
            self._lock_path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = FileIO(self._lock_path, "wb")
        except OSError as error:
            directory, cure = str(self._lock_path.parent), "give a directory you may write to"
            raise WayfixError(f"no log can be written here ({error.strerror})", directory, cure) from error
        lock(self._lock.fileno())

    def saver(self, log: Path, log_time_ns: int) -> Callable[[], None]:
        """What to call, in any thread, once everything that is in the ledger now is on the disk; it raises OSError.

        log_time_ns: of the newest record of `log`.
        """
        record = {
            "cursor": FORM,
            "boat_id": self._boat_id,
            "log": log.name,
            "log_time_ns": log_time_ns,
            "starts": self.ledger.as_record(),
        }

        def save() -> None:
            with whole_file(self._path) as stream:
                stream.write(json.dumps(record, separators=(",", ":")).encode())

        return save

    def close(self) -> None:
        """Let another station write here."""
        if self._lock is not None:
            self._lock.close()

    def _load(self, say: Callable[[str], None]) -> Ledger:
        try:
            record = json.loads(self._path.read_text(encoding="utf-8"))
            ledger = _ledger_of(record)
            log, since_ns = self._path.with_name(str(record["log"])), int(record["log_time_ns"])
        except FileNotFoundError:
            return Ledger()
        except (OSError, ValueError, KeyError, TypeError):
            say(f"{self._path}: not readable; the boat is taken for a new one, and frames are asked for from now on")
            return Ledger()
        logs = [(log, since_ns)] if log.exists() else []
        # Late ones are of a station that was killed before it put them into the trip.
        for path, from_ns in (*logs, *((late, 0) for _, late in late_logs(self._path.parent))):
            try:
                newest_ns = _add_newer(ledger, path, from_ns, self._boat_id)
                if newest_ns < from_ns:
                    say(f"{path}: it has lost its end; the frames that were in it are asked for once more")
                    ledger.forget_trip(path.name)
                    _add_newer(ledger, path, 0, self._boat_id)
            except WayfixError as error:
                say(f"frames that this log may hold are asked for once more: {error}")
                ledger.forget_trip(path.name)
        return ledger


def _ledger_of(record: Any) -> Ledger:
    if record["cursor"] != FORM:
        raise ValueError("another form")
    starts = []
    for item in record["starts"]:
        start = StartLedger(str(item["boot_id"]), int(item["first"]), int(item["upto"]))
        for name, seqs in (("seen", start.seen), ("gone", start.gone)):
            for first, last in item[name]:
                seqs.add(int(first), int(last))
        start.trips += [(int(first), str(name)) for first, name in item.get("trips", ())]
        starts.append(start)
    if starts and not any(start.trips for start in starts):  # a cursor of an earlier Wayfix names the last trip alone
        starts[-1].trips.append((starts[-1].first, str(record["log"])))
    return Ledger(starts)


def _add_newer(ledger: Ledger, log: Path, since_ns: int, boat_id: str) -> int:
    """Take in the frames since a log time, ns. Returns the log time of the newest record of all, 0 = there is none."""
    newest_ns = 0
    for record in read_log(log).records():
        newest_ns = max(newest_ns, record.log_time_ns)
        if record.topic == FRAMES and record.log_time_ns >= since_ns:
            try:
                frame = decode_frame(record.data)
            except CodecError:
                continue
            if frame.boat_id == boat_id:
                ledger.take(frame.boot_id, frame.first, frame.seq)
    return newest_ns
