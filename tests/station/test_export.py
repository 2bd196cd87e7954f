"""`wayfix export`: what programs of others read out of it is what the log says, the same in all formats."""

import csv
import json
import sys
import warnings
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import fastkml
import gpxpy
import polars as pl
import pynmea2
import pytest
from fastkml.validator import validate
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from common.codec import decode_frame, encode_frame
from common.errors import WayfixError
from common.events import event
from common.messages import Event, Frame
from common.settings import as_dict
from common.simulation.scenarios import scenario_voyage
from shore.logbook.exports import arguments, formats
from shore.logbook.exports.command import run
from shore.logbook.read import read_log
from shore.logbook.record import LogWriter
from shore.logbook.session import start_record
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline
from tests import offline

UTC_NS = 1_795_000_000_000_000_000
NS = 10**9
KINDS = arguments.FORMATS
HORROR = 'a <"sea"> & \x00\x1b trial'
"""A text that no XML can hold as it is."""

POSITION = {"type": "array", "minItems": 2, "maxItems": 3, "items": {"type": "number"}}
LINE = {"type": "array", "minItems": 2, "items": POSITION}
SHAPES = {"Point": POSITION, "LineString": LINE, "MultiLineString": {"type": "array", "items": LINE}}
GEOJSON: dict[str, Any] = {
    "type": "object",
    "required": ["type", "features"],
    "not": {"required": ["crs"]},
    "properties": {
        "type": {"const": "FeatureCollection"},
        "features": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["type", "geometry", "properties"],
                "properties": {
                    "type": {"const": "Feature"},
                    "properties": {"type": ["object", "null"]},
                    "geometry": {
                        "oneOf": [
                            {"type": "null"},
                            *(
                                {
                                    "required": ["type", "coordinates"],
                                    "additionalProperties": False,
                                    "properties": {"type": {"const": name}, "coordinates": shape},
                                }
                                for name, shape in SHAPES.items()
                            ),
                        ]
                    },
                },
            },
        },
    },
}
"""The essence of RFC 7946."""


def export(*words: object) -> int:
    parser = ArgumentParser()
    arguments.add_arguments(parser)
    return run(parser.parse_args([str(word) for word in words]))


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Forty seconds with two filters, UTC, a warning and an unprintable event."""
    path = tmp_path_factory.mktemp("log") / "trip.mcap"
    voyage = scenario_voyage("5.3", seed=1, seconds=40.0)
    config = offline.config_of(voyage)
    frames = [
        replace(frame, utc_ns=UTC_NS + frame.t0_ns, utc_unc_ns=10**8, utc_src="gnss")
        for frame in offline.frames_of(voyage)
    ]
    odd = Event(t_ns=frames[200].t1_ns, source="gps1", code="odd", level="warning", text=HORROR)
    frames[200] = replace(frames[200], events=(odd,))
    pipeline = Pipeline(config, ["fuzzy", "ukf"])
    writer = LogWriter.at(path)
    options = {"filters": ["fuzzy", "ukf"], "step_s": None}
    writer.write_session(start_record({"config": as_dict(config)}, options, UTC_NS), UTC_NS)
    writer.write_session({"kind": "trip", "name": HORROR, "note": HORROR}, UTC_NS)
    for data, frame, output in offline.pushed(pipeline, frames):
        now_ns = UTC_NS + frame.t1_ns + 30_000_000
        writer.write_frame(data, frame, now_ns)
        if frame.seq % 10 == 0:
            writer.sync()
        for estimate in output.estimates:
            writer.write_estimate(estimate.as_record(), now_ns)
        for happening in (*frame.events, *output.events):
            writer.write_event(happening, now_ns)
    writer.write_event(event("link-lost", frames[100].t1_ns, "link", age_s=3.5), now_ns)
    writer.close()
    return path


@pytest.fixture(scope="module")
def recorded(trip: Path) -> list[dict[str, Any]]:
    return list(read_log(trip).estimates("fuzzy"))


@pytest.fixture(scope="module")
def out(trip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every format of that trip, in `trip.<format>`."""
    directory = tmp_path_factory.mktemp("out")
    for kind in KINDS:
        assert export(trip, "--to", kind, directory / f"trip.{kind}") == 0
    return directory


def estimate(t_s: float, lat_deg: float, lon_deg: float, **more: Any) -> dict[str, Any]:
    """A whole estimate of a filter with five states, at that place."""
    made = Estimate(
        t_ns=round(t_s * NS), boot_id="b1", seq=round(t_s * 10), filter="ukf", names=("east_m", "north_m"),
        state=(0.0, 0.0), covariance=(4.0, 0.5, 9.0), origin_lat_deg=0.0, origin_lon_deg=0.0, lat_deg=lat_deg,
        lon_deg=lon_deg, heading_true_deg=12.5, sog_kn=3.0, cog_true_deg=None, sigma_east_m=2.0, sigma_north_m=3.0,
        sigma_heading_deg=1.0, aligned=True, waiting=(), repairs=0, channels={},
    )  # fmt: skip
    return replace(made, **more).as_record()


