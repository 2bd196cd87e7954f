"""Sentences of satellite receivers as typed readings: GGA, RMC, VTG, GSA, GLL, ZDA."""

from dataclasses import dataclass
from datetime import date
from typing import Final

from onboard.devices import fields
from onboard.devices.fields import Position
from onboard.devices.nmea import Form, Text

MODES: Final = "ADEFMNPRS"
"""Autonomous, differential, estimated, RTK float, manual, not valid, precise, RTK, simulator."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gga:
    """Position and quality; no position under quality 0 or an empty quality."""

    tod_ms: int | None
    position: Position | None
    quality: int | None
    """0 none, 1 GPS, 2 DGPS, 3 PPS, 4 RTK fixed, 5 RTK float, 6 estimated, 7 manual, 8 simulator."""
    satellites: int | None
    hdop: float | None
    alt_m: float | None
    """Above mean sea level."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rmc:
    """Position, speed, course and date."""

    tod_ms: int | None
    status_valid: bool | None
    """True A, False V."""
    position: Position | None
    sog_kn: float | None
    cog_true_deg: float | None
    date: date | None
    mode: str | None
    """A letter of `MODES`; `None` before NMEA 2.3."""


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
    """1 none, 2 = 2D, 3 = 3D."""
    pdop: float | None
    hdop: float | None
    vdop: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Gll:
    """Position."""

    tod_ms: int | None
    status_valid: bool | None
    position: Position | None
    mode: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Zda:
    """Time and date."""

    tod_ms: int | None
    date: date | None


Timed = Gga | Rmc | Gll | Zda
Untimed = Vtg | Gsa


def _gga(text: Text) -> Gga:
    alt_m = fields.number(text("altitude"), -12_000.0, 100_000.0)
    quality = fields.whole_number(text("gps_qual"), 0, 9)
    return Gga(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        # Without a fix some receivers fill the place in: MTK sends 8960.0000,N.
        position=_position(text) if quality else None,
        quality=quality,
        satellites=fields.whole_number(text("num_sats"), 0, 200),
        hdop=fields.dilution(text("horizontal_dil")),
        alt_m=fields.unit(alt_m, text("altitude_units"), "M"),
    )


def _rmc(text: Text) -> Rmc:
    mode = fields.letter(text("mode_indicator"), MODES, "status")
    return Rmc(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        status_valid=_status(text),
        position=None if mode == "N" else _position(text),
        sog_kn=fields.number(text("spd_over_grnd"), 0.0, 1000.0),
        cog_true_deg=fields.direction(text("true_course")),
        date=fields.short_date(text("datestamp")),
        mode=mode,
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
    return Gll(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        status_valid=_status(text),
        position=None if mode == "N" else _position(text),
        mode=mode,
    )


def _zda(text: Text) -> Zda:
    return Zda(
        tod_ms=fields.time_of_day_ms(text("timestamp")),
        date=fields.long_date(text("day"), text("month"), text("year")),
    )


def _position(text: Text) -> Position | None:
    return fields.position(text("lat"), text("lat_dir"), text("lon"), text("lon_dir"))


def _status(text: Text) -> bool | None:
    status = fields.letter(text("status"), "AV", "status")
    return None if status is None else status == "A"


FORMS: Final[dict[str, Form[Timed | Untimed]]] = {
    "GGA": Form(10, 15, _gga),
    "RMC": Form(9, 14, _rmc),
    "VTG": Form(8, 9, _vtg),
    "GSA": Form(17, 18, _gsa),
    "GLL": Form(4, 7, _gll),
    "ZDA": Form(4, 6, _zda),
}
