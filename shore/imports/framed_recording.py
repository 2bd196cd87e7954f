"""Frames that are there already (frames file, converted recording, log): logged, or unpacked (demultiplexed)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.framer import ImuSample, Measurement
from common.messages import Frame
from common.settings import convert
from common.units import NS_PER_S
from shore.imports.job import Job
from shore.imports.line_counts import Account
from shore.imports.log_maker import LogMaker, Written
from shore.imports.meaning import words_of
from shore.imports.part import ALONE, TripPart, check_sound, moved
from shore.imports.progress import frames_shown
from shore.imports.reader import digest_of
from shore.imports.recognise import RecordingKind
from shore.imports.recording_date import utc_offset_ns
from shore.logbook.log_reader import LogReader

REPAIRED_NS: Final = 512 * 7 * 86_400 * NS_PER_S
"""A UTC of the frames that is further than this, half the turn of a GPS week number, from the recording's was repaired,
ns."""


class FramedFile(Protocol):
    """A file of frames."""

    greeting: dict[str, Any]
    """What the boat said at the beginning."""

    @property
    def cut(self) -> object | None:
        """What is wrong with the file, `None` = nothing; known after the last frame."""

    def frames(self) -> Iterator[bytes]:
        """Each frame's bytes, in order; every call begins at the first one."""


class LogFrames:
    """The frames of a log."""

    def __init__(self, path: Path) -> None:
        """Raises WayfixError for a log without its beginning."""
        self._log = LogReader(path)
        start = next((record for record in self._log.session() if record.get("kind") == "start"), None)
        greeting = (start or {}).get("connected")
        if not isinstance(greeting, dict) or "config" not in greeting:
            raise WayfixError("has no record of how its session began", str(path), ALONE)
        self.greeting: dict[str, Any] = greeting

    @property
    def cut(self) -> object | None:
        """Damage of the log."""
        return self._log.damage

    def frames(self) -> Iterator[bytes]:
        """The frames' bytes, in order of arrival."""
        return self._log.frames()


@dataclass(slots=True)
class _Extent:
    """What a pass over all frames finds."""

    clocks: set[str] = field(default_factory=set)
    sensors: set[str] = field(default_factory=set)
    first_ns: int | None = None
    last_ns: int = 0
    newest_ns: int | None = None
    is_in_order: bool = True

    def take(self, frame: Frame) -> None:
        self.clocks.add(frame.clock_id)
        self.is_in_order &= self.newest_ns is None or frame.t1_ns > self.newest_ns
        self.newest_ns = frame.t1_ns
        measured = measurements_of(frame)
        if measured:
            first_ns, last_ns = (max(item.t_ns, frame.t0_ns) for item in (measured[0], measured[-1]))
            self.first_ns = first_ns if self.first_ns is None else self.first_ns
            self.last_ns = last_ns
            self.sensors.update(item.sensor for item in measured)