BOOTS: dict[str, dict[str, Any]] = {"b1": {}, "b2": {"boot_id": "b2", "clock_id": "c2", "start_no": 2}}


def empty_frame(t_s: float, **more: Any) -> Frame:
    t1_ns = round(t_s * NS)
    return replace(
        Frame(
            boat_id="x", boot_id="b1", seq=round(t_s * 10), clock_id="c1", start_no=1, t0_ns=t1_ns - NS // 10,
            t1_ns=t1_ns, utc_ns=UTC_NS + t1_ns - NS // 10, utc_src="gnss",
        ),
        **more,
    )  # fmt: skip


def log_of(path: Path, items: Sequence[dict[str, Any] | Frame | Event], made: dict[str, Any] | None = None) -> Path:
    """A log of these, in this order; an estimate brings an empty frame. made: of which recording, which has no UTC."""
    writer = LogWriter.at(path)
    begin_ns = UTC_NS if made is None else 0
    connected: dict[str, Any] = {"config": {"boat": {"id": "x"}}} | ({"file": made} if made else {})
    writer.write_session(start_record(connected, {"filters": ["ukf"]}, begin_ns), begin_ns)
    now_ns = begin_ns
    for item in items:
        if isinstance(item, Event):
            writer.write_event(item, now_ns)
            continue
        now_ns += NS // 10
        frame = item if isinstance(item, Frame) else empty_frame(item["t_ns"] / NS, **BOOTS[item["boot_id"]])
        if made is not None:
            frame = replace(frame, utc_ns=None, utc_src="none")
        writer.write_frame(encode_frame(frame), frame, now_ns)
        if not isinstance(item, Frame):
            writer.write_estimate(item, now_ns)
    writer.close()
    return path


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def kml_places(path: Path) -> list[tuple[float, float]]:
    (track,) = (feature for feature in kml_features(path) if isinstance(feature, fastkml.Placemark))
    pieces: Any = getattr(track.kml_geometry, "tracks", ())
    return [(item.coord.y, item.coord.x) for piece in pieces for item in piece.track_items]


def kml_features(path: Path) -> list[Any]:
    document: Any = fastkml.KML.parse(path).features[0]
    return list(document.features)


def gpx_of(path: Path) -> Any:
    with path.open(encoding="utf-8") as file:
        return gpxpy.parse(file)


def sentences(path: Path) -> Iterator[Any]:
    for line in path.read_bytes().decode("ascii").split("\r\n")[:-1]:
        yield pynmea2.parse(line, check=True)


def mcap_messages(path: Path, topic: str) -> list[dict[str, Any]]:
    with path.open("rb") as stream:
        return [json.loads(item.data) for _, _, item in make_reader(stream, validate_crcs=True).iter_messages([topic])]


def line_places(geojson: dict[str, Any]) -> list[tuple[float, float]]:
    geometry = geojson["features"][0]["geometry"]
    lines = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
    return [(lat, lon) for line in lines for lon, lat in line]


