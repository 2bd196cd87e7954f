"""Device encoders: a reading becomes the bytes a real device would send, and the values those bytes still hold.

Layouts are those of real devices: BU-353 receiver, HSC100 compass, ArduIMU V3. Every value is rounded to the
device's own resolution; `Encoded.values` tells what a decoder can get back, under the names of `common.messages`.
"""

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from common.angles import wrap_deg
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading
from common.units import M_S_PER_KN, NS_PER_MS, NS_PER_S, STANDARD_GRAVITY_M_S2

COUNTS_PER_G: Final = 4096
"""Counts of the accelerometer for 1 g: ArduIMU V3 (MPU-6000 at +-8 g), firmware 1.9."""
COUNTS_PER_DEG_S: Final = 16.4
"""Counts of the gyro for 1 deg/s: ArduIMU V3 at +-2000 deg/s."""
_COUNTS_PER_M_S2: Final = COUNTS_PER_G / STANDARD_GRAVITY_M_S2

Values = dict[str, float | int | None]


@dataclass(frozen=True, slots=True)
class Encoded:
    """One measurement as bytes: one line, or all sentences of a receiver's epoch."""

    data: bytes
    kind: str
    """Class name of the measurement a decoder makes of it."""
    values: Values


def nmea(body: str) -> bytes:
    """`body` between `$` and checksum (exclusive or of its bytes), line end included."""
    checksum = 0
    for byte in body.encode("ascii"):
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode("ascii")


def _angle(angle_deg: float, degree_digits: int, decimals: int, letters: str) -> tuple[str, float]:
    """`(d)ddmm.mmmm,H` and the degrees it stands for. Rounding comes before the split, so minutes never read 60."""
    units = 10**decimals
    total = round(abs(angle_deg) * 60 * units)
    degrees, rest = divmod(total, 60 * units)
    whole, fraction = divmod(rest, units)
    negative = angle_deg < 0 and total > 0
    text = f"{degrees:0{degree_digits}d}{whole:02d}.{fraction:0{decimals}d},{letters[negative]}"
    value = degrees + (rest / units) / 60
    return text, -value if negative else value


