"""Column readers of a table: the cell of a row becomes a number in the boat's unit, a place or a time."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from decimal import Decimal, InvalidOperation
from typing import Final, NamedTuple

from common.angles import difference_deg
from common.simulation.column_map import FixColumns, TimeColumn
from common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from shore.imports.cells import (
    Angle,
    angle_in,
    both_in,
    from_packed,
    is_nothing,
    letter_of,
    number_and_unit,
    with_point,
)
from shore.imports.line_counts import Rejected
from shore.imports.units import factor_of
from shore.imports.values import in_range, utc_ns_of

Cells = dict[str, str]
ISO: Final = "iso"
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_MIDNIGHT: Final = datetime(1900, 1, 1, tzinfo=UTC)
"""The day that strptime gives to a time of day."""
_EXCEL_OF_1970: Final = 25_569
"""Excel's number of the day 1970-01-01."""
_FINER: Final = re.compile(r"(?<=[0-9][.,][0-9]{6})[0-9]+")
"""Decimals of a second beyond microseconds, which strptime refuses."""
_NORTH_IS: Final = re.compile(r"(.*?)\s*(t|true|m|mag|magnetic)", re.IGNORECASE)


class BadCell(Rejected):
    """A cell that cannot be right; `where` names column and value."""

    def __init__(self, reason: str, column: str, text: str) -> None:
        super().__init__(reason)
        self.where = f"column {column!r}, value {text[:40]!r}"


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberColumn:
    """A column of numbers, with or without a unit in each cell."""

    name: str
    what: str
    """What a person calls the value."""
    low: float
    high: float
    """Bounds in the boat's unit."""
    decimal: str
    quantity: str | None = None
    """The quantity of `UNITS` whose units a cell may carry."""
    scale: float | None = None
    """Factor that the mapping gives."""
    named: float = 1.0
    """Factor where neither mapping nor cell says one."""
    magnetic: bool | None = None
    """Which north the mapping says, for a direction."""

    def read(self, cells: Cells) -> float | None:
        """The value; `None` = empty; raises BadCell."""
        text = cells[self.name]
        if is_nothing(text):
            return None
        try:
            value, unit = number_and_unit(text, self.decimal)
            return in_range(value * self._factor(unit), self.what, self.low, self.high)
        except Rejected as reason:
            raise BadCell(str(reason), self.name, text) from None

    def _factor(self, unit: str) -> float:
        if self.magnetic is not None and (match := _NORTH_IS.fullmatch(unit)) is not None:
            if match[2][0].casefold() != ("m" if self.magnetic else "t"):
                raise Rejected(f"{self.what}: its letter says the other north than `magnetic` of the mapping")
            unit = match[1]
        if not unit:
            return self.named if self.scale is None else self.scale
        factor = None if self.quantity is None else factor_of(unit, self.quantity)
        if factor is None:
            raise Rejected(f"{self.what}: not a number")
        if self.scale is None:
            return factor
        if not math.isclose(abs(self.scale), factor, rel_tol=1e-3):
            raise Rejected(f"{self.what}: its unit contradicts the scale of the mapping")
        return self.scale


