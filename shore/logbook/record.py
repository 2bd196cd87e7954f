"""Write the log of one session: an MCAP file that is readable up to the last `sync()`, whatever happens.

    writer = LogWriter(Path("logs"), "springer", utc_ns)
    writer.write_session({"kind": "start", ...}, utc_ns)
    writer.write_frame(data, frame, utc_ns)     # the bytes as received, before anything is done with them
    writer.sync()                               # once a second
    writer.close()

Every time handed in is the station's UTC in ns. `log_time` is that time, never decreasing, so that sorting by it keeps
the order of arrival; `publish_time` is the record's own time on the boat clock. No clock is read here.
"""

import dataclasses
import json
import math
import os
import re
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from io import FileIO
from pathlib import Path
from typing import Any, Final

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from common.errors import WayfixError
from common.messages import Event, Frame
from common.units import NS_PER_S
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, LINK, SESSION, json_schema

_LARGEST_TIME: Final = 2**64 - 1


class LogWriter:
    """One log file, new, never overwritten. After a WayfixError (disk full, unplugged) only `close` is allowed."""

    def __init__(self, directory: Path, boat_id: str, utc_ns: int) -> None:
        """Make `directory` if need be and open `<UTC start>-<boat_id>.mcap` in it; raises WayfixError."""
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._file = _new_file(directory, boat_id, utc_ns)
        except OSError as error:
            cure = "give a directory you may write to"
            raise WayfixError(f"no log can be written here ({error.strerror})", str(directory), cure) from error
        self.path = Path(os.fsdecode(self._file.name))
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._channels: dict[str, int] = {}
        self._log_time = 0
        self._failed = False
        self._guarded(lambda: self._writer.start(profile="", library="wayfix"))

    def write_frame(self, data: bytes, frame: Frame, t_ns: int) -> None:
        """A frame's bytes, unchanged; `frame` is the same, decoded."""
        self._add(FRAMES, data, t_ns, frame.t1_ns, frame.seq % 2**32)

    def write_estimate(self, record: dict[str, Any], t_ns: int) -> None:
        """What one filter published; `record` has at least `filter` and `t_ns` (boat clock)."""
        self._add(f"{ESTIMATES}{record['filter']}", _json(record), t_ns, record["t_ns"])

    def write_event(self, event: Event, t_ns: int) -> None:
        """An event of either side."""
        self._add(EVENTS, _json(dataclasses.asdict(event)), t_ns, event.t_ns)

    def write_session(self, record: dict[str, Any], t_ns: int) -> None:
        """Configuration, versions, options, operator actions: on the disk when this returns."""
        self._add(SESSION, _json(record), t_ns, t_ns)
        self.sync()

    def write_link(self, record: dict[str, Any], t_ns: int) -> None:
        """What the link said beside frames (`{"kind": "end", "sent": ...}`)."""
        self._add(LINK, _json(record), t_ns, t_ns)

    def sync(self) -> None:
        """Everything written so far is on the disk when this returns."""
        self._guarded(self._flush)

    def close(self) -> None:
        """Write the index and close; harmless when called twice or after a failure."""
        if self._file.closed:
            return
        try:
            if not self._failed:
                self._guarded(self._finish)
        finally:
            # The library's own buffer may hold what a full disk refused; closing tries once more and fails again.
            with suppress(OSError):
                self._file.close()

    def _add(self, topic: str, data: bytes, t_ns: int, publish_ns: int, sequence: int = 0) -> None:
        self._log_time = max(self._log_time, min(t_ns, _LARGEST_TIME))
        publish_time = min(max(publish_ns, 0), _LARGEST_TIME)
        channel = self._channels.get(topic) or self._new_channel(topic)
        self._guarded(lambda: self._writer.add_message(channel, self._log_time, data, publish_time, sequence))

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
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._flush()

    def _guarded(self, action: Callable[[], None]) -> None:
        if self._failed:
            raise WayfixError("the log ended with an earlier fault", str(self.path), "start a new one")
        try:
            action()
        except OSError as error:
            self._failed = True
            cure = "free some space or log to another disk; what was written stays readable"
            raise WayfixError(
                f"the log cannot be written any further ({error.strerror})", str(self.path), cure
            ) from error


def _new_file(directory: Path, boat_id: str, utc_ns: int) -> FileIO:
    start = datetime.fromtimestamp(utc_ns // NS_PER_S, UTC).strftime("%Y%m%dT%H%M%SZ")
    stem = f"{start}-{re.sub(r'[^A-Za-z0-9_-]+', '_', boat_id)}"
    number = 1
    while True:
        path = directory / (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap")
        try:
            file = FileIO(path, "xb")
        except FileExistsError:
            number += 1
            continue
        # Without this the file's name may be gone after a power cut, with all its synced data.
        entry = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(entry)
        finally:
            os.close(entry)
        return file


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
