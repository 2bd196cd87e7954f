"""The mapping file of a table for `wayfix import`.

It is that of `wayfix-onboard virtual` (deploy/examples/blueboat-map.toml), of which all parts but `[boat]` and `[time]`
may be left out, and some more keys. All rows are taken, no noise is added.
"""

from dataclasses import dataclass, field
from typing import Annotated

from common.errors import WayfixError
from common.ranges import Range
from common.sensors import BoatTable
from common.simulation.readings import SensorFacts
from common.simulation.recording_map import Noise, Rate, ReferenceColumns

Latitude = Annotated[float, Range(-90.0, 90.0)]
Longitude = Annotated[float, Range(-180.0, 180.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeColumn:
    """`[time]`."""

    column: str
    scale: float = 1.0
    """Seconds in one unit of the column."""
    nanoseconds: str | None = None
    """Column with the nanoseconds beyond it (ROS)."""
    unix: bool = False
    """Counts from 1970, UTC."""
    more: tuple[str, ...] = ()
    """Further columns of a time that is text; joined with a blank."""
    format: str | None = None
    """How the text is written (Python's strptime), for example "%Y-%m-%d %H:%M:%S.%f"."""
    utc: bool = False
    """The text is UTC, date included."""
    wraps_s: Annotated[float, Range(0.0, 1e9)] = 0.0
    """It begins anew after so long (a twelve-hour clock: 43200); 0 = never."""
    spread: bool = False
    """Rows of one stamp (whole seconds, several rows in each) lie evenly up to the next."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixColumns:
    """`[fix]`: latitude and longitude, or metres north and east of a given origin."""

    lat: str | None = None
    lon: str | None = None
    scale: float = 1.0
    """Degrees in one unit."""
    north: str | None = None
    east: str | None = None
    origin_lat_deg: Latitude | None = None
    origin_lon_deg: Longitude | None = None
    alt: str | None = None
    """m above mean sea level."""
    sog: str | None = None
    sog_scale: float = 1.0
    """Knots in one unit."""
    cog: str | None = None
    """Degrees from true north."""
    mode: str | None = None
    """1 none, 2 = 2D, 3 = 3D."""
    held: bool = False
    """The columns keep their last value between two fixes: a row that repeats them brings none."""
    rate_hz: Rate | None = None
    noise_m: Noise = 0.0
    """Both for the virtual boat only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingColumns:
    """`[heading]`: clockwise from north."""

    column: str | None = None
    quaternion: tuple[str, ...] = ()
    """Columns x, y, z, w of the rotation from body (forward, starboard, down) to north, east, down."""
    scale: float = 1.0
    """Degrees in one unit; negative = the column counts the other way."""
    offset_deg: Annotated[float, Range(-360.0, 360.0)] = 0.0
    """Added after scaling."""
    magnetic: bool = False
    held: bool = False
    rate_hz: Rate | None = None
    noise_deg: Noise = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuColumns:
    """`[imu]`: body axes forward and starboard, yaw rate + bow to starboard. Without accelerations a rate gyro."""

    yaw_rate: str
    accel_fwd: str | None = None
    accel_stb: str | None = None
    accel_scale: float = 1.0
    """m/s^2 in one unit."""
    accel_stb_scale: float | None = None
    """The same for starboard, where it is another (a column that points to port)."""
    yaw_rate_scale: float = 1.0
    """deg/s in one unit; negative = + bow to port."""
    held: bool = False
    rate_hz: Rate | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnMap:
    """The mapping file."""

    boat: BoatTable
    time: TimeColumn
    fix: FixColumns | None = None
    heading: HeadingColumns | None = None
    imu: ImuColumns | None = None
    reference: ReferenceColumns | None = None
    """For the virtual boat only."""
    facts: SensorFacts = field(default_factory=SensorFacts)

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        names: list[str | None] = [self.time.column, self.time.nanoseconds, *self.time.more]
        if self.fix is not None:
            fix = self.fix
            names += [fix.lat, fix.lon, fix.north, fix.east, fix.alt, fix.sog, fix.cog, fix.mode]
        if self.heading is not None:
            names += [self.heading.column, *self.heading.quaternion]
        if self.imu is not None:
            names += [self.imu.yaw_rate, self.imu.accel_fwd, self.imu.accel_stb]
        return tuple(dict.fromkeys(name for name in names if name is not None))

    def check(self, file: str) -> None:
        """Raises WayfixError for parts that do not fit together."""
        fix, heading, imu, time = self.fix, self.heading, self.imu, self.time
        if fix is None and heading is None and imu is None:
            raise WayfixError("maps nothing", file, "add [fix], [heading] or [imu]")
        if fix is not None:
            plane = (fix.north, fix.east, fix.origin_lat_deg, fix.origin_lon_deg)
            if ((fix.lat is None) != (fix.lon is None)) or (
                (fix.lat is None) != all(part is not None for part in plane)
            ):
                cure = "give lat and lon, or north, east, origin_lat_deg and origin_lon_deg"
                raise WayfixError("[fix] is no position", file, cure)
        if heading is not None and ((heading.column is None) == (len(heading.quaternion) != 4)):
            raise WayfixError("[heading] is no direction", file, "give column, or the four columns of quaternion")
        if imu is not None and (imu.accel_fwd is None) != (imu.accel_stb is None):
            raise WayfixError("[imu] has one acceleration", file, "give accel_fwd and accel_stb, or neither")
        if time.format is None and (time.more or time.utc):
            raise WayfixError("[time] says how text is read, but not its format", file, "add format")
        if time.format is not None and (time.nanoseconds or time.unix):
            raise WayfixError("[time] is text and a number at once", file, "leave format, or nanoseconds and unix out")
