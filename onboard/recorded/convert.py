"""`wayfix-onboard convert`: offline decoding, a recording through the daemon's decoders on the time of its sentences.

The boat clock of a converted recording is the UTC time of day of its sentences (nanoseconds after midnight, running on
over the next one), and counts from 0 where there are none. The same recording and configuration give the same bytes.
"""

import hashlib
import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig, BoatTable, PortTable
from common.clock import whole_us
from common.codec import encode_frame
from common.errors import WayfixError
from common.events import event
from common.framer import Identity
from common.frames_file import FILE_FORMAT, is_frames_file, write_frames_file
from common.messages import Frame
from common.settings import as_dict
from common.units import NS_PER_MS, NS_PER_S
from common.words import counted
from onboard.config import byte_budget, load
from onboard.devices.nmea_sentence import address
from onboard.reading.acquisition import Acquisition
from onboard.reading.port_chain import Tally
from onboard.reading.utc_clock import UNCERTAINTY_NS
from onboard.recorded.notes import before_gps, date_note, length_note, time_notes
from onboard.recorded.recording import BAUDS, Paced, pace, read_recording
from onboard.recorded.sensors_found import port_budget, sensor_tables, sensors_in

EMPTY_NS: Final = 60 * NS_PER_S
"""Longest silence that becomes empty frames, with the health that goes with it, ns; after that the grid has a hole, as
when the board sleeps."""
AFTER_NS: Final = 2 * NS_PER_S
"""Time for which the frames go on after the last line, ns: its epoch is closed, and health counts it."""
PROGRESS_LINES: Final = 200_000
PORT: Final = "recorded"
OTHER_CLOCK: Final = "another clock"
"""Why a sentence of another clock of the recording is left out: its fix would have a wrong UTC, or come twice."""
IN_PACKETS: Final = "in UBX packets"
"""Why pieces between two line ends are no lines: bytes of binary packets."""


@dataclass(frozen=True, slots=True)
class Summary:
    """What became of the lines."""

    tally: Tally
    too_long: int
    """Number of lines of more than 512 bytes, which the daemon throws away."""
    t0_ns: int
    t1_ns: int
    instead: str | None
    """What there is in place of lines of these sensors, and what to do; `None` = not known, or lines were accepted."""

    @property
    def lines(self) -> int:
        """All lines that were on the wire."""
        return self.tally.lines + self.too_long

    @property
    def accepted(self) -> dict[str, dict[str, int]]:
        """Sensor -> kind -> lines."""
        found: dict[str, dict[str, int]] = defaultdict(dict)
        for (sensor, kind), count in sorted(self.tally.accepted.items()):
            found[sensor][kind] = count
        return dict(found)


