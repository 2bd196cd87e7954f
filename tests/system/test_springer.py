"""The whole boat of the thesis, nine sensors on eight ports, through ports, daemon, socket, pipeline and log."""

import json
import struct
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.messages import Frame
from common.settings import read_toml
from onboard.devices import MODELS
from shore.logbook.log_reader import read_log
from tests.system.harness import command

pytestmark = [pytest.mark.slow, pytest.mark.in_pairs]

SPRINGER = Path(__file__).parents[2] / "deploy" / "examples" / "springer.toml"
SECONDS, SPEED = 120, 2
"""Faster, a stall of the machine would be a pause between two sentences of one epoch."""
KEYS = {
    "Fix": ("lat_deg", "lon_deg", "sog_kn", "hdop", "fix_quality", "sigma_east_m", "utc_ns"),
    "ImuSample": ("accel_fwd_m_s2", "accel_stb_m_s2", "yaw_rate_deg_s"),
    "Heading": ("heading_mag_deg", "pitch_deg", "roll_deg", "warning"),
    "TurnRate": ("rate_deg_s",),
    "AisLine": ("text",),
    "RadarTarget": ("number", "range_m", "bearing_true_deg", "sog_kn", "course_true_deg", "status"),
}
LISTS = ("fixes", "headings", "turn_rates", "ais", "radar")


class Run(NamedTuple):
    """What was sent, what is in the log."""

    summary: dict[str, Any]
    sent: list[dict[str, Any]]
    frames: list[Frame]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    directory = tmp_path_factory.mktemp("springer")
    options = ("--boat", SPRINGER, "--scenario", "real-coast", "--seconds", str(SECONDS), "--speed", str(SPEED))
    done = command(
        "wayfix", "demo", *options, "--filters", "fuzzy", "--log", directory, "--headless", "--json", seconds=200.0
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    sent = [json.loads(line) for line in (directory / "boat" / "sent.jsonl").read_text().splitlines()]
    return Run(summary, sent, [decode_frame(data) for data in read_log(summary["log"]).frames()])


def in_log(frames: list[Frame]) -> dict[str, list[tuple[Any, ...]]]:
    """The values of each sensor, in the order of the log."""
    found: dict[str, list[tuple[Any, ...]]] = defaultdict(list)
    for frame in frames:
        for item in (item for name in LISTS for item in getattr(frame, name)):
            found[item.sensor].append(tuple(getattr(item, key) for key in KEYS[type(item).__name__]))
        for block in frame.imu:
            found[block.sensor] += zip(block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=True)
    return found


def f32(value: Any) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def test_every_reading_sent_is_in_the_log_once(run: Run) -> None:
    expected: dict[str, list[tuple[Any, ...]]] = defaultdict(list)
    for item in run.sent:
        values = [item.get(key) for key in KEYS[item["kind"]]]
        expected[item["sensor"]].append(tuple(map(f32, values) if item["kind"] == "ImuSample" else values))
    found = in_log(run.frames)
    assert found.keys() == expected.keys() == {table.id for table in read_toml(SPRINGER, BoatConfig).sensor}
    for sensor, readings in expected.items():
        assert len(found[sensor]) == len(readings), sensor
        for ours, theirs in zip(found[sensor], readings, strict=True):
            assert ours == pytest.approx(theirs, abs=1e-9), sensor


def test_each_sensor_spoke_at_its_rate(run: Run) -> None:
    for table in read_toml(SPRINGER, BoatConfig).sensor:
        if table.rate_hz is not None:
            count = sum(item["sensor"] == table.id for item in run.sent)
            assert abs(count - SECONDS * table.rate_hz) <= 1, table.id


def test_nothing_was_rejected_or_lost(run: Run) -> None:
    assert run.summary["frames"]["lost"] == 0
    last = {report.sensor: report for frame in run.frames for report in frame.health}
    assert {sensor: report.rejected for sensor, report in last.items()} == {sensor: {} for sensor in last}
    assert {report.state for report in last.values()} == {"delivering"}
    assert not any(report.flooded or report.discarded_bytes for report in last.values())


def test_a_boat_of_this_kind_exercises_every_driver() -> None:
    """What springer.toml leaves out is the plain NMEA compass, which the three-port boat of the demo has."""
    models = {(table.role, table.model) for table in read_toml(SPRINGER, BoatConfig).sensor}
    assert models | {("compass", "nmea")} == MODELS.keys()
