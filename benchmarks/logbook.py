"""Eight hours at sea in one log: its size, and the time and memory of every export.

    python -m benchmarks.logbook DIR                    # some 10 minutes; 1 GB in DIR, which is made new
    python -m benchmarks.logbook DIR --minutes 10       # a quick look
    python -m benchmarks.logbook DIR --json

GPS 1 Hz, IMU and compass 20 Hz, 20 frames a second, one filter with nine states. Ten minutes of scenario 5.3 go through
framer and pipeline; their frames and estimates follow each other again and again, each round with new times, numbers
and digests, and beginning where the one before ended. The log is compressed in chunks of one second, so nothing of a
round makes the next one smaller.

Every export is a process of its own; time is from its start to its end, memory its greatest RSS.
"""

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig, FramesTable
from common.codec import decode_frame, encode_frame
from common.messages import Frame
from common.settings import as_dict
from common.simulation.readings import Rates
from common.simulation.scenarios import scenario_voyage
from common.units import NS_PER_MS, NS_PER_S
from shore.logbook.log_writer import log_at
from shore.logbook.session import start_record
from shore.pipeline import Pipeline
from tests import offline

FRAME_HZ: Final = 20
ROUND_S: Final = 600
SETTLE_S: Final = 30
"""The opening of a filter belongs to the first round only."""
UTC_NS: Final = 1_795_000_000 * NS_PER_S
DELAY_NS: Final = 40 * NS_PER_MS
FILTER: Final = "fuzzy"
KINDS: Final = ("csv", "gpx", "kml", "geojson", "nmea", "mcap", "parquet", "png")
SIZE_GOAL_MB: Final = 280.0
TIME_GOAL_S: Final = 60.0

Step = tuple[Frame, list[dict[str, Any]]]


def one_round(seconds: float, frame_hz: int = FRAME_HZ) -> tuple[BoatConfig, list[Step]]:
    """Configuration, and each frame with what the filter said of it."""
    rates = Rates(gps_hz=1, compass_hz=frame_hz, imu_hz=20)
    voyage = scenario_voyage("5.3", seed=1, rates=rates, seconds=seconds)
    config = replace(voyage.config, frames=FramesTable(rate_hz=frame_hz))
    sensors = tuple(replace(item, tilt_leak_sigma_per_m=0.2) if item.role == "imu" else item for item in config.sensor)
    config = replace(config, sensor=sensors)
    voyage = replace(voyage, config=config)
    steps = [
        (frame, [estimate.as_record() for estimate in output.estimates])
        for _, frame, output in offline.pushed(Pipeline(config, [FILTER]), offline.frames_of(voyage))
    ]
    return config, steps


def rounds(steps: list[Step], total: int, frame_hz: int = FRAME_HZ) -> Iterator[Step]:
    """`total` steps: the first round, then its settled part again and again, moved in time and place."""
    settled = steps[SETTLE_S * frame_hz :]
    first, last = settled[0][1][0], settled[-1][1][0]
    moved_ns = settled[-1][0].t1_ns - settled[0][0].t0_ns
    north_deg, east_deg = (last[name] - first[name] for name in ("lat_deg", "lon_deg"))
    yield from steps[:total]
    done, turn = len(steps), 0
    while done < total:
        turn += 1
        for frame, records in settled[: total - done]:
            shift_ns, sequence = turn * moved_ns, frame.seq + turn * len(settled)
            there = (turn * north_deg, turn * east_deg)
            yield (
                moved_frame(frame, shift_ns, sequence, there),
                [
                    {
                        **record,
                        "t_ns": record["t_ns"] + shift_ns,
                        "seq": sequence,
                        "lat_deg": record["lat_deg"] + there[0],
                        "lon_deg": record["lon_deg"] + there[1],
                        "state": [value * (1.0 + 1e-3 * turn) for value in record["state"]],
                        "covariance": [value * (1.0 + 1e-3 * turn) for value in record["covariance"]],
                    }
                    for record in records
                ],
            )
        done += len(settled)


