"""Parts of a row of a table, sensor by sensor: the mapped cells become one measurement each."""

import math
from typing import Any, Final, Protocol

from common.framer import ImuSample, Measurement
from common.geodesy import LocalPlane
from common.messages import Fix, Heading, TurnRate
from common.simulation.column_map import ColumnMap, FixColumns, HeadingColumns, ImuColumns
from common.units import NS_PER_MS
from shore.imports.cell_columns import BadCell, Cells, NumberColumn
from shore.imports.gpsd import DAY_MS
from shore.imports.line_counts import Rejected
from shore.imports.place_columns import PlaceColumns
from shore.imports.table_file import TableFile

FAR_M: Final = 50_000.0
"""Farthest place from a mapping's origin, m."""
Made = tuple[Any, Measurement]
"""What the cells said, by which a row that repeats them is known, and the measurement."""


class TablePart(Protocol):
    """One sensor of a table."""

    name: str
    held: bool
    """True = a row that repeats the cells of the row before brings nothing."""
    notes: list[str]

    def read(self, cells: Cells, t_ns: int, utc_ns: int | None, /) -> Made | None:
        """The measurement of a row at boat time `t_ns`; `None` = empty; raises Rejected."""


def parts_of(mapping: ColumnMap, file: TableFile) -> list[TablePart]:
    """The parts that a mapping names."""
    parts: list[TablePart] = []
    if mapping.fix is not None:
        parts.append(_FixPart(mapping.fix, file))
    if mapping.heading is not None:
        parts.append(_HeadingPart(mapping.heading, file))
    if mapping.imu is not None:
        parts.append(_ImuPart(mapping.imu, file))
    return parts


class _FixPart:
    name = "fix"

    def __init__(self, fix: FixColumns, file: TableFile) -> None:
        self.held, self.notes = fix.held, _noise(fix.noise_m)
        self._name = fix.place or f"{fix.lat} and {fix.lon}"
        self._plane: LocalPlane | None = None
        if fix.origin_lat_deg is not None and fix.origin_lon_deg is not None:
            self._plane = LocalPlane(fix.origin_lat_deg, fix.origin_lon_deg)
        decimal = file.table.decimal
        degrees = file.factor(fix.lat, "angle")
        self._places = PlaceColumns(fix, decimal, file.sample, degrees)
        self.notes += self._places.notes
        self._north, self._east = (
            _number(file, name, what, 2.0 * FAR_M, quantity="length")
            for name, what in ((fix.north, "north"), (fix.east, "east"))
        )
        self._alt = _number(file, fix.alt, "alt", 100_000.0, quantity="length")
        self._sog = _number(file, fix.sog, "sog", 1000.0, quantity="speed", scale=fix.sog_scale, low=0.0)
        self._cog = _number(
            file, fix.cog, "cog", 361.0, quantity="angle", scale=fix.cog_scale, low=-180.0, magnetic=False
        )
        self._mode = _number(file, fix.mode, "mode", 1e9, quantity="mode")
        self.notes += _units_taken(file, (self._alt, self._sog, self._cog))

    def read(self, cells: Cells, t_ns: int, utc_ns: int | None, /) -> Made | None:
        place = self._places.read(cells) if self._plane is None else self._on_plane(self._plane, cells)
        if place is None:
            return None
        if place == (0.0, 0.0):
            raise BadCell("place 0, 0: what a receiver without a fix writes", self._name, "0, 0")
        mode, course = _value(self._mode, cells), _value(self._cog, cells)
        return place, Fix(
            sensor="gps1",
            t_ns=t_ns,
            lat_deg=place[0],
            lon_deg=place[1],
            alt_m=_value(self._alt, cells),
            fix_mode=int(mode) if mode in (1.0, 2.0, 3.0) else None,
            sog_kn=_value(self._sog, cells),
            cog_true_deg=None if course is None else _turned(course),
            utc_ns=utc_ns,
            tod_ms=None if utc_ns is None else utc_ns // NS_PER_MS % DAY_MS,
        )

    def _on_plane(self, plane: LocalPlane, cells: Cells) -> tuple[float, float] | None:
        north_m, east_m = _value(self._north, cells), _value(self._east, cells)
        if north_m is None or east_m is None:
            return None
        if math.hypot(north_m, east_m) > FAR_M:
            raise Rejected("too far from the origin")
        return plane.to_lat_lon_deg(east_m, north_m)


