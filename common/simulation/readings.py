"""Sensor readings of a virtual boat (errors included) in order of time, before a device turns them into bytes.

A scenario (`scenarios.py`) or a recording (`column_recording.py`) makes the list; encoders
(`onboard.virtual.encoders`) or the laboratory take it. No numpy in here, so that encoders can be imported anywhere.
"""

from dataclasses import dataclass
from typing import Annotated, Final

from common.boat_config import IMU_AXES, SensorTable
from common.field_bounds import OneOf, Range

_TABLE: Final = SensorTable(id="imu1", port="imu", role="imu")
"""Sensor table that gives the defaults: what a boat's file means when it says nothing."""


@dataclass(frozen=True, slots=True)
class FixReading:
    """One position solution of a receiver (deg, WGS 84)."""

    lat_deg: float
    lon_deg: float
    v_east_m_s: float | None = None
    """Velocity over ground as the receiver measures it; `None` = it gives none."""
    v_north_m_s: float | None = None


@dataclass(frozen=True, slots=True)
class HeadingReading:
    """One heading with the sensor's errors in it, [0, 360), from true north: variation is the encoder's business."""

    heading_true_deg: float


@dataclass(frozen=True, slots=True)
class ImuReading:
    """One inertial sample over the interval that ends at its time; body axes, yaw rate + bow to starboard."""

    accel_fwd_m_s2: float
    accel_stb_m_s2: float
    yaw_rate_deg_s: float


Reading = FixReading | HeadingReading | ImuReading


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
    use: tuple[Annotated[str, OneOf(IMU_AXES)], ...] = _TABLE.use


@dataclass(frozen=True, slots=True, kw_only=True)
class Rates:
    """Samples a second. GPS and compass begin at t = 0, the IMU with its first whole interval."""

    gps_hz: float = 1.0
    compass_hz: float = 10.0
    imu_hz: float = 20.0