def moved_frame(frame: Frame, shift_ns: int, sequence: int, there: tuple[float, float]) -> Frame:
    """The same measurements at another time and place."""

    def moved(item: Any) -> Any:
        return replace(item, t_ns=item.t_ns + shift_ns)

    fixes = tuple(
        replace(moved(fix), lat_deg=fix.lat_deg + there[0], lon_deg=fix.lon_deg + there[1])
        for fix in frame.fixes
        if fix.lat_deg is not None and fix.lon_deg is not None
    )
    return replace(
        frame,
        seq=sequence,
        t0_ns=frame.t0_ns + shift_ns,
        t1_ns=frame.t1_ns + shift_ns,
        fixes=fixes,
        headings=tuple(map(moved, frame.headings)),
        imu=tuple(map(moved, frame.imu)),
    )


def write_log(path: Path, config: BoatConfig, steps: Iterable[Step]) -> int:
    """How many estimates are in it."""
    writer, rows, synced_ns = log_at(path), 0, 0
    options = {"filters": [FILTER], "step_s": None}
    writer.write_session(start_record({"config": as_dict(config)}, options, UTC_NS), UTC_NS)
    for frame, records in steps:
        utc_ns = UTC_NS + frame.t0_ns
        told = replace(frame, utc_ns=utc_ns, utc_unc_ns=100 * NS_PER_MS, utc_src="gnss")
        data, now_ns = encode_frame(told), UTC_NS + frame.t1_ns + DELAY_NS
        writer.write_frame(data, decode_frame(data), now_ns)
        for record in records:
            writer.write_estimate(record, now_ns)
            rows += 1
        if now_ns - synced_ns >= NS_PER_S:
            synced_ns = now_ns
            writer.sync()
    writer.close()
    return rows


def measured(*arguments: str | Path) -> tuple[float, float]:
    """Seconds and greatest RSS in MB of one `wayfix` command."""
    begun, peak_kb = time.monotonic(), 0
    with subprocess.Popen([sys.executable, "-m", "shore.main", *arguments], stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            # Not of `wait4`: what it says of a child begins with the memory of the parent.
            peak_kb = max(peak_kb, peak_rss_kb(process.pid))
            time.sleep(0.02)
    if process.returncode:
        raise SystemExit(f"wayfix {' '.join(map(str, arguments))} ended with {process.returncode}")
    return time.monotonic() - begun, peak_kb / 1024.0


def peak_rss_kb(pid: int) -> int:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next((int(line.split()[1]) for line in lines if line.startswith("VmHWM")), 0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument("--minutes", type=float, default=480.0)
    parser.add_argument("--to", default=",".join(KINDS), help="formats, comma-separated")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    arguments.directory.mkdir(parents=True)
    log = arguments.directory / "trip.mcap"
    begun = time.monotonic()
    config, steps = one_round(min(ROUND_S, arguments.minutes * 60.0))
    rows = write_log(log, config, rounds(steps, round(arguments.minutes * 60.0 * FRAME_HZ)))
    size_mb = log.stat().st_size / 1e6
    took_s = time.monotonic() - begun
    figures: dict[str, Any] = {"minutes": arguments.minutes, "rows": rows, "log_mb": round(size_mb, 1), "exports": {}}
    if not arguments.json:
        print(f"log: {rows} estimates, {size_mb:.1f} MB (goal for 480 minutes {SIZE_GOAL_MB:.0f}), {took_s:.0f} s")
        print(f"| format | s (goal {TIME_GOAL_S:.0f}) | us a row | peak RSS MB | file MB |\n|---|---|---|---|---|")
    for kind in arguments.to.split(","):
        out = arguments.directory / f"trip-export.{kind}"
        seconds, rss_mb = measured("export", log, "--to", kind, out)
        file_mb = out.stat().st_size / 1e6
        figures["exports"][kind] = {"s": round(seconds, 1), "rss_mb": round(rss_mb), "file_mb": round(file_mb, 1)}
        if not arguments.json:
            print(f"| {kind} | {seconds:.1f} | {seconds / rows * 1e6:.0f} | {rss_mb:.0f} | {file_mb:.0f} |", flush=True)
    if arguments.json:
        print(json.dumps(figures))


if __name__ == "__main__":
    main()
