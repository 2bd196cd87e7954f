"""Recordings played through pseudo-terminal, daemon and socket: no line is lost, and `convert` says the same."""

import math
import time
from pathlib import Path
from typing import Any

import pytest

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.frames_file import FramesFile
from common.geodesy import LocalPlane
from common.link_messages import MAX_WINDOW
from common.messages import Frame, SensorHealth
from common.settings import convert as as_config
from onboard.recorded.convert import convert
from shore.link.link import Link
from shore.pipeline import Pipeline
from tests.recordings import SHARED_DATA
from tests.system.harness import Process

RATE = 4
"""Boat seconds in a second. At four times the speed a stall of 37 ms is a pause between two sentences of one epoch."""
FASTER = 8
"""For the long recordings of the slow tier, which run alone: there it is 19 ms."""


def path_of(name: str) -> Path:
    found = sorted(SHARED_DATA.glob(name))
    if not found:
        pytest.skip(f"the recording {name} is not beside the repository ({SHARED_DATA})")
    return found[0]


def played(source: Path, directory: Path, rate: int = RATE) -> tuple[dict[str, Any], dict[str, Any], list[Frame]]:
    """Play a file to its end: what the player said when ready and when done, and all frames of the daemon."""
    clock = ("--clock-rate", f"{rate}", "--clock-start", str(time.clock_gettime_ns(time.CLOCK_BOOTTIME)))
    place = ("--dir", directory, "--bind", "tcp://127.0.0.1:*", "--hold", "--until-stdin-closes")
    player = Process("wayfix-onboard", "virtual", "--nmea", source, *place, *clock)
    daemon = None
    try:
        ready = player.ready()
        daemon = Process("wayfix-onboard", "run", "--open", ready["config"], *clock)
        link = Link(daemon.ready()["bind"], window=MAX_WINDOW)
        frames: list[Frame] = []
        try:
            link.connect()
            player.tell("go")
            done: dict[str, Any] | None = None
            end = time.monotonic() + ready["seconds"] / rate + 30
            last_ns = math.inf
            # Two seconds of boat time after the last byte: epochs are closed, and health has counted them.
            while time.monotonic() < end and (not frames or frames[-1].t1_ns < last_ns):
                received = link.receive(0.1)
                if received is not None and received.frame is not None:
                    frames.append(decode_frame(received.frame))
                done = done or player.said("done")
                if done is not None and frames and last_ns == math.inf:
                    last_ns = frames[-1].t1_ns + 2_500_000_000
        finally:
            link.close()
        assert done is not None, player.err
        return ready, done, frames
    finally:
        for process in (player, daemon):
            if process is not None:
                process.end()


def converted(source: Path, target: Path, **options: Any) -> tuple[dict[str, Any], list[Frame]]:
    summary = convert(source, target, **options)
    with FramesFile(target) as file:
        return summary, [decode_frame(data) for data in file.frames()]


def newest(frames: list[Frame]) -> dict[str, SensorHealth]:
    return {report.sensor: report for frame in frames for report in frame.health}


@pytest.mark.alone
@pytest.mark.parametrize(
    ("name", "lines", "fixes", "rate"),
    [
        ("gpsd-receivers/bu353s4.log", 90, 25, RATE),
        ("radar-ttm-nmea/RadarLogs_lines_1-2000.txt", 2000, 58, RATE),
        pytest.param("signalk-boat-nmea/gofree-merrimac.log", 6324, 142, FASTER, marks=pytest.mark.slow),
        pytest.param("milliampere-ferry/*_GPGGA.csv", 5380, 1795, FASTER, marks=pytest.mark.slow),
    ],
)
def test_every_line_played_is_accounted_for(name: str, lines: int, fixes: int, rate: int, tmp_path: Path) -> None:
    source = path_of(name)
    ready, done, frames = played(source, tmp_path / "boat", rate)
    (file,) = done["files"].values()
    assert done["dropped_bytes"] == 0
    assert file["not_sent"] == 0
    assert file["sent"] == lines == file["lines"] - sum(file["skipped"].values())

    # The frames carry what was accepted and rejected, not what was ignored; the same decoders offline count all.
    (port,) = ready["ports"]
    summary, offline = converted(source, tmp_path / "out", config_file=Path(ready["config"]), port=port)
    assert summary["lines"] == lines
    accepted = sum(sum(kinds.values()) for kinds in summary["accepted"].values())
    assert accepted + sum(summary["rejected"].values()) + sum(summary["ignored"].values()) == lines
    assert summary["too_long"] == 0

    live, expected = newest(frames), newest(offline)
    assert {sensor: (report.accepted, report.rejected) for sensor, report in live.items()} == {
        sensor: (report.accepted, report.rejected) for sensor, report in expected.items()
    }
    assert {report.discarded_bytes for report in live.values()} == {0}
    for kind in ("headings", "ais", "radar", "raw", "turn_rates", "attitudes"):
        assert sum(len(getattr(frame, kind)) for frame in frames) == sum(
            len(getattr(frame, kind)) for frame in offline
        ), kind
    found = [fix for frame in frames for fix in frame.fixes]
    assert len(found) == len({fix.tod_ms for fix in found}) == fixes
    places = [(fix.tod_ms, fix.lat_deg, fix.lon_deg) for frame in offline for fix in frame.fixes]
    assert [(fix.tod_ms, fix.lat_deg, fix.lon_deg) for fix in found] == places


def test_the_track_of_a_moored_boat_without_imu(tmp_path: Path) -> None:
    source = path_of("signalk-boat-nmea/gofree-merrimac.log")
    _, frames = converted(source, tmp_path / "out")
    with FramesFile(tmp_path / "out") as file:
        config = as_config(file.greeting["config"], BoatConfig)
    fixes = [fix for frame in frames for fix in frame.fixes]
    assert len(fixes) == 142
    assert all(fix.usable and not fix.held for fix in fixes)
    pipeline = Pipeline(config, ["fuzzy", "ukf", "kf"])
    estimates = [estimate for frame in frames for estimate in pipeline.push(frame).estimates]
    assert {estimate.filter for estimate in estimates} == {"fuzzy", "ukf", "kf"}
    assert len(estimates) > 3 * 1300
    plane = LocalPlane(fixes[0].lat_deg, fixes[0].lon_deg)  # type: ignore[arg-type]
    for estimate in estimates:
        assert estimate.heading_true_deg is not None
        numbers = (estimate.lat_deg, estimate.lon_deg, estimate.heading_true_deg)
        assert all(math.isfinite(value) for value in numbers)
        fix = max((fix for fix in fixes if fix.t_ns <= estimate.t_ns), key=lambda fix: fix.t_ns)
        east_m, north_m = plane.to_east_north_m(estimate.lat_deg, estimate.lon_deg)
        fix_east_m, fix_north_m = plane.to_east_north_m(fix.lat_deg, fix.lon_deg)  # type: ignore[arg-type]
        assert math.hypot(east_m - fix_east_m, north_m - fix_north_m) < 2.0
        # 181.7 degrees magnetic, variation 0.6 or 0.7 east.
        assert abs(estimate.heading_true_deg - 182.4) < 2.0
