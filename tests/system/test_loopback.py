"""Fake serial ports -> daemon -> socket -> filter -> log: every measurement sent is found in the log."""

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from common.codec import decode_frame
from common.messages import Frame
from common.units import NS_PER_S
from shore.logbook.log_reader import read_log
from tests.system.harness import command

pytestmark = pytest.mark.alone

SECONDS, SPEED = 40, 8
RATES = {"gps1": 1, "compass1": 10, "imu1": 20}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list[Frame], list[dict[str, Any]]]:
    directory = tmp_path_factory.mktemp("loopback")
    done = command(
        "wayfix", "demo", "--seconds", str(SECONDS), "--speed", str(SPEED), "--log", directory, "--headless", "--json"
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout.splitlines()[-1])
    frames = [decode_frame(data) for data in read_log(summary["log"]).frames()]
    sent = [json.loads(line) for line in (directory / "boat" / "sent.jsonl").read_text().splitlines()]
    return directory, summary, frames, sent


def f32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def test_no_frame_is_lost_and_sequence_numbers_are_whole(run: Any) -> None:
    _, summary, frames, _ = run
    assert summary["frames"]["lost"] == 0
    assert summary["frames"]["sent"] == summary["frames"]["received"] == len(frames)
    assert [frame.seq for frame in frames] == list(range(frames[0].seq, frames[0].seq + len(frames)))


def test_every_imu_sample_sent_is_in_the_log_in_order(run: Any) -> None:
    _, _, frames, sent = run
    keys = ("accel_fwd_m_s2", "accel_stb_m_s2", "yaw_rate_deg_s")
    expected = [tuple(f32(item[key]) for key in keys) for item in sent if item["kind"] == "ImuSample"]
    found = [
        sample
        for frame in frames
        for block in frame.imu
        for sample in zip(block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=True)
    ]
    assert len(expected) == SECONDS * RATES["imu1"]
    assert found == expected
    assert frames[-1].imu == () or frames[-1].imu[0].sum_count == len(expected)


def test_every_heading_sent_is_in_the_log_in_order(run: Any) -> None:
    _, _, frames, sent = run
    expected = [item["heading_mag_deg"] for item in sent if item["kind"] == "Heading"]
    assert len(expected) >= SECONDS * RATES["compass1"]
    assert [reading.heading_mag_deg for frame in frames for reading in frame.headings] == expected


def test_every_fix_sent_is_in_the_log_with_its_utc_and_near_its_time(run: Any) -> None:
    _, _, frames, sent = run
    expected = [item for item in sent if item["kind"] == "Fix"]
    found = [fix for frame in frames for fix in frame.fixes]
    assert len(expected) >= SECONDS * RATES["gps1"]
    assert [(fix.lat_deg, fix.lon_deg) for fix in found] == [(item["lat_deg"], item["lon_deg"]) for item in expected]
    assert [fix.utc_ns for fix in found] == [item["utc_ns"] for item in expected]
    assert all(fix.usable for fix in found)
    # A loaded machine reads late, at eight times its delay in boat time; a wrong latency or clock would be off by more.
    late_s = sorted((fix.t_ns - item["t_ns"]) / NS_PER_S for fix, item in zip(found, expected, strict=True))
    assert 0.0 <= late_s[len(late_s) // 2] < 0.25


def test_every_sentence_of_the_receiver_is_kept_raw(run: Any) -> None:
    _, _, frames, sent = run
    fixes = sum(item["kind"] == "Fix" for item in sent)
    raw = [line.text for frame in frames for line in frame.raw]
    assert len(raw) == 3 * fixes  # GGA, GSA, RMC
    assert all(text.startswith("$GP") for text in raw)


def test_nothing_was_rejected_and_every_sensor_delivers(run: Any) -> None:
    _, _, frames, _ = run
    newest = {report.sensor: report for frame in frames for report in frame.health}
    assert set(newest) == set(RATES)
    for report in newest.values():
        assert report.state == "delivering"
        assert report.rejected == {}
        assert report.discarded_bytes == 0


def test_the_filters_beat_the_raw_sensors(run: Any) -> None:
    _, summary, _, _ = run
    position, heading = summary["position_rms_m"], summary["heading_rms_deg"]
    assert set(position) == {"gps", "kf", "ukf", "fuzzy-thesis", "fuzzy"}
    assert max(value for name, value in position.items() if name != "gps") < position["gps"]
    assert max(value for name, value in heading.items() if name != "compass") < 0.5 * heading["compass"]


def test_replay_finds_every_estimate_again_bit_for_bit(run: Any) -> None:
    directory, summary, frames, _ = run
    done = command("wayfix", "replay", summary["log"], "--reference", directory / "boat" / "truth.csv", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    counts = result["estimates"]
    assert counts["equal"] == counts["recorded"] == counts["made"] > 4 * 0.9 * len(frames)
    assert result["position_rms_m"] == summary["position_rms_m"]
    assert result["heading_rms_deg"] == summary["heading_rms_deg"]


def test_the_picture_is_there(run: Any) -> None:
    _, summary, _, _ = run
    assert Path(summary["picture"]).stat().st_size > 20_000
