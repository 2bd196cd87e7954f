"""Two-pass import of a foreign recording: what is in it and when, then its measurements on one clock."""

from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig
from common.codec import encode_frame
from common.errors import WayfixError
from common.messages import Fix
from common.settings import read_toml
from common.units import NS_PER_MS, NS_PER_S
from shore.imports import frames as cut
from shore.imports.columns import ColumnReader
from shore.imports.job import Job
from shore.imports.log_maker import LogMaker, Written
from shore.imports.meaning import Doubt, words_of
from shore.imports.part import ALONE, TripPart, check_sound, moved
from shore.imports.progress import bytes_shown
from shore.imports.reader import RecordingReader, digest_of
from shore.imports.recognise import RecordingKind
from shore.imports.record_times import NO_TIME, Plan
from shore.imports.source_clocks import SourceClocks

PACE_HZ: Final = 1.0
"""Pace of JSON records without any time, Hz."""
Make = Callable[[Callable[[int], None] | None], RecordingReader]
"""A new pass over the recording; it is handed what shows its progress."""


class ForeignRecording:
    """A recording that a `RecordingReader` reads. The first pass is made at once."""

    def __init__(self, job: Job, make: Make) -> None:
        """Raises WayfixError for options that do not fit its times."""
        self._job = job
        self._make = make
        job.digest = digest_of(job.source)
        self._size = job.source.stat().st_size
        self._given = None if job.options.config is None else read_toml(job.options.config, BoatConfig)
        times, self._clocks = array("q"), SourceClocks()
        with bytes_shown("reading", self._size) as progress:
            self._first = make(progress)
            self._rates = cut.survey(_first_pass(self._first, times, self._clocks))
        if self._first.is_utc:
            self._clocks.align(times)
            job.notes += self._clocks.words()
        mapping = self._first.mapping.time if isinstance(self._first, ColumnReader) else None
        pace_hz = job.options.lines_per_second or PACE_HZ
        spread = mapping is not None and mapping.spread
        self._plan = Plan(times, pace_hz, spread=spread, is_utc=self._first.is_utc)
        self._is_utc = self._first.is_utc and self._plan.timed
        if self._plan.timed and job.options.lines_per_second is not None:
            raise WayfixError("the recording has its own times", "--lines-per-second", "leave it out")
        if not self._plan.timed and times:
            pace = f"one record every {1 / pace_hz:g} s"
            job.notes.append(f"no times inside: {pace}; --lines-per-second X sets another pace")
        if self._is_utc and self._plan.misdated:
            job.notes.append(
                f"the clock was set on the way: {self._plan.misdated} records bear another date; they keep their "
                "intervals, and their UTC is reckoned from the others"
            )

    def log(self, out: Path) -> tuple[bool, Written]:
        """A log of it alone; False = nothing could be used, and no log was written. Raises WayfixError."""
        job, plan = self._job, self._plan
        config = cut.boat_config(self._first.boat, self._first.sensors(self._rates), self._given)
        made = {"kind": str(job.kind), "clock": "utc" if self._is_utc else "from-zero"}
        greeting = cut.greeting_of(config, job.digest, made)
        source = "gnss" if job.kind in (RecordingKind.GPSD, RecordingKind.GPX) else "rtc"
        doubt_ns = 100 * NS_PER_MS if source == "gnss" else NS_PER_S
        clock = cut.RecordingClock(source if self._is_utc else "none", doubt_ns, plan.shift_of_date_ns)
        maker = LogMaker(greeting, job.options.settings, -plan.shift_of_date_ns if self._is_utc else None)
        with bytes_shown("importing", self._size) as progress:
            frames = cut.frames_of(self._second_pass(progress), config, cut.identity_of(greeting), clock)
            done = maker.write(out, map(encode_frame, frames), job.options.trip, lambda: self._record(maker.doubts()))
        return done, maker.written

    def part(self) -> TripPart:
        """It as one of several; raises WayfixError when it is damaged or has no UTC."""
        job, plan = self._job, self._plan
        job.accounts = self._first.accounts
        check_sound(job)
        if not plan.timed:
            raise WayfixError("has no times, and several recordings are put together by UTC", str(job.source), ALONE)
        if not self._is_utc:
            what = "counts its times from an unknown moment, and several recordings are put together by UTC"
            cure = "say in [time] of its mapping how they become UTC (unix, utc or zero_utc)"
            raise WayfixError(what, str(job.source), f"{cure}, or {ALONE}")
        first_ns, last_ns = plan.span_ns
        shift_ns = -plan.shift_of_date_ns
        return TripPart(
            job=job,
            boat=self._first.boat,
            sensors=self._first.sensors(self._rates),
            first_ns=first_ns + shift_ns,
            last_ns=last_ns + shift_ns,
            measurements=lambda: (moved(placed.measurement, shift_ns) for placed in self._second_pass(None)),
        )

    def _record(self, doubts: Sequence[Doubt]) -> dict[str, Any]:
        """The job's record, with what its values contradict among the notes."""
        mapping = self._first.mapping if isinstance(self._first, ColumnReader) else None
        self._job.notes += [words_of(doubt, mapping) for doubt in doubts]
        return self._job.record()

    def _second_pass(self, progress: Callable[[int], None] | None) -> Iterator[cut.Placed]:
        """The measurements on boat time; the accounts of the job are those of this pass."""
        job, plan = self._job, self._plan
        reader = self._make(progress)
        reader.sources = self._first.sources
        job.accounts = reader.accounts
        job.notes += [note for note in self._first.notes if note not in job.notes]
        if reader.sources.names:
            job.facts["sources"] = reader.sources.as_record()
        for number, record in enumerate(reader.records()):
            t_ns = plan.at(number)
            if t_ns is None:
                reader.leave_out(record, "wrong" if number in plan.doubted else "no time")
                continue
            shift_ns, epoch = plan.shift_ns(number), plan.epoch(number)
            for measurement in reader.measure(self._clocks.aligned(record), t_ns):
                yield cut.Placed(measurement, shift_ns, epoch)


def _first_pass(reader: RecordingReader, times: "array[int]", clocks: SourceClocks) -> Iterator[cut.Placed]:
    for record in reader.records():
        times.append(NO_TIME if record.t_ns is None else record.t_ns)
        measured = list(reader.measure(record, record.t_ns or 0))
        clocks.note(record.source, sum(isinstance(item, Fix) and item.lat_deg is not None for item in measured))
        for measurement in measured:
            yield cut.Placed(measurement, 0, 0)
