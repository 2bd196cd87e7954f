"""Readings as the board would have them: measurements, rounded (quantised) as each model prints its values.

What an encoder of `onboard.devices` prints and its driver reads back is this, value for value; a test holds both equal.
So benches may leave out ports, lines and drivers and still see what a device's digits leave.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

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
COURSE_ABOVE_KN: Final = 1.0
"""Below this speed the course of a receiver is not taken."""
DAY_MS: Final = 86_400_000


class Prints(NamedTuple):
    """What a model of compass prints beside the heading."""

    decimals: int = 1
    """Most decimals of the heading."""
    tilt: Literal["none", "beside", "apart"] = "none"
    """Pitch and roll: not printed, in the same line, or in sentences of their own, as the rate of turn is."""
    disturbed: str | None = None
    """Warning that a disturbed magnetic field leads to."""


COMPASSES: Final = {
    "nmea": Prints(decimals=3, tilt="apart"),
    "hsc100": Prints(decimals=3),
    "tcm2": Prints(tilt="beside", disturbed="E001"),
    "hmr3000": Prints(tilt="beside", disturbed="heading O"),
    "kvh-c100": Prints(),
}
"""Models of compass by their name in the boat's file; one that is not here prints a heading to a tenth."""


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
                return self._fix(t_s, t_ns, reading)
            case HeadingReading():
                return self._heading(t_ns, reading)
            case ImuReading():
                return self._sample(t_ns, reading)
            case TurnRateReading():
                return iter((TurnRate(sensor=name, t_ns=t_ns, rate_deg_s=round(reading.rate_deg_s, 3)),))
            case AisReading():
                return iter((AisLine(sensor=name, t_ns=t_ns, text=reading.sentence),))
            case RadarReading():
                return self._target(t_s, t_ns, reading)

    def _utc_ms(self, t_s: float) -> int:
        return round((self.utc_start_ns + t_s * NS_PER_S) / NS_PER_MS)

    def _fix(self, t_s: float, t_ns: int, reading: FixReading) -> Iterator[Measurement]:
        utc_ms = self._utc_ms(t_s - reading.late_s)
        utc_ns = utc_ms * NS_PER_MS
        void = Fix(
            sensor=self.sensor.id,
            t_ns=t_ns,
            fix_quality=reading.quality,
            status_valid=reading.quality > 0,
            satellites=reading.satellites,
            tod_ms=utc_ms % DAY_MS,
        )
        if not reading.quality:
            yield void
            return
        sog_kn, cog_deg = _over_ground(reading)
        yield replace(
            void,
            lat_deg=rounded_minutes(reading.lat_deg, reading.minute_decimals),
            lon_deg=rounded_minutes(reading.lon_deg, reading.minute_decimals),
            hdop=_rounded(reading.hdop, 1),
            sog_kn=sog_kn,
            cog_true_deg=cog_deg,
            sigma_east_m=_rounded(reading.sigma_east_m, 3),
            sigma_north_m=_rounded(reading.sigma_north_m, 3),
            utc_ns=utc_ns,
        )
        yield ClockPair(sensor=self.sensor.id, t_ns=t_ns, utc_ns=utc_ns, source="RMC")

    def _heading(self, t_ns: int, reading: HeadingReading) -> Iterator[Measurement]:
        name, prints = self.sensor.id, COMPASSES.get(self.sensor.model, Prints())
        magnetic_deg = wrap_deg(reading.heading_true_deg - self.variation_deg)
        heading = Heading(
            sensor=name,
            t_ns=t_ns,
            heading_mag_deg=wrap_deg(round(magnetic_deg, min(reading.decimals, prints.decimals))),
            warning=prints.disturbed if reading.disturbed else None,
        )
        pitch_deg, roll_deg = _rounded(reading.pitch_deg, 1), _rounded(reading.roll_deg, 1)
        if prints.tilt == "beside":
            heading = replace(heading, pitch_deg=pitch_deg, roll_deg=roll_deg)
        yield heading
        if prints.tilt != "apart":
            return
        if reading.turn_rate_deg_s is not None:
            yield TurnRate(sensor=name, t_ns=t_ns, rate_deg_s=round(reading.turn_rate_deg_s * 60.0, 1) / 60.0)
        if pitch_deg is not None or roll_deg is not None:
            yield Attitude(sensor=name, t_ns=t_ns, pitch_deg=pitch_deg, roll_deg=roll_deg)

    def _sample(self, t_ns: int, reading: ImuReading) -> Iterator[Measurement]:
        """The unit's own yaw, which no filter uses, is left out; a unit that reckons no attitude prints a level one."""
        yield ImuSample(
            self.sensor.id,
            t_ns,
            -_counted(-reading.accel_fwd_m_s2, COUNTS_PER_M_S2),
            -_counted(-reading.accel_stb_m_s2, COUNTS_PER_M_S2),
            _counted(reading.yaw_rate_deg_s, COUNTS_PER_DEG_S),
        )
        roll_deg, pitch_deg = round(reading.roll_deg or 0.0, 2), round(reading.pitch_deg or 0.0, 2)
        yield Attitude(sensor=self.sensor.id, t_ns=t_ns, roll_deg=roll_deg, pitch_deg=pitch_deg)

    def _target(self, t_s: float, t_ns: int, reading: RadarReading) -> Iterator[Measurement]:
        """A target with a place has a sentence for it; range and bearing, and a lost target, another one."""
        bare = RadarTarget(
            sensor=self.sensor.id,
            t_ns=t_ns,
            number=reading.number,
            name=reading.name or None,
            status=reading.status,
            tod_ms=self._utc_ms(t_s) // 1000 * 1000 % DAY_MS,
        )
        has_place = reading.lat_deg is not None and reading.lon_deg is not None
        if reading.range_m is not None or not has_place:
            mile_m = METRES_PER_NAUTICAL_MILE
            tracked = reading.status == "tracking" and reading.sog_m_s is not None
            sog_kn = round(reading.sog_m_s / M_S_PER_KN, 1) if tracked and reading.sog_m_s is not None else None
            yield replace(
                bare,
                range_m=None if reading.range_m is None else round(reading.range_m / mile_m, 2) * mile_m,
                bearing_true_deg=_direction(reading.bearing_true_deg),
                sog_kn=sog_kn,
                course_true_deg=_direction(reading.course_true_deg) if sog_kn else None,
            )
        if reading.lat_deg is not None and reading.lon_deg is not None:
            lat_deg, lon_deg = rounded_minutes(reading.lat_deg, 4), rounded_minutes(reading.lon_deg, 4)
            yield replace(bare, lat_deg=lat_deg, lon_deg=lon_deg)


