"""Exports of logs made by hand: pieces of track, the 180th meridian, sentences, raw fixes."""

import json
import math
import re
from pathlib import Path
from typing import Any

import polars as pl
import pynmea2
import pytest
from fastkml.validator import validate
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from common.codec import decode_frame
from common.frames_file import FramesFile
from common.messages import Event, Fix
from onboard.recorded.convert import convert
from shore.exports import nmea
from shore.exports.antimeridian import crossing
from shore.exports.text import iso
from tests.station.exporting import (
    GEOJSON,
    NS,
    UTC_NS,
    empty_frame,
    estimate,
    export,
    gpx_of,
    line_places,
    lines_of,
    log_of,
    rows_of,
    sentences,
)

LATITUDES = st.floats(-89.9, 89.9)
LONGITUDES = st.floats(-180.0, 180.0)


def told(code: str, t_s: float, **evidence: Any) -> Event:
    return Event(t_ns=round(t_s * NS), source="filter", code=code, level="info", text=code, evidence=evidence)


def geojson_of(log: Path, *words: object) -> dict[str, Any]:
    out = log.with_suffix(".geojson")
    assert export(log, "--to", "geojson", out, "--force", *words) == 0
    whole: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    Draft202012Validator(GEOJSON).validate(whole)
    return whole


# Pieces of track


def test_a_gap_a_reset_and_a_reboot_begin_a_new_piece(tmp_path: Path) -> None:
    items: list[Any] = [estimate(t_s, 50.0, t_s / 1e4) for t_s in (1.0, 2.0, 12.0)]
    items += [estimate(t_s, 50.0, t_s / 1e4) for t_s in (22.1, 23.0)]  # 10.1 s later
    items += [told("filter-reset", 23.5, filter="ukf"), told("filter-reset", 24.5, filter="kf")]
    items += [estimate(t_s, 50.0, t_s / 1e4) for t_s in (24.0, 25.0)]
    items += [estimate(1.5, 50.0, 0.01, boot_id="b2")]
    log = log_of(tmp_path / "log.mcap", items)
    assert export(log, "--to", "gpx", tmp_path / "a.gpx") == 0
    (track,) = gpx_of(tmp_path / "a.gpx").tracks
    assert [len(segment.points) for segment in track.segments] == [3, 2, 2, 1]
    whole = geojson_of(log)
    assert [len(line) for line in lines_of(whole)] == [3, 2, 2, 2]
    assert export(log, "--to", "kml", tmp_path / "a.kml") == 0
    assert validate(file_to_validate=tmp_path / "a.kml")
    assert (tmp_path / "a.kml").read_text().count("<gx:Track>") == 4
    assert export(log, "--to", "csv", tmp_path / "a.csv") == 0
    seconds = [float(row["t_s"]) for row in rows_of(tmp_path / "a.csv")]
    assert seconds == sorted(seconds)
    # every piece keeps its beginning
    assert [len(line) for line in lines_of(geojson_of(log, "--every", "100"))] == [2] * 4
    assert export(log, "--to", "png", tmp_path / "a.png") == 0


def test_the_first_filter_of_the_session_leads_and_states_may_change(tmp_path: Path) -> None:
    """The board came back with other sensors: the columns stay those of the beginning."""
    more = {"names": ("north_m", "east_m", "gyro_bias_rad_s"), "state": (1.0, 2.0, 3.0), "covariance": (1.0,) * 6}
    items = [estimate(1.0, 1.0, 1.0, filter="kf"), estimate(1.0, 5.0, 5.0), estimate(2.0, 5.0, 5.0, **more)]
    assert export(log_of(tmp_path / "log.mcap", items), "--to", "csv", tmp_path / "a.csv") == 0
    rows = rows_of(tmp_path / "a.csv")
    assert [row["lat_deg"] for row in rows] == ["5.0", "5.0"]
    assert list(rows[0])[-2:] == ["east_m", "north_m"]
    assert [(row["east_m"], row["north_m"]) for row in rows] == [("0.0", "0.0"), ("2.0", "1.0")]