_SIDE_NAMES: Final = {
    "NS": re.compile(r"(?i)n\W?s|.*lat.*(dir|ref|hem|ns|n\Ws|letter).*|.*n[_/ -]?s[_ ]?(ind|hem|dir).*"),
    "EW": re.compile(r"(?i)e\W?w|.*lon.*(dir|ref|hem|ew|e\Ww|letter).*|.*e[_/ -]?w[_ ]?(ind|hem|dir).*"),
}
"""Names of a column of letters that does not stand beside its latitude or longitude."""


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
        self._scale = named if fix.scale is None else fix.scale
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
        assert fix.lat is not None
        assert fix.lon is not None
        if is_nothing(cells[fix.lat]) or is_nothing(cells[fix.lon]):
            return None
        lat, lon = (
            cells[name] if letter is None else f"{cells[name]} {cells[letter]}".strip()
            for name, letter in zip((fix.lat, fix.lon), self.letters, strict=True)
        )
        return lat, lon

    def _axis(self, axis: _Axis, text: str) -> float:
        """One of the two, deg; a longitude up to 360."""
        try:
            degrees = self._degrees(angle_in(text, axis.letters, self._decimal))
            found = in_range(degrees, axis.what, -axis.most, 360.0 if axis is _LON else axis.most)
        except Rejected as reason:
            column = self._fix.place or (self._fix.lat if axis is _LAT else self._fix.lon) or ""
            raise BadCell(str(reason) if ":" in str(reason) else f"{axis.what}: {reason}", column, text) from None
        return 0.0 if found is None else found

    def _degrees(self, angle: Angle) -> float:
        if not angle.is_bare:
            return angle.value
        return from_packed(angle.value) if self.is_packed else angle.value * self._scale

    def _beside(self, name: str | None, given: str | None, axis: str, rows: Sequence[Cells]) -> str | None:
        """The column of the letters: the one that the mapping names, else a neighbour that holds nothing else."""
        if given is not None or name is None or not rows:
            return given
        columns = list(rows[0])
        place = columns.index(name)
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
        return (is_wide or any(abs(angle.value) > 90.0 for angle in lats)) and all(
            abs(angle.value) <= most * 100.0 and abs(angle.value) % 100.0 < 60.0
            for angles, most in ((lats, 90.0), (lons, 180.0))
            for angle in angles
        )

    def _first_eastward(self, lons: Sequence[Angle]) -> float | None:
        """The first longitude, when none has a letter or a sign: then the table may count 0 to 360 deg eastward."""
        if not lons or any(angle.has_side for angle in lons):
            return None
        try:
            return self._degrees(lons[0])
        except Rejected:
            return None


class TimeCells:
    """The time of a row."""

    def __init__(self, time: TimeColumn, decimal: str, named: float = 1.0) -> None:
        """named: seconds in one unit of the column by its name."""
        self._time = time
        self._decimal = decimal
        self._zero_ns = utc_ns_of(time.zero_utc) or 0
        self._scale = Decimal(repr(named if time.scale is None else time.scale))
        self._formats = () if time.format is None else _formats(time.format)
        self._epoch = _EPOCH if has_date(time.format) else _MIDNIGHT

    def read(self, cells: Cells) -> int:
        """Time of a row, ns; raises BadCell."""
        time = self._time
        text = " ".join(text for text in (cells[name] for name in (time.column, *time.more)) if text)
        try:
            return self._ns(cells, text)
        except Rejected as reason:
            raise BadCell(str(reason).removeprefix("time: "), " + ".join((time.column, *time.more)), text) from None

    def _ns(self, cells: Cells, text: str) -> int:
        time = self._time
        if is_nothing(text):
            raise Rejected("empty")
        if time.format == ISO:
            return utc_ns_of(text) or 0
        if time.format is not None:
            return self._written_ns(text)
        if time.excel:
            days = sum(_decimal(with_point(part, self._decimal)) for part in text.split())
            if not 1 <= days < 2_958_466:
                raise Rejected("no day of Excel")
            return round((days - _EXCEL_OF_1970) * 86_400_000) * NS_PER_MS
        seconds = _decimal(with_point(cells[time.column], self._decimal)) * self._scale
        if time.nanoseconds is not None:
            seconds += _decimal(cells[time.nanoseconds]) / NS_PER_S
        if not -4_000_000_000 <= seconds <= 4_000_000_000:
            raise Rejected("out of range")
        return self._zero_ns + int(seconds * 1_000_000) * NS_PER_US

    def _written_ns(self, text: str) -> int:
        for form in self._formats:
            try:
                moment = datetime.strptime(_FINER.sub("", text), form)  # noqa: DTZ007 (made UTC below)
            except ValueError:
                continue
            since = (moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment) - self._epoch
            return since // timedelta(microseconds=1) * NS_PER_US
        raise Rejected("not in the form of the mapping")


def has_date(form: str | None) -> bool:
    """True when a form of a time holds the day; without it a time counts from midnight."""
    return form is None or form == ISO or any(part in form for part in ("%d", "%j", "%x", "%c"))


def _formats(given: str) -> tuple[str, ...]:
    """The form, and the same with or without decimals of the second: writers leave them out of a whole second."""
    if "%f" in given:
        return (given, given.replace(".%f", "").replace(",%f", ""))
    return (given, given.replace("%S", "%S.%f"), given.replace("%S", "%S,%f")) if "%S" in given else (given,)


def _decimal(text: str) -> Decimal:
    if is_nothing(text):
        raise Rejected("empty")
    try:
        value = Decimal(text)
    except InvalidOperation:
        raise Rejected("not a number") from None
    if not value.is_finite():
        raise Rejected("not a number")
    return value
