"""The real daemon under the standard load: processor, memory, time stamps, way to the client, losses.

    python -m benchmarks.daemon_load [--seconds 20] [--repeat 3] [--flood] [--out FILE]

GPS 10 Hz (GGA, RMC, VTG, GSA), ArduIMU 100 Hz, three compasses 20 Hz and AIS 50/s on pseudo-terminals, 10 frames/s, one
client. Exit code 1 when the memory of a run of ten minutes or more grew.
What each figure means: benchmarks/README.md.
"""

import argparse
import json
import math
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.feeder import BAUD, GPS_FIELDS
from benchmarks.observer import Child, Client, Usage, child, kilobytes, slope_kb_h, usage
from common.clock import boottime_ns
from common.units import NS_PER_MS, NS_PER_S

WARM_UP_S: Final = 2.0
"""After the first line, not counted: imports on first use, the first health reports."""
SETTLE_S: Final = 2.2
"""After the last line: the frames it is in, and the health reports (once a second) that count it."""
FLOOD_BUDGET_BYTES_S: Final = 20_000
SOAK_S: Final = 600.0
"""Runs of this length and more say their memory once a minute and are judged by it."""
GROWTH_KB_H: Final = 512.0
GROWTH_LEAST_KB: Final = 128.0
FLOODED: Final = "compass99"
GOALS: Final = ("goal", "<= 6 (flood 10)", "<= 40", "", "", "<= 1 / 10", "<= 2 / 20", "0", "0", "", "")
HEAD: Final = (
    "load", "CPU %", "PSS MB", "RSS MB", "own kB/h", "stamp p50/p99 ms", "tick -> client p50/p99 ms", "frames lost",
    "lines lost", "lines sent / accepted", "feeder, client CPU %",
)  # fmt: skip


@dataclass
class Figures:
    """One run; latencies in ms, memory in MB, CPU in % of one core."""

    load: str
    seconds: float
    cpu_percent: float
    user_percent: float
    pss_mb: float
    rss_mb: float
    own_slope_kb_h: float | None
    """Of anonymous memory, which no other process can change; `None` for runs too short to tell."""
    stamp_p50_ms: float
    stamp_p99_ms: float
    stamp_max_ms: float
    client_p50_ms: float
    client_p99_ms: float
    client_max_ms: float
    frames: int
    frame_bytes: float
    frames_lost: int
    lines_sent: int
    """Of the ports that are not flooded, over the whole run; the next two as well."""
    lines_accepted: int
    lines_rejected: int
    lines_lost: int
    """Sent while measured, and in no frame."""
    writes_refused: int
    """By a full pty: lost before the daemon."""
    feeder_cpu_percent: float
    client_cpu_percent: float
    machine_busy_percent: float
    """All cores, our own processes included: above about 60 the machine was not ours."""
    flood_mb_s: float = 0.0
    flood_lines_accepted: int = 0


# --- one run --------------------------------------------------------------------------------------------------------


def config_text(ports: dict[str, str]) -> str:
    """The board's file: every device on its own port, no latency to take off."""
    parts = ['[boat]\nid = "benchmark"\n', "[frames]\nrate_hz = 10.0\n"]
    rates = {"gps": 10, "imu": 100, "compass": 20, "ais": 50, "flood": 20}
    for name, path in ports.items():
        kind = name.rstrip("123456789")
        budget = f"byte_budget_per_s = {FLOOD_BUDGET_BYTES_S}\n" if kind == "flood" else ""
        parts.append(f'[[port]]\nname = "{name}"\npath = "{path}"\nbaud = {BAUD[kind]}\n{budget}')
        role = "compass" if kind == "flood" else kind
        sensor = FLOODED if kind == "flood" else name if role == "compass" else f"{role}1"
        model = "arduimu" if role == "imu" else "nmea"
        parts.append(
            f'[[sensor]]\nid = "{sensor}"\nport = "{name}"\nrole = "{role}"\nmodel = "{model}"\n'
            f"rate_hz = {rates[kind]}\nlatency_ms = 0.0\n"
        )
    return "\n".join(parts)


@dataclass(frozen=True)
class Load:
    """What the devices do, and for how long it is measured."""

    seconds: float
    compasses: int = 3
    portion: int = 0
    flood: int = 0

    @property
    def name(self) -> str:
        parts = ["standard" if self.compasses == 3 else f"{self.compasses} compasses"]
        parts += [f"{self.portion} B portions"] if self.portion else []
        parts += [f"flood {self.flood / 1e6:g} MB/s"] if self.flood else []
        return ", ".join(parts)


@dataclass(frozen=True)
class Observed:
    """What one run left behind."""

    before: Usage
    after: Usage
    pss_kb: int
    rss_kb: int
    own_samples: list[tuple[float, int]]
    client: Client
    fed: dict[str, Any]
    """The devices' log."""
    flooded: dict[str, Any]
    """The babbler's; empty without one."""