def test_a_table_of_many_rows_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shore.exports.parquet.ROWS", 7)
    log = log_of(tmp_path / "log.mcap", [estimate(t_s, 1.0, t_s / 100) for t_s in range(1, 31)])
    assert export(log, "--to", "parquet", tmp_path / "a.parquet") == 0
    assert pl.read_parquet(tmp_path / "a.parquet")["lon_deg"].to_list() == [t_s / 100 for t_s in range(1, 31)]


# The 180th meridian


def test_a_line_is_cut_at_the_180th_meridian(tmp_path: Path) -> None:
    places = [(10.0, 179.98), (10.01, 179.99), (10.03, -179.99), (10.04, -179.98), (10.02, 179.98)]
    log = log_of(tmp_path / "log.mcap", [estimate(t_s, *place) for t_s, place in enumerate(places, 1)])
    assert lines_of(geojson_of(log)) == [
        [[179.98, 10.0], [179.99, 10.01], [180.0, 10.02]],
        [[-180.0, 10.02], [-179.99, 10.03], [-179.98, 10.04], [-180.0, 10.03]],
        [[180.0, 10.03], [179.98, 10.02]],
    ]
    assert export(log, "--to", "gpx", tmp_path / "a.gpx") == 0
    points = gpx_of(tmp_path / "a.gpx").tracks[0].segments[0].points
    assert [(point.latitude, point.longitude) for point in points] == places
    assert export(log, "--to", "png", tmp_path / "a.png") == 0


def test_lines_of_a_log_without_utc_are_cut_in_kml_too(tmp_path: Path) -> None:
    places = [(-10.0, 179.99), (-10.02, -179.99)]
    made = {"clock": "from-zero"}
    items = [*(estimate(t_s, *place) for t_s, place in enumerate(places, 1)), estimate(50.0, 1.0, 2.0)]
    log = log_of(tmp_path / "log.mcap", items, made)
    assert export(log, "--to", "kml", tmp_path / "a.kml") == 0
    assert validate(file_to_validate=tmp_path / "a.kml")
    lines = re.findall(r"<coordinates>\s*(.*?)\s*</coordinates>", (tmp_path / "a.kml").read_text(), re.DOTALL)
    assert [line.split() for line in lines] == [
        ["179.990000000,-10.000000000", "180.000000000,-10.010000000"],
        ["-180.000000000,-10.010000000", "-179.990000000,-10.020000000"],
        ["2.000000000,1.000000000"] * 2,
    ]


@given(LATITUDES, LONGITUDES, LATITUDES, LONGITUDES)
def test_both_ends_of_a_crossing_lie_on_the_meridian_and_between(a: float, b: float, c: float, d: float) -> None:
    ends = crossing((a, b), (c, d))
    if ends is None:
        assert abs(d - b) <= 180.0
        return
    (lat, side), (same_lat, other) = ends
    assert lat == same_lat
    assert (side, other) in {(180.0, -180.0), (-180.0, 180.0)}
    assert math.copysign(1.0, side) == math.copysign(1.0, b)
    assert min(a, c) - 1e-9 <= lat <= max(a, c) + 1e-9


