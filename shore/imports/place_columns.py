"""Latitude and longitude of a row (coordinate parsing), in whatever form the columns write them."""

import math
import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from common.angles import difference_deg
from common.simulation.column_map import FixColumns
from shore.imports.cell_columns import BadCell, Cells
from shore.imports.cells import Angle, angle_in, both_in, from_packed, is_nothing, letter_of, with_point
from shore.imports.line_counts import Rejected
from shore.imports.values import in_range

_SIDE_NAMES: Final = {
    "NS": re.compile(r"(?i)n\W?s|.*lat.*(dir|ref|hem|ns|n\Ws|letter).*|.*n[_/ -]?s[_ ]?(ind|hem|dir).*"),
    "EW": re.compile(r"(?i)e\W?w|.*lon.*(dir|ref|hem|ew|e\Ww|letter).*|.*e[_/ -]?w[_ ]?(ind|hem|dir).*"),
}
"""Names of a column of letters that does not stand beside its latitude or longitude."""
_WHOLE: Final = re.compile(r"\.0*$")


class _Axis(NamedTuple):
    what: str
    letters: str
    most: float
    """Largest angle, deg."""


_LAT: Final = _Axis("lat", "NS", 90.0)
_LON: Final = _Axis("lon", "EW", 180.0)


class PlaceColumns:
    """The columns of a latitude and a longitude, in whatever form they are written."""

    def __init__(self, fix: FixColumns, decimal: str, rows: Sequence[Cells], named: float = 1.0) -> None:
        """rows: some of the table, by which the form is told; named: degrees in one unit by the columns' names."""
        self._fix = fix
        self._decimal = decimal
        self.notes: list[str] = []
        """What was found out, and a person should know."""
        self.letters = (
            self._beside(fix.lat, fix.north_south, "NS", rows),
            self._beside(fix.lon, fix.east_west, "EW", rows),
        )
        scale = named if fix.scale is None else fix.scale
        self._scales = {_LAT: scale, _LON: scale if fix.lon_scale is None else fix.lon_scale}
        lats, lons = self._angles(() if fix.lat is None and fix.place is None else rows)
        self.is_packed = fix.packed if fix.packed is not None else fix.scale is None and self._looks_packed(lats, lons)
        if self.is_packed and fix.packed is None:
            self.notes.append("places are read as degrees and minutes (ddmm.mmmm); packed = false says otherwise")
        self._eastward = self._first_eastward(lons)

    def read(self, cells: Cells) -> tuple[float, float] | None:
        """Latitude and longitude, deg; `None` = empty; raises BadCell."""
        texts = self._texts(cells)
        if texts is None:
            return None
        lat_deg = self._axis(_LAT, texts[0])
        lon_deg = self._axis(_LON, texts[1])
        if lon_deg > 180.0:
            if self._eastward is None or abs(difference_deg(lon_deg, self._eastward)) > 90.0:
                raise BadCell("lon: out of range", self._fix.lon or self._fix.place or "", texts[1])
            lon_deg -= 360.0
        return lat_deg, lon_deg

    def _texts(self, cells: Cells) -> tuple[str, str] | None:
        """Latitude and longitude as they are written, each with its letter; `None` = empty."""
        fix = self._fix
        if fix.place is not None:
            text = cells[fix.place]
            try:
                return None if is_nothing(text) else both_in(text)
            except Rejected as reason:
                raise BadCell(str(reason), fix.place, text) from None
        lat = self._joined(cells, fix.lat or "", fix.lat_more, self.letters[0])
        lon = self._joined(cells, fix.lon or "", fix.lon_more, self.letters[1])
        return None if lat is None or lon is None else (lat, lon)

    def _joined(self, cells: Cells, name: str, more: Sequence[str], letter: str | None) -> str | None:
        """Degrees, minutes and seconds of several columns, and the letter, as one text; `None` = empty."""
        first, *finer = (cells[column] for column in (name, *more))
        if is_nothing(first) or any(map(is_nothing, finer)):
            return None
        if finer:
            first, *finer = (_WHOLE.sub("", with_point(text, self._decimal)) for text in (first, *finer))
            if any(text.startswith("-") for text in finer) and not first.startswith("-"):
                if first.strip("0"):
                    raise BadCell("a minus before the minutes, and none before the degrees", name, " ".join(cells))
                first = f"-{first}"  # 0 degrees have no sign
            first = " ".join((first, *(text.lstrip("-+") for text in finer)))
        return first if letter is None else f"{first} {cells[letter]}".strip()

    def _axis(self, axis: _Axis, text: str) -> float:
        """One of the two, deg; a longitude up to 360."""
        try:
            degrees = self._degrees(axis, angle_in(text, axis.letters, self._decimal))
            found = in_range(degrees, axis.what, -axis.most, 360.0 if axis is _LON else axis.most)
        except Rejected as reason:
            column = self._fix.place or (self._fix.lat if axis is _LAT else self._fix.lon) or ""
            raise BadCell(str(reason) if ":" in str(reason) else f"{axis.what}: {reason}", column, text) from None
        return 0.0 if found is None else found

    def _degrees(self, axis: _Axis, angle: Angle) -> float:
        scale = self._scales[axis]
        if angle.has_letter and scale < 0.0:
            raise Rejected("a letter contradicts the sign of the mapping's scale")
        if not angle.is_bare or self.is_packed:
            return math.copysign(1.0, scale) * (from_packed(angle.value) if angle.is_bare else angle.value)
        return angle.value * scale

    def _beside(self, name: str | None, given: str | None, axis: str, rows: Sequence[Cells]) -> str | None:
        """The column of the letters: the one that the mapping names, else a neighbour that holds nothing else."""
        if given is not None or name is None or not rows:
            return given
        columns = list(rows[0])
        place = columns.index(name) + len(self._fix.lat_more if axis == "NS" else self._fix.lon_more)
        beside = columns[place + 1 : place + 2] + columns[max(0, place - 1) : place]
        for column in dict.fromkeys((*beside, *filter(_SIDE_NAMES[axis].fullmatch, columns))):
            letters = {letter_of(row[column]) for row in rows if row[column]}
            if letters and letters <= set(axis):
                self.notes.append(f"the hemisphere of {name!r} is taken from the column {column!r}")
                return column
        return None

    def _angles(self, rows: Sequence[Cells]) -> tuple[list[Angle], list[Angle]]:
        """Latitudes and longitudes of the rows, those that can be read."""
        found: tuple[list[Angle], list[Angle]] = ([], [])
        for row in rows:
            try:
                texts = self._texts(row)
                angles = (
                    None
                    if texts is None
                    else [angle_in(text, axis, self._decimal) for text, axis in zip(texts, ("NS", "EW"), strict=True)]
                )
            except Rejected:
                continue
            for each, angle in zip(found, angles or (), strict=False):
                each.append(angle)
        return found

    def _looks_packed(self, lats: Sequence[Angle], lons: Sequence[Angle]) -> bool:
        if not lats or not all(angle.is_bare for angle in (*lats, *lons)):
            return False
        is_wide = all(angle.digits == 4 for angle in lats) and all(angle.digits == 5 for angle in lons)
        # A latitude of 91 to 180 may be a longitude in the wrong column.
        beyond = max(abs(angle.value) for angle in lats), max((abs(angle.value) for angle in lons), default=0.0)
        is_beyond = beyond[0] > 180.0 or (beyond[0] > 90.0 and beyond[1] > 180.0)
        return (is_wide or is_beyond) and all(
            abs(angle.value) <= most * 100.0 and abs(angle.value) % 100.0 < 60.0
            for angles, most in ((lats, 90.0), (lons, 180.0))
            for angle in angles
        )

    def _first_eastward(self, lons: Sequence[Angle]) -> float | None:
        """The first longitude, when none has a letter or a sign: then the table may count 0 to 360 deg eastward."""
        if not lons or any(angle.has_side for angle in lons):
            return None
        try:
            return self._degrees(_LON, lons[0])
        except Rejected:
            return None
