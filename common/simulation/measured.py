"""Readings as the board would have them: measurements, rounded (quantised) as each model prints its values.

What an encoder of `onboard.devices` prints and its driver reads back is this, value for value; a test holds both equal.
So benches may leave out ports, lines and drivers and still see what a device's digits leave.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from common.angles import wrap_deg
from common.boat_config import SensorTable
from common.framer import ImuSample, Measurement
from common.messages import AisLine, Attitude, ClockPair, Fix, Heading, RadarTarget, TurnRate
from common.simulation.readings import (
    AisReading,
    FixReading,
    HeadingReading,
    ImuReading,
    RadarReading,
    Reading,
    TurnRateReading,
)
from common.units import M_S_PER_KN, METRES_PER_NAUTICAL_MILE, NS_PER_MS, NS_PER_S, STANDARD_GRAVITY_M_S2

COUNTS_PER_M_S2: Final = 4096 / STANDARD_GRAVITY_M_S2
"""Counts of an ArduIMU V3's accelerometer (MPU-6000 at +-8 g, firmware 1.9) for 1 m/s^2."""
COUNTS_PER_DEG_S: Final = 16.4
"""Counts of its gyro for 1 deg/s (+-2000 deg/s)."""
DAY_MS: Final = 86_400_000


@dataclass(frozen=True, slots=True)
class Measured:
    """Makes measurements of one sensor's readings."""

    sensor: SensorTable
    variation_deg: float
    """Variation where the boat sails, deg, east +: a magnetic compass shows true less variation and deviation."""
    utc_start_ns: int
    """Universal time at the start of the voyage, ns since 1970."""

    def measurements(self, t_s: float, t_ns: int, reading: Reading) -> Iterator[Measurement]:
        """What a driver would give for a reading of voyage time `t_s` that the board stamps `t_ns`."""
        name = self.sensor.id
        match reading:
            case FixReading():
                yield from self._fix(t_s, t_ns, reading)
            case HeadingReading():
                yield from self._heading(t_ns, reading)
            case ImuReading():
                yield ImuSample(
                    name,
                    t_ns,
                    _counted(reading.accel_fwd_m_s2, COUNTS_PER_M_S2),
                    _counted(reading.accel_stb_m_s2, COUNTS_PER_M_S2),
                    _counted(reading.yaw_rate_deg_s, COUNTS_PER_DEG_S),
                )
                if reading.roll_deg is not None and reading.pitch_deg is not None:
                    roll_deg, pitch_deg = round(reading.roll_deg, 2), round(reading.pitch_deg, 2)
                    yield Attitude(sensor=name, t_ns=t_ns, roll_deg=roll_deg, pitch_deg=pitch_deg)
            case TurnRateReading():
                yield TurnRate(sensor=name, t_ns=t_ns, rate_deg_s=round(reading.rate_deg_s, 3))
            case AisReading():
                yield AisLine(sensor=name, t_ns=t_ns, text=reading.sentence)
            case RadarReading():
                yield self._target(t_ns, reading)

    def _fix(self, t_s: float, t_ns: int, reading: FixReading) -> Iterator[Measurement]:
        utc_ms = round((self.utc_start_ns + (t_s - reading.late_s) * NS_PER_S) / NS_PER_MS)
        utc_ns = utc_ms * NS_PER_MS
        is_valid = reading.quality > 0
        sog_kn, cog_deg = over_ground(reading)
        yield Fix(
            sensor=self.sensor.id,
            t_ns=t_ns,
            lat_deg=rounded_minutes(reading.lat_deg, reading.minute_decimals) if is_valid else None,
            lon_deg=rounded_minutes(reading.lon_deg, reading.minute_decimals) if is_valid else None,
            fix_quality=reading.quality,
            status_valid=is_valid,
            satellites=reading.satellites,
            hdop=None if reading.hdop is None else round(reading.hdop, 1),
            sog_kn=sog_kn if is_valid else None,
            cog_true_deg=cog_deg if is_valid else None,
            utc_ns=utc_ns,
            tod_ms=utc_ms % DAY_MS,
        )
        if is_valid:
            yield ClockPair(sensor=self.sensor.id, t_ns=t_ns, utc_ns=utc_ns, source="RMC")

    def _heading(self, t_ns: int, reading: HeadingReading) -> Iterator[Measurement]:
        name = self.sensor.id
        magnetic_deg = wrap_deg(reading.heading_true_deg - self.variation_deg)
        shown_deg = wrap_deg(round(magnetic_deg, reading.decimals))
        pitch_deg, roll_deg = _tenths(reading.pitch_deg), _tenths(reading.roll_deg)
        is_apart = self.sensor.model == "nmea"  # attitude and rate come in sentences of their own
        yield Heading(
            sensor=name,
            t_ns=t_ns,
            heading_mag_deg=shown_deg,
            pitch_deg=None if is_apart else pitch_deg,
            roll_deg=None if is_apart else roll_deg,
        )
        if is_apart and reading.turn_rate_deg_s is not None:
            yield TurnRate(sensor=name, t_ns=t_ns, rate_deg_s=round(reading.turn_rate_deg_s * 60.0, 1) / 60.0)
        if is_apart and (pitch_deg is not None or roll_deg is not None):
            yield Attitude(sensor=name, t_ns=t_ns, pitch_deg=pitch_deg, roll_deg=roll_deg)

    def _target(self, t_ns: int, reading: RadarReading) -> RadarTarget:
        mile = METRES_PER_NAUTICAL_MILE
        is_moving = reading.sog_m_s is not None and reading.status == "tracking"
        sog_kn = None if reading.sog_m_s is None or not is_moving else round(reading.sog_m_s / M_S_PER_KN, 1)
        return RadarTarget(
            sensor=self.sensor.id,
            t_ns=t_ns,
            number=reading.number,
            range_m=None if reading.range_m is None else round(reading.range_m / mile, 3) * mile,
            bearing_true_deg=_tenths(reading.bearing_true_deg),
            sog_kn=sog_kn,
            course_true_deg=_tenths(reading.course_true_deg) if sog_kn else None,
            lat_deg=None if reading.lat_deg is None else rounded_minutes(reading.lat_deg, 3),
            lon_deg=None if reading.lon_deg is None else rounded_minutes(reading.lon_deg, 3),
            name=reading.name or None,
            status=reading.status,
        )


def over_ground(reading: FixReading) -> tuple[float | None, float | None]:
    """(SOG in kn, COG in deg) to two decimals; `None` where the receiver measured no velocity."""
    if reading.v_east_m_s is None or reading.v_north_m_s is None:
        return None, None
    sog_kn = math.hypot(reading.v_east_m_s, reading.v_north_m_s) / M_S_PER_KN
    cog_deg = math.degrees(math.atan2(reading.v_east_m_s, reading.v_north_m_s))
    return round(sog_kn, 2), wrap_deg(round(wrap_deg(cog_deg), 2))


def rounded_minutes(angle_deg: float, decimals: int) -> float:
    """An angle whose minutes are printed with so many decimals."""
    units = 60 * 10**decimals
    return float(round(angle_deg * units) / units)


def _counted(value: float, per_unit: float) -> float:
    """What a 16-bit converter leaves: whole counts, and no more of them than it has."""
    return max(-32768, min(32767, round(value * per_unit))) / per_unit


def _tenths(value: float | None) -> float | None:
    return None if value is None else round(value, 1)
