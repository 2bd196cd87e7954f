"""GeoJSON (RFC 7946): each piece of track a LineString with a time for each place, each event a Point.

A piece rests on one thing (`position_from`: fix or coasting) and is cut at the 180th meridian. `coordTimes` are the UTC
of its places, as other programs write them; where UTC is not known, `times_s` are seconds of the log. Places whose
doubt is beyond 500 m are left out.
"""

import json
from contextlib import ExitStack
from typing import Any, BinaryIO, Final

from shore.exports.antimeridian import Place, crossing
from shore.exports.text import Aside, aside, iso
from shore.exports.track import ExportTrack, Mark, Row

DECIMALS: Final = 8


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """One FeatureCollection. Raises OSError."""
    about = {"name": track.title, "boat": track.survey.boat, "filter": track.filter, "order": track.order}
    with ExitStack() as stack:
        times, events = stack.enter_context(aside()), stack.enter_context(aside())
        stream.write(b'{"type": "FeatureCollection", "generator": "wayfix", "features": [\n')
        pieces = _Pieces(stream, times, about, has_utc=track.survey.clocks.know_utc)
        for item in track.drawn():
            if isinstance(item, Row):
                pieces.add(item)
            else:
                events.write(",\n" + _json(_event(item)))
        pieces.finish()
        events.pour(stream)
        stream.write(b"\n]}\n")


class _Pieces:
    """Features of two positions or more; a place that stands alone is written twice, since one is no line."""

    def __init__(self, stream: BinaryIO, times: Aside, about: dict[str, Any], *, has_utc: bool) -> None:
        self._stream = stream
        self._times = times
        self._about = about
        self._has_utc = has_utc
        self._is_alone = True
        """No piece was written yet."""
        self._points = 0
        """Number of positions in the open piece."""
        self._begin: Row | None = None
        self._last: Row | None = None

    def add(self, row: Row) -> None:
        place, last = (row.lat_deg, row.lon_deg), self._last
        if row.is_first or last is None:
            self._end()
            self._begin = row
        elif ends := crossing((last.lat_deg, last.lon_deg), place):
            self._point(ends[0], None)
            self._end()
            self._begin = row
            self._point(ends[1], None)
        self._point(place, row)
        self._last = row

    def finish(self) -> None:
        """End the open piece; a track without a row is a feature without a place."""
        self._end()
        if self._is_alone:
            self._stream.write(_json({"type": "Feature", "properties": self._about, "geometry": None}).encode())

    def _end(self) -> None:
        begin, last = self._begin, self._last
        if not self._points or begin is None or last is None:
            return
        if self._points == 1:
            self._point((last.lat_deg, last.lon_deg), last)
        properties = {
            **self._about, "position_from": begin.position_from, "aligned_parts": begin.aligned_parts,
            **_time("begin", begin), **_time("end", last),
        }  # fmt: skip
        name = "coordTimes" if self._has_utc else "times_s"
        self._stream.write(f']}}, "properties": {_json(properties)[:-1]}, "{name}": ['.encode())
        self._times.pour(self._stream)
        self._stream.write(b"]}}")
        self._points, self._is_alone = 0, False

    def _point(self, place: Place, row: Row | None) -> None:
        """row: which has this place; `None` = a point on the meridian, whose time nobody measured."""
        if not self._points:
            opening = "" if self._is_alone else ",\n"
            self._stream.write(
                f'{opening}{{"type": "Feature", "geometry": {{"type": "LineString", "coordinates": ['.encode()
            )
        separator = "," if self._points else ""
        self._stream.write(f"{separator}\n[{round(place[1], DECIMALS)}, {round(place[0], DECIMALS)}]".encode())
        self._times.write(separator + _json(None if row is None else _moment(row, has_utc=self._has_utc)))
        self._points += 1


def _moment(row: Row, *, has_utc: bool) -> str | float | None:
    if not has_utc:
        return row.t_s
    return None if row.utc_ns is None else iso(row.utc_ns)


def _time(which: str, row: Row) -> dict[str, Any]:
    return {f"{which}_utc": _moment(row, has_utc=True), f"{which}_s": row.t_s}


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


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)
