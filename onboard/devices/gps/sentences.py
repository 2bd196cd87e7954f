"""Sentences of GNSS receivers as typed readings: GGA, GNS, RMC, VTG, GSA, GLL, ZDA, GST.

Fields by NMEA 0183 from 2.0 to 4.11. Optional at the end: mode of RMC, GLL and VTG (2.3), system identity of GSA and
navigational status of RMC and GNS (4.1). The status says nothing of the fix (u-blox always sends V) and is not read.
"""

import math
from dataclasses import dataclass
from datetime import date
from typing import Final

from onboard.devices import nmea_fields as fields
from onboard.devices.gps.dates import long_date, short_date
from onboard.devices.nmea_fields import FieldFault, Position
from onboard.devices.nmea_parser import Form, Text

MODES: Final = "ADEFMNPRS"
"""Autonomous, differential, estimated, RTK float, manual, not valid, precise, RTK, simulator."""
SIGMAS_M: Final = (0.001, 1000.0)
"""Least and largest 1-sigma of a position that is believed, m."""
_ANY_NUMBER: Final = (float("-inf"), float("inf"))
_QUALITY_OF_LETTER: Final = {"R": 4, "F": 5, "P": 3, "D": 2, "A": 1, "E": 6, "M": 7, "S": 8, "N": 0}
"""Letters of GNS as qualities of GGA, best first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gga:
    """GGA or GNS: position and how good it is; no position under quality 0 or an empty quality."""

    tod_ms: int | None
    position: Position | None
    quality: int | None
    """0 none, 1 GPS, 2 DGPS, 3 PPS, 4 RTK fixed, 5 RTK float, 6 estimated, 7 manual, 8 simulator. Of GNS the best of
    the letters, of which there is one for each constellation (`AANN` = 1, `RRNN` = 4)."""
    satellites: int | None
    """Number of satellites in use; `None` too where a fix claims 0."""
    hdop: float | None
    alt_m: float | None
    """Height above mean sea level, m."""
    step_ms: int = 1
    """How finely `tod_ms` is written, ms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rmc:
    """Position, speed, course and date."""

    tod_ms: int | None
    status_valid: bool | None
    """Status of the sentence: True = A (valid), False = V."""
    position: Position | None
    sog_kn: float | None
    cog_true_deg: float | None
    date: date | None
    mode: str | None
    """Mode of the fix, a letter of `MODES`; `None` before NMEA 2.3."""
    step_ms: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Vtg:
    """Course and speed; carries no time."""

    cog_true_deg: float | None
    sog_kn: float | None
    mode: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gsa:
    """Mode and dilutions; carries no time."""

    fix_mode: int | None
    """Mode of the fix: 1 none, 2 = 2D, 3 = 3D."""
    pdop: float | None
    hdop: float | None
    vdop: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gll:
    """Position and its status."""

    tod_ms: int | None
    status_valid: bool | None
    position: Position | None
    mode: str | None
    step_ms: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Zda:
    """Time and date."""

    tod_ms: int | None
    date: date | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gst:
    """What the receiver thinks of its own error: 1-sigma on each axis, m; both `None` = it does not know."""

    tod_ms: int | None
    sigma_east_m: float | None
    sigma_north_m: float | None


Timed = Gga | Rmc | Gll
"""Sentences whose time is that of the epoch; the time of ZDA is that of a clock."""
Untimed = Vtg | Gsa


def _gga(text: Text) -> Gga:
    alt_m = fields.number(text("altitude"), -12_000.0, 100_000.0)
    quality = fields.whole_number(text("gps_qual"), 0, 9)
    return Gga(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        # Without a fix some receivers fill the place in: MTK sends 8960.0000,N.
        position=_position(text) if quality else None,
        quality=quality,
        satellites=_satellites(text("num_sats"), quality),
        hdop=fields.dilution(text("horizontal_dil")),
        alt_m=fields.unit(alt_m, text("altitude_units"), "M"),
        step_ms=fields.time_step_ms(text("timestamp")),
    )


def _gns(text: Text) -> Gga:
    quality = _best_quality(text("mode"))
    return Gga(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        position=_position(text) if quality else None,
        quality=quality,
        satellites=_satellites(text("satellites"), quality),
        hdop=fields.dilution(text("hdop")),
        alt_m=fields.number(text("altitude"), -12_000.0, 100_000.0),
        step_ms=fields.time_step_ms(text("timestamp")),
    )


def _satellites(text: str, quality: int | None) -> int | None:
    count = fields.whole_number(text, 0, 200)
    return None if quality and not count else count


def _best_quality(letters: str) -> int | None:
    """Empty where a receiver follows GNGNS with one empty sentence for each constellation."""
    if not set(letters) <= set(_QUALITY_OF_LETTER):
        raise FieldFault("status")
    return next((quality for letter, quality in _QUALITY_OF_LETTER.items() if letter in letters), None)


