"""Log recovery: all sound records go into a new file with an index (`recover`), or a log gets a name (`name_log`).

What was written is read back with MCAP's own reader and compared record for record with the source, before it gets its
name: nothing is ever overwritten by something worse.
"""

import json
import shlex
import shutil
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Metadata, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from common.atomic_file import check_target, part_of, whole_file
from common.errors import WayfixError
from shore.logbook.lock import is_being_written
from shore.logbook.log_reader import LogReader
from shore.logbook.mcap.records import Message
from shore.logbook.mcap.scan import Scan
from shore.logbook.mcap.walk import Item
from shore.logbook.schemas import SESSION, TRIP, json_schema
from shore.trips.examine import Examination, as_metadata, examine

Watch = Callable[[str, Scan], None]
"""Called now and then with the name of the step that is being done and its scan."""
_AS_IT_WAS: Final = "the log that was read is as it was"


class _Whole(NamedTuple):
    """A message with everything that an MCAP file says of it."""

    topic: str
    encoding: str
    schema: tuple[str, str, bytes] | None
    channel_metadata: tuple[tuple[str, str], ...]
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Rewritten:
    """A log that was written once more."""

    path: Path
    records: int
    source: Examination


def recover(source: Path, target: Path | None, trip: dict[str, Any] | None, watch: Watch) -> Rewritten:
    """All sound records of `source` into the new file `target` (default NAME-recovered.mcap beside it).

    trip: a `/session` record with the name of the trip, or `None`. Raises WayfixError; nothing is left behind then.
    """
    target = target or source.with_name(f"{source.stem}-recovered.mcap")
    _check_source(source)
    check_target(target, [source], "give another OUT")
    if target.exists():
        raise WayfixError("exists already", str(target), "give another OUT, or remove it first")

    def added(result: Examination) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
        words = [] if trip is None else [trip]
        for record in words:
            result.trip.session(record, 0)
        if not result.counts:
            raise WayfixError("holds no sound record", str(source), "nothing of it can be recovered")
        losses = [loss.as_record() for loss in result.reader.losses]
        summary = result.summary()
        end = {"kind": "recovered", "from": source.name, "losses": losses, "summary": summary}
        return [*words, end], summary if TRIP in result.metadata else None

    return _rewrite(source, target, added, watch, f"free some space, or give an OUT elsewhere; {_AS_IT_WAS}")


def name_log(path: Path, trip: dict[str, Any], watch: Watch) -> Rewritten:
    """Put a name to a trip: the same log with one more `/session` record. Raises WayfixError; the log is as before."""
    _check_source(path)

    def added(result: Examination) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
        if result.state != "whole":
            cure = f"`wayfix log recover {shlex.quote(str(path))}` with the same --name, --place and --note"
            raise WayfixError(f"is {result.state}", str(path), cure)
        result.trip.session(trip, 0)
        return [trip, result.summary()], result.summary()

    return _rewrite(path, path.resolve(), added, watch, f"free some space or check rights; {_AS_IT_WAS}")


Added = Callable[[Examination], tuple[list[dict[str, Any]], dict[str, Any] | None]]
"""Called with what a source holds; returns the `/session` records to add, and the trip metadata in place of the old."""


def _check_source(path: Path) -> None:
    LogReader(path)
    if is_being_written(path):
        raise WayfixError("is being written right now", str(path), "end the recording first")


def _rewrite(source: Path, target: Path, added: Added, watch: Watch, cure: str) -> Rewritten:
    try:
        with whole_file(target) as stream:
            copy = _Copy(stream)
            result = examine(source, lambda scan: watch("copying", scan), copy.take)
            records, trip = added(result)
            copy.finish(records, trip, result.last_ns or 0)
            stream.flush()
            _compare(source, part_of(target), copy, lambda scan: watch("comparing", scan))
            shutil.copymode(source, part_of(target))
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(target), cure) from error
    return Rewritten(target, copy.count, result)


