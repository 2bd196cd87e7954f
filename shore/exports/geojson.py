"""GeoJSON (RFC 7946): the track as a (Multi)LineString, each event as a Point with its properties."""

import json
from contextlib import ExitStack
from typing import Any, BinaryIO, Final

from shore.exports.antimeridian import Place, crossing
from shore.exports.text import Aside, aside, iso
from shore.exports.track import ExportTrack, Mark, Row

DECIMALS: Final = 8


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """One FeatureCollection. Raises OSError."""
    with ExitStack() as stack:
        lines, events = _Lines(stack.enter_context(aside())), stack.enter_context(aside())
        for item in track.items():
            if isinstance(item, Row):
                lines.add(item)
            else:
                events.write(",\n" + json.dumps(_event(item), ensure_ascii=False))
        lines.end()
        properties = {
            "name": track.title, "boat": track.survey.boat, "filter": track.filter, "order": track.order,
            **lines.times,
        }  # fmt: skip
        head = json.dumps({"type": "Feature", "properties": properties}, ensure_ascii=False)
        stream.write(
            f'{{"type": "FeatureCollection", "generator": "wayfix", "features": [\n{head[:-1]}, "geometry": '.encode()
        )
        lines.pour(stream)
        stream.write(b"}")
        events.pour(stream)
        stream.write(b"\n]}\n")


class _Lines:
    """Parts of two positions or more; a place that stands alone is written twice, since one is no line."""

    def __init__(self, places: Aside) -> None:
        self._places = places
        self._parts = 0
        self._points = 0
        """Number of positions in the open part."""
        self._last: Place = (0.0, 0.0)
        self.times: dict[str, Any] = {"begin_utc": None, "end_utc": None, "begin_s": None, "end_s": None}

    def add(self, row: Row) -> None:
        place = row.lat_deg, row.lon_deg
        if row.is_first:
            self.end()
        elif ends := crossing(self._last, place):
            self._point(ends[0])
            self.end()
            self._point(ends[1])
        self._point(place)
        utc = None if row.utc_ns is None else iso(row.utc_ns)
        if self.times["begin_s"] is None:
            self.times |= {"begin_utc": utc, "begin_s": row.t_s}
        self.times |= {"end_utc": utc, "end_s": row.t_s}

    def end(self) -> None:
        """End the open part."""
        if self._points == 1:
            self._point(self._last)
        if self._points:
            self._places.write("]")
        self._points = 0

    def pour(self, stream: BinaryIO) -> None:
        """The geometry; none of a track without a row."""
        if not self._parts:
            stream.write(b"null")
            return
        is_one = self._parts == 1
        stream.write(
            b'{"type": "LineString", "coordinates": ' if is_one else b'{"type": "MultiLineString", "coordinates": ['
        )
        self._places.pour(stream)
        stream.write(b"}" if is_one else b"]}")

    def _point(self, place: Place) -> None:
        if not self._points:
            self._parts += 1
        opening = "," if self._points else "[" if self._parts == 1 else ",["
        self._places.write(f"{opening}\n[{round(place[1], DECIMALS)}, {round(place[0], DECIMALS)}]")
        self._points += 1
        self._last = place


def _event(mark: Mark) -> dict[str, Any]:
    geometry = None
    if mark.place is not None:
        lat_deg, lon_deg = (round(value, DECIMALS) for value in mark.place)
        geometry = {"type": "Point", "coordinates": [lon_deg, lat_deg]}
    properties = {
        "level": mark.level, "source": mark.source, "code": mark.code, "text": mark.text, "evidence": mark.evidence,
        "utc": None if mark.utc_ns is None else iso(mark.utc_ns), "t_s": mark.t_s,
    }  # fmt: skip
    return {"type": "Feature", "properties": properties, "geometry": geometry}
