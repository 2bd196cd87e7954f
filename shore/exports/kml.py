"""KML 2.2: with UTC a gx:Track for each piece, so that Google Earth's time slider plays the trip; without, plain lines.

Events are placemarks in colours of their level. No picture comes from the internet.
"""

from contextlib import ExitStack
from typing import BinaryIO, Final
from xml.etree import ElementTree as ET

from shore.exports.antimeridian import Place, crossing
from shore.exports.text import Aside, aside, iso, xml_text
from shore.exports.track import ExportTrack, Mark, Row

SPACE: Final = "http://www.opengis.net/kml/2.2"
_HEAD: Final = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    "<!-- of wayfix export -->\n"
    f'<kml xmlns="{SPACE}" xmlns:gx="http://www.google.com/kml/ext/2.2">\n<Document>\n'
)
COLOURS: Final = {"debug": "ff999999", "info": "ffe08a2a", "warning": "ff1f9fff", "error": "ff2828d6"}
"""Colour of each event level, eight hex digits: alpha, blue, green, red."""
_TRACK_STYLE: Final = (
    '<Style id="track"><IconStyle><scale>0.7</scale></IconStyle><LabelStyle><scale>0</scale></LabelStyle>'
    "<LineStyle><color>ff3928d6</color><width>3</width></LineStyle></Style>\n"
)


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """Write the track as KML. Raises OSError."""
    has_time = track.survey.clocks.know_utc
    with ExitStack() as stack:
        events, behind = stack.enter_context(aside()), stack.enter_context(aside())
        stream.write(_HEAD.encode())
        _put(stream, _text("name", track.title))
        if track.survey.trip.get("note"):
            _put(stream, _text("description", track.survey.trip["note"]))
        stream.write(_styles().encode())
        stream.write(b"<Placemark>\n")
        _put(stream, _text("name", f"{track.title} ({track.filter})"))
        stream.write(b"<styleUrl>#track</styleUrl>\n")
        piece = _Timed(stream, behind) if has_time else _Lines(stream)
        for item in track.items():
            if isinstance(item, Row):
                piece.add(item)
            elif item.place is not None and item.level != "debug":
                events.write(ET.tostring(_placemark(item), "unicode") + "\n")
        piece.finish()
        stream.write(b"</Placemark>\n<Folder>\n<name>Events</name>\n")
        events.pour(stream)
        stream.write(b"</Folder>\n</Document>\n</kml>\n")


class _Timed:
    """A gx:MultiTrack: in each track all times stand before all places."""

    def __init__(self, stream: BinaryIO, places: Aside) -> None:
        self._stream = stream
        self._places = places
        self._is_open = False
        stream.write(b"<gx:MultiTrack>\n<gx:interpolate>0</gx:interpolate>\n")

    def add(self, row: Row) -> None:
        assert row.utc_ns is not None
        if row.is_first:
            self._end()
            self._stream.write(b"<gx:Track>\n")
            self._is_open = True
        self._stream.write(f"<when>{iso(row.utc_ns)}</when>\n".encode())
        self._places.write(f"<gx:coord>{row.lon_deg:.9f} {row.lat_deg:.9f} 0</gx:coord>\n")

    def finish(self) -> None:
        self._end()
        self._stream.write(b"</gx:MultiTrack>\n")

    def _end(self) -> None:
        if self._is_open:
            self._places.pour(self._stream)
            self._stream.write(b"</gx:Track>\n")


class _Lines:
    """A MultiGeometry of LineStrings, cut at the 180th meridian."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._last: Place | None = None
        self._is_alone = False
        stream.write(b"<MultiGeometry>\n")

    def add(self, row: Row) -> None:
        place = row.lat_deg, row.lon_deg
        if self._last is None or row.is_first:
            self._begin()
        elif ends := crossing(self._last, place):
            self._point(ends[0])
            self._begin()
            self._point(ends[1])
        self._point(place)

    def finish(self) -> None:
        self._end()
        self._stream.write(b"</MultiGeometry>\n")

    def _begin(self) -> None:
        self._end()
        self._stream.write(b"<LineString><tessellate>1</tessellate><coordinates>\n")
        self._last = None

    def _end(self) -> None:
        if self._last is not None:
            if self._is_alone:  # one place is no line
                self._point(self._last)
            self._stream.write(b"</coordinates></LineString>\n")

    def _point(self, place: Place) -> None:
        self._stream.write(f"{place[1]:.9f},{place[0]:.9f}\n".encode())
        self._is_alone = self._last is None
        self._last = place


def _styles() -> str:
    pins = (
        f'<Style id="{level}"><IconStyle><color>{colour}</color><scale>0.8</scale></IconStyle>'
        f"<LabelStyle><color>{colour}</color><scale>0.8</scale></LabelStyle></Style>\n"
        for level, colour in COLOURS.items()
    )
    return _TRACK_STYLE + "".join(pins)


def _placemark(mark: Mark) -> ET.Element:
    assert mark.place is not None
    placemark = ET.Element("Placemark")
    placemark.append(_text("name", mark.code))
    placemark.append(_text("description", f"{mark.level}, {mark.source}: {mark.text}"))
    if mark.utc_ns is not None:
        ET.SubElement(placemark, "TimeStamp").append(_text("when", iso(mark.utc_ns)))
    placemark.append(_text("styleUrl", f"#{mark.level}"))
    lat_deg, lon_deg = mark.place
    ET.SubElement(placemark, "Point").append(_text("coordinates", f"{lon_deg:.9f},{lat_deg:.9f}"))
    return placemark


def _text(tag: str, text: str) -> ET.Element:
    element = ET.Element(tag)
    element.text = xml_text(text)
    return element


def _put(stream: BinaryIO, element: ET.Element) -> None:
    stream.write(ET.tostring(element, "utf-8", xml_declaration=False) + b"\n")
