"""Log maker: frames become a log like that of a live run. Its times come from the data, none from the wall clock."""

from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.errors import CodecError
from common.messages import Frame
from common.settings import convert
from shore.imports.meaning import Doubt, MeaningCheck
from shore.logbook.schemas import SESSION
from shore.logbook.session import start_record
from shore.pipeline import Output, Pipeline
from shore.settings.station import StationSettings
from shore.watchers.log import WholeLog
from shore.watchers.watcher import Arrival, RunSeconds, Start, Step, Watcher, Watchers

MEASUREMENTS: Final = ("fixes", "headings", "turn_rates", "attitudes", "ais", "radar")


@dataclass(slots=True)
class Written:
    """What the log holds."""

    frames: int = 0
    bad: int = 0
    """Number of frames that could not be decoded."""
    seconds: float = 0.0
    utc_ns: int | None = None
    """When the recording began; `None` = it does not say."""
    measurements: Counter[str] = field(default_factory=Counter)
    usable_fixes: int = 0
    estimates: Counter[str] = field(default_factory=Counter)
    """Number of estimates of each filter."""
    aligned: Counter[str] = field(default_factory=Counter)
    """Number of estimates of the first filter whose `position`, `heading`, or both (`whole`) are valid."""
    waiting: Counter[tuple[str, ...]] = field(default_factory=Counter)
    """Number of frames after which the first filter lacked this."""
    events: Counter[str] = field(default_factory=Counter)
    """Number of events of each level."""

    def why_not_aligned(self) -> str | None:
        """Why no estimate is wholly valid, as a sentence; `None` = there is one, or no filter ran."""
        if self.aligned["whole"] or not self.waiting:
            return None
        if not self.measurements["fixes"]:
            return "there is no position in it, and filters begin with one"
        if not self.usable_fixes:
            return f"none of its {self.measurements['fixes']} fixes says that it is valid"
        lacking = ", ".join(self.waiting.most_common(1)[0][0])
        compass = "" if self.measurements["headings"] or "heading" not in lacking else " (there is no compass in it)"
        return f"the filters waited for: {lacking}{compass}" if lacking else None


class ImportCounts(Watcher):
    """Counts what becomes of the frames of an import."""

    def __init__(self, filters: tuple[str, ...]) -> None:
        self.written = Written()
        self._shown_filter = filters[0] if filters else None
        self._first_ns: int | None = None

    def take(self, step: Step) -> None:
        """One frame, its measurements, estimates and events."""
        written, frame = self.written, step.frame
        written.frames += 1
        self._first_ns = frame.t0_ns if self._first_ns is None else self._first_ns
        written.seconds = (frame.t1_ns - self._first_ns) / 1e9
        for name in MEASUREMENTS:
            if items := getattr(frame, name):
                written.measurements[name] += len(items)
        for block in frame.imu:
            written.measurements["imu_samples"] += len(block.offset_us)
        written.usable_fixes += sum(fix.usable for fix in frame.fixes)
        if self._shown_filter is not None and step.output.waiting is not None:
            written.waiting[step.output.waiting] += 1
        for estimate in step.output.estimates:
            written.estimates[estimate.filter] += 1
            if estimate.filter == self._shown_filter:
                written.aligned.update([*estimate.aligned_parts, *(["whole"] if estimate.aligned else [])])
        for event in step.events:
            written.events[event.level] += 1


class LogMaker:
    """An import as a source of steps: the frames of a recording go to the filters and into a log."""

    def __init__(self, greeting: dict[str, Any], settings: StationSettings, offset_ns: int | None) -> None:
        """No filter in `settings` = frames only. offset_ns: UTC less boat time; `None` = all is at its boat time."""
        self._greeting = greeting
        self._settings = settings
        self._offset_ns = offset_ns
        self._config = convert(greeting["config"], BoatConfig, "configuration of the boat", strict=False)
        asked = settings.filter
        self._pipeline = Pipeline(self._config, asked.names, asked.step_s) if asked.names else None
        self._counts = ImportCounts(asked.names)
        self._meaning = MeaningCheck()

    @property
    def written(self) -> Written:
        """What the log holds so far."""
        return self._counts.written

    def doubts(self) -> list[Doubt]:
        """What the sensors' own values contradict, by the frames so far."""
        return self._meaning.doubts()

    def write(
        self, out: Path, frames: Iterable[bytes], trip: dict[str, Any] | None, facts: Callable[[], dict[str, Any]]
    ) -> bool:
        """Write the log; False, and no file, when nothing was measured in any frame. Raises WayfixError.

        facts: what to say of the import at its end, asked when all frames were taken.
        """
        with ExitStack() as stack:  # a file without any frame opens no log
            return self._run(lambda: Watchers(stack.enter_context(WholeLog(out)), self._counts), frames, trip, facts)

    def _run(
        self,
        open_watchers: Callable[[], Watcher],
        frames: Iterable[bytes],
        trip: dict[str, Any] | None,
        facts: Callable[[], dict[str, Any]],
    ) -> bool:
        start: Start | None = None
        watchers = Watcher()
        seconds, t_ns = RunSeconds(), 0
        for data in frames:
            try:
                frame = decode_frame(data)
            except CodecError:
                self.written.bad += 1
                continue
            self._meaning.take(frame)
            t_ns = self._log_time_ns(frame)
            if start is None:
                watchers = open_watchers()
                start = self._begin(watchers, frame, trip)
            arrival = Arrival(data, frame, start, t_ns, seconds.at(frame))
            output = Output() if self._pipeline is None else self._pipeline.push(frame)
            watchers.take(Step.of(arrival, output))
        if not self.written.measurements.total():
            return False
        counts = {"received": self.written.frames, "missing": 0, "bad": self.written.bad}
        watchers.end({**counts, "reason": "imported", "import": facts()}, t_ns)
        return True

    def _begin(self, watchers: Watcher, frame: Frame, trip: dict[str, Any] | None) -> Start:
        begin_ns = self._log_time_ns(frame) - (frame.t1_ns - frame.t0_ns)
        self.written.utc_ns = None if self._offset_ns is None else begin_ns
        options = {**self._settings.as_options(), "frames": None, "period_s": None}
        start = Start(start_record(self._greeting, options, max(0, begin_ns)), self._config)
        watchers.begin(start, begin_ns)
        if trip is not None:
            watchers.note(SESSION, trip, begin_ns)
        return start

    def _log_time_ns(self, frame: Frame) -> int:
        """UTC of the frame's end, by one offset for all (`shore.imports.recording_date`)."""
        return max(0, frame.t1_ns + (self._offset_ns or 0))
