"""What the tests of `wayfix export` share: logs made by hand, and readers of what was written."""

import csv
import json
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import fastkml
import gpxpy
import pynmea2
from mcap.reader import make_reader

from common.codec import encode_frame
from common.messages import Event, Frame
from shore.exports import arguments, formats
from shore.exports.command import run
from shore.logbook.log_writer import log_at
from shore.logbook.session import start_record
from shore.navigation.estimate import Estimate

UTC_NS = 1_795_000_000_000_000_000
NS = 10**9
KINDS = tuple(formats.FORMATS)
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


def estimated(t_s: float, lat_deg: float, lon_deg: float, **more: Any) -> Estimate:
    """A whole estimate of a filter with five states, at that place."""
    made = Estimate(
        t_ns=round(t_s * NS), boot_id="b1", seq=round(t_s * 10), filter="ukf", names=("east_m", "north_m"),
        state=(0.0, 0.0), covariance=(4.0, 0.5, 9.0), origin_lat_deg=0.0, origin_lon_deg=0.0, lat_deg=lat_deg,
        lon_deg=lon_deg, heading_true_deg=12.5, sog_kn=3.0, cog_true_deg=None, sigma_east_m=2.0, sigma_north_m=3.0,
        sigma_heading_deg=1.0, aligned=True, aligned_parts=("position", "heading"), waiting=(), position_from="fix",
        position_since_ns=0, heading_from="compass", repairs=0, channels={},
    )  # fmt: skip
    return replace(made, **more)


def estimate(t_s: float, lat_deg: float, lon_deg: float, **more: Any) -> dict[str, Any]:
    """Its record."""
    return estimated(t_s, lat_deg, lon_deg, **more).as_record()


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
    writer = log_at(path)
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
    """Of all stretches in order of time."""
    tracks: Any = [feature for feature in kml_features(path) if isinstance(feature, fastkml.Placemark)]
    pieces = [piece for track in tracks for piece in track.kml_geometry.tracks]
    items = sorted((item for piece in pieces for item in piece.track_items), key=lambda item: item.when.dt)
    return [(item.coord.y, item.coord.x) for item in items]


def kml_features(path: Path) -> list[Any]:
    document: Any = fastkml.KML.parse(path).features[0]
    return list(document.features)


def gpx_of(path: Path) -> Any:
    with path.open(encoding="utf-8") as file:
        return gpxpy.parse(file)


def sentences(path: Path) -> Iterator[Any]:
    for line in path.read_bytes().decode("ascii").split("\r\n")[:-1]:
        if line[3:6] != "THS":  # which pynmea2 does not know
            yield pynmea2.parse(line, check=True)


def mcap_messages(path: Path, topic: str) -> list[dict[str, Any]]:
    with path.open("rb") as stream:
        return [json.loads(item.data) for _, _, item in make_reader(stream, validate_crcs=True).iter_messages([topic])]


def line_places(geojson: dict[str, Any]) -> list[tuple[float, float]]:
    return [(lat, lon) for line in lines_of(geojson) for lon, lat in line]


def lines_of(geojson: dict[str, Any]) -> list[list[list[float]]]:
    """Coordinates of the pieces of track; each has as many times."""
    lines = [each for each in geojson["features"] if each["geometry"] and each["geometry"]["type"] == "LineString"]
    for each in lines:
        times = each["properties"].get("coordTimes") or each["properties"]["times_s"]
        assert len(times) == len(each["geometry"]["coordinates"])
    return [each["geometry"]["coordinates"] for each in lines]