class _HeadingPart:
    name = "heading"

    def __init__(self, heading: HeadingColumns, file: TableFile) -> None:
        self.held, self.notes = heading.held, _noise(heading.noise_deg)
        self._heading = heading
        self._parts = [_number(file, name, "quaternion", 1.1) for name in heading.quaternion]
        # The mapping's scale goes after a quaternion, which has no unit.
        scale = heading.scale if not heading.quaternion else None
        self._column = _number(
            file, heading.column, "heading", 361.0, quantity="angle", scale=scale, magnetic=heading.magnetic
        )
        self.notes += _units_taken(file, (self._column,))

    def read(self, cells: Cells, t_ns: int, _: int | None, /) -> Made | None:
        value = self._of_quaternion(cells) if self._parts else _value(self._column, cells)
        if value is None:
            return None
        found = math.fmod(value + self._heading.offset_deg + 720.0, 360.0)
        mag_deg, true_deg = (found, None) if self._heading.magnetic else (None, found)
        return value, Heading(sensor="compass1", t_ns=t_ns, heading_mag_deg=mag_deg, heading_true_deg=true_deg)

    def _of_quaternion(self, cells: Cells) -> float | None:
        parts = [_value(part, cells) for part in self._parts]
        if None in parts:
            return None
        x, y, z, w = (part for part in parts if part is not None)
        if not 0.9 < x * x + y * y + z * z + w * w < 1.1:
            raise Rejected("no unit quaternion")
        yaw_deg = math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
        return yaw_deg * (1.0 if self._heading.scale is None else self._heading.scale)


class _ImuPart:
    name = "imu"

    def __init__(self, imu: ImuColumns, file: TableFile) -> None:
        self.held = imu.held
        self._rate = _number(file, imu.yaw_rate, "yaw rate", 4000.0, quantity="rate", scale=imu.yaw_rate_scale)
        stb_scale = imu.accel_scale if imu.accel_stb_scale is None else imu.accel_stb_scale
        self._fwd = _number(file, imu.accel_fwd, "accel_fwd", 1000.0, quantity="acceleration", scale=imu.accel_scale)
        self._stb = _number(file, imu.accel_stb, "accel_stb", 1000.0, quantity="acceleration", scale=stb_scale)
        self.notes = _units_taken(file, (self._rate, self._fwd, self._stb))

    def read(self, cells: Cells, t_ns: int, _: int | None, /) -> Made | None:
        rate_deg_s = _value(self._rate, cells)
        if rate_deg_s is None:
            return None
        if self._fwd is None:
            return rate_deg_s, TurnRate(sensor="gyro1", t_ns=t_ns, rate_deg_s=rate_deg_s)
        fwd_m_s2, stb_m_s2 = _value(self._fwd, cells), _value(self._stb, cells)
        if fwd_m_s2 is None or stb_m_s2 is None:
            return None
        sample = ImuSample("imu1", t_ns, fwd_m_s2, stb_m_s2, rate_deg_s)
        return (fwd_m_s2, stb_m_s2, rate_deg_s), sample


def _number(
    file: TableFile,
    name: str | None,
    what: str,
    high: float,
    *,
    quantity: str | None = None,
    scale: float | None = None,
    low: float | None = None,
    magnetic: bool | None = None,
) -> NumberColumn | None:
    """The column of a key, `None` = the mapping leaves it out; low: `None` = -high."""
    if name is None:
        return None
    return NumberColumn(
        name=name,
        what=what,
        low=-high if low is None else low,
        high=high,
        decimal=file.table.decimal,
        quantity=quantity,
        scale=scale,
        named=1.0 if quantity is None else file.factor(name, quantity),
        magnetic=magnetic,
    )


def _value(column: NumberColumn | None, cells: Cells) -> float | None:
    return None if column is None else column.read(cells)


def _units_taken(file: TableFile, columns: tuple[NumberColumn | None, ...]) -> list[str]:
    """What the columns' names say of units, where it changes the values or contradicts the mapping."""
    notes = []
    for column in columns:
        unit = None if column is None or column.quantity is None else file.unit(column.name, column.quantity)
        if column is None or unit is None:
            continue
        if column.scale is None and column.named != 1.0:
            notes.append(f"{column.what}: {column.name!r} is taken as {unit}")
        elif column.scale is not None and not math.isclose(abs(column.scale), column.named, rel_tol=1e-3):
            notes.append(
                f"{column.what}: {column.name!r} says {unit} ({column.named:.7g}), but the mapping's scale "
                f"{column.scale:.7g} is taken"
            )
    return notes


def _noise(noise: float) -> list[str]:
    return ["the mapping's noise is for the virtual boat: none was added"] if noise else []


def _turned(course_deg: float) -> float:
    turned = math.fmod(course_deg, 360.0)
    return turned if turned >= 0.0 else min(turned + 360.0, math.nextafter(360.0, 0.0))
