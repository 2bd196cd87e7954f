"""`wayfix export`: what programs of others read out of it is what the log says, the same in all formats."""

import json
import warnings
from pathlib import Path
from typing import Any

import fastkml
import polars as pl
import pytest
from fastkml.validator import validate
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from common.codec import decode_frame, encode_frame
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import log_at
from shore.logbook.session import start_record
from tests.station.exporting import (
    GEOJSON,
    HORROR,
    KINDS,
    NS,
    UTC_NS,
    export,
    gpx_of,
    kml_features,
    kml_places,
    line_places,
    mcap_messages,
    rows_of,
    sentences,
)


def test_all_formats_have_the_places_of_the_log(out: Path, recorded: list[dict[str, Any]]) -> None:
    expected = [(item["lat_deg"], item["lon_deg"]) for item in recorded]
    assert len(expected) > 350
    table = pl.read_parquet(out / "trip.parquet")
    (track,) = gpx_of(out / "trip.gpx").tracks
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        places = {
            "csv": [(float(row["lat_deg"]), float(row["lon_deg"])) for row in rows_of(out / "trip.csv")],
            "gpx": [(point.latitude, point.longitude) for segment in track.segments for point in segment.points],
            "kml": kml_places(out / "trip.kml"),
            "geojson": line_places(json.loads((out / "trip.geojson").read_text())),
            "nmea": [(s.latitude, s.longitude) for s in sentences(out / "trip.nmea") if s.sentence_type == "GGA"],
            "nmea, RMC": [(s.latitude, s.longitude) for s in sentences(out / "trip.nmea") if s.sentence_type == "RMC"],
            "mcap": [(m["lat_deg"], m["lon_deg"]) for m in mcap_messages(out / "trip.mcap", "/estimates/fuzzy")],
            "parquet": list(zip(table["lat_deg"].to_list(), table["lon_deg"].to_list(), strict=True)),
        }
    for kind, found in places.items():
        assert len(found) == len(expected), kind
        apart = max(
            max(abs(a - b) for a, b in zip(one, two, strict=True)) for one, two in zip(found, expected, strict=True)
        )
        assert apart <= 1e-7, kind
    for exact in ("csv", "mcap", "parquet"):
        assert places[exact] == expected


