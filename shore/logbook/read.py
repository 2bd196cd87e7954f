"""Read a log in file order, which is the order of arrival; a cut file gives everything up to its last whole chunk.

    reader = read_log(Path("20261122T140055Z-springer.mcap"))
    for data in reader.frames(): ...
    if reader.damage: print(reader.damage)

The index is never used: a file left by a crash has none, and file order is what replay needs.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from mcap.records import Channel, Footer, Message
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

from common.errors import WayfixError
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, SESSION

_RECORD_LIMIT: Final = 256 * 2**20
"""Bytes; the writer's chunks are about 1 MiB, so a longer one is a damaged length."""


@dataclass(frozen=True, slots=True)
class LogRecord:
    """One message of a log."""

    topic: str
    data: bytes
    log_time_ns: int
    """Arrival, the station's UTC."""
    publish_time_ns: int
    """The record's own time on the boat clock (frames: `t1_ns`)."""

    def json(self) -> dict[str, Any]:
        """The content of a JSON record (every topic but /frames)."""
        content: dict[str, Any] = json.loads(self.data)
        return content


class LogReader:
    """One log file. Every iterator starts at the beginning; several may run at once."""

    def __init__(self, path: Path) -> None:
        """Raises WayfixError when the file is missing, empty or no MCAP file."""
        self.path = path
        self.damage: str | None = None
        """Why the log ends early; `None` while nothing is known against it. Complete after any full pass."""
        try:
            with path.open("rb") as stream:
                self._check(stream)
        except OSError as error:
            raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give the path of a log file") from error

    def _check(self, stream: BinaryIO) -> None:
        head = stream.read(len(MCAP0_MAGIC))
        if not head:
            raise WayfixError("the file is empty", str(self.path), "nothing was recorded")
        if not MCAP0_MAGIC.startswith(head):
            raise WayfixError("not an MCAP log", str(self.path), "other files are read with `wayfix import`")
        size = stream.seek(0, 2)
        stream.seek(max(0, size - len(MCAP0_MAGIC)))
        if size < 2 * len(MCAP0_MAGIC) or stream.read() != MCAP0_MAGIC:
            self.damage = "the log was not closed (crash, power cut, or still being written)"

    def records(self, *topics: str) -> Iterator[LogRecord]:
        """Records in file order, all or those of `topics`; ends quietly where the file is damaged and sets `damage`."""
        channels: dict[int, str] = {}
        with self.path.open("rb") as stream:
            for record in self._whole_records(stream):
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message):
                    topic = channels.get(record.channel_id, "")
                    if not topics or topic in topics:
                        yield LogRecord(topic, record.data, record.log_time, record.publish_time)

    def _whole_records(self, stream: BinaryIO) -> Iterator[object]:
        records = StreamReader(stream, validate_crcs=True, record_size_limit=_RECORD_LIMIT).records
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except Exception as error:  # a cut or damaged file makes the library raise nearly anything
                if self.damage is None:
                    self.damage = f"damaged before byte {stream.tell()} ({type(error).__name__}), read up to there"
                return
            yield record
            if isinstance(record, Footer):
                return

    def frames(self) -> Iterator[bytes]:
        """The frames' bytes as they were received, in order of arrival."""
        return (record.data for record in self.records(FRAMES))

    def estimates(self, name: str | None = None) -> Iterator[dict[str, Any]]:
        """Published estimates, of one filter or (None) of all."""
        for record in self.records():
            if record.topic.startswith(ESTIMATES) and name in (None, record.topic.removeprefix(ESTIMATES)):
                yield record.json()

    def events(self) -> Iterator[dict[str, Any]]:
        """Events of both sides."""
        return (record.json() for record in self.records(EVENTS))

    def session(self) -> Iterator[dict[str, Any]]:
        """Session records: `kind` start (configuration, versions, filters, options), operator actions, end."""
        return (record.json() for record in self.records(SESSION))


def read_log(path: str | Path) -> LogReader:
    """Open a log; raises WayfixError with one sentence when it cannot be."""
    return LogReader(Path(path))
