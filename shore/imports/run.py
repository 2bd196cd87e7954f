"""Import pipelines, one for each kind of file: a recording becomes a log, or part of one (ETL)."""

import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from common.errors import WayfixError
from common.frames_file import FramesFile
from shore.imports import serial_port
from shore.imports.column_map import read_column_map
from shore.imports.columns import ColumnReader
from shore.imports.foreign_recording import ForeignRecording, Make
from shore.imports.framed_recording import FramedRecording, LogFrames
from shore.imports.gpsd import GpsdReader
from shore.imports.gpx import GpxReader
from shore.imports.job import Job
from shore.imports.json_lines import one_object_a_line
from shore.imports.log_maker import Written
from shore.imports.part import TripPart
from shore.imports.reader import Lines
from shore.imports.recognise import RecordingKind
from shore.imports.signalk import SELF, SignalKReader, own_contexts
from shore.terminal import say


class Recording(Protocol):
    """A recording that was looked at."""

    def log(self, out: Path) -> tuple[bool, Written]:
        """A log of it alone; False = nothing could be used, and no log was written. Raises WayfixError."""

    def part(self) -> TripPart:
        """It as one of several; raises WayfixError when it cannot be one."""


def imported(job: Job, out: Path) -> tuple[bool, Written]:
    """A log of one recording; False = nothing could be used, and no log was written. Raises WayfixError."""
    with ExitStack() as stack:
        return opened_recording(job, stack).log(out)


def opened_recording(job: Job, stack: ExitStack) -> Recording:
    """Look at it. stack: until it ends, the recording can be read. Raises WayfixError."""
    match job.kind:
        case RecordingKind.FRAMES:
            return FramedRecording(job, stack.enter_context(FramesFile(job.source)))
        case RecordingKind.LOG:
            return FramedRecording(job, LogFrames(job.source))
        case RecordingKind.SERIAL:
            return _from_serial(job, stack, job.source, None)
        case RecordingKind.SIGNALK_LOG:
            return _from_server_log(job, stack)
        case RecordingKind.TABLE:
            assert job.options.map is not None
            mapping = read_column_map(job.options.map)
            return _from_reader(job, lambda progress: ColumnReader(job.source, mapping, progress))
        case RecordingKind.GPSD:
            return _from_reader(job, lambda progress: GpsdReader(one_object_a_line(Lines(job.source, progress))))
        case RecordingKind.GPX:
            return _from_reader(job, lambda progress: GpxReader(job.source, progress))
        case RecordingKind.SIGNALK:
            return _from_deltas(job)


def _from_reader(job: Job, make: Make) -> Recording:
    return ForeignRecording(job, make)


def _from_deltas(job: Job) -> Recording:
    own = own_contexts(one_object_a_line(Lines(job.source)), job.options.vessel, str(job.source))
    if own[0] != SELF:
        job.notes.append(f"taken for our own boat: {own[0]}")
    job.facts["own"] = own[0]
    return _from_reader(job, lambda progress: SignalKReader(one_object_a_line(Lines(job.source, progress)), own))


def _from_server_log(job: Job, stack: ExitStack) -> Recording:
    """Import a server's log: its sentences where it has any, else its deltas."""
    target = _directory(stack) / job.source.name
    log = serial_port.ServerLog(job.source, target)
    if not log.sentences:
        return _from_deltas(job)
    if job.options.vessel is not None:
        raise WayfixError("names a vessel, but the log has the boat's own sentences", "--vessel", "leave it out")
    if len(log.providers) > 1:
        names = ", ".join(sorted(log.providers))
        job.notes.append(f"sentences of {len(log.providers)} providers ({names}) are taken for one port")
    if log.deltas:
        job.notes.append(f"{log.deltas} deltas are not used: the sentences stand beside them")
    return _from_serial(job, stack, target, log)


def _from_serial(job: Job, stack: ExitStack, source: Path, log: serial_port.ServerLog | None) -> Recording:
    asked = job.options
    frames = _directory(stack) / "frames"
    given: list[str] = []
    for name, value in (
        ("--config", asked.config),
        ("--port", asked.port),
        ("--lines-per-second", asked.lines_per_second),
    ):
        given += [] if value is None else [name, str(value)]
    try:
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
    job.facts["clocks"] = summary["clocks"]
    job.notes += summary["notes"]
    if summary["pace"] == "baud":
        job.notes.append("no times inside: lines follow each other at the baud rate; --lines-per-second X sets another")
    file = stack.enter_context(FramesFile(frames))
    hint_ns = None if log is None else log.first_ns
    return FramedRecording(job, file, hint_ns, summary["frames"], summary["utc_less_boat_ns"])


def _directory(stack: ExitStack) -> Path:
    """A temporary directory that lasts as long as the stack."""
    return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="wayfix-import-")))
