"""Log reader: records in file order, which is the order of arrival, also from a cut or damaged file.

    reader = read_log(Path("20261122T140055Z-springer.mcap"))
    for data in reader.frames(): ...
    if reader.damage: print(reader.damage)

A cut log gives everything up to its last whole chunk, a damaged one all chunks whose checksum holds (`mcap/scan.py`).
A sound record that has not the form of its channel (`record_checks.py`) is left out, counted and named like a damaged
one.
"""

import os
import re
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.messages import Frame
from common.words import counted, did_you_mean
from shore.logbook.foxglove import event_of
from shore.logbook.lock import is_being_written
from shore.logbook.mcap.damage import Flaw, Loss, sentence
from shore.logbook.mcap.records import MAGIC
from shore.logbook.mcap.scan import Scan, is_log
from shore.logbook.mcap.walk import Item
from shore.logbook.record_checks import FormError, content_of
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, LATE, LATE_OF, SESSION

_BUFFER: Final = 2**18
_LATE_NAME: Final = re.compile(rf"(?P<trip>.+){LATE}(-\d+)?\.mcap")


class LogRecord(NamedTuple):
    """One message of a log."""

    topic: str
    data: bytes
    log_time_ns: int
    """Time of arrival, the station's UTC, ns."""
    publish_time_ns: int
    """The record's own time on the boat clock, ns (frames: `t1_ns`)."""
    number: int = 0
    """Number of the record in file order."""

    def json(self) -> dict[str, Any]:
        """The content of a JSON record (every topic but /frames). Raises FormError for one of another form."""
        return content_of(self.topic, self.data)


@dataclass(slots=True)
class OddRecords:
    """Records of one topic that do not have its form."""

    topic: str
    first: str
    """What is wrong with the first such record."""
    numbers: set[int] = field(default_factory=set)
    """Numbers of these records in file order."""

    def __str__(self) -> str:
        return f"{counted(len(self.numbers), 'record')} of {self.topic} left out, not of its form ({self.first})"


