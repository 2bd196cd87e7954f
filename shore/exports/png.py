"""Track plot: a picture of the trip, drawn by matplotlib (extra `report`)."""

from datetime import timedelta
from typing import BinaryIO, Final

import numpy as np

from common.geodesy import LocalPlane
from common.units import NS_PER_S
from shore.exports.track import RAW, ExportTrack, Mark, Row
from shore.report.trip_picture import STRETCHES, Happening, Points, TripPlot, draw, when

SHOWN: Final = 20_000
"""Most rows and fixes that a picture shows; more are thinned out."""
_NAN: Final = float("nan")
_Values = tuple[float, ...]


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """Write the picture of the track. Raises OSError."""
    rows, marks = _Thinned(), []
    plane: LocalPlane | None = None
    begin = end = None
    has_utc = track.survey.clocks.know_utc
    for item in track.drawn():
        if isinstance(item, Mark):
            marks.append(item)
            continue
        begin, end = begin or item, item
        plane = plane or LocalPlane(item.lat_deg, item.lon_deg)
        rows.add(_values(item, plane, has_utc=has_utc))
    if plane is None or begin is None or end is None:
        return
    fixes = _Thinned()
    for _, fix in track.fixes():
        if fix.usable and fix.lat_deg is not None and fix.lon_deg is not None:
            fixes.add(plane.to_east_north_m(fix.lat_deg, fix.lon_deg))
    draw(
        stream,
        TripPlot(
            title=track.title,
            subtitle=_subtitle(track, begin, end),
            has_utc=has_utc,
            origin=(plane.origin_lat_deg, plane.origin_lon_deg),
            rows=rows.points(10),
            fixes=fixes.points(2),
            direction="course over ground, deg" if track.filter == RAW else "true heading, deg",
            events=[_happening(mark, plane, has_utc=has_utc) for mark in marks if mark.level != "debug"],
        ),
    )


class _Thinned:
    """Decimation: at most twice `SHOWN` values, evenly taken; each may stand for more and more others."""

    def __init__(self) -> None:
        self._kept: list[_Values] = []
        self._each = 1
        self._count = 0
        self._begins = False

    def add(self, values: _Values) -> None:
        """Add a row. The last value of a row says that a piece begins; this is never lost."""
        is_row = len(values) > 2
        self._begins |= is_row and values[-1] == 1.0
        if self._count % self._each == 0:
            self._kept.append((*values[:-1], float(self._begins)) if is_row else values)
            self._begins = False
        self._count += 1
        if len(self._kept) >= 2 * SHOWN:
            self._kept = self._halved() if is_row else self._kept[::2]
            self._each *= 2

    def points(self, width: int) -> Points:
        return np.array(self._kept, dtype=np.float64).reshape(-1, width)

    def _halved(self) -> list[_Values]:
        pairs = zip(self._kept[::2], self._kept[1::2], strict=False)
        return [(*one[:-1], max(one[-1], other[-1])) for one, other in pairs]


def _values(row: Row, plane: LocalPlane, *, has_utc: bool) -> _Values:
    place = plane.to_east_north_m(row.lat_deg, row.lon_deg)
    covariance = row.covariance_m2 or (_NAN, _NAN, _NAN)
    heading = row.heading_true_deg if row.record is not None else row.cog_true_deg
    numbers = (_NAN if value is None else value for value in (heading, row.sigma_heading_deg))
    heading_deg, sigma_deg = numbers
    return (
        _time(row, has_utc=has_utc), *place, heading_deg, *covariance, sigma_deg, float(STRETCHES.index(row.stretch)),
        float(row.is_first),
    )  # fmt: skip


def _time(item: Row | Mark, *, has_utc: bool) -> float:
    return item.utc_ns / NS_PER_S if has_utc and item.utc_ns is not None else item.t_s


def _happening(mark: Mark, plane: LocalPlane, *, has_utc: bool) -> Happening:
    east_m, north_m = (None, None) if mark.place is None else plane.to_east_north_m(*mark.place)
    return Happening(_time(mark, has_utc=has_utc), mark.level, mark.code, east_m, north_m)


def _subtitle(track: ExportTrack, begin: Row, end: Row) -> str:
    what = f"fixes of {track.gps or 'the GPS'}" if track.filter == RAW else track.filter
    how = "" if track.order == "recorded" else ", filtered again in order of boat time"
    took = timedelta(seconds=round(end.t_s - begin.t_s))
    words = [f"{what}{how}", str(took)]
    if begin.utc_ns is not None:
        words.insert(1, when(begin.utc_ns))
    return "  ·  ".join(words)