class FramedRecording:
    """A recording of which there are frames."""

    def __init__(
        self,
        job: Job,
        file: FramedFile,
        hint_ns: int | None = None,
        count: int | None = None,
        utc_less_boat_ns: int | None = None,
    ) -> None:
        """hint_ns: UTC of the first line where nothing else gives it; count: of the frames, for the bar.

        utc_less_boat_ns: by the leading clock of the recording; where the frames say a wholly different UTC (a week
        rollover that was repaired), these are believed.
        """
        self._job = job
        self._file = file
        self._count = count
        job.digest = digest_of(job.source)
        first = next(decoded(file.frames()), None)
        self._offset_ns = utc_offset_ns(decoded(file.frames()))
        if utc_less_boat_ns is not None and (
            self._offset_ns is None or abs(self._offset_ns - utc_less_boat_ns) < REPAIRED_NS
        ):
            self._offset_ns = utc_less_boat_ns
        if self._offset_ns is None and hint_ns is not None and first is not None:
            self._offset_ns = hint_ns - first.t0_ns

    def log(self, out: Path) -> tuple[bool, Written]:
        """A log of it alone; False = nothing was measured, and no log was written. Raises WayfixError."""
        job, file = self._job, self._file
        account = Account("frames")

        def taken() -> Iterator[bytes]:
            for data in file.frames():
                account.taken["frame"] += 1
                yield data
            if file.cut is not None:
                job.notes.append(f"the file is {file.cut}")

        def facts() -> dict[str, Any]:
            job.notes += [words_of(doubt, None) for doubt in maker.doubts()]
            return job.record()

        if job.kind is RecordingKind.FRAMES:
            job.accounts = (account,)
        maker = LogMaker(file.greeting, job.options.settings, self._offset_ns)
        done = maker.write(out, frames_shown(taken(), "filtering", self._count), job.options.trip, facts)
        return done, maker.written

    def part(self) -> TripPart:
        """It as one of several; raises WayfixError when it is damaged, in disorder, or has no UTC."""
        job = self._job
        extent = _Extent()
        account = Account("frames")
        for frame in decoded(self._file.frames(), account):
            extent.take(frame)
        job.accounts = job.accounts or (account,)
        self._check(extent)
        assert self._offset_ns is not None
        assert extent.first_ns is not None
        offset_ns = self._offset_ns
        config = convert(self._file.greeting["config"], BoatConfig, "configuration of the boat", strict=False)
        return TripPart(
            job=job,
            boat=config.boat,
            sensors=tuple(table for table in config.sensor if table.id in extent.sensors),
            first_ns=extent.first_ns + offset_ns,
            last_ns=extent.last_ns + offset_ns,
            measurements=lambda: (
                moved(measurement, offset_ns)
                for frame in decoded(self._file.frames())
                for measurement in measurements_of(frame)
            ),
        )

    def _check(self, extent: _Extent) -> None:
        where = str(self._job.source)
        is_log = self._job.kind is RecordingKind.LOG
        if self._file.cut is not None:
            cure = "`wayfix log recover` writes what is sound into a log of its own" if is_log else ALONE
            raise WayfixError(f"is damaged: {self._file.cut}", where, cure)
        if extent.first_ns is None:
            raise WayfixError("nothing in it could be used", where, "leave it out")
        check_sound(self._job)
        if not extent.is_in_order or len(extent.clocks) > 1:
            what = "has frames that came late" if not extent.is_in_order else "holds several starts of the boat's clock"
            cure = "`wayfix replay LOG --order time --record OUT.mcap` puts them in order, then import OUT.mcap"
            raise WayfixError(what, where, cure if not extent.is_in_order and is_log else ALONE)
        if self._offset_ns is None:
            made = self._file.greeting.get("file") or {}
            has_time = made.get("clock") == "utc-time-of-day"
            what = "says the time of day but no date" if has_time else "says no UTC"
            raise WayfixError(f"{what}, and several recordings are put together by UTC", where, ALONE)


def measurements_of(frame: Frame) -> list[Measurement]:
    """All measurements of a frame; those that came late first, the others by time."""
    found: list[Measurement] = [*frame.fixes, *frame.headings, *frame.turn_rates, *frame.attitudes]
    found += [*frame.clock_pairs, *frame.ais, *frame.radar, *frame.raw]
    for block in frame.imu:
        columns = (block.sample_t_ns, block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s)
        found += (ImuSample(block.sensor, *sample) for sample in zip(*columns, strict=True))
    return sorted(found, key=lambda measurement: max(measurement.t_ns, frame.t0_ns))


def decoded(frames: Iterable[bytes], account: Account | None = None) -> Iterator[Frame]:
    """The frames that are such; account: counts them all."""
    for data in frames:
        try:
            frame = decode_frame(data)
        except CodecError:
            if account is not None:
                account.rejected["no frame"] += 1
            continue
        if account is not None:
            account.taken["frame"] += 1
        yield frame
