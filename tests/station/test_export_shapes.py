"""Exports of logs made by hand: pieces of track, the 180th meridian, clocks, sentences, pictures."""

import itertools
import json
import math
import re
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.image as mpl_image
import numpy as np
import polars as pl
import pynmea2
import pytest
from fastkml.validator import validate
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from common.codec import decode_frame, encode_frame
from common.events import event
from common.frames_file import FramesFile
from common.geodesy import LocalPlane
from common.messages import Event, Fix, Frame
from onboard.convert import convert
from shore.logbook.exports import nmea
from shore.logbook.exports.antimeridian import crossing
from shore.logbook.exports.clocks import Clock, Clocks
from shore.logbook.exports.png import SHOWN, _Thinned
from shore.logbook.exports.text import iso
from shore.logbook.record import LogWriter
from shore.logbook.session import start_record
from shore.report.trip import Trip, draw
from tests.station.test_export import (
    GEOJSON,
    NS,
    UTC_NS,
    empty_frame,
    estimate,
    export,
    gpx_of,
    kml_features,
    line_places,
    log_of,
    mcap_messages,
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
    assert [len(line) for line in whole["features"][0]["geometry"]["coordinates"]] == [3, 2, 2, 2]
    assert export(log, "--to", "kml", tmp_path / "a.kml") == 0
    assert validate(file_to_validate=tmp_path / "a.kml")
    assert (tmp_path / "a.kml").read_text().count("<gx:Track>") == 4
    assert export(log, "--to", "csv", tmp_path / "a.csv") == 0
    seconds = [float(row["t_s"]) for row in rows_of(tmp_path / "a.csv")]
    assert seconds == sorted(seconds)
    # every piece keeps its beginning
    assert [len(line) for line in geojson_of(log, "--every", "100")["features"][0]["geometry"]["coordinates"]] == [
        2
    ] * 4
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
    monkeypatch.setattr("shore.logbook.exports.parquet.ROWS", 7)
    log = log_of(tmp_path / "log.mcap", [estimate(t_s, 1.0, t_s / 100) for t_s in range(1, 31)])
    assert export(log, "--to", "parquet", tmp_path / "a.parquet") == 0
    assert pl.read_parquet(tmp_path / "a.parquet")["lon_deg"].to_list() == [t_s / 100 for t_s in range(1, 31)]


# The 180th meridian


def test_a_line_is_cut_at_the_180th_meridian(tmp_path: Path) -> None:
    places = [(10.0, 179.98), (10.01, 179.99), (10.03, -179.99), (10.04, -179.98), (10.02, 179.98)]
    log = log_of(tmp_path / "log.mcap", [estimate(t_s, *place) for t_s, place in enumerate(places, 1)])
    geometry = geojson_of(log)["features"][0]["geometry"]
    assert geometry["type"] == "MultiLineString"
    assert geometry["coordinates"] == [
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


# Clocks


def clock(*frames: Frame) -> Clock:
    made = Clock(0, 0, 0.0)
    for frame in frames:
        made.told(frame)
    made.settle()
    return made


def frame_at(t_s: float, offset_s: float, source: str = "gnss", epoch: int = 0) -> Frame:
    frame = empty_frame(t_s + 0.1, utc_src=source, clk_epoch=epoch)
    return replace(frame, utc_ns=frame.t0_ns + round(offset_s * NS))


def test_the_first_minutes_get_utc_from_when_it_was_known() -> None:
    """The board's own clock was an hour wrong until the receiver told it; nothing goes by it then."""
    made = clock(*(frame_at(t_s, 5000.0, "rtc") for t_s in (0, 15)), frame_at(30, 8600.0, epoch=1))
    assert made.utc_ns(0) == 8600 * NS
    assert made.utc_ns(60 * NS) == 8660 * NS


def test_a_date_of_another_year_that_a_receiver_told_for_a_while_is_no_utc() -> None:
    told = [frame_at(0, 4e8), *(frame_at(t_s, 1000.0, epoch=1) for t_s in (20, 30, 40))]
    assert clock(*told).utc_ns(0) == 1000 * NS
    assert clock(*told[:1]).utc_ns(0) == 400_000_000 * NS


def test_between_two_knots_utc_is_a_straight_line_and_after_a_step_the_nearer_holds() -> None:
    drift = clock(frame_at(0, 1000.0), frame_at(100, 1000.5))
    assert drift.utc_ns(50 * NS) == 1_050_250_000_000
    assert [drift.utc_ns(t_s * NS) for t_s in (-10, 110)] == [990 * NS, 1_110_500_000_000]
    step = clock(frame_at(0, 1000.0), frame_at(100, 2000.0, epoch=1))
    assert [step.utc_ns(t_s * NS) for t_s in (49, 51)] == [1049 * NS, 2051 * NS]
    backfilled = clock(frame_at(100, 1000.5), frame_at(0, 1000.0), frame_at(200, 1000.5))
    assert backfilled.utc_ns(50 * NS) == 1_050_250_000_000
    soon = clock(frame_at(0, 1000.0), frame_at(2, 2000.0, epoch=1))
    assert [soon.utc_ns(t_s * NS) for t_s in (0, 2)] == [1000 * NS, 2002 * NS]


@given(st.lists(st.tuples(st.integers(0, 10_000), st.floats(-0.5, 0.5)), min_size=2, max_size=30))
def test_utc_never_goes_back_while_the_mapping_is_one(told: list[tuple[int, float]]) -> None:
    made = clock(*(frame_at(20.0 * t_s, 1e6 + offset_s) for t_s, offset_s in told))
    found = [made.utc_ns(t_s * NS) for t_s in range(0, 200_000, 997)]
    assert all(a is not None and b is not None and a < b for a, b in itertools.pairwise(found))


def test_a_live_log_without_utc_goes_by_its_quickest_arrivals(tmp_path: Path) -> None:
    lags = (0.3, 0.05, 0.4, 0.2)
    plain = [replace(empty_frame(t_s), utc_ns=None, utc_src="none") for t_s in range(1, 5)]
    made = Clocks(None)
    for frame, lag_s in zip(plain, lags, strict=True):
        made.came(made.of_frame(frame), frame.t1_ns, UTC_NS + frame.t1_ns + round(lag_s * NS))
    made.settle()
    assert made.know_utc
    assert made.all[0].utc_ns(3 * NS) == UTC_NS + 3 * NS + 50_000_000


def test_an_import_with_a_date_goes_by_what_it_says(tmp_path: Path) -> None:
    """Its frames had no UTC, its arrivals are the recording's own."""
    log = tmp_path / "log.mcap"
    writer = LogWriter.at(log)
    connected = {"config": {"boat": {"id": "x"}}, "file": {"clock": "own"}}
    writer.write_session(start_record(connected, {"filters": ["ukf"]}, UTC_NS), UTC_NS)
    frame = replace(empty_frame(1.0), utc_ns=None, utc_src="none")
    writer.write_frame(encode_frame(frame), frame, UTC_NS + 5)
    writer.write_estimate(estimate(1.0, 50.0, 1.0), UTC_NS + 5)
    writer.close()
    assert export(log, "--to", "gpx", tmp_path / "a.gpx") == 0
    (point,) = gpx_of(tmp_path / "a.gpx").tracks[0].segments[0].points
    assert point.time.timestamp() == UTC_NS / NS


def test_arrivals_before_2000_are_no_utc() -> None:
    made = Clocks(None)
    frame = replace(empty_frame(1.0), utc_ns=None, utc_src="none")
    made.came(made.of_frame(frame), frame.t1_ns, frame.t1_ns)
    made.settle()
    assert not made.know_utc


def test_a_recording_without_date_says_so_and_has_no_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at_s = 13 * 3600 + 5 * 60 + 6.5
    items = [estimate(at_s + second, 50.0, 1.0) for second in range(3)]
    log = log_of(tmp_path / "log.mcap", items, {"clock": "utc-time-of-day"})
    for kind in ("csv", "gpx", "kml", "geojson", "nmea", "mcap", "parquet", "png"):
        assert export(log, "--to", kind, tmp_path / f"a.{kind}") == 0
        said = capsys.readouterr().out
        assert "the log knows the time of day, but no date: times are seconds of the log" in said
    assert {row["utc"] for row in rows_of(tmp_path / "a.csv")} == {""}
    assert {point.time for point in gpx_of(tmp_path / "a.gpx").tracks[0].segments[0].points} == {None}
    assert validate(file_to_validate=tmp_path / "a.kml")
    (line,) = (feature.geometry for feature in kml_features(tmp_path / "a.kml") if hasattr(feature, "geometry"))
    assert len(list(line.geoms)) == 1
    whole = json.loads((tmp_path / "a.geojson").read_text(encoding="utf-8"))
    assert whole["features"][0]["properties"]["begin_utc"] is None
    gga, rmc, *_ = sentences(tmp_path / "a.nmea")
    assert (gga.data[0], rmc.data[0], rmc.data[8]) == ("130506.500", "130506.500", "")
    first = mcap_messages(tmp_path / "a.mcap", "/position/ukf")[0]
    assert first["timestamp"] == {"sec": 0, "nsec": 100_000_000}


def test_a_recording_without_times_gives_sentences_without_times(tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.mcap", [estimate(1.0, 50.0, 1.0)], {"clock": "from-zero"})
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    gga, rmc, hdt = sentences(tmp_path / "a.nmea")
    assert (gga.data[0], rmc.data[0], rmc.data[8], hdt.data[0]) == ("", "", "", "12.500")


def test_seconds_go_on_over_a_reboot_as_in_replay() -> None:
    made = Clocks(None)
    first = made.of_frame(empty_frame(10.0))
    made.came(first, 70 * NS, UTC_NS)
    second = made.of_frame(empty_frame(5.0, clock_id="c2", boot_id="b2"))
    assert first.seconds(20 * NS) == pytest.approx(10.1)
    assert second.seconds(6 * NS) == pytest.approx(60.1 + 1.1)
    assert made.of_boot("b1", 0) is first
    assert made.of_boot("unknown", 0) is second


# Sentences


def test_what_is_not_aligned_is_not_valid(tmp_path: Path) -> None:
    items = [
        estimate(1.0, -0.5, 1.0, aligned=False, waiting=("heading",)),
        estimate(1.1, -0.5, 1.0, cog_true_deg=359.9999),
    ]
    assert export(log_of(tmp_path / "log.mcap", items), "--to", "nmea", tmp_path / "a.nmea") == 0
    gga, rmc, valid_gga, valid_rmc, hdt = sentences(tmp_path / "a.nmea")
    assert (gga.gps_qual, rmc.status, rmc.data[11]) == (0, "V", "N")
    assert (valid_gga.gps_qual, valid_rmc.status, valid_rmc.data[11]) == (1, "A", "A")
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


# Raw fixes


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


# Pictures


def trip_of(rows: np.ndarray, **more: Any) -> Trip:
    defaults: dict[str, Any] = {
        "title": "cost $5 and $6_", "subtitle": "海上試験", "has_utc": True, "origin": (50.0, -1.0),
        "fixes": rows[::5, 1:3],
    }  # fmt: skip
    return Trip(rows=rows, **(defaults | more))


def straight(count: int = 200, spread_m: float = 1000.0) -> np.ndarray:
    along = np.linspace(0.0, 1.0, count)
    rows = np.column_stack((1.8e9 + 60.0 * along, spread_m * along, 0.3 * spread_m * along, *[along] * 7))
    rows[:, 3:] = (350.0, 4.0, 1.0, 9.0, 0.5, 1.0, 0.0)
    rows[0, 9] = 1.0
    return rows


@pytest.mark.parametrize(
    "rows",
    [
        straight(),
        straight(1),
        straight(spread_m=0.0),
        straight(spread_m=300_000.0),
        np.column_stack((straight()[:, :4], np.full((200, 4), np.nan), straight()[:, 8:])),
    ],
)
def test_a_picture_of_any_trip_has_its_track_in_it(rows: np.ndarray) -> None:
    for has_utc in (True, False):
        stream = BytesIO()
        draw(stream, trip_of(rows, has_utc=has_utc))
        stream.seek(0)
        image = mpl_image.imread(stream)
        red = np.array((0xD6, 0x28, 0x39)) / 255.0
        drawn = np.abs(image[:, :, :3] - red).max(axis=2) < 0.02
        assert image.shape[1] == 1320
        assert drawn.sum() > 20


def test_a_long_trip_is_thinned_and_keeps_its_pieces() -> None:
    thinned = _Thinned()
    for number in range(5 * SHOWN):
        thinned.add((float(number), *[0.0] * 8, float(number == 33_333)))
    points = thinned.points(10)
    assert SHOWN <= len(points) <= 2 * SHOWN
    steps = np.diff(points[:, 0])
    assert steps.min() == steps.max()
    (begins,) = points[points[:, 9] == 1.0, 0]
    assert abs(begins - 33_333) <= 4


def test_a_picture_of_a_log_has_right_places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from shore.logbook.exports import png

    drawn: list[Trip] = []
    monkeypatch.setattr(png, "draw", lambda _stream, trip: drawn.append(trip))
    items: list[Any] = [estimate(t_s, 50.0 + t_s / 1e4, -1.0) for t_s in range(1, 5)]
    items.append(event("link-lost", 3 * NS, "link", age_s=3.5))
    assert export(log_of(tmp_path / "log.mcap", items), "--to", "png", tmp_path / "a.png") == 0
    (trip,) = drawn
    plane = LocalPlane(*trip.origin)
    assert trip.origin == (items[0]["lat_deg"], items[0]["lon_deg"])
    for row, item in zip(trip.rows, items, strict=False):
        assert (row[1], row[2]) == pytest.approx(plane.to_east_north_m(item["lat_deg"], item["lon_deg"]), abs=1e-6)
        assert tuple(row[4:7]) == (4.0, 0.5, 9.0)
        assert row[0] == pytest.approx((UTC_NS + item["t_ns"]) / NS)
    (happening,) = trip.events
    assert happening.code == "link-lost"
    assert happening.north_m == pytest.approx(trip.rows[2, 2])


def test_times_are_written_to_the_microsecond() -> None:
    assert iso(UTC_NS + 5_999) == "2026-11-18T11:06:40.000005Z"