class LogReader:
    """One log file. Every iterator starts at the beginning; several may run at once."""

    def __init__(self, path: Path) -> None:
        """Raises WayfixError when the file is missing, empty or no MCAP file."""
        self.path = path
        if path.exists() and not path.is_file() and not path.is_dir():  # a pipe waits for ever, a device never ends
            raise WayfixError("is no plain file", str(path), "give the path of a log file")
        self.is_being_written = is_being_written(path)
        """True when another program holds the writer's lock on the file."""
        self._scan: Scan | None = None
        """The newest pass that came to its end."""
        self._odd: dict[str, OddRecords] = {}
        """Odd records by topic."""
        with self._opened() as stream:
            self._looks_closed = self._check(stream)

    @property
    def damage(self) -> str | None:
        """What is wrong with the file and its records, in a sentence; `None` while nothing is known.

        Complete after any full pass; of odd records, those that were asked for.
        """
        told = [self._damage, *map(str, self._odd.values())]
        return "; ".join(each for each in told if each) or None

    @property
    def odd(self) -> tuple[OddRecords, ...]:
        """Records that have not the form of their channel, of those that were asked for."""
        return tuple(self._odd.values())

    @property
    def _damage(self) -> str | None:
        if self._scan is None:
            if self._looks_closed:
                return None
            if self.is_being_written:
                return "the log is being written right now"
            return "the log was not closed (crash or power cut)"
        scan = self._scan
        return sentence(scan.losses, scan.flaws, scan.cut, is_being_written=self.is_being_written)

    @property
    def losses(self) -> tuple[Loss, ...]:
        """Stretches without their records, in file order, the cut end last. Complete after any full pass.

        The end of a log that is being written is none.
        """
        if self._scan is None:
            return ()
        cut = (self._scan.cut,) if self._scan.cut is not None and not self.is_being_written else ()
        return (*self._scan.losses, *cut)

    @property
    def flaws(self) -> tuple[Flaw, ...]:
        """Damage that costs no record. Complete after any full pass."""
        return tuple(self._scan.flaws) if self._scan is not None else ()

    @property
    def is_cut(self) -> bool:
        """The log was not closed, and no program is writing it. Complete after any full pass."""
        if self._scan is None:
            return not self._looks_closed and not self.is_being_written
        return self._scan.cut is not None and not self.is_being_written

    def records(self, *topics: str) -> Iterator[LogRecord]:
        """Records in file order, all or those of `topics`. Raises WayfixError when the disk itself fails."""
        with closing(self.items()) as items:
            for number, item in enumerate(items):
                if isinstance(item, tuple):
                    channel, _, log_time_ns, publish_time_ns, data = item
                    if channel is not None and (not topics or channel.topic in topics):
                        yield LogRecord(channel.topic, data, log_time_ns, publish_time_ns, number)

    def content(self, record: LogRecord) -> dict[str, Any] | None:
        """The content of a JSON record; `None` for an odd one, which is counted."""
        try:
            return record.json()
        except FormError as error:
            self._leave_out(record, error)
            return None

    def frame(self, record: LogRecord) -> Frame | None:
        """A record of `/frames`; `None` for what is no frame, which is counted."""
        try:
            return decode_frame(record.data)
        except CodecError as error:
            self._leave_out(record, error)
            return None

    def items(self, progress: Callable[[Scan], None] | None = None, *, check_index: bool = False) -> Generator[Item]:
        """Messages, metadata and attachments as the scan gives them. progress: called now and then."""
        with self._opened() as stream:
            try:
                scan = Scan(stream, check_index=check_index)
                for count, item in enumerate(scan.items()):
                    if progress is not None and count % 1024 == 0:
                        progress(scan)
                    yield item
            except OSError as error:
                raise self._unreadable(error) from error
        if scan.cut is not None and not self.is_being_written:
            self.is_being_written = is_being_written(self.path)
        self._scan = scan
        if progress is not None:
            progress(scan)

    def frames(self) -> Iterator[bytes]:
        """The frames' bytes as they were received, in order of arrival."""
        return (record.data for record in self.records(FRAMES))

    def estimates(self, name: str | None = None) -> Iterator[dict[str, Any]]:
        """Published estimates, of one filter or (None) of all."""
        for record in self.records():
            if record.topic.startswith(ESTIMATES) and name in (None, record.topic.removeprefix(ESTIMATES)):
                content = self.content(record)
                if content is not None:
                    yield content

    def events(self) -> Iterator[dict[str, Any]]:
        """Events of both sides, with the fields of `Event`."""
        return map(event_of, self._contents(EVENTS))

    def session(self) -> Iterator[dict[str, Any]]:
        """Session records: `kind` start (configuration, versions, filters, options), trip, operator, end, summary."""
        return self._contents(SESSION)

    def start(self) -> dict[str, Any] | None:
        """The first session record of kind start; `None` = it has none."""
        return next((record for record in self.session() if record["kind"] == "start"), None)

    def _contents(self, topic: str) -> Iterator[dict[str, Any]]:
        return (content for record in self.records(topic) if (content := self.content(record)) is not None)

    def _leave_out(self, record: LogRecord, why: Exception) -> None:
        self._odd.setdefault(record.topic, OddRecords(record.topic, str(why))).numbers.add(record.number)

    def _opened(self) -> BinaryIO:
        try:
            return self.path.open("rb", buffering=_BUFFER)
        except OSError as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: OSError) -> WayfixError:
        cure = "give the path of a log file" if self._scan is None else "copy the file to a sound disk first"
        return WayfixError(f"cannot be read ({error.strerror}{near_name(self.path)})", str(self.path), cure)

    def _check(self, stream: BinaryIO) -> bool:
        """Check whether the file ends like a closed log."""
        try:
            head = stream.read(len(MAGIC))
            size = stream.seek(0, 2)
            stream.seek(max(0, size - len(MAGIC)))
            foot = stream.read(len(MAGIC))
            is_readable = is_log(stream)
        except OSError as error:
            raise self._unreadable(error) from error
        if not head:
            raise WayfixError("the file is empty", str(self.path), "nothing was recorded")
        if not is_readable:
            raise WayfixError("not an MCAP log", str(self.path), "other files are read with `wayfix import`")
        return size >= 2 * len(MAGIC) and foot == MAGIC


def near_name(path: Path) -> str:
    """`, did you mean trip.mcap?` for a file that is not there; empty where no name beside it is near."""
    try:
        return "" if path.exists() else did_you_mean(path.name, os.listdir(path.parent))  # noqa: PTH208 - names alone
    except (OSError, ValueError):
        return ""


def read_log(path: str | Path) -> LogReader:
    """Open a log; raises WayfixError with one sentence when it cannot be."""
    return LogReader(Path(path))


def late_logs(directory: Path) -> list[tuple[Path, Path]]:
    """The logs of late frames in a directory, each behind the path of the trip that it belongs to. Raises OSError.

    One that cannot be read is among them, so that its reader says what is wrong with it.
    """
    found = [(path, _LATE_NAME.fullmatch(path.name)) for path in sorted(directory.glob(f"*{LATE}*.mcap"))]
    return [(path.with_name(f"{match['trip']}.mcap"), path) for path, match in found if match and _may_be_late(path)]


def _may_be_late(path: Path) -> bool:
    try:
        start = LogReader(path).start()
    except WayfixError:
        return True
    return start is None or LATE_OF in start
