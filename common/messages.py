"""Message schema: the frozen, slotted dataclasses that both sides share.

Conventions (docs/signs-and-units.md): `None` = not available, never 0 or NaN; degrees at this interface;
`t_ns` = int nanoseconds on the boat clock when the measurement was valid; latitude north +, longitude east +;
headings clockwise from north; roll + starboard down, pitch + bow up; rate of turn + bow to starboard; variation and
deviation east +; body axes forward, starboard, down.

Ranges stand in the annotations and are checked by the codec on both ends. Fields without a default are required on the
wire and are never added within a schema version; fields with a default may be added at any time (an old reader ignores
them, a new reader fills them in).
"""

from dataclasses import dataclass, field
from typing import Annotated, Final

from common.field_bounds import MaxLength, OneOf, Range

Latitude = Annotated[float, Range(-90.0, 90.0)]
Longitude = Annotated[float, Range(-180.0, 180.0)]
Direction = Annotated[float, Range(0.0, 360.0)]
SignedAngle = Annotated[float, Range(-180.0, 180.0)]
Speed = Annotated[float, Range(0.0, 1000.0)]
Dilution = Annotated[float, Range(0.0, 100.0)]
PositionSigma = Annotated[float, Range(0.001, 1000.0)]
TimeOfDayMs = Annotated[int, Range(0, 86_401_000)]
SensorId = Annotated[str, MaxLength(32)]
Sentence = Annotated[str, MaxLength(512)]
UtcNs = Annotated[int, Range(0, 2**63 - 1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix:
    """One position solution: one for each receiver epoch (same UTC hhmmss.sss). A void fix has no position."""

    sensor: SensorId
    t_ns: int
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    alt_m: float | None = None
    """Height above mean sea level, m."""
    fix_quality: Annotated[int, Range(0, 9)] | None = None
    """GGA (GNS in the same numbers): 0 none, 1 GPS, 2 DGPS, 3 PPS, 4 RTK fixed, 5 RTK float, 6 estimated, 7 manual,
    8 simulator."""
    fix_mode: Annotated[int, Range(1, 3)] | None = None
    """Mode of the fix from GSA: 1 none, 2 = 2D, 3 = 3D."""
    status_valid: bool | None = None
    """RMC (or GLL) status: True A, False V."""
    satellites: Annotated[int, Range(0, 200)] | None = None
    hdop: Dilution | None = None
    pdop: Dilution | None = None
    vdop: Dilution | None = None
    sog_kn: Speed | None = None
    cog_true_deg: Direction | None = None
    """Undefined near zero speed: some receivers freeze it there."""
    utc_ns: UtcNs | None = None
    """UTC of the epoch, where the receiver gave a date."""
    tod_ms: TimeOfDayMs | None = None
    """UTC time of day of the epoch; 86,400,000 and above = the leap second 23:59:60."""
    held: bool = False
    """True when the receiver repeated its last position under a new time: the fix is kept, never fused."""
    sigma_east_m: PositionSigma | None = None
    """1-sigma toward east that the receiver claims of its position (GST), m; never without `sigma_north_m`."""
    sigma_north_m: PositionSigma | None = None

    @property
    def usable(self) -> bool:
        """May a filter take the position? Not when void, held, estimated, manual, simulated or under RMC status V.

        Nor one of 0, 0, which devices fill in that know no place.
        """
        return (
            self.lat_deg is not None
            and self.lon_deg is not None
            and not self.held
            and self.status_valid is not False
            and self.fix_quality not in (0, 6, 7, 8)
            and self.fix_mode != 1
            and not self.is_zero
        )

    @property
    def is_zero(self) -> bool:
        """True = the position is 0, 0 to the last digit."""
        return self.lat_deg == 0.0 and self.lon_deg == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuBlock:
    """All samples of one IMU in a frame, in columns; a sample covers the interval that ends at its time.

    Columns have one entry for each sample and travel as little-endian f32 (times: u32 microseconds after `t_ns`).
    The means are over the block (the journal paper's section 5 averages 50 Hz over a filter step); the sums run since
    the daemon's start, so that the difference of two blocks bridges any frames missing between them.
    """

    sensor: SensorId
    t_ns: int
    """Time of the first sample."""
    offset_us: tuple[int, ...]
    accel_fwd_m_s2: tuple[float, ...]
    accel_stb_m_s2: tuple[float, ...]
    yaw_rate_deg_s: tuple[float, ...]
    mean_accel_fwd_m_s2: float | None = None
    mean_accel_stb_m_s2: float | None = None
    mean_yaw_rate_deg_s: float | None = None
    sum_accel_fwd_m_s: float = 0.0
    """Integral of the forward acceleration since start."""
    sum_accel_stb_m_s: float = 0.0
    sum_yaw_deg: float = 0.0
    sum_count: Annotated[int, Range(0, None)] = 0
    """Number of samples since start."""
    sum_time_s: Annotated[float, Range(0.0, None)] = 0.0
    """Seconds covered by the integrals; gaps are not covered."""

    @property
    def sample_t_ns(self) -> tuple[int, ...]:
        """Time of each sample on the boat clock."""
        return tuple(self.t_ns + 1000 * offset for offset in self.offset_us)


@dataclass(frozen=True, slots=True, kw_only=True)
class Heading:
    """One compass reading: magnetic or true, never both."""

    sensor: SensorId
    t_ns: int
    heading_mag_deg: Direction | None = None
    heading_true_deg: Direction | None = None
    deviation_deg: SignedAngle | None = None
    """As sent by the device (HDG), east +; `None` = not programmed there."""
    variation_deg: SignedAngle | None = None
    pitch_deg: SignedAngle | None = None
    roll_deg: SignedAngle | None = None
    field_ut: Annotated[float, Range(0.0, 10_000.0)] | None = None
    """Strength of the magnetic field, microtesla."""
    temperature_c: Annotated[float, Range(-100.0, 200.0)] | None = None
    warning: Annotated[str, MaxLength(64)] | None = None
    """The device's own warning in its own letters (distortion flag, status letter)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnRate:
    """Rate of turn of a compass or gyro, + bow to starboard."""

    sensor: SensorId
    t_ns: int
    rate_deg_s: Annotated[float, Range(-4000.0, 4000.0)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude:
    """Attitude and magnetometer of an IMU. `yaw_deg` is the IMU's own estimate, not a compass heading."""

    sensor: SensorId
    t_ns: int
    roll_deg: SignedAngle | None = None
    pitch_deg: SignedAngle | None = None
    yaw_deg: SignedAngle | None = None
    mag_fwd_counts: float | None = None
    mag_stb_counts: float | None = None
    mag_down_counts: float | None = None
    warning: Annotated[str, MaxLength(64)] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockPair:
    """The boat clock and UTC at the same instant, from a valid RMC or ZDA (arrival less the receiver's latency)."""

    sensor: SensorId
    t_ns: int
    utc_ns: UtcNs
    source: Annotated[str, MaxLength(16)]


@dataclass(frozen=True, slots=True, kw_only=True)
class AisLine:
    """One AIS sentence with a right checksum; decoding is done ashore."""

    sensor: SensorId
    t_ns: int
    text: Sentence


@dataclass(frozen=True, slots=True, kw_only=True)
class RadarTarget:
    """One target of a radar's own tracker (TTM or TLL), units already converted."""

    sensor: SensorId
    t_ns: int
    number: Annotated[int, Range(0, 9999)]
    range_m: Annotated[float, Range(0.0, 1e6)] | None = None
    bearing_true_deg: Direction | None = None
    bearing_rel_deg: Direction | None = None
    """Bearing relative to the bow, deg, clockwise."""
    sog_kn: Speed | None = None
    course_true_deg: Direction | None = None
    course_rel_deg: Direction | None = None
    cpa_m: Annotated[float, Range(0.0, 1e6)] | None = None
    tcpa_s: float | None = None
    """Time to the closest point of approach, s; negative = already passed."""
    lat_deg: Latitude | None = None
    lon_deg: Longitude | None = None
    name: Annotated[str, MaxLength(64)] | None = None
    status: Annotated[str, OneOf(("lost", "acquiring", "tracking"))] | None = None
    tod_ms: TimeOfDayMs | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RawLine:
    """A sentence as it came (GPS, AIS, TTM), so that the shore can decode it again.

    One that came without checksum (`checksum = "optional"`) has been given one.
    """

    sensor: SensorId
    t_ns: int
    text: Sentence


SENSOR_STATES: Final = ("delivering", "silent", "missing")
"""Delivering; port open but nothing good within stale-after; port not open (reason says why)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorHealth:
    """Health of one sensor: sent once a second and on every change of state."""

    sensor: SensorId
    t_ns: int
    state: Annotated[str, OneOf(SENSOR_STATES)]
    reason: Annotated[str, MaxLength(256)] | None = None
    last_good_t_ns: int | None = None
    """Boat time of the last accepted line, ns; `None` = none since start."""
    rate_hz: Annotated[float, Range(0.0, None)] | None = None
    """Rate of accepted measurements over the last seconds, Hz."""
    flooded: bool = False
    """True when the port exceeds its byte budget; the surplus is read and thrown away."""
    accepted: Annotated[int, Range(0, None)] = 0
    """Number of lines accepted since start."""
    unchecked: Annotated[int, Range(0, None)] = 0
    """How many of these had no checksum (`checksum = "optional"`)."""
    rejected: dict[str, int] = field(default_factory=dict)
    """Number of lines rejected since start, by reason."""
    discarded_bytes: Annotated[int, Range(0, None)] = 0


LEVELS: Final = ("debug", "info", "warning", "error")


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something a person should know, on either side; codes stand in `common.event_kinds`."""

    t_ns: int
    source: SensorId
    """The sensor or part concerned: `gps1`, `link`, `daemon`, `filter`."""
    code: Annotated[str, MaxLength(48)]
    level: Annotated[str, OneOf(LEVELS)]
    text: Annotated[str, MaxLength(512)]
    evidence: dict[str, str | int | float | bool | None] = field(default_factory=dict)


UTC_SOURCES: Final = ("none", "rtc", "ntp", "gnss", "pps")


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """What became known in [t0_ns, t1_ns), each measurement with its own time, which may lie before t0_ns.

    Identity is (boot_id, seq).
    """

    boat_id: Annotated[str, MaxLength(64)]
    boot_id: Annotated[str, MaxLength(16)]
    """16 hex digits drawn at each start of the daemon."""
    seq: Annotated[int, Range(0, 2**53)]
    """Board frames count from 0 at each start."""
    clock_id: Annotated[str, MaxLength(64)]
    """Identity of the clock: times with an equal clock_id can be compared."""
    start_no: Annotated[int, Range(0, 2**53)]
    t0_ns: int
    t1_ns: int
    first_seq: Annotated[int, Range(0, 2**53)] | None = None
    """Set on a frame merged from several board frames (`run` with a period): their first seq; `seq` is their last."""
    utc_ns: UtcNs | None = None
    """UTC of t0_ns, ns since 1970; `None` = not known."""
    utc_unc_ns: Annotated[int, Range(0, 2**63 - 1)] | None = None
    utc_src: Annotated[str, OneOf(UTC_SOURCES)] = "none"
    clk_epoch: Annotated[int, Range(0, 2**53)] = 0
    """Number of steps so far of the mapping from boat clock to UTC."""
    fixes: tuple[Fix, ...] = ()
    imu: tuple[ImuBlock, ...] = ()
    headings: tuple[Heading, ...] = ()
    turn_rates: tuple[TurnRate, ...] = ()
    attitudes: tuple[Attitude, ...] = ()
    clock_pairs: tuple[ClockPair, ...] = ()
    ais: tuple[AisLine, ...] = ()
    radar: tuple[RadarTarget, ...] = ()
    raw: tuple[RawLine, ...] = ()
    health: tuple[SensorHealth, ...] = ()
    events: tuple[Event, ...] = ()

    @property
    def first(self) -> int:
        """The first board frame that this one covers; `seq` is the last."""
        return self.seq if self.first_seq is None else self.first_seq

    @property
    def seqs(self) -> range:
        """All board frames that this one covers."""
        return range(self.first, self.seq + 1)
