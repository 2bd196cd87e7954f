"""Log index: `wayfix log ls` has one row for each trip, read from the end of a closed log without the rest of it."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.opcode import Opcode

from common.errors import WayfixError
from common.units import NS_PER_S
from shore.logbook.lock import is_being_written
from shore.logbook.log_reader import LogReader, near_name
from shore.logbook.mcap.damage import iso
from shore.logbook.mcap.index_at_end import Tail, tail_of
from shore.logbook.mcap.records import (
    HEAD,
    LIMIT,
    LOG_START,
    MAGIC,
    BrokenError,
    chunk_head,
    is_parsed,
    messages_in,
    parsed,
    unpacked,
)
from shore.logbook.mcap.scan import Scan
from shore.logbook.schemas import SESSION, TRIP
from shore.trips.examine import examine, from_metadata

FIRST_DATE_NS: Final = 315_964_800 * NS_PER_S
"""6 January 1980, the first day of GPS, ns since 1970: what is before that is no date of a trip."""
SHOWN: Final = ("utc_ns", "seconds", "name", "place", "note", "boat", "frames", "distance_m")


@dataclass(frozen=True, slots=True)
class Trip:
    """One log in a list."""

    path: Path
    size: int
    state: str
    """State of the log: `closed`, `cut`, `being written`, `damaged`, or the reason why it is no log."""
    is_log: bool
    summary: dict[str, Any]

    def as_record(self) -> dict[str, Any]:
        """The row for JSON."""
        fields = {name: self.summary.get(name) for name in SHOWN}
        return {
            "log": str(self.path),
            "state": self.state,
            "bytes": self.size,
            **fields,
            "start_utc": date_of(fields["utc_ns"]),
        }


def number(value: Any, kind: type[int] | type[float] = float) -> Any:
    """A number out of what a file says; `None` for anything else."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and value == value  # noqa: PLR0124
    return kind(value) if is_number and abs(value) < 2**64 else None


def logs_in(given: Iterable[Path]) -> list[Path]:
    """The files, and the logs of the directories. Raises WayfixError for what is not there."""
    found: list[Path] = []
    for path in given:
        if path.is_dir():
            try:
                found += sorted(each for each in path.glob("*.mcap") if not each.name.startswith("."))
            except OSError as error:
                raise WayfixError(f"cannot be read ({error.strerror})", str(path), "check its rights") from error
        elif path.exists():
            found.append(path)
        else:
            what = f"no such file or directory{near_name(path)}"
            raise WayfixError(what, str(path), "give logs, or a directory with logs")
    return list(dict.fromkeys(found))


def trip_of(path: Path, progress: Callable[[Scan], None]) -> Trip:
    """One row; only a log without a sound end is read whole."""
    try:
        LogReader(path)
        size = path.stat().st_size
        with path.open("rb") as stream:
            is_closed = not is_being_written(path) and _begins_well(stream)
            summary = _summary(stream) if is_closed else None
        if summary is not None:
            return Trip(path, size, "closed", True, summary)
        result = examine(path, progress)
    except WayfixError as error:
        return Trip(path, 0, error.what, False, {})
    except OSError as error:
        return Trip(path, 0, f"cannot be read ({error.strerror})", False, {})
    return Trip(path, size, "closed" if result.state == "whole" else result.state, True, result.summary())


def newest_first(trips: Iterable[Trip]) -> list[Trip]:
    """Trips in order of their start, the newest first; those without a start are last."""
    return sorted(trips, key=lambda trip: (number(trip.summary.get("utc_ns")) or 0, trip.path.name), reverse=True)


def _begins_well(stream: BinaryIO) -> bool:
    """Whether magic and header are sound. Raises OSError."""
    begin = stream.read(len(MAGIC) + HEAD.size)
    if not begin.startswith(LOG_START) or len(begin) < len(MAGIC) + HEAD.size:
        return False
    length = HEAD.unpack_from(begin, len(MAGIC))[1]
    return length <= LIMIT and is_parsed(Opcode.HEADER, stream.read(length))


def _summary(stream: BinaryIO) -> dict[str, Any] | None:
    """What the metadata record of a closed log says. Raises OSError."""
    tail = tail_of(stream)
    for index in reversed(tail.metadata if tail is not None else []):
        if index.name != TRIP or index.length > LIMIT:
            continue
        stream.seek(index.offset)
        if HEAD.unpack(stream.read(HEAD.size).ljust(HEAD.size, b"\0"))[0] != Opcode.METADATA:
            return None
        try:
            record = parsed(Opcode.METADATA, stream.read(index.length - HEAD.size))
        except BrokenError:
            return None
        return from_metadata(record.metadata)
    return _recovered(stream, tail) if tail is not None else None


def _recovered(stream: BinaryIO, tail: Tail) -> dict[str, Any] | None:
    """The summary in the last record of a log that `wayfix log recover` wrote. Raises OSError."""
    place, index = max((tail.chunks or {}).items(), default=(0, None))
    if index is None or index.chunk_length > LIMIT:
        return None
    stream.seek(place + HEAD.size)
    content = stream.read(index.chunk_length - HEAD.size)
    head = chunk_head(content, len(content))
    try:
        messages, _ = messages_in(unpacked(content, head), dict(tail.channels), {}) if head is not None else ([], 0)
        channel, *_, data = messages[-1]
        record = json.loads(data) if channel is not None and channel.topic == SESSION else {}
        summary = record["summary"]
    except (BrokenError, ValueError, LookupError, TypeError):
        return None
    return summary if isinstance(summary, dict) else None


def date_of(utc_ns: Any) -> str | None:
    """A time for programs; `None` where there is no date, or a record holds no number."""
    value = number(utc_ns, int)
    return None if value is None or value < FIRST_DATE_NS else iso(value)


def day(utc_ns: Any) -> str:
    """A start for people, to the minute; the first days of 1970 are no date, but a clock that was never set."""
    value = number(utc_ns, int)
    if value is not None and value < FIRST_DATE_NS:
        return "unknown date"
    try:
        return f"{datetime.fromtimestamp(value // NS_PER_S, UTC):%Y-%m-%d %H:%M}"
    except (TypeError, ValueError, OverflowError, OSError):
        return "?"