@dataclass(frozen=True, slots=True)
class GpsEncoder:
    """GGA + GSA + RMC once an epoch, like a BU-353. Quality is 1 (GPS): no filter would take 8 (simulator)."""

    utc_start_ns: int
    """UTC of t = 0, ns since 1970, whole milliseconds."""
    decimals: int = 5
    """Decimals of the minutes: 5 = 2 cm; 4 = 19 cm, the real BU-353."""
    talker: str = "GP"

    def encode(self, t_s: float, reading: FixReading) -> Encoded:
        """All sentences of the epoch at `t_s`."""
        utc_ms = round((self.utc_start_ns + t_s * NS_PER_S) / NS_PER_MS)
        utc = datetime.fromtimestamp(utc_ms // 1000, tz=UTC)
        clock = f"{utc:%H%M%S}.{utc_ms % 1000:03d}"
        lat, lat_deg = _angle(reading.lat_deg, 2, self.decimals, "NS")
        lon, lon_deg = _angle(reading.lon_deg, 3, self.decimals, "EW")
        sog_kn, cog_deg = _over_ground(reading)
        sog = "" if sog_kn is None else f"{sog_kn:.2f}"
        cog = "" if cog_deg is None else f"{cog_deg:.2f}"
        data = (
            nmea(f"{self.talker}GGA,{clock},{lat},{lon},1,08,1.1,2.5,M,47.0,M,,0000")
            + nmea(f"{self.talker}GSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5")
            + nmea(f"{self.talker}RMC,{clock},A,{lat},{lon},{sog},{cog},{utc:%d%m%y},,,A")
        )
        values: Values = {"lat_deg": lat_deg, "lon_deg": lon_deg, "sog_kn": sog_kn, "cog_true_deg": cog_deg}
        return Encoded(data, "Fix", {**values, "utc_ns": utc_ms * NS_PER_MS})


def _over_ground(reading: FixReading) -> tuple[float | None, float | None]:
    """(SOG in kn, COG in deg) to two decimals; `None` where the receiver measured no velocity."""
    if reading.v_east_m_s is None or reading.v_north_m_s is None:
        return None, None
    sog_kn = math.hypot(reading.v_east_m_s, reading.v_north_m_s) / M_S_PER_KN
    cog_deg = math.degrees(math.atan2(reading.v_east_m_s, reading.v_north_m_s))
    return round(sog_kn, 2), wrap_deg(round(wrap_deg(cog_deg), 2))


@dataclass(frozen=True, slots=True)
class CompassEncoder:
    """`$HCHDG,123.4,,,,*46`, like an HSC100: magnetic heading to 0.1 deg, deviation and variation always empty."""

    variation_deg: float
    """Variation, deg, east +: magnetic = true - variation."""

    def encode(self, t_s: float, reading: HeadingReading) -> Encoded:  # noqa: ARG002 - every encoder is handed the time
        """One HDG sentence."""
        magnetic = wrap_deg(round(wrap_deg(reading.heading_true_deg - self.variation_deg), 1))
        return Encoded(nmea(f"HCHDG,{magnetic:05.1f},,,,"), "Heading", {"heading_mag_deg": magnetic})


@dataclass(slots=True)
class ArduImuEncoder:
    """The line of an ArduIMU V3 with raw counts: AN0..2 gyro x, y, z; AN3..5 accelerometer x, y, z; no checksum.

    Axes forward, starboard, down; the firmware prints gravity, minus the specific force, so z reads +1 g at rest. `YAW`
    is the unit's own integral of its gyro from 0 (it has no magnetometer line here); `TOW:0` = no receiver attached.
    """

    _yaw_deg: float = 0.0
    _t_s: float | None = None

    def encode(self, t_s: float, reading: ImuReading) -> Encoded:
        """One line; the sample covers the interval that ends at `t_s`."""
        gyro = _counts(reading.yaw_rate_deg_s * COUNTS_PER_DEG_S)
        forward = _counts(-reading.accel_fwd_m_s2 * _COUNTS_PER_M_S2)
        starboard = _counts(-reading.accel_stb_m_s2 * _COUNTS_PER_M_S2)
        rate_deg_s = gyro / COUNTS_PER_DEG_S
        if self._t_s is not None:
            self._yaw_deg = math.remainder(self._yaw_deg + rate_deg_s * (t_s - self._t_s), 360.0)
        self._t_s = t_s
        text = (
            f"!!!VER:1.9,AN0:0,AN1:0,AN2:{gyro},AN3:{forward},AN4:{starboard},AN5:{COUNTS_PER_G},"
            f"RLL:0.00,PCH:0.00,YAW:{self._yaw_deg:.2f},IMUH:253,TOW:0***\r\n"
        )
        values: Values = {
            "accel_fwd_m_s2": -forward / _COUNTS_PER_M_S2,
            "accel_stb_m_s2": -starboard / _COUNTS_PER_M_S2,
            "yaw_rate_deg_s": rate_deg_s,
        }
        return Encoded(text.encode("ascii"), "ImuSample", values)


def _counts(value: float) -> int:
    """A 16-bit converter rounds, and saturates."""
    return max(-32768, min(32767, round(value)))


@dataclass(frozen=True, slots=True)
class BoatEncoders:
    """The three devices of the virtual boat."""

    gps: GpsEncoder
    compass: CompassEncoder
    imu: ArduImuEncoder

    def encode(self, t_s: float, reading: Reading) -> Encoded:
        """Hand the reading to the device that makes such readings."""
        match reading:
            case FixReading():
                return self.gps.encode(t_s, reading)
            case HeadingReading():
                return self.compass.encode(t_s, reading)
            case ImuReading():
                return self.imu.encode(t_s, reading)
            case _:
                raise TypeError(f"this boat has no device for a {type(reading).__name__}")
