"""NMEA 0183 (4.1), talker IN: GGA, RMC and HDT or THS for each estimate, as an integrated navigator sends them.

position          GGA   RMC           navigational status (behind RMC's mode)
on a fix          1     A, mode A     S safe; C caution while its 95 % radius (2 DRMS) is beyond 10 m, U beyond 100 m
coasting          6     A, mode E     C; U beyond 100 m
not valid         0     V, mode N     U; no place at all where its 1-sigma is beyond 500 m

A heading of a compass is HDT. One that is estimated (from the course over ground, or carried on) is THS with mode E;
one that is not known, or not aligned, is no sentence. A raw fix keeps its own quality, and is C, for nothing is known
of its integrity. Time and date fields are empty where UTC is not known; a recording that knew the time of day, but no
date, gives times without dates.
"""

from functools import reduce
from operator import xor
from typing import BinaryIO, Final

from common.units import NS_PER_MS, NS_PER_S
from shore.exports.track import ExportTrack, Row

TALKER: Final = "IN"
SAFE_M: Final = 10.0
"""95 % radius of a position that is safe near a coast (IMO resolution A.915: general navigation, harbour approach)."""
CAUTION_M: Final = 100.0
"""The same on the ocean; beyond it a position is unsafe."""
_MODES: Final = {2: "D", 3: "P", 4: "R", 5: "F"}
"""Modes of RMC for the qualities of a raw fix that are not plainly autonomous."""
_MINUTES: Final = 60 * 10**7
"""Number of steps of a coordinate in one degree: minutes with seven decimals."""


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """Write the track as NMEA sentences. Raises OSError."""
    has_time_of_day = track.survey.clocks.has_time_of_day
    for row in track.items():
        if isinstance(row, Row):
            time, date = times(row, has_time_of_day=has_time_of_day)
            stream.write("".join(sentences(row, time, date)).encode("ascii"))


def times(row: Row, *, has_time_of_day: bool) -> tuple[str, str]:
    """`hhmmss.sss` and `ddmmyy`, empty where they are not known."""
    from datetime import UTC, datetime

    utc_ns = row.utc_ns
    if utc_ns is None and not has_time_of_day:
        return "", ""
    total_ms = (row.t_ns if utc_ns is None else utc_ns) // NS_PER_MS
    seconds, ms = divmod(total_ms, NS_PER_S // NS_PER_MS)
    moment = datetime.fromtimestamp(seconds, UTC)
    return f"{moment:%H%M%S}.{ms:03d}", "" if utc_ns is None else f"{moment:%d%m%y}"


def sentences(row: Row, time: str, date: str) -> list[str]:
    """GGA, RMC and HDT with CR LF."""
    place = f"{_coordinate(row.lat_deg, 2, 'NS')},{_coordinate(row.lon_deg, 3, 'EW')}" if row.has_place else ",,,"
    quality, status, mode = _quality(row)
    speed, course = _number(row.sog_kn, 3), _direction(row.cog_true_deg)
    made = [
        _sentence(f"GGA,{time},{place},{quality},,,,M,,M,,"),
        _sentence(f"RMC,{time},{status},{place},{speed},{course},{date},,,{mode},{_navigational_status(row)}"),
    ]
    if row.heading_true_deg is not None and "position" in row.aligned_parts:
        if row.heading_from not in ("compass", None):
            made.append(_sentence(f"THS,{_direction(row.heading_true_deg)},E"))
        elif row.aligned:
            made.append(_sentence(f"HDT,{_direction(row.heading_true_deg)},T"))
    return made


def _quality(row: Row) -> tuple[str, str, str]:
    """Quality of GGA, status and mode of RMC."""
    match row.stretch:
        case "coasting":
            return "6", "A", "E"
        case "fix":
            quality = row.fix_quality or 1
            return str(quality), "A", _MODES.get(quality, "A")
        case _:
            return "0", "V", "N"


def _navigational_status(row: Row) -> str:
    """`S` safe, `C` caution, `U` unsafe."""
    if "position" not in row.aligned_parts:
        return "U"
    if row.sigma_m is None:
        return "C"
    radius_m = 2.0 * row.sigma_m
    if radius_m > CAUTION_M:
        return "U"
    return "S" if row.stretch == "fix" and radius_m <= SAFE_M else "C"


def _sentence(text: str) -> str:
    body = f"{TALKER}{text}"
    return f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n"


def _coordinate(value_deg: float, digits: int, sides: str) -> str:
    """`ddmm.mmmmmmm,N`: rounded as a whole, so that there are never 60 minutes."""
    degrees, steps = divmod(round(abs(value_deg) * _MINUTES), _MINUTES)
    minutes, decimals = divmod(steps, 10**7)
    return f"{degrees:0{digits}d}{minutes:02d}.{decimals:07d},{sides[value_deg < 0.0]}"


def _number(value: float | None, decimals: int) -> str:
    return "" if value is None else f"{value:.{decimals}f}"


def _direction(value_deg: float | None) -> str:
    """Below 360 after rounding too."""
    return "" if value_deg is None else f"{round(value_deg, 3) % 360.0:.3f}"
