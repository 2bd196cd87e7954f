"""Log writer: the MCAP file of one session, which is readable up to the last `sync()`, whatever happens.

    writer = new_log(Path("logs"), "springer", utc_ns)     # or log_at(Path("out.mcap"))
    writer.write_session({"kind": "start", ...}, utc_ns)
    writer.write_frame(data, frame, utc_ns)     # the bytes as received, before anything is done with them
    writer.sync()                               # once a second
    writer.close()

Every time handed in is the station's UTC in ns. `log_time` is that time, never decreasing, so that sorting by it keeps
the order of arrival; `publish_time` is the record's own time on the boat clock. No clock is read here.
"""

import json
import math
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from io import FileIO
from itertools import chain, count
from pathlib import Path
from typing import Any, Final

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from common.atomic_file import part_of, sync_directory
from common.errors import WayfixError
from common.messages import Event, Frame
from common.units import NS_PER_S
from shore.logbook import foxglove
from shore.logbook.estimate_rounding import logged
from shore.logbook.lock import lock
from shore.logbook.schemas import (
    ESTIMATES,
    EVENTS,
    FIXES,
    FRAMES,
    LATE,
    LATE_OF,
    LINK,
    POSITIONS,
    SESSION,
    TRIP,
    json_schema,
)
from shore.logbook.summary import TripSummary

_LARGEST_TIME: Final = 2**64 - 1
WRONG_CLOCK_NS: Final = 60 * NS_PER_S
"""A station's clock that is further from the boat's UTC names no log, ns."""


