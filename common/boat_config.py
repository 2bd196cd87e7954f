"""Sensor configuration: the table of roles, and the tables of the boat's file (sigmas, lever arms, biases, rates).

Liveness limits, frame fields and documentation derive from `ROLES`. The board's file is the only source of sensor
facts: the parsed tables travel in `connected` and into the log.
"""

from dataclasses import dataclass, field
from typing import Annotated, Final

from common.field_bounds import MaxLength, OneOf, Range


@dataclass(frozen=True, slots=True)
class Role:
    """What a role means to both sides."""

    text: str
    nominal_rate_hz: float
    """Rate that is assumed when the configuration gives no `rate_hz`, Hz."""
    periodic: bool
    """False = event sensor (AIS, radar): silence is no fault and never reopens the port."""
    kinds: tuple[str, ...]
    """Measurement types (class names of `common.messages`) that the sensor may produce."""


ROLES: Final[dict[str, Role]] = {
    "gps": Role("GNSS receiver", 1.0, True, ("Fix", "ClockPair", "RawLine")),
    "imu": Role("inertial unit: acceleration fore and athwart, yaw rate", 20.0, True, ("ImuBlock", "Attitude")),
    "gyro": Role("rate gyro", 20.0, True, ("TurnRate",)),
    "compass": Role("magnetic or true heading", 10.0, True, ("Heading", "TurnRate", "Attitude")),
    "ais": Role("AIS receiver", 1.0, False, ("AisLine",)),
    "radar": Role("marine radar's own target tracker", 1.0, False, ("RadarTarget", "RawLine")),
}


def stale_after_s(role: str, rate_hz: float | None) -> float:
    """Age at which a periodic sensor's newest value is stale: max(3 s, 5 periods); inf for event sensors."""
    if not ROLES[role].periodic:
        return float("inf")
    return max(3.0, 5.0 / (rate_hz or ROLES[role].nominal_rate_hz))


LATE_IMU_S: Final = 1.0
"""An IMU sample covers the whole interval since the one before it, up to this long: lines that wait in a busy board
come late and in a burst, they are not lost. After a longer interval there is a gap: the board's sums leave it out, the
filters let the sample cover one period of it."""