def _over_ground(reading: FixReading) -> tuple[float | None, float | None]:
    """(SOG in kn, COG in deg) to two decimals; `None` where the receiver measured no velocity or hardly moves."""
    if reading.v_east_m_s is None or reading.v_north_m_s is None:
        return None, None
    sog_kn = round(math.hypot(reading.v_east_m_s, reading.v_north_m_s) / M_S_PER_KN, 2)
    cog_deg = wrap_deg(math.degrees(math.atan2(reading.v_east_m_s, reading.v_north_m_s)))
    return sog_kn, wrap_deg(round(cog_deg, 2)) if sog_kn >= COURSE_ABOVE_KN else None


def rounded_minutes(angle_deg: float, decimals: int) -> float:
    """An angle whose minutes are printed with so many decimals, summed up as a driver does: equal to the last bit."""
    units = 10**decimals
    degrees, rest = divmod(round(abs(angle_deg) * 60 * units), 60 * units)
    return math.copysign(degrees + (rest / units) / 60.0, angle_deg)


def _counted(value: float, per_unit: float) -> float:
    """What a 16-bit converter leaves: whole counts, and no more of them than it has."""
    return max(-32768, min(32767, round(value * per_unit))) / per_unit


def _rounded(value: float | None, decimals: int) -> float | None:
    return None if value is None else round(value, decimals)


def _direction(value: float | None) -> float | None:
    """Whole tenths of a degree in [0, 360)."""
    return None if value is None else wrap_deg(round(value, 1))