def test_the_formats_of_the_arguments_are_those_there_are() -> None:
    assert tuple(formats.FORMATS) == arguments.FORMATS


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
            "mcap": [(m["latitude"], m["longitude"]) for m in mcap_messages(out / "trip.mcap", "/position/fuzzy")],
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
    (segment,) = track.segments
    found = [round(point.time.timestamp() * 1e6) for point in segment.points]
    assert found == expected_us
    rmc = [s for s in sentences(out / "trip.nmea") if s.sentence_type == "RMC"]
    assert [round(s.datetime.timestamp() * 1e3) for s in rmc] == [us // 1000 for us in expected_us]
    first = rows_of(out / "trip.csv")[0]
    assert first["utc"] == table["utc"].dt.to_string("%Y-%m-%dT%H:%M:%S%.6fZ")[0]
    stamps = [m["timestamp"] for m in mcap_messages(out / "trip.mcap", "/position/fuzzy")]
    assert [item["sec"] * NS + item["nsec"] for item in stamps] == [UTC_NS + item["t_ns"] for item in recorded]


def test_the_csv_says_its_units_and_every_digit(out: Path, recorded: list[dict[str, Any]]) -> None:
    names = ",".join(recorded[0]["names"])
    head = (out / "trip.csv").read_text(encoding="utf-8").splitlines()[0]
    assert head == (
        "t_s,utc,t_ns,lat_deg,lon_deg,heading_true_deg,sog_kn,cog_true_deg,sigma_east_m,sigma_north_m,"
        f"sigma_heading_deg,aligned,waiting,{names}"
    )
    for row, item in zip(rows_of(out / "trip.csv"), recorded, strict=True):
        for name in ("heading_true_deg", "sog_kn", "sigma_east_m", "sigma_north_m", "sigma_heading_deg"):
            assert float(row[name]) == item[name]
        assert [float(row[name]) for name in item["names"]] == item["state"]
        assert row["cog_true_deg"] == ("" if item["cog_true_deg"] is None else repr(item["cog_true_deg"]))
        assert row["aligned"] == json.dumps(item["aligned"])


def test_the_csv_is_a_reference_for_replay(out: Path, recorded: list[dict[str, Any]]) -> None:
    from shore.score import read_reference

    reference = read_reference(out / "trip.csv", 0)
    assert reference.at(recorded[50]["t_ns"]) is not None


def test_geojson_is_valid(out: Path) -> None:
    whole = json.loads((out / "trip.geojson").read_text(encoding="utf-8"))
    Draft202012Validator(GEOJSON).validate(whole)
    events = {feature["properties"]["code"]: feature for feature in whole["features"][1:]}
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
    inside = [child.tag.split("}")[1] for child in root.find("{*}wpt") or ()]
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
    assert topics == {"/position/fuzzy", "/fixes/gps1", "/events", "/estimates/fuzzy"}
    assert mcap_messages(out / "trip.mcap", "/estimates/fuzzy") == recorded
    fixes, place = (
        mcap_messages(out / "trip.mcap", "/fixes/gps1"),
        mcap_messages(out / "trip.mcap", "/position/fuzzy")[9],
    )
    assert len(fixes) == 41
    assert {(fix["position_covariance_type"], fix["position_covariance"][0]) for fix in fixes} == {(2, 6.5**2)}
    size = len(recorded[9]["state"])
    assert place["position_covariance"][:5:4] == [recorded[9]["covariance"][0], recorded[9]["covariance"][size]]


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
    writer = LogWriter.at(late)
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


def test_an_empty_log_gives_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = log_of(tmp_path / "empty.mcap", [])
    (tmp_path / "out").mkdir()
    for kind in KINDS:
        assert export(log, "--to", kind, tmp_path / "out" / f"x.{kind}", "--json") == 1
        said = capsys.readouterr()
        assert "holds no usable fix; nothing was written" in said.err
        assert json.loads(said.out.splitlines()[-1])["rows"] == 0
    assert list((tmp_path / "out").iterdir()) == []


def test_frames_without_a_fix_give_no_file(tmp_path: Path) -> None:
    log = log_of(tmp_path / "x.mcap", [empty_frame(1.0), empty_frame(1.1)])
    assert export(log, "--to", "csv", tmp_path / "x.csv") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]


def test_what_is_read_is_never_lost(trip: Path, tmp_path: Path) -> None:
    log = tmp_path / "trip.mcap"
    log.write_bytes(trip.read_bytes())
    (tmp_path / "link.mcap").symlink_to(log)
    before = log.read_bytes()
    for target in (log, tmp_path / "link.mcap"):
        with pytest.raises(WayfixError, match="it would be lost"):
            export(log, "--to", "mcap", target, "--force")
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(before)
    with pytest.raises(WayfixError, match=r"is no mcap file of `wayfix export`"):
        export(log, "--to", "mcap", copy, "--force")
    assert log.read_bytes() == copy.read_bytes() == before


@pytest.mark.parametrize(
    ("kind", "ours", "theirs"),
    [
        ("gpx", b'creator="wayfix"', b'creator="Garmin"'),
        ("kml", b"<!-- of wayfix export -->", b""),
        ("geojson", b'"generator": "wayfix", ', b""),
        ("png", b"wayfix", b"others"),
    ],
)
def test_force_leaves_foreign_files_of_the_kind_alone(
    kind: str, ours: bytes, theirs: bytes, trip: Path, tmp_path: Path
) -> None:
    target = tmp_path / f"other.{kind}"
    assert export(trip, "--to", kind, target) == 0
    foreign = target.read_bytes().replace(ours, theirs, 1)
    target.write_bytes(foreign)
    with pytest.raises(WayfixError, match=r"is no .* file of `wayfix export`"):
        export(trip, "--to", kind, target, "--force")
    assert target.read_bytes() == foreign


@pytest.mark.parametrize("kind", KINDS)
def test_only_force_replaces_and_only_its_own_kind(kind: str, trip: Path, out: Path, tmp_path: Path) -> None:
    target = tmp_path / f"a.{kind}"
    target.write_bytes((out / f"trip.{kind}").read_bytes()[:1000])
    with pytest.raises(WayfixError, match=r"exists already; .*--force"):
        export(trip, "--to", kind, target)
    assert export(trip, "--to", kind, target, "--force") == 0
    assert target.stat().st_size > 1000
    target.write_bytes(b"my diary")
    with pytest.raises(WayfixError, match=f"exists already and is no {kind} file"):
        export(trip, "--to", kind, target, "--force")
    assert target.read_bytes() == b"my diary"