def measure(load: Load) -> Figures:
    """One run of the daemon."""
    feeder = (sys.executable, "-m", "benchmarks.feeder")
    options = ("--compasses", str(load.compasses), "--portion", str(load.portion))
    with tempfile.TemporaryDirectory() as place, child(*feeder, *options) as devices:
        ports = dict(devices.line()["ports"])
        if not load.flood:
            return _figures(load, _observe(load, Path(place), ports, [devices]))
        with child(*feeder, "--flood", str(load.flood)) as babbler:
            ports.update(babbler.line()["ports"])
            return _figures(load, _observe(load, Path(place), ports, [devices, babbler]))


def _observe(load: Load, place: Path, ports: dict[str, str], feeders: list[Child]) -> Observed:
    config = place / "boat.toml"
    config.write_text(config_text(ports), encoding="utf-8")
    program = str(Path(sys.executable).with_name("wayfix-onboard"))
    command = (program, "run", "--open", str(config), "--bind", "tcp://127.0.0.1:*", "--until-stdin-closes")
    names = [*GPS_FIELDS, "imu1", "ais1", *(name for name in ports if name.startswith("compass"))]
    samples: list[tuple[float, int]] = []
    said_s = [-math.inf]
    with (place / "log").open("w", encoding="utf-8") as log, child(*command, stderr=log) as daemon:
        pid = daemon.process.pid

        def watch_memory() -> None:
            # At most 200 samples: reading them holds a lock of the daemon for a moment.
            t_s = time.monotonic()
            if not samples or t_s - samples[-1][0] >= max(5.0, load.seconds / 200):
                samples.append((t_s, kilobytes(pid, "smaps_rollup", "Anonymous:")))
                if load.seconds >= SOAK_S and t_s - said_s[-1] >= 60:
                    said_s.append(t_s)
                    say_memory(pid, t_s - samples[0][0])

        client = Client(daemon.line()["ready"]["bind"], names)
        for feeder in feeders:
            feeder.tell()
        client.listen(boottime_ns() + round(WARM_UP_S * NS_PER_S))
        before = usage(pid)
        client.listen(before.t_ns + round(load.seconds * NS_PER_S), watch_memory)
        after = usage(pid)
        pss_kb, rss_kb = kilobytes(pid, "smaps_rollup", "Pss:"), kilobytes(pid, "status", "VmRSS:")
        for feeder in feeders:
            feeder.tell()
        fed, *flooded = [feeder.line() for feeder in feeders]
        client.listen(boottime_ns() + round(SETTLE_S * NS_PER_S))
        client.close()
    return Observed(before, after, pss_kb, rss_kb, samples, client, fed, flooded[0] if flooded else {})


def _figures(load: Load, run: Observed) -> Figures:
    before, after, client, fed, flooded = run.before, run.after, run.client, run.fed, run.flooded
    seconds = (after.t_ns - before.t_ns) / NS_PER_S
    percent = 100 / os.sysconf("SC_CLK_TCK") / seconds
    stamps_ns, lost = _stamps(fed["sent"], client, before.t_ns, after.t_ns)
    delays_ns = [delay for t_ns, delay in client.delays_ns if before.t_ns <= t_ns < after.t_ns]
    others = [sensor for sensor in client.accepted if sensor != FLOODED]
    return Figures(
        load=load.name,
        seconds=seconds,
        cpu_percent=(after.user - before.user + after.system - before.system) * percent,
        user_percent=(after.user - before.user) * percent,
        pss_mb=run.pss_kb / 1024,
        rss_mb=run.rss_kb / 1024,
        own_slope_kb_h=slope_kb_h(run.own_samples),
        stamp_p50_ms=quantile(stamps_ns, 0.5) / NS_PER_MS,
        stamp_p99_ms=quantile(stamps_ns, 0.99) / NS_PER_MS,
        stamp_max_ms=max(stamps_ns) / NS_PER_MS,
        client_p50_ms=quantile(delays_ns, 0.5) / NS_PER_MS,
        client_p99_ms=quantile(delays_ns, 0.99) / NS_PER_MS,
        client_max_ms=max(delays_ns) / NS_PER_MS,
        frames=len(delays_ns),
        frame_bytes=client.bytes / client.frames,
        frames_lost=client.lost,
        lines_sent=sum(map(len, fed["sent"].values())),
        lines_accepted=sum(client.accepted[sensor] for sensor in others),
        lines_rejected=sum(client.rejected[sensor] for sensor in others),
        lines_lost=lost,
        writes_refused=fed["refused"],
        feeder_cpu_percent=fed["cpu_percent"],
        client_cpu_percent=100 * (after.own_s - before.own_s) / seconds,
        machine_busy_percent=100 * (after.busy - before.busy) / (after.total - before.total),
        flood_mb_s=flooded["bytes"] / flooded["seconds"] / 1e6 if flooded else 0.0,
        flood_lines_accepted=client.accepted.get(FLOODED, 0),
    )


