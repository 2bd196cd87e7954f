"""Import pipelines, one for each kind of file; all of them end in `write`."""

import sys
import tempfile
from array import array
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig
from common.codec import decode_frame, encode_frame
from common.errors import CodecError, WayfixError
from common.frames_file import FramesFile
from common.messages import Frame
from common.settings import read_toml
from common.units import NS_PER_MS, NS_PER_S
from shore.imports import frames as cut
from shore.imports import serial_port
from shore.imports.column_map import read_column_map
from shore.imports.columns import ColumnReader
from shore.imports.gpsd import GpsdReader
from shore.imports.line_counts import Account
from shore.imports.log_maker import LogMaker, Written
from shore.imports.reader import Lines, RecordingReader, digest_of
from shore.imports.recognise import RecordingKind
from shore.imports.record_times import NO_TIME, Plan
from shore.imports.recording_date import utc_offset_ns
from shore.imports.signalk import SELF, SignalKReader, own_contexts
from shore.settings.station import FRAMES_ONLY, StationSettings
from shore.terminal import say

PACE_HZ: Final = 1.0
"""Pace of JSON records without any time, Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """What an import was asked for."""

    settings: StationSettings = FRAMES_ONLY
    """Settings of the station; without a filter in them the log holds frames only."""
    trip: dict[str, Any] | None = None
    """Name, place and note of the trip (`trip_record`); `None` = none was given."""
    map: Path | None = None
    """Mapping file that says which column of a table is what; a table needs one."""
    config: Path | None = None
    """The boat's configuration file; `None` = the sensors are those found in the recording."""
    port: str | None = None
    """The `[[port]]` of `config` that a serial recording comes from."""
    vessel: str | None = None
    """The vessel whose Signal K deltas are read; `None` = the server's own."""
    lines_per_second: float | None = None
    """Pace of a recording without times, lines a second."""


@dataclass(slots=True)
class Job:
    """One import on its way."""

    source: Path
    out: Path
    options: ImportOptions
    kind: RecordingKind
    accounts: tuple[Account, ...] = ()
    notes: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    """Facts that are kept in the log besides: the source of each sensor, gaps."""
    digest: str = ""

    def record(self) -> dict[str, Any]:
        """Record of the import for the log's `end` record and for the summary."""
        accounts = {account.unit: account.as_record() for account in self.accounts}
        made = {"file": self.source.name, "sha256": self.digest, "kind": str(self.kind)}
        return {**made, "accounts": accounts, "notes": self.notes, **self.facts}


def imported(job: Job) -> tuple[bool, Written]:
    """Do it; False = nothing could be used, and no log was written. Raises WayfixError."""
    with tempfile.TemporaryDirectory(prefix="wayfix-import-") as directory:
        match job.kind:
            case RecordingKind.FRAMES:
                return _from_frames_file(job, job.source)
            case RecordingKind.SERIAL:
                return _from_serial(job, job.source, Path(directory) / "frames", None)
            case RecordingKind.SIGNALK_LOG:
                return _from_server_log(job, Path(directory))
            case RecordingKind.TABLE:
                assert job.options.map is not None
                mapping = read_column_map(job.options.map)
                return _from_reader(job, lambda progress: ColumnReader(job.source, mapping, progress))
            case RecordingKind.GPSD:
                return _from_reader(job, lambda progress: GpsdReader(Lines(job.source, progress)))
            case RecordingKind.SIGNALK:
                return _from_deltas(job)


def _from_deltas(job: Job) -> tuple[bool, Written]:
    own = own_contexts(Lines(job.source), job.options.vessel, str(job.source))
    if own[0] != SELF:
        job.notes.append(f"taken for our own boat: {own[0]}")
    job.facts["own"] = own[0]
    return _from_reader(job, lambda progress: SignalKReader(Lines(job.source, progress), own))


def _from_server_log(job: Job, directory: Path) -> tuple[bool, Written]:
    """Import a server's log: its sentences where it has any, else its deltas."""
    log = serial_port.ServerLog(job.source, directory / job.source.name)
    if not log.sentences:
        return _from_deltas(job)
    if job.options.vessel is not None:
        raise WayfixError("names a vessel, but the log has the boat's own sentences", "--vessel", "leave it out")
    if len(log.providers) > 1:
        names = ", ".join(sorted(log.providers))
        job.notes.append(f"sentences of {len(log.providers)} providers ({names}) are taken for one port")
    if log.deltas:
        job.notes.append(f"{log.deltas} deltas are not used: the sentences stand beside them")
    return _from_serial(job, directory / job.source.name, directory / "frames", log)


def _from_serial(job: Job, source: Path, frames: Path, log: serial_port.ServerLog | None) -> tuple[bool, Written]:
    asked = job.options
    given: list[str] = []
    for name, value in (
        ("--config", asked.config),
        ("--port", asked.port),
        ("--lines-per-second", asked.lines_per_second),
    ):
        given += [] if value is None else [name, str(value)]
    try:
        summary = serial_port.convert(source, frames, given, say)
        if log is not None and summary["pace"] == "baud" and log.lines_per_second is not None:
            given += ["--lines-per-second", repr(log.lines_per_second)]
            summary = serial_port.convert(source, frames, given, say)
    except WayfixError as error:
        raise WayfixError(str(error).replace(str(source), str(job.source))) from error
    account = serial_port.account_of(summary)
    if log is not None:
        account.ignored.update(log.ignored)
        account.rejected.update(log.rejected)
    job.accounts = (account,)
    job.facts["pace"] = summary["pace"]
    job.facts["gaps"] = summary["gaps"]
    if summary["pace"] == "baud":
        job.notes.append("no times inside: lines follow each other at the baud rate; --lines-per-second X sets another")
    return _from_frames_file(job, frames, None if log is None else log.first_ns, summary["frames"])


