"""The mapping file of a column recording: which column is what (deploy/examples/blueboat-map.toml explains them)."""

from dataclasses import dataclass, field
from typing import Annotated

from common.ranges import Range
from common.sensors import BoatTable
from common.simulation.readings import SensorFacts

Rate = Annotated[float, Range(0.01, 1000.0)]
Noise = Annotated[float, Range(0.0, 1e6)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeColumn:
    """`[time]`."""

    column: str
    scale: float = 1.0
    """Seconds in one unit of the column."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixColumns:
    """`[fix]`: degrees, WGS 84."""

    lat: str
    lon: str
    rate_hz: Rate = 1.0
    noise_m: Noise = 0.0
    """1-sigma added to each horizontal axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingColumn:
    """`[heading]`: from true north, clockwise."""

    column: str
    scale: float = 1.0
    """Degrees in one unit."""
    rate_hz: Rate = 10.0
    noise_deg: Noise = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuColumns:
    """`[imu]`: body axes forward and starboard, yaw rate + bow to starboard."""

    accel_fwd: str
    accel_stb: str
    yaw_rate: str
    accel_scale: float = 1.0
    """m/s^2 in one unit."""
    yaw_rate_scale: float = 1.0
    """deg/s in one unit."""
    rate_hz: Rate = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReferenceColumns:
    """`[reference]`: the best there is to compare with; body velocity over ground, forward and starboard (m/s)."""

    lat: str
    lon: str
    heading: str
    heading_scale: float = 1.0
    v_fwd: str
    v_stb: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingMap:
    """The mapping file."""

    boat: BoatTable
    time: TimeColumn
    fix: FixColumns
    heading: HeadingColumn
    imu: ImuColumns
    reference: ReferenceColumns
    facts: SensorFacts = field(default_factory=SensorFacts)

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column that must be there."""
        fix, imu, ref = self.fix, self.imu, self.reference
        names = (self.time.column, fix.lat, fix.lon, self.heading.column, imu.accel_fwd, imu.accel_stb, imu.yaw_rate)
        return (*names, ref.lat, ref.lon, ref.heading, ref.v_fwd, ref.v_stb)
