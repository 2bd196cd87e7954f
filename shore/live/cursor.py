"""Checkpoint (cursor) beside a directory of logs: which frames of a boat it holds, so that each is stored once.

`<boat>.cursor` is written after the log is on the disk, so it never claims a frame that no log holds; what a killed
station wrote after its last cursor is read from the log it names. A log that ends before that has lost what the cursor
claims (a damaged card, an older copy): then the log alone says which frames are here. A cursor that is gone, holds what
cannot be, or does not know a log beside it (an older copy) is made again of all these logs.
"""

import json
import re
from collections.abc import Callable
from contextlib import suppress
from hashlib import blake2b
from io import FileIO
from pathlib import Path
from typing import Any, Final, NamedTuple

from common.atomic_file import whole_file
from common.errors import WayfixError
from common.link_messages import MAX_SEQ
from shore.link.frame_ledger import Ledger, StartLedger
from shore.live.ledger_from_logs import ledger_from_logs, take_frames, unknown_trips
from shore.logbook.lock import is_being_written, lock
from shore.logbook.log_reader import late_logs

FORM: Final = 1
MOST_BYTES: Final = 2**26
"""A larger file is no cursor, bytes."""


def _stem_of(boat_id: str) -> str:
    """Name of a boat's files; two boats whose ids differ in other letters only have two."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", boat_id)
    return plain if plain == boat_id else f"{plain}-{blake2b(boat_id.encode(), digest_size=4).hexdigest()}"


class Cursor:
    """Owns the ledger of one boat in one directory; `close` it at the end."""

    def __init__(self, directory: Path, boat_id: str, say: Callable[[str], None]) -> None:
        """Raises WayfixError when another station writes logs of this boat here, or the directory cannot be written."""
        stem = _stem_of(boat_id)
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
        for part in self._path.parent.glob(
            f".{self._path.name}.*.part"
        ):  # of stations that died: nobody else writes here
            with suppress(OSError):
                part.unlink()

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
            "forgotten": self.ledger.forgotten,
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
        checkpoint, doubt = None, None
        try:
            checkpoint = _checkpoint_of(_content(self._path), self._boat_id)
        except FileNotFoundError:
            doubt = ""
        except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            doubt = f"not readable ({_reason(error)})"
        if checkpoint is not None:
            doubt = self._doubt(checkpoint)
        if doubt is not None and (ledger := ledger_from_logs(self._path.parent, self._boat_id, say)) is not None:
            if doubt:
                say(f"{self._path}: {doubt}; the logs beside it say what is here")
            return ledger
        if checkpoint is not None:
            return self._with_newer(checkpoint, say)
        if doubt:
            say(f"{self._path}: {doubt}, no log is beside it: frames are asked for from now on")
        return Ledger()

    def _doubt(self, checkpoint: "_Checkpoint") -> str | None:
        """Why the logs beside it know better; `None` = they do not."""
        if not self._path.with_name(checkpoint.log).exists():
            return f"it is of the log {checkpoint.log}, which is not there any more"
        known = {checkpoint.log, *checkpoint.ledger.trips}
        unknown = unknown_trips(self._path.parent, self._boat_id, known)
        return f"it does not know the log {min(unknown)}" if unknown else None

    def _with_newer(self, checkpoint: "_Checkpoint", say: Callable[[str], None]) -> Ledger:
        """The ledger with what was written after the cursor."""
        ledger, log = checkpoint.ledger, self._path.with_name(checkpoint.log)
        logs = [(log, checkpoint.log_time_ns)] if log.exists() else []
        # Late ones are of a station that was killed before it put them into the trip.
        for path, from_ns in (*logs, *((late, 0) for _, late in late_logs(self._path.parent))):
            try:
                newest_ns = take_frames(ledger, path, from_ns, self._boat_id)
                if newest_ns < from_ns:
                    say(f"{path}: it has lost its end; the frames that were in it are asked for once more")
                    ledger.forget_trip(path.name)
                    take_frames(ledger, path, 0, self._boat_id)
            except WayfixError as error:
                say(f"frames that this log may hold are asked for once more: {error}")
                ledger.forget_trip(path.name)
        return ledger


class _Checkpoint(NamedTuple):
    """What the file says."""

    ledger: Ledger
    log: str
    log_time_ns: int


def _content(path: Path) -> bytes:
    """Raises OSError, and ValueError for a file that is too large."""
    with path.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise ValueError("it is too large")
    return content


def _checkpoint_of(content: bytes, boat_id: str) -> _Checkpoint:
    """The content of the file, every value in its range. Raises ValueError, KeyError, TypeError and their kin."""
    record = json.loads(content)
    if not isinstance(record, dict) or record["cursor"] != FORM:
        raise ValueError("it has another form")
    if record["boat_id"] != boat_id:
        raise ValueError("it is of another boat")
    log = _log_name(record["log"])
    starts = [_start_of(item) for item in record["starts"]]
    if starts and not any(start.trips for start in starts):  # a cursor of an earlier Wayfix names the last trip alone
        starts[-1].trips.append((starts[-1].first, log))
    return _Checkpoint(
        Ledger(starts, _number(record.get("forgotten", 0))), log, _number(record["log_time_ns"], 2**63 - 1)
    )


def _start_of(item: Any) -> StartLedger:
    boot_id, first, upto = item["boot_id"], _number(item["first"]), _number(item["upto"])
    if not isinstance(boot_id, str) or first > upto:
        raise ValueError("it names no start of a daemon")
    start = StartLedger(boot_id, first, upto)
    for name, seqs in (("seen", start.seen), ("gone", start.gone)):
        for begin, last in item[name]:
            if _number(begin) > _number(last):
                raise ValueError("a range ends before it begins")
            seqs.add(begin, last)
    start.trips += [(_number(first), _log_name(name)) for first, name in item.get("trips", ())]
    return start


def _log_name(name: Any) -> str:
    if not isinstance(name, str) or Path(name).name != name or not name.endswith(".mcap"):
        raise ValueError("it names no log")
    return name


def _number(value: Any, most: int = MAX_SEQ) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise ValueError("a number in it is out of its range")
    return value


def _reason(error: Exception) -> str:
    match error:
        case OSError():
            return str(error.strerror)
        case json.JSONDecodeError() | UnicodeDecodeError() | RecursionError():
            return "it is empty or damaged"
        case KeyError() | TypeError():
            return "it has another form"
        case _:
            return str(error)
