"""Sensor readings of a virtual boat (errors included) in order of time, before a device turns them into bytes.

A scenario (`scenarios.py`) or a recording (`column_recording.py`) makes the list; encoders
(`onboard.devices`) or the laboratory take it. No numpy in here, so that encoders can be imported anywhere.
"""

from dataclasses import dataclass
from typing import Annotated, Final

from common.boat_config import IMU_AXES, SensorTable
from common.field_bounds import OneOf, Range
from common.units import STANDARD_GRAVITY_M_S2

_TABLE: Final = SensorTable(id="imu1", port="imu", role="imu")
"""Sensor table that gives the defaults: what a boat's file means when it says nothing."""


@dataclass(frozen=True, slots=True)
class FixReading:
    """One position solution of a receiver (deg, WGS 84), and what the receiver says of it."""

    lat_deg: float
    lon_deg: float
    v_east_m_s: float | None = None
    """Velocity over ground as the receiver gives it, smoothed or frozen; `None` = it gives none."""
    v_north_m_s: float | None = None
    quality: int = 1
    """Quality as in GGA: 0 none (the place is not sent), 1 GPS, 2 DGPS, 4 RTK fixed, 5 RTK float."""
    satellites: int = 8
    hdop: float | None = 1.1
    sigma_east_m: float | None = None
    """1-sigma that the receiver claims on each axis (GST), m; `None` = it sends no GST."""
    sigma_north_m: float | None = None
    late_s: float = 0.0
    """How much older than its stamp the position is, s: a latency that the boat's file does not know. The receiver's
    own UTC is right."""
    minute_decimals: int = 5
    """Decimals of the minutes that the receiver prints: 4 = 0.19 m (BU-353), 5 = 2 cm, 7 = 0.2 mm (RTK)."""


@dataclass(frozen=True, slots=True)
class HeadingReading:
    """One heading with the sensor's errors in it, [0, 360), from true north: variation is the encoder's business."""

    heading_true_deg: float
    pitch_deg: float | None = None
    """Pitch of the hull, deg, bow up +. A compass without tilt sensors prints none, whatever stands here."""
    roll_deg: float | None = None
    """Roll of the hull, deg, starboard down +."""
    turn_rate_deg_s: float | None = None
    """Rate of turn, deg/s, bow to starboard +."""
    decimals: int = 1
    """Decimals of the heading that the device prints; 0 = whole degrees."""
    disturbed: bool = False
    """The device says itself that its magnetic field is disturbed (distortion word, status letter)."""


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One inertial sample over the interval that ends at its time; body axes forward, starboard, down.

    Accelerations are specific force along the axes (gravity appears where the hull is tilted).
    """

    accel_fwd_m_s2: float
    accel_stb_m_s2: float
    yaw_rate_deg_s: float
    """Yaw rate, deg/s, bow to starboard +."""
    accel_down_m_s2: float = -STANDARD_GRAVITY_M_S2
    """Specific force downward, m/s^2: -9.8 at rest, for the hull is held up against gravity."""
    roll_rate_deg_s: float = 0.0
    pitch_rate_deg_s: float = 0.0
    roll_deg: float | None = None
    """Attitude that the unit reckons itself; `None` = it reckons none."""
    pitch_deg: float | None = None


@dataclass(frozen=True, slots=True)
class TurnRateReading:
    """One yaw rate of a rate gyro, deg/s, + bow to starboard, mean over the interval that ends at its time."""

    rate_deg_s: float


@dataclass(frozen=True, slots=True)
class AisReading:
    """One AIS sentence as a receiver would print it, whole but for its line end (`!AIVDM,...*hh`)."""

    sentence: str


@dataclass(frozen=True, slots=True)
class RadarReading:
    """One target of a marine radar's own tracker: range and bearing (TTM), or a place (TLL)."""

    number: int
    range_m: float | None = None
    bearing_true_deg: float | None = None
    sog_m_s: float | None = None
    """Speed of the target over ground, m/s."""
    course_true_deg: float | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    status: str = "tracking"
    """State of the target in the tracker: `acquiring`, `tracking` or `lost`."""
    name: str = ""


Reading = FixReading | HeadingReading | ImuReading | TurnRateReading | AisReading | RadarReading


@dataclass(frozen=True, slots=True)
class Timed:
    """A reading of `sensor` (role + number), valid `t_s` seconds after the start of the voyage."""

    t_s: float
    sensor: str
    reading: Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFacts:
    """What the boat's configuration claims about its sensors (1-sigma); not what the simulation really does."""

    sigma_m: Annotated[float, Range(0.001, 1000.0)] = _TABLE.sigma_m
    sigma_deg: Annotated[float, Range(0.001, 180.0)] = _TABLE.sigma_deg
    accel_density: Annotated[float, Range(1e-6, 100.0)] = _TABLE.accel_density
    gyro_density_deg: Annotated[float, Range(1e-6, 1000.0)] = _TABLE.gyro_density_deg
    bias_accel_sigma_m_s2: Annotated[float, Range(0.0, 10.0)] = _TABLE.bias_accel_sigma_m_s2
    bias_accel_walk_m_s2: Annotated[float, Range(0.0, 1.0)] = _TABLE.bias_accel_walk_m_s2
    bias_yaw_rate_sigma_deg_s: Annotated[float, Range(0.0, 50.0)] = _TABLE.bias_yaw_rate_sigma_deg_s
    bias_yaw_rate_walk_deg_s: Annotated[float, Range(0.0, 5.0)] = _TABLE.bias_yaw_rate_walk_deg_s
    tilt_leak_sigma_per_m: Annotated[float, Range(0.0, 2.0)] = _TABLE.tilt_leak_sigma_per_m
    heel_leak_sigma: Annotated[float, Range(0.0, 20.0)] = _TABLE.heel_leak_sigma
    compass_bias_sigma_deg: Annotated[float, Range(0.0, 180.0)] = _TABLE.compass_bias_sigma_deg
    compass_deviation_sigma_deg: Annotated[float, Range(0.0, 180.0)] = _TABLE.compass_deviation_sigma_deg
    use: tuple[Annotated[str, OneOf(IMU_AXES)], ...] = _TABLE.use


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """Samples a second. GPS and compass begin at t = 0, the IMU with its first whole interval."""

    gps_hz: float = 1.0
    compass_hz: float = 10.0
    imu_hz: float = 20.0