def test_all_formats_have_the_times_of_the_log(out: Path, recorded: list[dict[str, Any]]) -> None:
    """The frames say UTC = boat time + a constant."""
    expected_us = [(UTC_NS + item["t_ns"]) // 1000 for item in recorded]
    table = pl.read_parquet(out / "trip.parquet")
    assert table["utc"].dt.timestamp("us").to_list() == expected_us
    assert table["t_ns"].to_list() == [item["t_ns"] for item in recorded]
    (track,) = gpx_of(out / "trip.gpx").tracks
    found = [round(point.time.timestamp() * 1e6) for segment in track.segments for point in segment.points]
    assert found == expected_us
    rmc = [s for s in sentences(out / "trip.nmea") if s.sentence_type == "RMC"]
    assert [round(s.datetime.timestamp() * 1e3) for s in rmc] == [us // 1000 for us in expected_us]
    first = rows_of(out / "trip.csv")[0]
    assert first["utc"] == table["utc"].dt.to_string("%Y-%m-%dT%H:%M:%S%.6fZ")[0]
    stamps = [m["timestamp"] for m in mcap_messages(out / "trip.mcap", "/position/fuzzy")]
    valid = [item for item in recorded if "position" in item["aligned_parts"]]
    assert 200 < len(valid) < len(recorded)
    assert [item["sec"] * NS + item["nsec"] for item in stamps] == [UTC_NS + item["t_ns"] for item in valid]


def test_the_csv_says_its_units_and_every_digit(out: Path, recorded: list[dict[str, Any]]) -> None:
    names = ",".join(recorded[0]["names"])
    head = (out / "trip.csv").read_text(encoding="utf-8").splitlines()[0]
    assert head == (
        "t_s,utc,t_ns,lat_deg,lon_deg,heading_true_deg,sog_kn,cog_true_deg,sigma_east_m,sigma_north_m,"
        f"sigma_heading_deg,aligned,aligned_parts,waiting,position_from,position_since_ns,heading_from,{names}"
    )
    for row, item in zip(rows_of(out / "trip.csv"), recorded, strict=True):
        for name in ("heading_true_deg", "sog_kn", "sigma_east_m", "sigma_north_m", "sigma_heading_deg"):
            assert float(row[name]) == item[name]
        assert [float(row[name]) for name in item["names"]] == item["state"]
        assert row["cog_true_deg"] == ("" if item["cog_true_deg"] is None else repr(item["cog_true_deg"]))
        assert row["aligned"] == json.dumps(item["aligned"])


def test_the_csv_is_a_reference_for_replay(out: Path, recorded: list[dict[str, Any]]) -> None:
    from shore.report.reference import read_reference

    reference = read_reference(out / "trip.csv", 0)
    assert reference.at(recorded[50]["t_ns"]) is not None


def test_geojson_is_valid(out: Path) -> None:
    whole = json.loads((out / "trip.geojson").read_text(encoding="utf-8"))
    Draft202012Validator(GEOJSON).validate(whole)
    events = {
        feature["properties"]["code"]: feature for feature in whole["features"] if "code" in feature["properties"]
    }
    assert {"filter-started", "link-lost", "odd"} <= set(events)
    assert events["odd"]["properties"]["text"] == HORROR
    assert all(round(value, 8) == value for place in line_places(whole) for value in place)


def test_kml_is_valid_and_plays_in_time(out: Path) -> None:
    assert validate(file_to_validate=out / "trip.kml")
    text = (out / "trip.kml").read_text(encoding="utf-8")
    assert "http" not in text.split("<Document>")[1]
    (folder,) = (feature for feature in kml_features(out / "trip.kml") if isinstance(feature, fastkml.Folder))
    assert {"odd", "link-lost"} <= {feature.name for feature in folder.features}
    odd = next(feature for feature in folder.features if feature.name == "odd")
    assert odd.style_url is not None
    assert odd.style_url.url == "#warning"


def test_gpx_has_the_order_of_its_schema(out: Path) -> None:
    gpx = gpx_of(out / "trip.gpx")
    assert {"odd", "link-lost"} <= {point.name for point in gpx.waypoints}
    from xml.etree import ElementTree as ET

    root = ET.parse(out / "trip.gpx").getroot()
    tags = [child.tag.split("}")[1] for child in root]
    assert tags == sorted(tags, key=("metadata", "wpt", "rte", "trk").index)
    assert root.get("version") == "1.1"
    inside = [child.tag.split("}")[1] for child in root.iterfind("{*}wpt[1]/*")]
    assert inside == ["time", "name", "desc", "src", "type"]


def test_every_mcap_message_fits_its_schema(out: Path, recorded: list[dict[str, Any]]) -> None:
    topics = set()
    with (out / "trip.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            topics.add(channel.topic)
            Draft202012Validator(json.loads(schema.data)).validate(json.loads(message.data))
            assert channel.message_encoding == "json"
    valid = [item for item in recorded if "position" in item["aligned_parts"]]
    drawn = mcap_messages(out / "trip.mcap", "/position/fuzzy")
    assert [(m["latitude"], m["longitude"]) for m in drawn] == [(item["lat_deg"], item["lon_deg"]) for item in valid]
    assert topics == {"/position/fuzzy", "/fixes/gps1", "/events", "/estimates/fuzzy"}
    assert mcap_messages(out / "trip.mcap", "/estimates/fuzzy") == recorded
    fixes = mcap_messages(out / "trip.mcap", "/fixes/gps1")
    assert len(fixes) == 41
    assert {(fix["position_covariance_type"], fix["position_covariance"][0]) for fix in fixes} == {(2, 6.5**2)}
    covariance, size = valid[9]["covariance"], len(valid[9]["state"])
    assert drawn[9]["position_covariance"][:5:4] == [covariance[0], covariance[size]]


def test_a_directory_takes_all_that_was_measured(trip: Path, tmp_path: Path) -> None:
    frames = [decode_frame(data) for data in read_log(trip).frames()]
    for kind in ("csv", "parquet"):
        assert export(trip, "--to", kind, f"{tmp_path}/{kind}/") == 0
    names = {"estimates", "events", "fixes", "headings", "imu"}
    assert {path.stem for path in (tmp_path / "csv").iterdir()} == names
    for name in names:
        texts, table = (
            rows_of(tmp_path / "csv" / f"{name}.csv"),
            pl.read_parquet(tmp_path / "parquet" / f"{name}.parquet"),
        )
        assert list(texts[0]) == table.columns
        assert len(texts) == table.height
        assert [int(row["t_ns"]) for row in texts] == table["t_ns"].to_list()
    samples = [value for frame in frames for block in frame.imu for value in block.yaw_rate_deg_s]
    assert [float(row["yaw_rate_deg_s"]) for row in rows_of(tmp_path / "csv" / "imu.csv")] == samples
    fixes = [fix for frame in frames for fix in frame.fixes]
    found = pl.read_parquet(tmp_path / "parquet" / "fixes.parquet")
    assert found["lat_deg"].to_list() == [fix.lat_deg for fix in fixes]
    assert found["usable"].to_list() == [fix.usable for fix in fixes]
    headings = [item.heading_mag_deg for frame in frames for item in frame.headings]
    assert pl.read_parquet(tmp_path / "parquet" / "headings.parquet")["heading_mag_deg"].to_list() == headings
    (odd,) = (row for row in rows_of(tmp_path / "csv" / "events.csv") if row["code"] == "odd")
    assert (odd["text"], odd["level"], odd["source"]) == (HORROR, "warning", "gps1")


def test_an_event_stands_where_the_boat_was(
    out: Path, trip: Path, tmp_path: Path, recorded: list[dict[str, Any]]
) -> None:
    """`link-lost` was written at the end of the log, with the time of its middle."""
    by_time = {item["t_ns"]: (item["lat_deg"], item["lon_deg"]) for item in recorded}
    export(trip, "--to", "csv", f"{tmp_path}/all/")
    events = {row["code"]: row for row in rows_of(tmp_path / "all" / "events.csv")}
    for code in ("link-lost", "odd"):
        row = events[code]
        assert (float(row["lat_deg"]), float(row["lon_deg"])) == by_time[int(row["t_ns"])]


def test_another_filter_and_fewer_rows(trip: Path, tmp_path: Path) -> None:
    expected = list(read_log(trip).estimates("ukf"))
    assert export(trip, "--to", "csv", tmp_path / "ukf.csv", "--filter", "ukf", "--every", "1") == 0
    rows = rows_of(tmp_path / "ukf.csv")
    assert 38 <= len(rows) <= 41
    assert {int(row["t_ns"]): float(row["lat_deg"]) for row in rows}.items() <= {
        (item["t_ns"], item["lat_deg"]) for item in expected
    }
    seconds = [int(row["t_ns"]) // NS for row in rows]
    assert len(set(seconds)) == len(seconds)


def test_raw_is_the_first_receiver(trip: Path, tmp_path: Path) -> None:
    fixes = [fix for data in read_log(trip).frames() for fix in decode_frame(data).fixes]
    assert export(trip, "--to", "csv", tmp_path / "raw.csv", "--filter", "raw") == 0
    rows = rows_of(tmp_path / "raw.csv")
    assert [(int(row["t_ns"]), float(row["lat_deg"])) for row in rows] == [(fix.t_ns, fix.lat_deg) for fix in fixes]
    assert {row["heading_true_deg"] for row in rows} == {""}
    for kind in KINDS:
        assert export(trip, "--to", kind, tmp_path / f"raw.{kind}", "--filter", "raw", "--force") == 0


def test_order_of_time_filters_again_and_says_so(
    trip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without late frames the filter finds the live estimates again."""
    assert export(trip, "--to", "csv", tmp_path / "time.csv", "--order", "time") == 0
    assert "filtered again in order of boat time: the best track" in capsys.readouterr().out
    assert export(trip, "--to", "csv", tmp_path / "live.csv") == 0
    assert "as published live" in capsys.readouterr().out
    again, live = rows_of(tmp_path / "time.csv"), rows_of(tmp_path / "live.csv")
    assert [row["t_ns"] for row in again] == [row["t_ns"] for row in live]
    for one, two in zip(again, live, strict=True):
        assert float(one["lat_deg"]) == pytest.approx(float(two["lat_deg"]), abs=1e-9)
    assert export(trip, "--to", "csv", tmp_path / "ekf.csv", "--order", "time", "--filter", "ekf") == 0
    for kind in ("mcap", "png"):
        assert export(trip, "--to", kind, tmp_path / f"time.{kind}", "--order", "time") == 0
    assert len(mcap_messages(tmp_path / "time.mcap", "/estimates/fuzzy")) == len(live)
    assert export(trip, "--to", "mcap", tmp_path / "live.mcap") == 0
    events = [mcap_messages(tmp_path / f"{name}.mcap", "/events") for name in ("time", "live")]
    assert events[0] == events[1]


def test_late_frames_are_told_and_used_in_order_of_time(
    trip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reader = read_log(trip)
    frames = [decode_frame(data) for data in reader.frames()]
    config = next(reader.session())["connected"]
    late = tmp_path / "late.mcap"
    writer = log_at(late)
    writer.write_session(start_record(config, {"filters": ["ukf"]}, UTC_NS), UTC_NS)
    frames[20], frames[40] = frames[40], frames[20]  # two seconds are not late
    for frame in (*frames[:150], *frames[250:], *frames[150:250]):
        writer.write_frame(encode_frame(frame), frame, UTC_NS + frame.t1_ns)
    writer.close()
    assert export(late, "--to", "csv", tmp_path / "raw.csv") == 0
    said = capsys.readouterr()
    assert "holds no estimates, so these are the GPS fixes as they came" in said.err
    assert "100 frames came more than 5 s late; --order time puts them in their place" in said.out
    assert export(late, "--to", "csv", tmp_path / "all.csv", "--filter", "raw", "--order", "time") == 0
    assert len(rows_of(tmp_path / "all.csv")) == 41
    assert len(rows_of(tmp_path / "raw.csv")) == 31
    assert export(late, "--to", "csv", tmp_path / "track.csv", "--order", "time", "--filter", "ukf") == 0
    times = [int(row["t_ns"]) for row in rows_of(tmp_path / "track.csv")]
    assert times == sorted(times)
    assert len(times) > 380


def test_json_says_what_was_written(trip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert export(trip, "--to", "gpx", tmp_path / "a.gpx", "--json") == 0
    summary = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert summary["files"] == {"a.gpx": (tmp_path / "a.gpx").stat().st_size}
    assert (summary["filter"], summary["order"], summary["has_utc"], summary["late"]) == ("fuzzy", "recorded", True, 0)
    assert summary["rows"] == len(list(read_log(trip).estimates("fuzzy")))


def test_a_log_that_was_cut_is_exported_and_said(
    trip: Path, tmp_path: Path, recorded: list[dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    whole = trip.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    assert export(cut, "--to", "csv", tmp_path / "cut.csv", "--json") == 0
    said = capsys.readouterr()
    assert "all that is sound was exported" in said.err
    assert json.loads(said.out.splitlines()[-1])["damage"]
    rows = rows_of(tmp_path / "cut.csv")
    assert 100 < len(rows) < 300
    assert [int(row["t_ns"]) for row in rows] == [item["t_ns"] for item in recorded][: len(rows)]
