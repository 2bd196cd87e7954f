"""Playback of recorded streams as the virtual boat's source: each file on its own port, on its sentences' time."""

import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from common.boat_config import BoatConfig, BoatTable, LinkTable, PortTable, SensorTable
from common.errors import WayfixError
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_fields import tod_step_ms
from onboard.recorded.line_times import Schedule
from onboard.recorded.notes import time_notes
from onboard.recorded.recording import LAG_NS, Paced, pace, read_recording
from onboard.recorded.sensors_found import port_budget, sensor_tables, sensors_in
from onboard.virtual.baud_pacing import SerialLine

TOLD_GAP_S = 30.0
"""Longest wait that begins without a message, s."""


class Player:
    """One port for each file. t = 0 is the first line; files whose times overlap keep their distance in UTC."""

    def __init__(
        self,
        files: Sequence[Path],
        *,
        baud: int | None = None,
        lines_per_second: float | None = None,
        longest_gap_s: float | None = None,
        seconds: float | None = None,
    ) -> None:
        """Seconds: play only the beginning. Raises WayfixError for a file that is no recording."""
        paced = [pace(read_recording(file), baud, lines_per_second, longest_gap_s) for file in files]
        if lines_per_second is not None and all(item.timed for item in paced):
            raise WayfixError("the recording has its own times", "--lines-per-second", "leave it out")
        names = _port_names(files)
        self._paced = dict(zip(names, paced, strict=True))
        self._seconds = seconds
        together = longest_gap_s is None
        self._offsets_ns = dict(zip(names, offsets_ns(paced) if together else [0] * len(paced), strict=True))
        self.bauds: Mapping[str, int] = {name: item.baud for name, item in self._paced.items()}
        self.counted = ("port", tuple(self._paced))
        self._tell()

    def head(self) -> str:
        """Which files; what is in boat.toml is a guess from them."""
        files = ", ".join(item.recording.path.name for item in self._paced.values())
        return f"for the recording {files!r}: the sensors found in it."

    def config(self, ports: Mapping[str, str], bind: str) -> BoatConfig:
        """The sensors found in the files; a port may send all that its baud rate carries."""
        taken: Counter[str] = Counter()
        sensors: list[SensorTable] = []
        for name, item in self._paced.items():
            sensors += sensor_tables(sensors_in(item), name, taken)
        tables = [
            PortTable(name=name, path=path, baud=self.bauds[name], byte_budget_per_s=port_budget(self.bauds[name]))
            for name, path in ports.items()
        ]
        return BoatConfig(
            boat=BoatTable(id="recording"), link=LinkTable(bind=bind), port=tuple(tables), sensor=tuple(sensors)
        )

    def ready(self, directory: Path) -> dict[str, Any]:
        """How long it takes, and what of each file is played."""
        del directory
        seconds = max(self._offsets_ns[name] + item.starts_ns[-1] for name, item in self._paced.items()) / NS_PER_S
        return {
            "seconds": seconds if self._seconds is None else min(seconds, self._seconds),
            "bauds": dict(self.bauds),
            "lines": {name: item.recording.total for name, item in self._paced.items()},
            "skipped": {name: item.recording.skipped for name, item in self._paced.items()},
        }

    def lines(self, start_ns: int, clock_rate: float) -> Mapping[str, Iterator[SerialLine]]:
        """Every line as it was."""
        del clock_rate
        return {name: self._lines(name, start_ns + self._offsets_ns[name]) for name in self._paced}

    def started(self, directory: Path, start_ns: int) -> None:
        """Nothing to write, because the truth of a recording is not known."""

    def done(self, counts: Mapping[str, int]) -> dict[str, Any]:
        """What became of each file's lines: lines = sent + skipped + not_sent (unread, unplugged, after the end)."""
        files = {}
        for name, item in self._paced.items():
            total, skipped, sent = item.recording.total, item.recording.skipped, counts[name]
            files[name] = {
                "file": str(item.recording.path),
                "lines": total,
                "sent": sent,
                "skipped": skipped,
                "not_sent": total - sent - sum(skipped.values()),
            }
        return {"files": files}

    def _lines(self, name: str, start_ns: int) -> Iterator[SerialLine]:
        item = self._paced[name]
        end_ns = None if self._seconds is None else start_ns - self._offsets_ns[name] + round(self._seconds * NS_PER_S)
        recording = item.recording
        times_ns = zip(item.schedule.at_ns, item.starts_ns, strict=True)
        for number, (at_ns, begins_ns), data in zip(recording.numbers, times_ns, recording.lines, strict=True):
            if end_ns is not None and start_ns + begins_ns >= end_ns:
                return
            t_ns = start_ns + at_ns
            yield SerialLine(t_ns, data, {"port": name, "line": number, "t_ns": t_ns})

    def _tell(self) -> None:
        """What a person should know before he waits."""
        for name, item in self._paced.items():
            for note in time_notes(item):
                _say(f"{name}: {note}")
            for gap in item.schedule.gaps:
                if gap.seconds > TOLD_GAP_S:
                    line = item.recording.numbers[gap.line]
                    _say(f"{name}: nothing for {gap.seconds:.0f} s before line {line}; --longest-gap S shortens it")
            if item.lag_ns > LAG_NS:
                late_s = item.lag_ns / NS_PER_S
                _say(f"{name}: {item.baud} baud cannot carry it, lines come up to {late_s:.1f} s late; raise --baud")
            if not item.timed and not item.schedule.at_ns[-1]:
                _say(f"{name}: no times inside, played at {item.baud} baud; --lines-per-second X sets another pace")


def offsets_ns(paced: Sequence[Paced]) -> list[int]:
    """When each recording begins: as their UTC says for those that overlap with the first that has one, else at 0."""
    reference = next((item for item in paced if item.timed), None)
    if reference is None or reference.schedule.first_tod_ms is None:
        return [0] * len(paced)
    begins: list[int | None] = []
    for item in paced:
        step_ns = _apart_ms(reference.schedule, item.schedule) * NS_PER_MS
        overlaps = step_ns <= reference.schedule.at_ns[-1] and step_ns + item.schedule.at_ns[-1] >= 0
        begins.append(step_ns if item.schedule.first_tod_ms is not None and overlaps else None)
    earliest = min(begin for begin in begins if begin is not None)
    return [0 if begin is None else begin - earliest for begin in begins]


def _apart_ms(reference: Schedule, schedule: Schedule) -> int:
    """How much later than the reference a recording begins, ms: by their dates where both have one."""
    if reference.first_utc_ms is not None and schedule.first_utc_ms is not None:
        return schedule.first_utc_ms - reference.first_utc_ms
    return tod_step_ms(reference.first_tod_ms or 0, schedule.first_tod_ms or 0)


def _port_names(files: Sequence[Path]) -> list[str]:
    """One name for each file, short, without anything a path or a command line could trip over."""
    names: list[str] = []
    for file in files:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "-", file.name.split(".")[0]).strip("-")[:24] or "port"
        number = sum(name == stem or name.startswith(f"{stem}+") for name in names)
        names.append(f"{stem}+{number + 1}" if number else stem)
    return names


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")
