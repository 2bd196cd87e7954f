"""Column mapping file of a table (CSV): which column is what, in which unit (deploy/examples/*-map.toml explain it).

docs/mapping.md explains every key. Two programs read it. An import (`wayfix import`) takes every row as it is, of
whatever parts are mapped. A voyage (`wayfix-onboard virtual`) sub-samples the rows and adds noise; it wants every part,
and knows fewer keys.
"""

from dataclasses import dataclass, field
from typing import Annotated, Final, TypeVar

from common.boat_config import BoatTable
from common.field_bounds import NeededFor, OneOf, OnlyFor, Range
from common.simulation.readings import SensorFacts

T = TypeVar("T")

IMPORT: Final = "import"
VOYAGE: Final = "voyage"

ImportOnly = Annotated[T, OnlyFor(IMPORT)]
VoyageNeeds = Annotated[T, NeededFor(VOYAGE)]
Rate = Annotated[float, Range(0.01, 1000.0)]
"""Rate to which a voyage sub-samples the rows, Hz; an import takes every row."""
Noise = Annotated[float, Range(0.0, 1e6)]
"""Noise that a voyage adds, 1-sigma; an import adds none."""
Latitude = Annotated[float, Range(-90.0, 90.0)]
Longitude = Annotated[float, Range(-180.0, 180.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableShape:
    """`[table]`: how the file is written, where an import does not find it out by itself."""

    skip_lines: Annotated[int, Range(0, 10_000)] = 0
    """Number of lines before the line of column names (or before the first row, with `columns`)."""
    columns: tuple[str, ...] = ()
    """Names of the columns of a table that has no line of names."""
    delimiter: str | None = None
    decimal: Annotated[str | None, OneOf((".", ","))] = None
    encoding: Annotated[str | None, OneOf(("utf-8", "utf-16", "cp1252", "latin-1"))] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeColumn:
    """The table `[time]`: when each row was measured."""

    column: str
    scale: float | None = None
    """Seconds in one unit of the column; `None` = the unit in its name, else 1."""
    nanoseconds: ImportOnly[str | None] = None
    """Column with the nanoseconds beyond it (ROS)."""
    unix: ImportOnly[bool] = False
    """True = the column counts from 1970, UTC."""
    zero_utc: ImportOnly[str | None] = None
    """UTC at which the column is 0 (a clock that counts from its start), ISO 8601."""
    more: ImportOnly[tuple[str, ...]] = ()
    """Further columns of a time that is text; joined with a blank."""
    format: ImportOnly[str | None] = None
    """How the text is written (Python's strptime), for example "%Y-%m-%d %H:%M:%S.%f"; "iso" = ISO 8601."""
    excel: ImportOnly[bool] = False
    """True = the column counts days as Excel does (45,000 is in 2023); one of `more` may hold the fraction of a day."""
    day_of_1970: ImportOnly[Annotated[float | None, Range(-1e7, 1e7)]] = None
    """The number that 1 January 1970 has in a column that counts days: 719529 for MATLAB, 2440587.5 for Julian days."""
    gps: ImportOnly[bool] = False
    """True = GPS time, which has no leap seconds; a number counts from 1980-01-06, or from the beginning of `week`."""
    week: ImportOnly[str | None] = None
    """Column of the GPS week, where `column` is the time of week."""
    utc: ImportOnly[bool] = False
    """True = the text or Excel's day is UTC, date included."""
    wraps_s: ImportOnly[Annotated[float, Range(0.0, 1e9)]] = 0.0
    """Period after which the clock starts again, s (a twelve-hour clock: 43200); 0 = never."""
    spread: ImportOnly[bool] = False
    """True = rows of one stamp (whole seconds, several rows in each) lie evenly up to the next."""

    @property
    def is_utc(self) -> bool:
        """True when the time is UTC, date included."""
        return self.unix or self.utc or self.gps or self.zero_utc is not None

    @property
    def is_days(self) -> bool:
        """True when the column counts days."""
        return self.excel or self.day_of_1970 is not None

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        return _named(self.column, self.nanoseconds, self.week, *self.more)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixColumns:
    """`[fix]`: latitude and longitude (WGS 84), or metres north and east of a given origin.

    Degrees are read in every form: -8.74, 8.74 W, 8 44.4 W, 8 44 24 W; 0 to 360 east.
    """

    lat: VoyageNeeds[str | None] = None
    lon: VoyageNeeds[str | None] = None
    lat_more: ImportOnly[tuple[str, ...]] = ()
    """Columns of the minutes of latitude, and of the seconds, where `lat` holds whole degrees alone."""
    lon_more: ImportOnly[tuple[str, ...]] = ()
    place: ImportOnly[str | None] = None
    """Column that holds latitude and longitude in one cell."""
    north_south: ImportOnly[str | None] = None
    """Column of the letter N or S; found by itself beside `lat`."""
    east_west: ImportOnly[str | None] = None
    scale: ImportOnly[float | None] = None
    """Degrees in one unit of the columns; `None` = the unit in their names, else 1."""
    lon_scale: ImportOnly[float | None] = None
    """Degrees in one unit of `lon`, where it is another one than that of `lat`; negative = + is west."""
    packed: ImportOnly[bool | None] = None
    """True = ddmm.mmmm (NMEA); `None` = found out from the values."""
    north: ImportOnly[str | None] = None
    east: ImportOnly[str | None] = None
    origin_lat_deg: ImportOnly[Latitude | None] = None
    origin_lon_deg: ImportOnly[Longitude | None] = None
    alt: ImportOnly[str | None] = None
    """Column of the height above mean sea level, m."""
    sog: ImportOnly[str | None] = None
    sog_scale: ImportOnly[float | None] = None
    """Knots in one unit of the column; `None` = the unit in the cells or the name, else 1."""
    cog: ImportOnly[str | None] = None
    """Column of the course over ground from true north."""
    cog_scale: ImportOnly[float | None] = None
    """Degrees in one unit of the column; `None` = the unit in the cells or the name, else 1."""
    mode: ImportOnly[str | None] = None
    """Column of the fix mode: 1 none, 2 = 2D, 3 = 3D."""
    held: ImportOnly[bool] = False
    """True = the columns keep their last value between two fixes: a row that repeats them brings none."""
    rate_hz: Rate = 1.0
    noise_m: Noise = 0.0
    """1-sigma added to each horizontal axis."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        places = (self.lat, self.lon, self.place, self.north_south, self.east_west, self.north, self.east)
        return _named(*places, *self.lat_more, *self.lon_more, self.alt, self.sog, self.cog, self.mode)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingColumns:
    """`[heading]`: clockwise from north, true unless it says `magnetic`."""

    column: VoyageNeeds[str | None] = None
    quaternion: ImportOnly[tuple[str, ...]] = ()
    """Columns x, y, z, w of the rotation from body (forward, starboard, down) to north, east, down."""
    scale: float | None = None
    """Degrees in one unit of the column, negative = the column counts the other way; `None` = the unit in the cells or
    the name, else 1."""
    offset_deg: ImportOnly[Annotated[float, Range(-360.0, 360.0)]] = 0.0
    """Offset that is added after scaling, deg."""
    magnetic: ImportOnly[bool] = False
    held: ImportOnly[bool] = False
    rate_hz: Rate = 10.0
    noise_deg: Noise = 0.0

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        return _named(self.column, *self.quaternion)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuColumns:
    """`[imu]`: body axes forward and starboard, yaw rate + bow to starboard. Without accelerations a rate gyro."""

    accel_fwd: VoyageNeeds[str | None] = None
    accel_stb: VoyageNeeds[str | None] = None
    yaw_rate: str
    accel_scale: float | None = None
    """Acceleration in one unit of the columns, m/s^2; `None` = the unit in the cells or the name, else 1."""
    accel_stb_scale: ImportOnly[float | None] = None
    """Acceleration in one unit of the starboard column, where it is another one (a column that points to port),
    m/s^2."""
    yaw_rate_scale: float | None = None
    """Yaw rate in one unit of the column, deg/s, negative = the column is + bow to port; `None` = the unit in the cells
    or the name, else 1."""
    held: ImportOnly[bool] = False
    rate_hz: Rate = 20.0

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        return _named(self.accel_fwd, self.accel_stb, self.yaw_rate)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceColumns:
    """`[reference]`: the best there is to compare with; body velocity over ground, forward and starboard (m/s)."""

    lat: str
    lon: str
    heading: str
    heading_scale: float = 1.0
    v_fwd: str
    v_stb: str

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        return (self.lat, self.lon, self.heading, self.v_fwd, self.v_stb)


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnMap:
    """The mapping file; read it for one use: `read_toml(path, ColumnMap, IMPORT)`."""

    boat: BoatTable
    time: TimeColumn
    table: ImportOnly[TableShape] = field(default_factory=TableShape)
    fix: VoyageNeeds[FixColumns | None] = None
    heading: VoyageNeeds[HeadingColumns | None] = None
    imu: VoyageNeeds[ImuColumns | None] = None
    reference: VoyageNeeds[ReferenceColumns | None] = None
    """Columns of the reference track; an import does not look at them."""
    facts: SensorFacts = field(default_factory=SensorFacts)

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column of time and sensors that must be there; those of the reference are its own."""
        parts = (self.time, self.fix, self.heading, self.imu)
        return tuple(dict.fromkeys(name for part in parts if part is not None for name in part.columns))


def _named(*names: str | None) -> tuple[str, ...]:
    return tuple(name for name in names if name is not None)
