"""KML 2.2: with UTC a gx:Track for each piece, so that Google Earth's time slider plays the trip; without, plain lines.

Stretches of dead reckoning are a placemark of their own, "coasting", in another colour, and so are those that were
not aligned yet; where the doubt is beyond 500 m there is no track. Events are placemarks in colours of their level. No
picture comes from the internet.
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
TRACK_COLOURS: Final = {"fix": "ff3928d6", "coasting": "ff23a2e9", "not aligned": "ff999999"}
"""Colour of each kind of stretch."""


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """Write the track as KML. Raises OSError."""
    has_time = track.survey.clocks.know_utc
    with ExitStack() as stack:
        events = stack.enter_context(aside())
        stretches = {kind: _Stretch(stack, has_time=has_time) for kind in TRACK_COLOURS}
        stream.write(_HEAD.encode())
        _put(stream, _text("name", track.title))
        if track.survey.trip.get("note"):
            _put(stream, _text("description", track.survey.trip["note"]))
        stream.write(_styles().encode())
        for item in track.drawn():
            if isinstance(item, Row):
                stretches[item.stretch].add(item)
            elif item.place is not None and item.level != "debug":
                events.write(ET.tostring(_placemark(item), "unicode") + "\n")
        for kind, stretch in stretches.items():
            what = track.filter if kind == "fix" else f"{track.filter}, {kind}"
            stretch.pour(stream, f"{track.title} ({what})", kind)
        stream.write(b"<Folder>\n<name>Events</name>\n")
        events.pour(stream)
        stream.write(b"</Folder>\n</Document>\n</kml>\n")


class _Stretch:
    """The pieces of track of one kind, which become a placemark."""

    def __init__(self, stack: ExitStack, *, has_time: bool) -> None:
        self._text = stack.enter_context(aside())
        self._piece = _Timed(self._text, stack.enter_context(aside())) if has_time else _Lines(self._text)
        self._is_empty = True

    def add(self, row: Row) -> None:
        self._is_empty = False
        self._piece.add(row)

    def pour(self, stream: BinaryIO, name: str, style: str) -> None:
        """Write the placemark, if there is any piece."""
        if self._is_empty:
            return
        self._piece.finish()
        stream.write(b"<Placemark>\n")
        _put(stream, _text("name", name))
        _put(stream, _text("styleUrl", f"#{_style(style)}"))
        self._text.pour(stream)
        stream.write(b"</Placemark>\n")


class _Timed:
    """A gx:MultiTrack: in each track all times stand before all places."""

    def __init__(self, stream: Aside, places: Aside) -> None:
        self._stream = stream
        self._places = places
        self._is_open = False
        stream.write("<gx:MultiTrack>\n<gx:interpolate>0</gx:interpolate>\n")

    def add(self, row: Row) -> None:
        assert row.utc_ns is not None
        if row.is_first:
            self._end()
            self._stream.write("<gx:Track>\n")
            self._is_open = True
        self._stream.write(f"<when>{iso(row.utc_ns)}</when>\n")
        self._places.write(f"<gx:coord>{row.lon_deg:.9f} {row.lat_deg:.9f} 0</gx:coord>\n")

    def finish(self) -> None:
        self._end()
        self._stream.write("</gx:MultiTrack>\n")

    def _end(self) -> None:
        if self._is_open:
            self._stream.append(self._places)
            self._stream.write("</gx:Track>\n")
            self._is_open = False


class _Lines:
    """A MultiGeometry of LineStrings, cut at the 180th meridian."""

    def __init__(self, stream: Aside) -> None:
        self._stream = stream
        self._last: Place | None = None
        self._is_alone = False
        stream.write("<MultiGeometry>\n")

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
        self._stream.write("</MultiGeometry>\n")

    def _begin(self) -> None:
        self._end()
        self._stream.write("<LineString><tessellate>1</tessellate><coordinates>\n")
        self._last = None

    def _end(self) -> None:
        if self._last is not None:
            if self._is_alone:  # one place is no line
                self._point(self._last)
            self._stream.write("</coordinates></LineString>\n")

    def _point(self, place: Place) -> None:
        self._stream.write(f"{place[1]:.9f},{place[0]:.9f}\n")
        self._is_alone = self._last is None
        self._last = place


def _style(stretch: str) -> str:
    return "track" if stretch == "fix" else f"track-{stretch.replace(' ', '-')}"


def _styles() -> str:
    tracks = (
        f'<Style id="{_style(stretch)}"><IconStyle><scale>0.7</scale></IconStyle>'
        f"<LabelStyle><scale>0</scale></LabelStyle>"
        f"<LineStyle><color>{colour}</color><width>3</width></LineStyle></Style>\n"
        for stretch, colour in TRACK_COLOURS.items()
    )
    pins = (
        f'<Style id="{level}"><IconStyle><color>{colour}</color><scale>0.8</scale></IconStyle>'
        f"<LabelStyle><color>{colour}</color><scale>0.8</scale></LabelStyle></Style>\n"
        for level, colour in COLOURS.items()
    )
    return "".join((*tracks, *pins))


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