@pytest.mark.parametrize("kind", KINDS)
def test_a_full_disk_is_one_sentence_and_no_half_file(
    kind: str, trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every write of every format fails at some byte; what was there before stays."""

    class Full:
        def __init__(self, stream: Any) -> None:
            self._stream = stream
            self._left = 2000

        def write(self, data: bytes) -> int:
            self._left -= len(data)
            if self._left < 0:
                raise OSError(28, "No space left on device")
            return int(self._stream.write(data))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._stream, name)

    opened = Path.open

    def full(path: Path, mode: str = "r", *args: Any, **named: Any) -> Any:
        stream = opened(path, mode, *args, **named)
        return _Context(stream, Full(stream)) if mode == "xb" else stream

    class _Context:
        def __init__(self, stream: Any, shown: Any) -> None:
            self._stream, self._shown = stream, shown

        def __enter__(self) -> Any:
            return self._shown

        def __exit__(self, *_: object) -> None:
            self._stream.close()

    monkeypatch.setattr(Path, "open", full)
    with pytest.raises(WayfixError, match=r"cannot be written \(No space left"):
        export(trip, "--to", kind, tmp_path / f"a.{kind}")
    assert list(tmp_path.iterdir()) == []


def test_targets_that_cannot_be(trip: Path, tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="no such directory"):
        export(trip, "--to", "gpx", tmp_path / "no" / "a.gpx")
    with pytest.raises(WayfixError, match="no plain file"):
        export(trip, "--to", "gpx", tmp_path)
    with pytest.raises(WayfixError, match="no such directory above it"):
        export(trip, "--to", "csv", f"{tmp_path}/no/such/")
    with pytest.raises(WayfixError, match="no plain file"):
        export(trip, "--to", "csv", "/dev/full")


def test_unknown_filters(trip: Path, tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="unknown filter 'kalman'"):
        export(trip, "--to", "csv", tmp_path / "a.csv", "--filter", "kalman")
    with pytest.raises(WayfixError, match=r"no estimates of kf .*which has fuzzy, ukf; add --order time"):
        export(trip, "--to", "csv", tmp_path / "a.csv", "--filter", "kf")


@pytest.mark.parametrize(
    ("kind", "package", "extra"), [("parquet", "polars", "analysis"), ("png", "matplotlib", "report")]
)
def test_a_missing_package_is_named_before_the_work(
    kind: str, package: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(WayfixError, match=rf"{package} is missing.*pip install 'wayfix\[{extra}\]'"):
        export(tmp_path / "not read.mcap", "--to", kind, tmp_path / "a")


def test_the_others_need_no_extra(trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("polars", "matplotlib"):
        monkeypatch.setitem(sys.modules, package, None)
    for kind in set(KINDS) - {"parquet", "png"}:
        assert export(trip, "--to", kind, tmp_path / f"a.{kind}") == 0


def test_a_directory_is_all_or_nothing(trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    empty = log_of(tmp_path / "empty.mcap", [])
    assert export(empty, "--to", "csv", f"{tmp_path}/new/") == 1
    assert not (tmp_path / "new").exists()
    (tmp_path / "mine").mkdir()
    assert export(empty, "--to", "csv", tmp_path / "mine") == 1
    assert (tmp_path / "mine").is_dir()
    assert export(trip, "--to", "csv", tmp_path / "mine") == 0
    before = (tmp_path / "mine" / "imu.csv").read_bytes()
    with pytest.raises(WayfixError, match=r"estimates.csv: exists already"):
        export(trip, "--to", "csv", tmp_path / "mine")
    (tmp_path / "mine" / "imu.csv").write_text("my own notes")
    with pytest.raises(WayfixError, match=r"imu.csv: exists already and is no csv file"):
        export(trip, "--to", "csv", tmp_path / "mine", "--force")
    (tmp_path / "mine" / "imu.csv").unlink()
    monkeypatch.setattr("shore.logbook.exports.table._measured", _fail)
    with pytest.raises(WayfixError, match="cannot be written"):
        export(trip, "--to", "csv", tmp_path / "mine", "--force")
    assert not (tmp_path / "mine" / "imu.csv").exists()
    monkeypatch.undo()
    assert export(trip, "--to", "csv", tmp_path / "mine", "--force") == 0
    assert (tmp_path / "mine" / "imu.csv").read_bytes() == before
    assert {path.name[0] for path in (tmp_path / "mine").iterdir()} == set("efhi")


def _fail(*_: object) -> None:
    raise OSError(28, "No space left on device")