def _stamps(sent: dict[str, list[int]], client: Client, begin_ns: int, end_ns: int) -> tuple[list[int], int]:
    """(from the write of a line to its time stamp, lines without one), of the lines written in the interval."""
    stamps_ns, lost = [], 0
    for name, times_ns in sent.items():
        received = client.streams[name].t_ns
        for number, t_ns in enumerate(times_ns):
            if begin_ns <= t_ns < end_ns:
                if number in received:
                    stamps_ns.append(received[number] - t_ns)
                else:
                    lost += 1
    return stamps_ns, lost


def say_memory(pid: int, t_s: float) -> None:
    """Once a minute of a soak."""
    pss_kb, own_kb = (kilobytes(pid, "smaps_rollup", key) for key in ("Pss:", "Anonymous:"))
    print(f"{t_s / 60:5.0f} min: PSS {pss_kb} kB, own {own_kb} kB", file=sys.stderr, flush=True)


def verdict(run: Figures) -> str | None:
    """Why a soak failed; `None` = memory is flat, or the run was too short to tell."""
    slope = run.own_slope_kb_h
    if run.seconds < SOAK_S or slope is None:
        return None
    # In the last three quarters of the run, and per hour: single pages more or less are no growth.
    rise_kb = slope * 0.75 * run.seconds / 3600
    if slope > GROWTH_KB_H and rise_kb > GROWTH_LEAST_KB:
        return f"memory grows: {slope:.0f} kB/h, {rise_kb:.0f} kB in the last three quarters"
    return None


def quantile(values: Sequence[int], share: float) -> float:
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, math.floor(share * len(ordered)))]


# --- output ---------------------------------------------------------------------------------------------------------


def row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def table_row(runs: Sequence[Figures]) -> str:
    """Medians, with the range of several runs for what decides."""

    def median(name: str, digits: int = 2) -> str:
        values = [getattr(run, name) for run in runs]
        if None in values:
            return "-"
        middle = f"{statistics.median(values):.{digits}f}"
        return middle if len(runs) == 1 else f"{middle} [{min(values):.{digits}f}-{max(values):.{digits}f}]"

    accepted = f"{sum(run.lines_sent for run in runs)} / {sum(run.lines_accepted for run in runs)}"
    return row(
        (
            runs[0].load,
            median("cpu_percent"),
            median("pss_mb", 1),
            median("rss_mb", 1),
            median("own_slope_kb_h", 0),
            f"{median('stamp_p50_ms')} / {median('stamp_p99_ms')}",
            f"{median('client_p50_ms')} / {median('client_p99_ms')}",
            str(sum(run.frames_lost for run in runs)),
            str(sum(run.lines_lost for run in runs)),
            accepted,
            f"{median('feeder_cpu_percent', 1)}, {median('client_cpu_percent', 1)}",
        )
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="measured time of one run (default 20)")
    parser.add_argument("--repeat", type=int, help="runs (default 3, and 1 for runs of more than a minute)")
    parser.add_argument("--compasses", type=int, default=3, help="each on a port of its own (default 3)")
    parser.add_argument(
        "--portion", type=int, default=0, metavar="BYTES", help="write lines as a UART would, 16 at a time"
    )
    parser.add_argument("--flood", type=int, nargs="?", const=1_000_000, default=0, metavar="BYTES_PER_S",
                        help="one more port, flooded with valid lines (default 1000000)")  # fmt: skip
    parser.add_argument("--out", type=Path, help="write the JSON line there too")
    arguments = parser.parse_args()
    repeat = arguments.repeat or (3 if arguments.seconds <= 60 else 1)
    load = Load(arguments.seconds, arguments.compasses, arguments.portion, arguments.flood)
    print("\n".join((row(HEAD), row("---" for _ in HEAD), row(GOALS))), flush=True)
    runs = []
    for _ in range(repeat):
        runs.append(measure(load))
        print(table_row(runs[-1:]), flush=True)
    if repeat > 1:
        print(table_row(runs))
    line = json.dumps({"benchmark": "daemon_load", "runs": [asdict(run) for run in runs]})
    print(line)
    if arguments.out is not None:
        arguments.out.write_text(f"{line}\n", encoding="utf-8")
    grown = [words for run in runs if (words := verdict(run)) is not None]
    if arguments.seconds >= SOAK_S:
        print("; ".join(grown) or "memory is flat", file=sys.stderr)
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