Name = Annotated[str, MaxLength(32)]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoatTable:
    """The table `[boat]`: the vessel itself."""

    id: Annotated[str, MaxLength(64)]
    variation_deg: Annotated[float, Range(-180.0, 180.0)] | None = None
    """Magnetic variation where the boat sails, east +; it goes before what a compass sends. Left out = what the compass
    sends where the World Magnetic Model agrees, else the model's, ashore."""
    current_sigma_m_s: Annotated[float, Range(0.0, 10.0)] = 0.5
    """1-sigma of the current on each axis before anything is known of it, m/s: the filters estimate it. 0 = still
    water."""
    leeway_m_s: Annotated[float, Range(0.0, 10.0)] = 0.1
    """1-sigma of the speed athwart through the water, m/s (wind, waves); 0 = the boat goes athwart at will, as a ferry
    with thrusters all around does, so that its bow says nothing about its way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesTable:
    """The table `[frames]`: the frames that the daemon makes."""

    rate_hz: Annotated[float, Range(1.0, 20.0)] = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkTable:
    """`[link]`: where the daemon listens, and what clients may ask of it."""

    bind: Annotated[str, MaxLength(128)] = "tcp://*:5760"
    max_clients: Annotated[int, Range(1, 1000)] = 32
    fill_kb_per_s: Annotated[int, Range(10, 100_000)] = 1000
    """Missing frames of all clients together, kB/s; new frames are not counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SpoolTable:
    """`[spool]`: the frames kept on the board's disk (docs/spool-format.md)."""

    max_mib: Annotated[int, Range(16, 1_000_000)] = 2048
    """Largest size of all frames that are kept, MiB; beyond it the oldest frames are removed."""
    min_free_mib: Annotated[int, Range(0, 1_000_000)] = 256
    """Free space of the file system that is left to other programs, MiB; below it the oldest frames are removed."""
    sync_s: Annotated[float, Range(0.0, 60.0)] = 1.0
    """Most seconds of frames that a power cut may cost; 0 = every frame is made durable at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PortTable:
    """`[[port]]`: one serial port; several sensors may share it."""

    name: Name
    path: Annotated[str, MaxLength(256)]
    baud: Annotated[int, Range(300, 4_000_000)] = 4800
    byte_budget_per_s: Annotated[int, Range(100, 10_000_000)] | None = None
    """Bytes a second that are parsed; the rest is discarded and the port marked flooded. Default: four times what its
    sensors nominally send, at least 2000."""


IMU_AXES: Final = ("accel_fwd", "accel_stb", "yaw_rate")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorTable:
    """`[[sensor]]`: one sensor on a port. Sigmas are 1-sigma and what the station's filters start from."""

    id: Name
    """Role + number: gps1, imu1, gyro1, compass1..4, ais1, radar1."""
    port: Name
    role: Annotated[str, OneOf(tuple(ROLES))]
    model: Name = "nmea"
    talkers: tuple[Annotated[str, MaxLength(2)], ...] = ()
    """Only sentences of these talkers (shared port); empty = all."""
    checksum: Annotated[str, OneOf(("required", "optional"))] = "required"
    """Whether NMEA sentences of this sensor need their checksum. Without one a changed digit cannot be seen; such lines
    are counted apart."""
    rate_hz: Annotated[float, Range(0.01, 1000.0)] | None = None
    latency_ms: Annotated[float, Range(0.0, 10_000.0)] = 0.0
    """Latency, ms: how long before the first byte of its (first) sentence reaches the board a measurement was valid."""
    sigma_m: Annotated[float, Range(0.001, 1000.0)] = 3.0
    """1-sigma of a GPS fix on each horizontal axis at HDOP 1, m, if single or of a quality that says nothing more.
    The station multiplies it by the HDOP; a receiver that sends GST is taken at its word instead."""
    sigma_dgps_m: Annotated[float, Range(0.001, 1000.0)] | None = None
    """The same of a differential fix (quality 2: SBAS, DGPS), m; left out = `sigma_m`."""
    sigma_rtk_m: Annotated[float, Range(0.001, 1000.0)] = 0.015
    """The same of a fixed RTK solution (quality 4), m."""
    sigma_float_m: Annotated[float, Range(0.001, 1000.0)] = 0.3
    """The same of a floating RTK solution (quality 5), m."""
    error_lasts_s: Annotated[float, Range(1.0, 36_000.0)] = 150.0
    """Time for which the lasting part of a fix' error stays alike, s (ionosphere, multipath: 60 to 600 s)."""
    sigma_deg: Annotated[float, Range(0.001, 180.0)] = 1.0
    """1-sigma of a compass heading, deg."""
    compass_bias_sigma_deg: Annotated[float, Range(0.0, 180.0)] = 2.0
    """What is left of a constant or slow error of the compass, deg (1-sigma): the filters estimate it. 0 = none."""
    compass_bias_lasts_s: Annotated[float, Range(1.0, 36_000.0)] = 100.0
    """Time for which that error stays alike, s."""
    compass_deviation_sigma_deg: Annotated[float, Range(0.0, 180.0)] = 3.0
    """What is left of the deviation, deg (1-sigma of each of its two coefficients, sin and cos of the heading): the
    filters estimate it. 0 = compensated. A heading that an autopilot has fused deserves 1."""
    accel_density: Annotated[float, Range(1e-6, 100.0)] = 0.1
    """IMU acceleration noise, m/s^2/sqrt(Hz). The default is no data sheet's (0.001 to 0.004): a hull that heels or
    trims by 0.4 deg for about a second shows 0.07 m/s^2 of gravity (0.07 sqrt(2 x 1 s) = 0.1). Regular rolling adds
    little: what it shows comes back within a period."""
    gyro_density_deg: Annotated[float, Range(1e-6, 1000.0)] = 0.2
    """IMU or gyro yaw-rate noise, deg/s/sqrt(Hz). The default covers a scale error of 1 % in a turn of 10 deg/s over
    two seconds (0.1 sqrt(2 x 2 s) = 0.2); a data sheet's own is 0.005 to 0.04."""
    bias_accel_fwd_m_s2: float = 0.0
    """Known bias of the forward accelerometer, m/s^2, subtracted ashore (thesis Eq. 3.2)."""
    bias_accel_stb_m_s2: float = 0.0
    bias_yaw_rate_deg_s: float = 0.0
    """Known bias of the yaw rate, deg/s, subtracted ashore (thesis Eq. 3.3)."""
    bias_accel_sigma_m_s2: Annotated[float, Range(0.0, 10.0)] = 0.15
    """What is left of the accelerometers' biases, each axis: the filters estimate it. 0 = calibrated, not estimated.
    The default is a consumer sensor mounted by eye: an offset of 10 mg, and 0.7 deg off level shows 0.12 m/s^2."""
    bias_accel_walk_m_s2: Annotated[float, Range(0.0, 1.0)] = 0.002
    """How fast that bias wanders: it changes by this in a second, by ten times as much in 100 s (m/s^2 / sqrt(s)).
    The default is a sensor of 1 mg/deg C that warms by 1 deg C a minute, and a list that changes by 0.1 deg in it."""
    bias_yaw_rate_sigma_deg_s: Annotated[float, Range(0.0, 50.0)] = 1.0
    """1-sigma of what is left of the yaw rate's bias, deg/s; 0 = calibrated, not estimated. The default is a consumer
    gyro that was not zeroed at rest."""
    bias_yaw_rate_walk_deg_s: Annotated[float, Range(0.0, 5.0)] = 0.005
    """How fast that bias wanders, deg/s / sqrt(s); the default is a gyro of 0.03 deg/s per deg C that warms by 1 deg C
    a minute."""
    tilt_leak_sigma_per_m: Annotated[float, Range(0.0, 2.0)] = 0.2
    """A hull that lifts its bow with speed u lets the forward accelerometer see c u |u| of gravity: 1-sigma of c, which
    the filters estimate; 0 = no such state."""
    heel_leak_sigma: Annotated[float, Range(0.0, 20.0)] = 1.5
    """A hull that heels in turns lets the starboard accelerometer see c u r of gravity (speed u, yaw rate r): 1-sigma
    of c, which the filters estimate; 0 = no such state. 1.5 is 0.15 rad of heel for each m/s^2 of u r."""
    trust_tilt: bool = False
    """True = roll and pitch of this IMU take gravity out of its accelerations: it levels itself by gyros (AHRS, INS),
    also in turns. An inclinometer shows apparent gravity, and what the boat does would be lost with it."""
    week_rollover: bool = False
    """True = the dates of this GPS are 1024 or 2048 weeks in the past (event `week-rollover`) and are repaired."""
    lever_fwd_m: Annotated[float, Range(-100.0, 100.0)] = 0.0
    """Lever arm of the GPS antenna: how far it is forward of the boat's reference point (the IMU), m."""
    lever_stb_m: Annotated[float, Range(-100.0, 100.0)] = 0.0
    """Lever arm of the GPS antenna: how far it is to starboard of that point, m."""
    deviation_deg: Annotated[float, Range(-180.0, 180.0)] | None = None
    """Compass deviation, east +: true = compass + deviation + variation. Left out = what the device sends, else 0."""
    use: tuple[Annotated[str, OneOf(IMU_AXES)], ...] = IMU_AXES
    """IMU axes the filters may use; the others are recorded only."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoatConfig:
    """The whole of the board's file, as it travels in `connected` and into the log."""

    boat: BoatTable
    frames: FramesTable = field(default_factory=FramesTable)
    link: LinkTable = field(default_factory=LinkTable)
    spool: SpoolTable = field(default_factory=SpoolTable)
    port: tuple[PortTable, ...] = ()
    sensor: tuple[SensorTable, ...] = ()

    def with_role(self, role: str) -> tuple[SensorTable, ...]:
        """The sensors of one role, in file order."""
        return tuple(sensor for sensor in self.sensor if sensor.role == role)