class _Copy:
    """Messages, metadata and attachments into a new file of 1 MiB chunks."""

    def __init__(self, stream: BinaryIO) -> None:
        self.count = 0
        self.added: list[_Whole] = []
        self.metadata: list[Metadata] = []
        self.attachments = 0
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._is_started = False
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._topics: dict[str, _Whole] = {}

    def take(self, item: Item, scan: Scan) -> None:
        """Write one item. Raises OSError."""
        self._start(scan.profile)
        if isinstance(item, tuple):
            whole = whole_of(item, scan.schemas)
            self._write(whole)
            self._topics[whole.topic] = whole
        elif isinstance(item, Metadata):
            self.metadata.append(item)
        else:
            self.attachments += 1
            self._writer.add_attachment(item.create_time, item.log_time, item.name, item.media_type, item.data)

    def finish(self, records: list[dict[str, Any]], trip: dict[str, Any] | None, last_ns: int) -> None:
        """Further `/session` records behind the last one, the metadata, and the index. Raises OSError."""
        self._start("")
        name, text = json_schema(SESSION)
        schema = name, SchemaEncoding.JSONSchema, text
        like = self._topics.get(SESSION)
        for record in records:
            data = json.dumps(record, allow_nan=False, separators=(",", ":")).encode()
            whole = _Whole(SESSION, MessageEncoding.JSON, schema, (), 0, last_ns, last_ns, data)
            if like is not None:
                whole = whole._replace(
                    encoding=like.encoding, schema=like.schema, channel_metadata=like.channel_metadata
                )
            self._write(whole)
            self.added.append(whole)
        if trip is not None:
            self.metadata = [each for each in self.metadata if each.name != TRIP] + [Metadata(TRIP, as_metadata(trip))]
        for each in self.metadata:
            self._writer.add_metadata(each.name, each.metadata)
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _start(self, profile: str) -> None:
        if not self._is_started:
            self._is_started = True
            self._writer.start(profile=profile, library="wayfix")

    def _write(self, whole: _Whole) -> None:
        self.count += 1
        key = whole[:4]
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._writer.register_channel(
                whole.topic, whole.encoding, self._schema(whole.schema), dict(whole.channel_metadata)
            )
        self._writer.add_message(channel, whole.log_time_ns, whole.data, whole.publish_time_ns, whole.sequence)

    def _schema(self, schema: tuple[str, str, bytes] | None) -> int:
        if schema is None:
            return 0
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(*schema)
        return self._schemas[schema]


def whole_of(message: Message, schemas: dict[int, Schema]) -> _Whole:
    """A message of a scan with its channel and schema."""
    channel, sequence, log_time_ns, publish_time_ns, data = message
    assert channel is not None
    return _Whole(*_about(channel, schemas.get(channel.schema_id)), sequence, log_time_ns, publish_time_ns, data)


def _about(
    channel: Channel, schema: Schema | None
) -> tuple[str, str, tuple[str, str, bytes] | None, tuple[tuple[str, str], ...]]:
    named = None if schema is None else (schema.name, schema.encoding, schema.data)
    return channel.topic, channel.message_encoding, named, tuple(channel.metadata.items())


def _compare(source: Path, copy_path: Path, copy: _Copy, watch: Callable[[Scan], None]) -> None:
    """Raises WayfixError unless MCAP's own reader finds exactly the sound records of the source, and what was added."""
    scans: list[Scan] = []

    def note(scan: Scan) -> None:
        scans[:] = [scan]
        watch(scan)

    try:
        with copy_path.open("rb") as stream, closing(LogReader(source).items(note)) as items:
            reader = make_reader(stream, validate_crcs=True)
            found = _messages(reader.iter_messages(log_time_order=False))
            attachments = []
            for item in items:
                if isinstance(item, tuple):
                    _same(next(found, None) == whole_of(item, scans[0].schemas))
                elif isinstance(item, Attachment):
                    attachments.append(item)
            _same(list(found) == copy.added)
            _same(list(reader.iter_metadata()) == copy.metadata)
            _same(list(reader.iter_attachments()) == attachments)
    except (OSError, WayfixError):
        raise
    except Exception as error:  # the library raises nearly anything
        raise _differs() from error


def _messages(found: Iterator[tuple[Schema | None, Channel, Any]]) -> Iterator[_Whole]:
    for schema, channel, message in found:
        about = _about(channel, schema)
        yield _Whole(*about, message.sequence, message.log_time, message.publish_time, message.data)


def _same(is_same: bool) -> None:
    if not is_same:
        raise _differs()


def _differs() -> WayfixError:
    return WayfixError("what was written does not read back as it should", "", "nothing was kept of it; check the disk")