class LogWriter:
    """One log file, new, never overwritten. After a WayfixError (disk full, unplugged) only `close` is allowed."""

    def __init__(self, file: FileIO, final: Path | None = None) -> None:
        """Begin a log in a file that is new and open (`new_log`, `log_at`); `close` moves it to `final`, if given.

        Raises WayfixError when nothing can be written, and OSError when the file cannot be locked.
        """
        self._file = file
        self.path = Path(os.fsdecode(file.name))
        """Path of the file while it grows, and after `close` the path where it stays."""
        self._final = final
        self._identity = os.fstat(file.fileno())
        lock(file.fileno())
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        self._log_time = 0
        self._failed = False
        self._has_frames = False
        self._summary = TripSummary()
        self._utc_less_boat_ns: int | None = None
        """UTC less boat time as the newest frame says, ns; `None` = it does not know UTC."""
        self._drawn_ns: dict[str, int] = {}
        """Boat time of the newest position of each filter, ns."""
        self.guarded(lambda: self._writer.start(profile="", library="wayfix"))

    @property
    def log_time_ns(self) -> int:
        """Log time of the newest record, ns."""
        return self._log_time

    @property
    def is_gone(self) -> bool:
        """True when another file, or none, has the name by now: the log or its directory was removed or moved."""
        try:
            return not os.path.samestat(self.path.stat(), self._identity)
        except OSError:
            return True

    def write_frame(self, data: bytes, frame: Frame, t_ns: int) -> None:
        """A frame's bytes, unchanged; `frame` is the same, decoded. Usable fixes once more as Foxglove draws them."""
        self._add(FRAMES, data, t_ns, frame.t1_ns, frame.seq % 2**32)
        self._has_frames = True
        self._summary.frame(frame)
        self._utc_less_boat_ns = None if frame.utc_ns is None else frame.utc_ns - frame.t0_ns
        for fix in frame.fixes:
            if fix.usable and fix.lat_deg is not None and fix.lon_deg is not None:
                place = (fix.lat_deg, fix.lon_deg)
                record = foxglove.location_fix(self._utc_ns(fix.t_ns), fix.t_ns, fix.sensor, place, None)
                self._add(f"{FIXES}{fix.sensor}", _json(record), t_ns, fix.t_ns)

    def write_estimate(self, record: dict[str, Any], t_ns: int) -> None:
        """What one filter published (`Estimate.as_record()`), rounded.

        Each second it comes once more as Foxglove draws it, where its position is valid.
        """
        stored, name, boat_ns = logged(record), record["filter"], record["t_ns"]
        self._add(f"{ESTIMATES}{name}", _json(stored), t_ns, boat_ns)
        self._summary.estimate(stored)
        if (
            "position" in record["aligned_parts"]
            and not 0 <= boat_ns - self._drawn_ns.get(name, boat_ns - NS_PER_S) < NS_PER_S
        ):
            self._drawn_ns[name] = boat_ns
            place, size = (stored["lat_deg"], stored["lon_deg"]), len(stored["state"])
            east, cross, north = (stored["covariance"][index] for index in (0, 1, size))
            drawn = foxglove.location_fix(self._utc_ns(boat_ns), boat_ns, name, place, (east, cross, north))
            self._add(f"{POSITIONS}{name}", _json(drawn), t_ns, boat_ns)

    def write_event(self, event: Event, t_ns: int) -> None:
        """An event of either side."""
        self._log_time = max(self._log_time, min(t_ns, _LARGEST_TIME))
        self._add(EVENTS, _json(foxglove.log_record(event, self._utc_ns(event.t_ns))), t_ns, event.t_ns)
        self._summary.event(event.level)

    def write_session(self, record: dict[str, Any], t_ns: int) -> None:
        """Configuration, versions, options, operator actions: on the disk when this returns."""
        self._add(SESSION, _json(record), t_ns, t_ns)
        self._summary.session(record, t_ns)
        self.sync()

    def write_link(self, record: dict[str, Any], t_ns: int) -> None:
        """What the link said beside frames (`{"kind": "end", "sent": ...}`)."""
        self._add(LINK, _json(record), t_ns, t_ns)

    def sync(self) -> None:
        """Everything written so far is on the disk when this returns."""
        self.guarded(self._flush)

    def flush(self) -> int:
        """Everything written so far is the system's; returns the file's descriptor, for a sync in another thread."""
        self.guarded(self._writer.flush)
        return self._file.fileno()

    def guarded(self, action: Callable[[], None]) -> None:
        """Do something whose OSError ends the log; raises WayfixError."""
        if self._failed:
            raise WayfixError("the log ended with an earlier fault", str(self.path), "start a new one")
        try:
            action()
        except OSError as error:
            self._failed = True
            what, cure = (
                f"the log cannot be written any further ({error.strerror})",
                "free some space or use another disk",
            )
            if self._final is None:
                cure += "; what was written stays readable"
            raise WayfixError(what, str(self._final or self.path), cure) from error

    def close(self) -> None:
        """Write summary and index and close; harmless when called twice or after a failure."""
        if self._file.closed:
            return
        try:
            if not self._failed:
                self.guarded(self._finish)
        finally:
            # The library's own buffer may hold what a full disk refused; closing tries once more and fails again.
            with suppress(OSError):
                self._file.close()

    def remove_without_frames(self) -> bool:
        """Leave no file behind in which no frame is: its disk took nothing. Close it before. True = it is removed."""
        if self._has_frames or self.is_gone:
            return False
        with suppress(OSError):
            self.path.unlink()
        return self.is_gone

    def name_by_boat(self, boat_id: str, utc_ns: int) -> Path | None:
        """Where `close` will leave the log: under the boat's UTC of its first frame; `None` = under the name it has.

        utc_ns: of the station when the log began; within a minute of the boat's, it gave a good name.
        """
        begin_ns, _ = self._summary.utc.span()
        if begin_ns is None or abs(begin_ns - utc_ns) <= WRONG_CLOCK_NS:
            return None
        self._final = _free_name(self.path.parent, _stem(boat_id, begin_ns))
        return self._final

    def abandon(self) -> None:
        """Close without an end; a log of `log_at` leaves nothing behind. Harmless to a log that is closed already."""
        with suppress(OSError):
            self._file.close()
        if self._final is not None and self.path != self._final:
            with suppress(OSError):
                self.path.unlink()

    def _utc_ns(self, t_ns: int) -> int:
        """UTC of a boat time by the boat, or else the time of arrival by the station."""
        known = t_ns > 0 and self._utc_less_boat_ns is not None
        return min(max(t_ns + (self._utc_less_boat_ns or 0), 0), _LARGEST_TIME) if known else self._log_time

    def _add(self, topic: str, data: bytes, t_ns: int, publish_ns: int, sequence: int = 0) -> None:
        self._log_time = max(self._log_time, min(t_ns, _LARGEST_TIME))
        publish_time = min(max(publish_ns, 0), _LARGEST_TIME)
        channel = self._channels.get(topic) or self._new_channel(topic)
        self.guarded(lambda: self._writer.add_message(channel, self._log_time, data, publish_time, sequence))

    def _new_channel(self, topic: str) -> int:
        encoding, schema = MessageEncoding.MessagePack, 0
        if topic != FRAMES:
            name, text = json_schema(topic)
            encoding, schema = MessageEncoding.JSON, self._writer.register_schema(name, SchemaEncoding.JSONSchema, text)
        self._channels[topic] = self._writer.register_channel(topic, encoding, schema)
        return self._channels[topic]

    def _flush(self) -> None:
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._file.fileno())

    def _finish(self) -> None:
        summary = {"kind": "summary", **self._summary.as_record()}
        self._add(SESSION, _json(summary), self._log_time, self._log_time)
        self._writer.add_metadata(TRIP, {name: str(value) for name, value in summary.items() if value is not None})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._flush()
        if self._final is not None:
            self.path.replace(self._final)
            self.path = self._final
            sync_directory(self.path.parent)