def _rmc(text: Text) -> Rmc:
    mode = fields.letter(text("mode_indicator"), MODES, "status")
    # D = differential: in the status of some older receivers, beside A and V.
    status_valid = _status(text, "AVD")
    return Rmc(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        status_valid=status_valid,
        position=None if mode == "N" else _position_under(text, status_valid),
        sog_kn=fields.number(text("spd_over_grnd"), 0.0, 1000.0),
        cog_true_deg=fields.direction(text("true_course")),
        date=short_date(text("datestamp")),
        mode=mode,
        step_ms=fields.time_step_ms(text("timestamp")),
    )


def _vtg(text: Text) -> Vtg:
    return Vtg(
        cog_true_deg=fields.unit(fields.direction(text("true_track")), text("true_track_sym"), "T"),
        sog_kn=fields.unit(fields.number(text("spd_over_grnd_kts"), 0.0, 1000.0), text("spd_over_grnd_kts_sym"), "N"),
        mode=fields.letter(text("faa_mode"), MODES, "status"),
    )


def _gsa(text: Text) -> Gsa:
    return Gsa(
        fix_mode=fields.whole_number(text("mode_fix_type"), 1, 3),
        pdop=fields.dilution(text("pdop")),
        hdop=fields.dilution(text("hdop")),
        vdop=fields.dilution(text("vdop")),
    )


def _gll(text: Text) -> Gll:
    mode = fields.letter(text("faa_mode"), MODES, "status")
    status_valid = _status(text, "AV")
    if status_valid is None and not text("timestamp") and not mode:
        status_valid = True  # before NMEA 2.0 it was the position alone, sent while there was one
    if status_valid is None and text("lat"):
        raise FieldFault("status")
    return Gll(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        status_valid=status_valid,
        position=None if mode == "N" else _position_under(text, status_valid),
        mode=mode,
        step_ms=fields.time_step_ms(text("timestamp")),
    )


def _zda(text: Text) -> Zda:
    return Zda(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        date=long_date(text("day"), text("month"), text("year")),
    )


def _gst(text: Text) -> Gst:
    """The sigmas of latitude and longitude, else those of the ellipse, its axes turned to north and east.

    A value that no receiver can mean is left out: 0, and beyond 1 km (u-blox sends kilometres before it has a fix).
    """
    names = ("north", "east", "major", "minor")
    north_m, east_m, major_m, minor_m = (fields.number(text(name), *_ANY_NUMBER) for name in names)
    angle_deg = fields.number(text("orientation"), -360.0, 360.0)
    if not (_is_credible(north_m) and _is_credible(east_m)):
        north_m = east_m = None
        if major_m is not None and minor_m is not None and angle_deg is not None:
            north_m, east_m = _turned(major_m, minor_m, math.radians(angle_deg))
    known = _is_credible(north_m) and _is_credible(east_m)
    return Gst(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        sigma_east_m=east_m if known else None,
        sigma_north_m=north_m if known else None,
    )


def _is_credible(sigma_m: float | None) -> bool:
    return sigma_m is not None and SIGMAS_M[0] <= sigma_m <= SIGMAS_M[1]


def _turned(major_m: float, minor_m: float, angle_rad: float) -> tuple[float, float]:
    """Sigmas toward north and east of an error ellipse whose major axis lies `angle_rad` clockwise from north."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return math.hypot(major_m * cos, minor_m * sin), math.hypot(major_m * sin, minor_m * cos)


def _position(text: Text) -> Position | None:
    return fields.position(text("lat"), text("lat_dir"), text("lon"), text("lon_dir"))


def _position_under(text: Text, status_valid: bool | None) -> Position | None:
    """Under status V what cannot be read is no position, and the time is still good: MTK sends 8960.0000,N."""
    try:
        return _position(text)
    except FieldFault:
        if status_valid is not False:
            raise
        return None


def _status(text: Text, letters: str) -> bool | None:
    status = fields.letter(text("status"), letters, "status")
    return None if status is None else status != "V"


_GNS_FIELDS: Final = (
    "timestamp", "lat", "lat_dir", "lon", "lon_dir", "mode", "satellites", "hdop", "altitude", "geo_sep",
    "age_gps_data", "ref_station_id", "nav_status",
)  # fmt: skip

_GST_NAMES: Final = ("timestamp", "rms", "major", "minor", "orientation", "north", "east", "up")

FORMS: Final[dict[str, Form[Timed | Untimed | Zda | Gst]]] = {
    "GGA": Form(10, 15, _gga),
    # Older versions of pynmea2 name its fields differently.
    "GNS": Form(10, 13, _gns, _GNS_FIELDS),
    "RMC": Form(9, 14, _rmc),
    "VTG": Form(8, 9, _vtg),
    "GSA": Form(17, 18, _gsa),
    "GLL": Form(4, 7, _gll),
    "ZDA": Form(4, 6, _zda),
    "GST": Form(8, 8, _gst, _GST_NAMES),
}