class Conversion:
    """One recording on its way through `Acquisition`; `frames` may be run once."""

    def __init__(self, paced: Paced, config: BoatConfig) -> None:
        """Config: one port, and the sensors on it."""
        self._paced = paced
        self.config = config
        self._period_ns = round(NS_PER_S / config.frames.rate_hz)
        start_ns = (paced.schedule.first_tod_ms or 0) * NS_PER_MS
        self._starts_ns = [whole_us(start_ns + t_ns) for t_ns in paced.starts_ns]
        self._ends_ns = [whole_us(start_ns + t_ns) for t_ns in paced.ends_ns]
        self._tick_ns = (start_ns // self._period_ns + 1) * self._period_ns
        self._t0_ns = self._tick_ns - self._period_ns
        identity = identity_of(paced, config)
        self._acquisition = Acquisition(config, identity, self._t0_ns, start_ns, lambda _: None, is_archive=True)
        (self._chain,) = self._acquisition.chains
        self._chain.changed(None, start_ns)
        # A port that was just opened waits for the end of a line; a recording begins with a line.
        self._chain.chunk(b"\n", start_ns)
        self._heard_ns = start_ns
        self._unused = unused_lines(paced, config)
        self._utc_less_boat_ns = None if is_doubtful(paced, config) else paced.schedule.utc_less_boat_ns

    def greeting(self) -> dict[str, Any]:
        """The fields of `connected`, and what the file was made of."""
        made = {
            "format": FILE_FORMAT,
            "sha256": self._paced.recording.digest,
            "clock": "from-zero" if self._paced.schedule.first_tod_ms is None else "utc-time-of-day",
            "skipped": self.skipped,
        }
        return {**self._acquisition.greeting(self._t0_ns, 1.0), "file": made}

    def frames(self) -> Iterator[Frame]:
        """All frames, in order."""
        total = len(self._starts_ns)
        lines = zip(self._starts_ns, self._ends_ns, self._paced.recording.lines, strict=True)
        for number, (start_ns, end_ns, data) in enumerate(lines):
            if number and number % PROGRESS_LINES == 0:
                sys.stderr.write(f"{number} of {counted(total, 'line')} ({100 * number // total} %)\n")
            if number in self._unused:
                continue
            # Two chunks, as from a port: at a low baud rate a line in progress is what tells a pause from an end.
            yield from self._ticks_to(start_ns)
            self._chain.chunk(data[:1], start_ns)
            yield from self._ticks_to(end_ns)
            self._chain.chunk(data[1:], end_ns)
            self._heard_ns = end_ns
        self._chain.chunk(b"\n", self._heard_ns)
        yield from self._ticks_to(self._heard_ns + AFTER_NS)

    @property
    def skipped(self) -> dict[str, int]:
        """Number of lines that the decoders do not see, by reason."""
        others = {OTHER_CLOCK: len(self._unused)} if self._unused else {}
        splitter, tally = self._chain.splitter, self._chain.tally
        if splitter.packet_bytes:
            on_the_wire = len(self._starts_ns) - len(self._unused)
            others[IN_PACKETS] = on_the_wire - tally.lines - splitter.overflows
        return {**self._paced.recording.skipped, **others}

    def summary(self) -> Summary:
        """After the last frame: what became of the lines."""
        chain = self._chain
        t1_ns = self._acquisition.framer.t0_ns
        instead = None
        if not chain.tally.accepted:
            monitor, *_ = chain.monitors.values()
            instead = str(monitor.why_not(t1_ns, chain.stranger(monitor)))
        return Summary(chain.tally, chain.splitter.overflows, self._t0_ns, t1_ns, instead)

    def _dated(self, frame: Frame) -> Frame:
        """The frame with the UTC of the whole recording where the pairs of date and time before it say none."""
        if frame.utc_ns is not None or self._utc_less_boat_ns is None:
            return frame
        source, doubt_ns = ("rtc", NS_PER_S) if self._paced.schedule.dated_by_stamps else ("gnss", UNCERTAINTY_NS)
        return replace(frame, utc_ns=frame.t0_ns + self._utc_less_boat_ns, utc_unc_ns=doubt_ns, utc_src=source)

    def _ticks_to(self, t_ns: int) -> Iterator[Frame]:
        """The frames that end at or before `t_ns`."""
        while self._tick_ns <= t_ns:
            if self._tick_ns - self._heard_ns > EMPTY_NS:
                missed = (t_ns - self._tick_ns) // self._period_ns
                self._tick_ns += missed * self._period_ns
                if missed:
                    self._acquisition.happened(event("ticks-missed", self._tick_ns, "daemon", count=missed))
                self._heard_ns = t_ns
            self._chain.flush(self._tick_ns)
            yield self._dated(self._acquisition.frame(self._tick_ns))
            self._tick_ns += self._period_ns


def unused_lines(paced: Paced, config: BoatConfig) -> frozenset[int]:
    """Indices of the lines of other clocks, but for talkers that the configuration gives a receiver of their own."""
    own = {talker for sensor in config.with_role("gps") for talker in sensor.talkers}
    unused = paced.schedule.unused
    if not own:
        return unused
    bare = paced.recording.bare
    return frozenset(line for line in unused if (address(bare[line]) or ("", ""))[0] not in own)


def is_doubtful(paced: Paced, config: BoatConfig) -> bool:
    """True when the date may be that of a receiver that lost its weeks, by itself or by the boat's file."""
    return before_gps(paced) or any(sensor.week_rollover for sensor in config.sensor)


def identity_of(paced: Paced, config: BoatConfig) -> Identity:
    """Identity from the recording, its pace and the configuration: nothing random, nothing of this machine."""
    facts = json.dumps([as_dict(config), paced.baud, paced.starts_ns[-1]], sort_keys=True)
    digest = hashlib.sha256(f"{paced.recording.digest} {facts}".encode()).hexdigest()
    return Identity(config.boat.id, digest[:16], digest[16:48], 1)


def config_of(paced: Paced, config: BoatConfig | None) -> BoatConfig:
    """`config`, or one made up of the sensors found in the recording.

    The port's byte budget is raised to what the baud rate carries: lines in a file are no flood.
    """
    if config is None:
        tables = sensor_tables(sensors_in(paced), PORT)
        table = PortTable(name=PORT, path=PORT, baud=paced.baud)
        config = BoatConfig(boat=BoatTable(id=PORT), port=(table,), sensor=tables)
    (table,) = config.port
    budget = max(byte_budget(table, config), port_budget(paced.baud))
    return replace(config, port=(replace(table, byte_budget_per_s=budget),))


def _with_port(config: BoatConfig, file: str, name: str | None) -> BoatConfig:
    """One port of the configuration and its sensors."""
    if name is None and len(config.port) > 1:
        known = ", ".join(port.name for port in config.port)
        raise WayfixError("it has several ports", file, f"say with --port whose recording it is: {known}")
    ports = tuple(port for port in config.port if name in (None, port.name))
    if not ports:
        known = ", ".join(port.name for port in config.port)
        raise WayfixError(f"no [[port]] is named {name}", file, f"known: {known}")
    sensors = tuple(sensor for sensor in config.sensor if sensor.port == ports[0].name)
    if not sensors:
        raise WayfixError(f"no [[sensor]] is on the port {ports[0].name}", file, "name another --port")
    return replace(config, port=ports, sensor=sensors)


def convert(
    source: Path,
    target: Path,
    *,
    config_file: Path | None = None,
    port: str | None = None,
    lines_per_second: float | None = None,
) -> dict[str, Any]:
    """Convert a file; the summary as JSON-able values. Raises WayfixError for wrong input, OSError for a full disk."""
    if port is not None and config_file is None:
        raise WayfixError("names a port of a configuration", "--port", "add --config BOAT.toml")
    _check_target(source, target)
    recording = read_recording(source)
    given = None if config_file is None else _with_port(load(config_file), str(config_file), port)
    least_baud = BAUDS[0] if given is None else given.port[0].baud
    paced = pace(recording, lines_per_second=lines_per_second, least_baud=least_baud)
    if lines_per_second is not None and paced.timed:
        raise WayfixError("the recording has its own times", "--lines-per-second", "leave it out")
    conversion = Conversion(paced, config_of(paced, given))
    greeting = conversion.greeting()
    try:
        count = write_frames_file(target, greeting, map(encode_frame, conversion.frames()))
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(target), "check space and rights") from error
    summary = conversion.summary()
    numbers = paced.recording.numbers
    date_said = date_note(paced, conversion.config)
    gaps = [{"line": numbers[gap.line], "seconds": round(gap.seconds, 3)} for gap in paced.schedule.gaps]
    return {
        "out": str(target),
        "frames": count,
        "seconds": (summary.t1_ns - summary.t0_ns) / NS_PER_S,
        "pace": _pace_of(paced, lines_per_second),
        "gaps": gaps,
        "utc_ms": paced.schedule.first_utc_ms,
        "utc_less_boat_ns": paced.schedule.utc_less_boat_ns,
        "clocks": [as_dict(clock) for clock in paced.schedule.clocks],
        "notes": [*time_notes(paced), *filter(None, [length_note(paced), date_said])],
        "file_lines": recording.total,
        "skipped": conversion.skipped,
        "lines": summary.lines,
        "accepted": summary.accepted,
        "rejected": dict(sorted(summary.tally.rejected.items())),
        "ignored": dict(sorted(summary.tally.ignored.items())),
        "too_long": summary.too_long,
        "instead": summary.instead,
        "sensors": [sensor["id"] for sensor in greeting["sensors"]],
        "boot_id": greeting["boot_id"],
    }