def new_log(directory: Path, boat_id: str, utc_ns: int) -> LogWriter:
    """Make `directory` if need be and begin `<UTC start>-<boat_id>.mcap` in it; raises WayfixError."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        file = _new_file(directory, _stem(boat_id, utc_ns))
    except OSError as error:
        cure = "give a directory you may write to"
        raise WayfixError(f"no log can be written here ({error.strerror})", str(directory), cure) from error
    with _none_left_behind(file):
        return LogWriter(file)


def log_at(path: Path) -> LogWriter:
    """A log that appears at `path` when it is closed; raises WayfixError when something is there already."""
    if path.exists():
        raise WayfixError("exists already", str(path), "choose another name, or remove it first")
    try:
        return LogWriter(FileIO(part_of(path), "xb"), path)
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(path), "check space and rights") from error


def late_log(trip: Path, start: dict[str, Any], utc_ns: int) -> LogWriter:
    """Begin `<trip>-late.mcap` beside the log of a trip, for what comes after its end.

    start: what its first session record says beside that. Raises WayfixError; no file is left behind then.
    """
    try:
        trip.parent.mkdir(parents=True, exist_ok=True)
        file = _new_file(trip.parent, f"{trip.stem}{LATE}")
    except OSError as error:
        raise WayfixError(f"no log can be written here ({error.strerror})", str(trip.parent), "check space") from error
    with _none_left_behind(file):
        writer = LogWriter(file)
        writer.write_session({**start, LATE_OF: trip.name}, utc_ns)
    return writer


@contextmanager
def _none_left_behind(file: FileIO) -> Iterator[None]:
    """Remove a file in which no log could be begun."""
    try:
        yield
    except WayfixError:
        with suppress(OSError):
            file.close()
        with suppress(OSError):
            Path(os.fsdecode(file.name)).unlink()
        raise


def _stem(boat_id: str, utc_ns: int) -> str:
    start = datetime.fromtimestamp(utc_ns // NS_PER_S, UTC).strftime("%Y%m%dT%H%M%SZ")
    return f"{start}-{re.sub(r'[^A-Za-z0-9_-]+', '_', boat_id)}"


def _new_file(directory: Path, stem: str) -> FileIO:
    """A new file with its name durable; none is left where that fails. Raises OSError."""
    while True:
        path = _free_name(directory, stem)
        with suppress(FileExistsError):
            file = FileIO(path, "xb")
            try:
                sync_directory(directory)
            except OSError:
                file.close()
                with suppress(OSError):
                    path.unlink()
                raise
            return file


def _free_name(directory: Path, stem: str) -> Path:
    names = (directory / f"{stem}{number}.mcap" for number in chain([""], (f"-{number}" for number in count(2))))
    return next(path for path in names if not path.exists())


def _json(record: dict[str, Any]) -> bytes:
    """Compact JSON; what is not finite becomes null, numpy values become plain ones."""
    try:
        text = json.dumps(record, allow_nan=False, separators=(",", ":"), default=_plain)
    except ValueError:
        text = json.dumps(_finite(record), allow_nan=False, separators=(",", ":"))
    return text.encode()


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        return value.tolist()
    return str(value)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, str | int):
        return value
    return _finite(_plain(value))
