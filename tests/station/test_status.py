from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.messages import Fix, Frame, Heading
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.pipeline import Output, Pipeline
from shore.watchers.newest import Newest
from shore.watchers.status import position_text, status_text
from shore.watchers.watcher import SourceState
from tests.navigate.voyages import UNCALIBRATED, frames_of, sail
from tests.station.exporting import estimate, estimated
from tests.strategies import frame_of

CONFIG = BoatConfig(
    boat=BoatTable(id="b"),
    port=(PortTable(name="p", path="x"),),
    sensor=(SensorTable(id="gps1", port="p", role="gps"), SensorTable(id="compass1", port="p", role="compass")),
)


def ended_at(t1_s: float, *entries: Fix | Heading) -> Frame:
    t1_ns = int(t1_s * NS_PER_S)
    return frame_of(*entries, start_no=0, t0_ns=t1_ns - 1000, t1_ns=t1_ns)


@pytest.fixture(scope="module")
def short_voyage() -> list[Frame]:
    return frames_of(sail(42, 0.05), 1)


def test_every_number_has_its_age_and_a_stale_one_says_so() -> None:
    line = Newest(CONFIG, "fuzzy")
    assert status_text(line, SourceState(0, 0)) == "fuzzy waits | no fix yet | no heading yet | 0 frames, 0 missing"
    fix = Fix(sensor="gps1", t_ns=NS_PER_S, lat_deg=1.0, lon_deg=2.0, fix_quality=1)
    reading = Heading(sensor="compass1", t_ns=NS_PER_S, heading_mag_deg=7.0)
    line.take(ended_at(1.5, fix, reading), Output())
    assert "gps1 GPS (0.5 s) | compass1 007.0°M (0.5 s)" in status_text(line, SourceState(1, 0))
    line.take(ended_at(7.0), Output())
    assert "gps1 GPS STALE (6 s) | compass1 007.0°M STALE (6 s)" in status_text(line, SourceState(2, 0))


def test_a_picture_whose_frames_stopped_grows_old_on_the_stations_own_clock() -> None:
    now_s = [100.0]
    line = Newest(CONFIG, "ukf", now_s=lambda: now_s[0])
    fix = Fix(sensor="gps1", t_ns=NS_PER_S, lat_deg=1.0, lon_deg=2.0, fix_quality=1)
    output = Output(estimates=(estimated(1.4, 50.0, -1.0),))
    line.take(replace(ended_at(1.5, fix), t0_ns=1_400_000_000), output)
    shown = {}
    for after_s in (0.1, 1.0, 2.0, 2.2, 3.0, 60.0):
        now_s[0] = 100.0 + after_s
        shown[after_s] = status_text(line, SourceState(0, 0)).split(" | ")[:2]
    assert shown[0.1][1] == "gps1 GPS (0.5 s)", "the next frame is only due"
    assert shown[1.0][1] == "gps1 GPS (1.4 s)"
    assert not any("STALE" in text for after_s in (0.1, 1.0) for text in shown[after_s])
    assert all("STALE" in text for after_s in (2.2, 3.0, 60.0) for text in shown[after_s])
    assert shown[60.0][1] == "gps1 GPS STALE (60 s)"


@pytest.mark.parametrize("width", range(8, 120, 7))
def test_a_line_that_is_cut_does_not_lose_the_word_stale(width: int) -> None:
    line = Newest(CONFIG, "ukf")
    line.take(ended_at(115.0), Output(estimates=(Estimate(**estimate(115.0, 42.23, -8.74)),)))
    line.take(ended_at(120.0), Output())
    text = status_text(line, SourceState(0, 0), width)
    assert "STALE" in text
    assert len(text) <= width


