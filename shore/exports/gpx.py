"""GPX 1.1: one track, a segment for each piece, the events as waypoints; points without time where UTC is not known.

A segment rests on fixes or on dead reckoning, never on both: the points of the latter say `<fix>none</fix>`. Points
that are not valid yet say so in `<cmt>`; where the doubt is beyond 500 m there is no point.
"""

from typing import BinaryIO, Final
from xml.etree import ElementTree as ET

from shore.exports.text import Aside, aside, iso, xml_text
from shore.exports.track import ExportTrack, Mark, Row

SPACE: Final = "http://www.topografix.com/GPX/1/1"
_SCHEMA: Final = "http://www.topografix.com/GPX/1/1/gpx.xsd"
_HEAD: Final = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    f'<gpx version="1.1" creator="wayfix" xmlns="{SPACE}" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
    f'xsi:schemaLocation="{SPACE} {_SCHEMA}">\n'
)
_STRETCHES: Final = {"fix": "", "coasting": "<fix>none</fix>", "not aligned": "<cmt>not aligned</cmt>"}
"""What a point says of its stretch."""


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """The schema wants the waypoints first, though they are known last. Raises OSError."""
    with aside() as points:
        marks = _write_points(points, track)
        stream.write(_HEAD.encode())
        metadata = ET.Element("metadata")
        _child(metadata, "name", track.title)
        if track.survey.trip.get("note"):
            _child(metadata, "desc", track.survey.trip["note"])
        _put(stream, metadata)
        for mark in marks:
            _put(stream, _waypoint(mark))
        name, source = ET.Element("name"), ET.Element("src")
        name.text, source.text = xml_text(track.title), xml_text(f"{track.filter}, {track.order}")
        stream.write(b"<trk>\n")
        _put(stream, name)
        _put(stream, source)
        points.pour(stream)
        stream.write(b"</trk>\n</gpx>\n")


def _write_points(points: Aside, track: ExportTrack) -> list[Mark]:
    """The segments; what is to be a waypoint is given back."""
    marks, is_open = [], False
    for item in track.drawn():
        if isinstance(item, Mark):
            if item.place is not None and item.level != "debug":
                marks.append(item)
            continue
        if item.is_first:
            points.write("</trkseg>\n<trkseg>\n" if is_open else "<trkseg>\n")
            is_open = True
        points.write(_point(item))
    if is_open:
        points.write("</trkseg>\n")
    return marks


def _point(row: Row) -> str:
    place = f'<trkpt lat="{row.lat_deg:.9f}" lon="{row.lon_deg:.9f}"'
    time = "" if row.utc_ns is None else f"<time>{iso(row.utc_ns)}</time>"
    told = f"{time}{_STRETCHES[row.stretch]}"
    return f"{place}>{told}</trkpt>\n" if told else f"{place}/>\n"


def _waypoint(mark: Mark) -> ET.Element:
    assert mark.place is not None
    point = ET.Element("wpt", lat=f"{mark.place[0]:.9f}", lon=f"{mark.place[1]:.9f}")
    if mark.utc_ns is not None:
        _child(point, "time", iso(mark.utc_ns))
    _child(point, "name", mark.code)
    _child(point, "desc", mark.text)
    _child(point, "src", mark.source)
    _child(point, "type", mark.level)
    return point


def _child(parent: ET.Element, tag: str, text: str) -> None:
    ET.SubElement(parent, tag).text = xml_text(text)


def _put(stream: BinaryIO, element: ET.Element) -> None:
    stream.write(ET.tostring(element, "utf-8", xml_declaration=False) + b"\n")
