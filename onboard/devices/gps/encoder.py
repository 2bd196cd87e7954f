"""NMEA GNSS receiver as an encoder (receiver simulation): GGA, GSA and RMC once an epoch like a BU-353, then GST.

GST is sent where the reading has sigmas: minor and major axis lie along north and east, the residuals and the height
are not known. Quality 0 is a void epoch: no place, no dilutions, GSA 1, RMC status V, no GST; the clock goes on.
"""

import math
from typing import TYPE_CHECKING, Final

from common.angles import wrap_deg
from common.boat_config import SensorTable
from common.units import M_S_PER_KN
from onboard.devices.encoder import Surroundings, day_and_clock, fixed, place, sealed

if TYPE_CHECKING:
    from common.simulation.readings import FixReading

_MODE_OF_QUALITY: Final = {0: "N", 1: "A", 2: "D", 3: "P", 4: "R", 5: "F", 6: "E", 7: "M", 8: "S"}
"""Letters of RMC (NMEA 2.3 and later) for the qualities of GGA."""
_IN_VIEW: Final = ("17", "28", "06", "01", "30", "20", "26", "13", "03", "11", "19", "23")
"""Satellites in use, first to last; GSA has places for twelve."""
_PDOP_PER_HDOP: Final = 1.8 / 1.1
_VDOP_PER_HDOP: Final = 1.5 / 1.1
"""Other dilutions, as a BU-353 under an open sky showed them beside its HDOP of 1.1."""


class GpsEncoder:
    """One receiver; its talker is the first of its table, else GP. Its height is always 2.5 m."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        self._around = around
        self._talker = table.talkers[0] if table.talkers else "GP"

    def encode(self, t_s: float, reading: "FixReading") -> bytes:
        """All sentences of one epoch; their UTC is that of the position, which may be older than `t_s`."""
        day, clock = day_and_clock(self._around.utc_ms(t_s - reading.late_s))
        used = f"{reading.satellites:02d}"
        if reading.quality == 0:
            bodies: tuple[str, ...] = (
                f"GGA,{clock},,,,,0,{used},,,M,,M,,0000",
                "GSA,A,1,,,,,,,,,,,,,,,",
                f"RMC,{clock},V,,,,,,,{day},,,N",
            )
        else:
            where = place(reading.lat_deg, reading.lon_deg, reading.minute_decimals)
            quality, mode = reading.quality, _MODE_OF_QUALITY[reading.quality]
            bodies = (
                f"GGA,{clock},{where},{quality},{used},{fixed(reading.hdop, 1)},2.5,M,47.0,M,,0000",
                f"GSA,A,3,{_satellites(reading)},{_dilutions(reading.hdop)}",
                f"RMC,{clock},A,{where},{_over_ground(reading)},{day},,,{mode}",
                *_claimed(clock, reading),
            )
        return b"".join(sealed(self._talker + body) for body in bodies)


def _satellites(reading: "FixReading") -> str:
    in_use = _IN_VIEW[: reading.satellites]
    return ",".join((*in_use, *[""] * (len(_IN_VIEW) - len(in_use))))


def _dilutions(hdop: float | None) -> str:
    if hdop is None:
        return ",,"
    return f"{hdop * _PDOP_PER_HDOP:.1f},{hdop:.1f},{hdop * _VDOP_PER_HDOP:.1f}"


def _over_ground(reading: "FixReading") -> str:
    """SOG in kn and COG in deg, two decimals each; empty where the receiver measured no velocity."""
    if reading.v_east_m_s is None or reading.v_north_m_s is None:
        return ","
    sog_kn = math.hypot(reading.v_east_m_s, reading.v_north_m_s) / M_S_PER_KN
    cog_deg = math.degrees(math.atan2(reading.v_east_m_s, reading.v_north_m_s))
    return f"{sog_kn:.2f},{wrap_deg(round(wrap_deg(cog_deg), 2)):.2f}"


def _claimed(clock: str, reading: "FixReading") -> tuple[str, ...]:
    """GST, 1-sigma in m to three decimals, or nothing; the angle is that of the major axis from north."""
    east_m, north_m = reading.sigma_east_m, reading.sigma_north_m
    if east_m is None or north_m is None:
        return ()
    major_m, minor_m, angle = (east_m, north_m, "90.0") if east_m > north_m else (north_m, east_m, "0.0")
    return (f"GST,{clock},,{major_m:.3f},{minor_m:.3f},{angle},{north_m:.3f},{east_m:.3f},",)
