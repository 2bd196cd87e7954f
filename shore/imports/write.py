"""Frames -> a log like that of a live run. Every time in it is of the data, none of the clock on the wall."""

from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median_low
from typing import Any, Final

from common.codec import decode_frame
from common.errors import CodecError
from common.messages import Frame
from common.sensors import BoatConfig
from common.settings import convert
from shore.logbook.record import LogWriter
from shore.logbook.session import start_record
from shore.pipeline import Pipeline

ENOUGH: Final = 6_000
"""So many frames or fixes with a date (ten minutes of frames) tell the UTC of a recording."""
MEASUREMENTS: Final = ("fixes", "headings", "turn_rates", "attitudes", "ais", "radar")


@dataclass(slots=True)
class Written:
    """What the log holds."""

    frames: int = 0
    bad: int = 0
    """Frames that were not understood."""
    seconds: float = 0.0
    utc_ns: int | None = None
    """When the recording began; `None` = it does not say."""
    measurements: Counter[str] = field(default_factory=Counter)
    usable_fixes: int = 0
    estimates: Counter[str] = field(default_factory=Counter)
    """By filter."""
    aligned: int = 0
    """Estimates of the first filter that were valid."""
    events: Counter[str] = field(default_factory=Counter)
    """By level."""


def utc_offset_ns(frames: Iterable[Frame]) -> int | None:
    """UTC less boat time, by most frames, else by most fixes; `None` where there is no date."""
    said, usable, others = array("q"), array("q"), array("q")
    for frame in frames:
        if frame.utc_ns is not None:
            said.append(frame.utc_ns - frame.t0_ns)
        for fix in frame.fixes:
            if fix.utc_ns is not None:
                (usable if fix.usable else others).append(fix.utc_ns - fix.t_ns)
        if max(len(said), len(usable)) >= ENOUGH:
            break
    found = said or usable or others
    return median_low(found) if found else None


class LogMaker:
    """Feeds frames to the filters and writes what comes of them."""

    def __init__(self, greeting: dict[str, Any], filters: tuple[str, ...], offset_ns: int | None) -> None:
        """offset_ns: UTC less boat time; without it, everything stands at its boat time after 1970."""
        self.written = Written()
        self._greeting = greeting
        self._filters = filters
        self._offset_ns = offset_ns
        config = convert(greeting["config"], BoatConfig, "configuration of the boat", strict=False)
        self._pipeline = Pipeline(config, filters) if filters else None
        self._first_ns: int | None = None

    def write(
        self, out: Path, frames: Iterable[bytes], trip: dict[str, Any] | None, facts: Callable[[], dict[str, Any]]
    ) -> bool:
        """Write the log; False, and no file, when nothing was measured in any frame. Raises WayfixError.

        facts: what to say of the import at its end, asked when all frames were taken.
        """
        writer: LogWriter | None = None
        t_ns = 0
        try:
            for data in frames:
                try:
                    frame = decode_frame(data)
                except CodecError:
                    self.written.bad += 1
                    continue
                t_ns = self._log_time_ns(frame)
                if writer is None:
                    writer = self._begin(out, frame, trip)
                self._take(writer, data, frame, t_ns)
            if writer is None or not self.written.measurements.total():
                if writer is not None:
                    writer.abandon()
                return False
            counts = {"received": self.written.frames, "missing": 0, "bad": self.written.bad}
            writer.write_session({"kind": "end", **counts, "reason": "imported", "import": facts()}, t_ns)
            writer.close()
        except BaseException:
            if writer is not None:
                writer.abandon()
            raise
        return True

    def _begin(self, out: Path, frame: Frame, trip: dict[str, Any] | None) -> LogWriter:
        begin_ns = self._log_time_ns(frame) - (frame.t1_ns - frame.t0_ns)
        self.written.utc_ns = None if self._offset_ns is None else begin_ns
        options = {"filters": list(self._filters), "step_s": None, "frames": None, "period_s": None}
        writer = LogWriter.at(out)
        try:
            writer.write_session(start_record(self._greeting, options, max(0, begin_ns)), begin_ns)
            if trip is not None:
                writer.write_session(trip, begin_ns)
        except BaseException:
            writer.abandon()
            raise
        return writer

    def _take(self, writer: LogWriter, data: bytes, frame: Frame, t_ns: int) -> None:
        written = self.written
        written.frames += 1
        self._first_ns = frame.t0_ns if self._first_ns is None else self._first_ns
        written.seconds = (frame.t1_ns - self._first_ns) / 1e9
        for name in MEASUREMENTS:
            if items := getattr(frame, name):
                written.measurements[name] += len(items)
        for block in frame.imu:
            written.measurements["imu_samples"] += len(block.offset_us)
        written.usable_fixes += sum(fix.usable for fix in frame.fixes)
        writer.write_frame(data, frame, t_ns)
        events = frame.events
        if self._pipeline is not None:
            output = self._pipeline.push(frame)
            for estimate in output.estimates:
                written.estimates[estimate.filter] += 1
                written.aligned += estimate.filter == self._filters[0] and not estimate.waiting
                writer.write_estimate(estimate.as_record(), t_ns)
            events = (*events, *output.events)
        for happening in events:
            written.events[happening.level] += 1
            writer.write_event(happening, t_ns)

    def _log_time_ns(self, frame: Frame) -> int:
        """UTC of the frame's end, by one offset for all: a clock that was wrong for a while does not date the trip."""
        return max(0, frame.t1_ns + (self._offset_ns or 0))