def _pace_of(paced: Paced, lines_per_second: float | None) -> str:
    if paced.timed:
        return "stamps" if paced.schedule.stamped else "sentences"
    return "baud" if lines_per_second is None else "lines-per-second"


def _check_target(source: Path, target: Path) -> None:
    cure = "give another OUT"
    try:
        if target.exists() and source.exists() and target.samefile(source):
            raise WayfixError("is the recording itself", str(target), cure)
    except OSError as error:
        raise WayfixError(f"cannot be looked at ({error.strerror})", str(target), cure) from error
    if os.path.lexists(target) and not is_frames_file(target):
        raise WayfixError("exists already and is no frames file", str(target), cure)


def words(summary: dict[str, Any]) -> Sequence[str]:
    """The summary for a person."""
    lines = summary["lines"]
    parts = [f"{counted(summary['file_lines'], 'line')} in the recording"]
    parts += [f"{count} left out: {reason}" for reason, count in summary["skipped"].items()]
    text = [", ".join(parts)]
    rows = [(f"accepted {sensor}", kinds) for sensor, kinds in summary["accepted"].items()] + [
        (name, summary[name]) for name in ("rejected", "ignored") if summary[name]
    ]
    if summary["too_long"]:
        rows.append(("discarded", {"longer than 512 bytes": summary["too_long"]}))
    for name, counts in rows:
        details = ", ".join(f"{kind} {count}" for kind, count in counts.items())
        text.append(f"  {name:18} {sum(counts.values()):>8}   {details}")
    text.append(f"  {'all':18} {lines:>8}")
    text += [f"gap of {gap['seconds']:.0f} s before line {gap['line']}" for gap in summary["gaps"]]
    text += summary["notes"]
    if summary["pace"] == "baud":
        text.append("no times inside: lines follow each other at the baud rate; --lines-per-second X sets another pace")
    text.append(f"{summary['out']}: {counted(summary['frames'], 'frame')}, {summary['seconds']:.1f} s")
    return text