def test_what_the_filter_waits_for_is_said_until_nothing_is_missing(short_voyage: list[Frame]) -> None:
    """The compass is silent for the first two seconds; then the biases are not known yet."""
    pipeline, line, said = Pipeline(UNCALIBRATED, ("ukf",)), Newest(UNCALIBRATED, "ukf"), []
    for each in short_voyage[:600]:
        quiet = replace(each, headings=each.headings if each.seq >= 20 else ())
        line.take(quiet, pipeline.push(quiet))
        text = status_text(line, SourceState(each.seq + 1, 0)).split(" | ")[0]
        if "waiting for: " in text:
            said.append(text[text.index("waiting for: ") :])
        else:
            said.append("valid" if "kn" in text else "nothing")
    begins = [
        "waiting for: heading",
        "waiting for: noise of the sensors, IMU biases",
        "waiting for: IMU biases",
        "valid",
    ]
    assert list(dict.fromkeys(said)) == begins
    assert said == sorted(said, key=begins.index)


def test_backfill_changes_nothing_and_a_reboot_begins_anew() -> None:
    line = Newest(CONFIG, "fuzzy")
    fixes = {
        t_s: Fix(sensor="gps1", t_ns=t_s * NS_PER_S, lat_deg=1.0, lon_deg=2.0, fix_quality=1 + (t_s == 1))
        for t_s in (1, 50)
    }
    line.take(ended_at(50.5, fixes[50]), Output())
    newest = status_text(line, SourceState(0, 0))
    line.take(ended_at(1.5, fixes[1]), Output())
    assert status_text(line, SourceState(0, 0)) == newest
    line.take(replace(ended_at(1.5, fixes[1]), clock_id="before", start_no=-1), Output(is_past=True))
    assert status_text(line, SourceState(0, 0)) == newest
    line.take(replace(ended_at(1.5, fixes[1]), clock_id="after", start_no=1), Output())
    assert "gps1 DGPS (0.5 s)" in status_text(line, SourceState(0, 0))


def test_a_fix_that_is_not_fused_says_so() -> None:
    line = Newest(CONFIG, "fuzzy")
    line.take(ended_at(1.0, Fix(sensor="gps1", t_ns=NS_PER_S, fix_quality=0)), Output())
    assert "gps1 not usable" in status_text(line, SourceState(1, 0))


def test_positions_read_as_on_a_chart() -> None:
    assert position_text(50.76, -1.29) == "50°45.600'N 001°17.400'W"
    assert position_text(-0.9999999999, 179.9999999) == "01°00.000'S 180°00.000'E"


@given(st.floats(-90, 90), st.floats(-180, 180))
def test_a_position_text_is_right_to_half_a_thousandth_of_a_minute(lat: float, lon: float) -> None:
    text = position_text(lat, lon)
    assert "60.000'" not in text
    degrees, minutes = text.split()[0].split("°")
    value = int(degrees) + float(minutes[:-2]) / 60
    assert abs(value - abs(lat)) <= 0.00051 / 60
    assert minutes[-1] == ("S" if lat < 0 else "N")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, "42°13.800'N 008°44.400'W ±5.0 m  012.5°T ±1.0°  3.0 kn"),
        (
            {"position_from": "coasting", "position_since_ns": 0, "sigma_east_m": 30.0, "sigma_north_m": 40.0},
            "42°13.800'N 008°44.400'W ±50.0 m COASTING 115 s  012.5°T ±1.0°  3.0 kn",
        ),
        (
            {"position_from": "coasting", "position_since_ns": 0, "sigma_east_m": 600.0},
            "position unknown (±0.6 km) COASTING 115 s  012.5°T ±1.0°  3.0 kn",
        ),
        ({"heading_true_deg": None, "heading_from": None}, "±5.0 m  heading unknown  3.0 kn"),
        ({"heading_from": "course", "sigma_heading_deg": 22.0}, "±5.0 m  012.5°T ±22.0° by COG  3.0 kn"),
        ({"heading_from": "coasting"}, "±5.0 m  012.5°T ±1.0° carried on  3.0 kn"),
    ],
)
def test_what_an_estimate_rests_on_is_said_and_no_number_of_too_much_doubt(changes: dict[str, Any], told: str) -> None:
    line = Newest(CONFIG, "ukf")
    record = estimate(115.0, 42.23, -8.74, sigma_east_m=3.0, sigma_north_m=4.0) | changes
    line.take(ended_at(115.0), Output(estimates=(Estimate(**record),)))
    assert status_text(line, SourceState(0, 0)).split(" | ")[0].endswith(told)