def test_one_place_alone_is_told_twice(tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.mcap", [estimate(1.0, 1.0, 2.0)])
    assert line_places(geojson_of(log)) == [(1.0, 2.0), (1.0, 2.0)]
    for kind in ("kml", "png", "gpx", "nmea", "mcap", "parquet"):
        assert export(log, "--to", kind, tmp_path / f"a.{kind}") == 0
    assert validate(file_to_validate=tmp_path / "a.kml")


# Sentences


def test_what_is_not_aligned_is_not_valid(tmp_path: Path) -> None:
    items = [
        estimate(1.0, -0.5, 1.0, aligned=False, aligned_parts=(), waiting=("noise of the sensors", "heading")),
        estimate(1.1, -0.5, 1.0, cog_true_deg=359.9999),
    ]
    assert export(log_of(tmp_path / "log.mcap", items), "--to", "nmea", tmp_path / "a.nmea") == 0
    gga, rmc, valid_gga, valid_rmc, hdt = sentences(tmp_path / "a.nmea")
    assert (gga.gps_qual, rmc.status, rmc.data[11:]) == (0, "V", ["N", "U"])
    assert (valid_gga.gps_qual, valid_rmc.status, valid_rmc.data[11:]) == (1, "A", ["A", "S"])
    assert (valid_rmc.data[6], valid_rmc.data[7], hdt.data) == ("3.000", "0.000", ["12.500", "T"])
    assert {sentence.talker for sentence in (gga, rmc, hdt)} == {"IN"}
    assert (valid_gga.data[1], valid_gga.data[2]) == ("0030.0000000", "S")


@given(LATITUDES, LONGITUDES)
def test_coordinates_come_back(lat_deg: float, lon_deg: float) -> None:
    text = f"{nmea._coordinate(lat_deg, 2, 'NS')},{nmea._coordinate(lon_deg, 3, 'EW')}"
    assert re.fullmatch(r"\d\d[0-5]\d\.\d{7},[NS],[01]\d\d[0-5]\d\.\d{7},[EW]", text)
    parsed: Any = pynmea2.parse(f"$INGGA,000000,{text},1,,,,M,,M,,")
    assert (parsed.latitude, parsed.longitude) == pytest.approx((lat_deg, lon_deg), abs=1e-9)


def test_sentences_are_imported_again(tmp_path: Path) -> None:
    """`wayfix-onboard convert` finds every position, time and heading."""
    items = [
        estimate(100.0 + t_s, 50.0 + t_s / 1e5, -1.0 - t_s / 1e5, heading_true_deg=10.0 + t_s) for t_s in range(30)
    ]
    log = log_of(tmp_path / "log.mcap", items)
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    assert max(map(len, (tmp_path / "a.nmea").read_bytes().split(b"\r\n"))) <= 80
    summary = convert(tmp_path / "a.nmea", tmp_path / "a.frames")
    assert summary["accepted"] == {"compass1": {"HDT": 30}, "gps1": {"GGA": 30, "RMC": 30}}
    assert not summary["rejected"]
    with FramesFile(tmp_path / "a.frames") as file:
        frames = [decode_frame(data) for data in file.frames()]
    fixes = [fix for frame in frames for fix in frame.fixes]
    assert [fix.utc_ns for fix in fixes] == [UTC_NS + item["t_ns"] for item in items]
    for fix, item in zip(fixes, items, strict=True):
        assert fix.usable
        assert (fix.lat_deg, fix.lon_deg) == pytest.approx((item["lat_deg"], item["lon_deg"]), abs=1e-8)
    headings = [heading.heading_true_deg for frame in frames for heading in frame.headings]
    assert headings == [item["heading_true_deg"] for item in items]


def test_the_time_of_day_begins_again_at_midnight(tmp_path: Path) -> None:
    items = [estimate(86_399.5 + t_s, 50.0, 1.0) for t_s in range(2)]
    log = log_of(tmp_path / "log.mcap", items, {"clock": "utc-time-of-day"})
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    assert [s.data[0] for s in sentences(tmp_path / "a.nmea") if s.sentence_type == "GGA"] == [
        "235959.500",
        "000000.500",
    ]


# Raw fixes, times


def test_raw_takes_usable_fixes_of_the_first_receiver_only(tmp_path: Path) -> None:
    def fix(t_s: float, sensor: str = "gps2", **more: Any) -> Fix:
        return Fix(sensor=sensor, t_ns=round(t_s * NS), lat_deg=1.0, lon_deg=2.0, **more)

    frames = [
        empty_frame(1.0, fixes=(fix(0.9, fix_quality=0), fix(0.9, "gps1", held=True))),
        empty_frame(2.0, fixes=(fix(1.9), fix(1.95, "gps1"), Fix(sensor="gps2", t_ns=2 * NS))),
        empty_frame(3.0, fixes=(fix(2.9), fix(1.5))),
    ]
    log = log_of(tmp_path / "log.mcap", frames)
    assert export(log, "--to", "csv", tmp_path / "a.csv") == 0
    assert [int(row["t_ns"]) for row in rows_of(tmp_path / "a.csv")] == [1_900_000_000, 2_900_000_000]


def test_times_are_written_to_the_microsecond() -> None:
    assert iso(UTC_NS + 5_999) == "2026-11-18T11:06:40.000005Z"