def _from_frames_file(
    job: Job, path: Path, hint_ns: int | None = None, count: int | None = None
) -> tuple[bool, Written]:
    """hint_ns: UTC of the first line where nothing else gives it; count: of the frames, for the bar."""
    job.digest = digest_of(job.source)
    with FramesFile(path) as file:
        first = next(_decoded(file.frames()), None)
        offset_ns = utc_offset_ns(_decoded(file.frames()))
        if offset_ns is None and hint_ns is not None and first is not None:
            offset_ns = hint_ns - first.t0_ns
        account = Account("frames")

        def taken() -> Iterator[bytes]:
            for data in file.frames():
                account.taken["frame"] += 1
                yield data
            if file.cut is not None:
                job.notes.append(f"the file is {file.cut}")

        if job.kind is RecordingKind.FRAMES:
            job.accounts = (account,)
        maker = LogMaker(file.greeting, job.options.settings, offset_ns)
        done = maker.write(job.out, _shown(taken(), "filtering", count), job.options.trip, job.record)
    return done, maker.written


def _from_reader(job: Job, make: Callable[[Callable[[int], None] | None], RecordingReader]) -> tuple[bool, Written]:
    """Two passes: what is in it and when, then the frames."""
    job.digest = digest_of(job.source)
    size = job.source.stat().st_size
    given = None if job.options.config is None else read_toml(job.options.config, BoatConfig)
    times = array("q")
    with _bytes_shown("reading", size) as progress:
        first = make(progress)
        rates = cut.survey(_first_pass(first, times))
    mapping = first.mapping.time if isinstance(first, ColumnReader) else None
    pace_hz = job.options.lines_per_second or PACE_HZ
    plan = Plan(times, pace_hz, spread=mapping is not None and mapping.spread, is_utc=first.is_utc)
    if plan.timed and job.options.lines_per_second is not None:
        raise WayfixError("the recording has its own times", "--lines-per-second", "leave it out")
    if not plan.timed and times:
        job.notes.append(f"no times inside: one record every {1 / pace_hz:g} s; --lines-per-second X sets another pace")
    config = cut.boat_config(first.boat, first.sensors(rates), given)
    is_utc = first.is_utc and plan.timed
    made = {"kind": str(job.kind), "clock": "utc" if is_utc else "from-zero"}
    greeting = cut.greeting_of(config, job.digest, made)
    source = "gnss" if job.kind is RecordingKind.GPSD else "rtc"
    doubt_ns = 100 * NS_PER_MS if source == "gnss" else NS_PER_S
    clock = cut.RecordingClock(source if is_utc else "none", doubt_ns, plan.shift_of_date_ns)
    if is_utc and plan.misdated:
        job.notes.append(
            f"the clock was set on the way: {plan.misdated} records bear another date; they keep their intervals, "
            "and their UTC is reckoned from the others"
        )
    maker = LogMaker(greeting, job.options.settings, -plan.shift_of_date_ns if is_utc else None)
    with _bytes_shown("importing", size) as progress:
        second = make(progress)
        second.sources = first.sources
        job.accounts, job.notes = second.accounts, [*job.notes, *second.notes]
        if first.sources.names:
            job.facts["sources"] = first.sources.as_record()
        placed = _second_pass(second, plan)
        frames = cut.frames_of(placed, config, cut.identity_of(greeting), clock)
        done = maker.write(job.out, map(encode_frame, frames), job.options.trip, job.record)
    return done, maker.written


def _first_pass(reader: RecordingReader, times: "array[int]") -> Iterator[cut.Placed]:
    for record in reader.records():
        times.append(NO_TIME if record.t_ns is None else record.t_ns)
        for measurement in reader.measure(record, record.t_ns or 0):
            yield cut.Placed(measurement, 0, 0)


def _second_pass(reader: RecordingReader, plan: Plan) -> Iterator[cut.Placed]:
    for number, record in enumerate(reader.records()):
        t_ns = plan.at(number)
        if t_ns is None:
            reader.leave_out(record, "wrong" if number in plan.doubted else "no time")
            continue
        shift_ns, epoch = plan.shift_ns(number), plan.epoch(number)
        for measurement in reader.measure(record, t_ns):
            yield cut.Placed(measurement, shift_ns, epoch)


def _decoded(frames: Iterable[bytes]) -> Iterator[Frame]:
    for data in frames:
        try:
            yield decode_frame(data)
        except CodecError:
            continue


def _shown(items: Iterator[bytes], words: str, total: int | None) -> Iterable[bytes]:
    if not (sys.stderr and sys.stderr.isatty()):
        return items
    from rich.console import Console
    from rich.progress import track

    return track(items, description=words, console=Console(stderr=True), total=total, transient=True)


@contextmanager
def _bytes_shown(words: str, size: int) -> Iterator[Callable[[int], None] | None]:
    """A bar over the bytes of a file; `None` where stderr is no terminal."""
    if not (sys.stderr and sys.stderr.isatty()):
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(words, total=size)
        yield lambda count: progress.advance(task, count)
