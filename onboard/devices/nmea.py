"""NMEA sentences to typed readings: the only importer of pynmea2, behind a strict guard.

pynmea2 splits a sentence and names its fields; its converters are not used, because they answer an empty coordinate
with 0.0, a bad number with its text, `nan` with nan, and raise IndexError, TypeError or OverflowError on what a noisy
cable sends. Every value is read by `onboard.devices.fields` instead. An empty field is `None`, not a fault.

Another sentence = a reading, a function and a row in `FORMS`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import date
from typing import Final

import pynmea2

from onboard.devices import fields
from onboard.devices.fields import FieldFault, Position
from onboard.devices.sentence import Sentence

RMC_MODES: Final = "ADEFMNPRS"
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
    """A letter of `RMC_MODES`; `None` before NMEA 2.3."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingReading:
    """HDG and HDM (magnetic) or HDT (true); both headings `None` = the field was empty."""

    heading_mag_deg: float | None = None
    heading_true_deg: float | None = None
    deviation_deg: float | None = None
    """East +."""
    variation_deg: float | None = None
    """East +."""


Reading = Gga | Rmc | Vtg | Gsa | Gll | Zda | HeadingReading
Text = Callable[[str], str]
"""Raw text of the field with that pynmea2 name; empty where the sentence ends before it."""


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
    mode = fields.letter(text("mode_indicator"), RMC_MODES, "status")
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
        mode=fields.letter(text("faa_mode"), RMC_MODES, "status"),
    )


def _gsa(text: Text) -> Gsa:
    return Gsa(
        fix_mode=fields.whole_number(text("mode_fix_type"), 1, 3),
        pdop=fields.dilution(text("pdop")),
        hdop=fields.dilution(text("hdop")),
        vdop=fields.dilution(text("vdop")),
    )


def _gll(text: Text) -> Gll:
    mode = fields.letter(text("faa_mode"), RMC_MODES, "status")
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


def _hdg(text: Text) -> HeadingReading:
    return HeadingReading(
        heading_mag_deg=fields.direction(text("heading")),
        deviation_deg=fields.east_positive(text("deviation"), text("dev_dir")),
        variation_deg=fields.east_positive(text("variation"), text("var_dir")),
    )


def _hdm(text: Text) -> HeadingReading:
    fields.letter(text("magnetic"), "M", "unit")
    # KVH: `$HCHDM,123.4,M,*hh` has a comma too many, nothing may follow it.
    fields.letter(text("#2"), "", "fields")
    return HeadingReading(heading_mag_deg=fields.direction(text("heading")))


def _hdt(text: Text) -> HeadingReading:
    # HSC100T: `$HEHDT,123.4*hh` leaves the T out.
    fields.letter(text("hdg_true"), "T", "unit")
    return HeadingReading(heading_true_deg=fields.direction(text("heading")))


def _position(text: Text) -> Position | None:
    return fields.position(text("lat"), text("lat_dir"), text("lon"), text("lon_dir"))


def _status(text: Text) -> bool | None:
    status = fields.letter(text("status"), "AV", "status")
    return None if status is None else status == "A"


@dataclass(frozen=True, slots=True)
class Form:
    """One row of the table: how many fields the sentence may have, and who reads them."""

    least: int
    most: int
    read: Callable[[Text], Reading]


FORMS: Final[dict[str, Form]] = {
    "GGA": Form(10, 15, _gga),
    "RMC": Form(9, 14, _rmc),
    "VTG": Form(8, 9, _vtg),
    "GSA": Form(17, 18, _gsa),
    "GLL": Form(4, 7, _gll),
    "ZDA": Form(4, 6, _zda),
    "HDG": Form(5, 5, _hdg),
    "HDM": Form(1, 3, _hdm),
    "HDT": Form(1, 2, _hdt),
}
# Fields that pynmea2 1.15 (Debian 12) has no name for, by place; `#2` marks what no version names.
_PLACES: Final = {"mode_indicator": 11, "#2": 2}


def read(sentence: Sentence) -> Reading | str:
    """The reading, or the reason why there is none.

    Reasons: `formatter` (not in `FORMS`), `fields` (their number; half a position), `not-a-number`, `range`,
    `hemisphere`, `unit`, `status`, `time`, `date`, `parser` (pynmea2 gave up or broke).
    """
    form = FORMS.get(sentence.formatter)
    if form is None:
        return "formatter"
    try:
        parsed = pynmea2.parse(sentence.text)
        data: list[str] = parsed.data
        if not form.least <= len(data) <= form.most:
            return "fields"
        places: dict[str, int] = type(parsed).name_to_idx

        def text(name: str) -> str:
            place = places[name] if name in places else _PLACES[name]
            return data[place] if place < len(data) else ""

        return form.read(text)
    except FieldFault as fault:
        return fault.reason
    except Exception:
        return "parser"
