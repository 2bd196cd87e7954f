"""Log recovery: all sound records go into a new file with an index (`recover`), or a log gets a name (`name_log`).

What was written is read back with MCAP's own reader and compared record for record with the source, before it gets its
name: nothing is ever overwritten by something worse.
"""

import json
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
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


class Whole(NamedTuple):
    """A message with everything that an MCAP file says of it."""

    topic: str
    encoding: str
    schema: tuple[str, str, bytes] | None
    channel_metadata: tuple[tuple[str, str], ...]
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: bytes


def _nothing() -> Iterator[Whole]:
    return iter(())


class Added(NamedTuple):
    """What is written behind the records of a source, in this order."""

    sessions: list[dict[str, Any]]
    """Content of the `/session` records that come first, one map each."""
    more: Callable[[], Iterator[Whole]] = _nothing
    """Records of another log; asked for twice, since what was written is compared."""
    last: Sequence[dict[str, Any]] = ()
    """Content of the `/session` records that come last."""
    trip: dict[str, Any] | None = None
    """The trip's metadata in place of the old; `None` = as it was."""


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
    check_source(source)
    check_target(target, [source], "give another OUT")
    if target.exists():
        raise WayfixError("exists already", str(target), "give another OUT, or remove it first")

    def added(result: Examination) -> Added:
        words = [] if trip is None else [trip]
        for record in words:
            result.trip.session(record, 0)
        if not result.counts:
            raise WayfixError("holds no sound record", str(source), "nothing of it can be recovered")
        losses = [loss.as_record() for loss in result.reader.losses]
        summary = result.summary()
        end = {"kind": "recovered", "from": source.name, "losses": losses, "summary": summary}
        return Added([*words, end], trip=summary if TRIP in result.metadata else None)

    return rewrite(source, target, added, watch, f"free some space, or give an OUT elsewhere; {_AS_IT_WAS}")


def name_log(path: Path, trip: dict[str, Any], watch: Watch) -> Rewritten:
    """Put a name to a trip: the same log with one more `/session` record. Raises WayfixError; the log is as before."""
    check_source(path)

    def added(result: Examination) -> Added:
        if result.state != "whole":
            cure = f"`wayfix log recover {shlex.quote(str(path))}` with the same --name, --place and --note"
            raise WayfixError(f"is {result.state}", str(path), cure)
        result.trip.session(trip, 0)
        return Added([trip, result.summary()], trip=result.summary())

    return rewrite(path, path.resolve(), added, watch, f"free some space or check rights; {_AS_IT_WAS}")


def check_source(path: Path) -> None:
    """Raises WayfixError for what is no log, or is being written."""
    LogReader(path)
    if is_being_written(path):
        raise WayfixError("is being written right now", str(path), "end the recording first")


def rewrite(source: Path, target: Path, add: Callable[[Examination], Added], watch: Watch, cure: str) -> Rewritten:
    """The sound records of `source`, and what `add` gives behind them, as `target`.

    It has the rights and the time of `source`. Raises WayfixError; `target` is as it was then.
    """
    try:
        with whole_file(target) as stream:
            copy = _Copy(stream)
            result = examine(source, lambda scan: watch("copying", scan), copy.take)
            copy.finish(add(result), result.last_ns or 0)
            stream.flush()
            _compare(source, part_of(target), copy, lambda scan: watch("comparing", scan))
            shutil.copystat(source, part_of(target))
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(target), cure) from error
    return Rewritten(target, copy.count, result)


class _Copy:
    """Messages, metadata and attachments into a new file of 1 MiB chunks."""

    def __init__(self, stream: BinaryIO) -> None:
        self.count = 0
        self.added: Callable[[], Iterable[Whole]] = _nothing
        """What stands behind the source's own records."""
        self.metadata: list[Metadata] = []
        self.attachments = 0
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._is_started = False
        self._channels: dict[tuple[object, ...], int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._topics: dict[str, Whole] = {}

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

    def finish(self, added: Added, last_ns: int) -> None:
        """Write what is added behind the last record, the metadata, and the index. Raises OSError."""
        self._start("")
        first = [self._session(record, last_ns) for record in added.sessions]
        for whole in chain(first, added.more()):
            self._write(whole)
            last_ns = max(last_ns, whole.log_time_ns)
        last = [self._session(record, last_ns) for record in added.last]
        for whole in last:
            self._write(whole)
        self.added = lambda: chain(first, added.more(), last)
        if added.trip is not None:
            self.metadata = [each for each in self.metadata if each.name != TRIP]
            self.metadata.append(Metadata(TRIP, as_metadata(added.trip)))
        for each in self.metadata:
            self._writer.add_metadata(each.name, each.metadata)
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _session(self, record: dict[str, Any], log_time_ns: int) -> Whole:
        """A `/session` record in the form that the source gives to them."""
        name, text = json_schema(SESSION)
        data = json.dumps(record, allow_nan=False, separators=(",", ":")).encode()
        schema = name, SchemaEncoding.JSONSchema, text
        whole = Whole(SESSION, MessageEncoding.JSON, schema, (), 0, log_time_ns, log_time_ns, data)
        like = self._topics.get(SESSION)
        if like is None:
            return whole
        return whole._replace(encoding=like.encoding, schema=like.schema, channel_metadata=like.channel_metadata)

    def _start(self, profile: str) -> None:
        if not self._is_started:
            self._is_started = True
            self._writer.start(profile=profile, library="wayfix")

    def _write(self, whole: Whole) -> None:
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


def whole_of(message: Message, schemas: dict[int, Schema]) -> Whole:
    """A message of a scan with its channel and schema."""
    channel, sequence, log_time_ns, publish_time_ns, data = message
    assert channel is not None
    return Whole(*_about(channel, schemas.get(channel.schema_id)), sequence, log_time_ns, publish_time_ns, data)


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
            _same(all(next(found, None) == whole for whole in copy.added()))
            _same(next(found, None) is None)
            _same(list(reader.iter_metadata()) == copy.metadata)
            _same(list(reader.iter_attachments()) == attachments)
    except (OSError, WayfixError):
        raise
    except Exception as error:  # the library raises nearly anything
        raise _differs() from error


def _messages(found: Iterator[tuple[Schema | None, Channel, Any]]) -> Iterator[Whole]:
    for schema, channel, message in found:
        about = _about(channel, schema)
        yield Whole(*about, message.sequence, message.log_time, message.publish_time, message.data)


def _same(is_same: bool) -> None:
    if not is_same:
        raise _differs()


def _differs() -> WayfixError:
    return WayfixError("what was written does not read back as it should", "", "nothing was kept of it; check the disk")
