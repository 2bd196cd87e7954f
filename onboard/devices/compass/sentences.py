"""Sentences of compasses as typed readings, and which of them each model sends.

Standard ones: HDG, HDM, HCC (magnetic), HDT (true), ROT, XDR. Honeywell's own: PTNTHPR; PTNTHTM only to be refused.
Signs: variation and deviation east +, rate + bow to starboard, pitch + bow up, roll + starboard down.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from onboard.devices import nmea_fields as fields
from onboard.devices.nmea_fields import FieldFault
from onboard.devices.nmea_parser import Form, Text

PITCH_LIMIT_DEG: Final = 90.0
ROLL_LIMIT_DEG: Final = 180.0
TURN_LIMIT_DEG_MIN: Final = 7_200.0
"""Largest rate of turn, deg/min: a full turn in three seconds. Some senders write 9999.9 for a rate they do not
know."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingReading:
    """HDG, HDM and HCC (magnetic) or HDT (true); both headings `None` = the field was empty."""

    heading_mag_deg: float | None = None
    heading_true_deg: float | None = None
    deviation_deg: float | None = None
    """Deviation that is programmed in the device, deg, east +."""
    variation_deg: float | None = None
    """Variation that is programmed in the device, deg, east +."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnReading:
    """ROT with status A; `None` = the field was empty."""

    rate_deg_s: float | None
    """Rate of turn, deg/s, + bow to starboard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeReading:
    """XDR, as far as it is about attitude; both `None` = the fields were empty (saturated sensor)."""

    pitch_deg: float | None
    """Pitch, deg, + bow up."""
    roll_deg: float | None
    """Roll, deg, + starboard down."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HprReading:
    """PTNTHPR. The heading is magnetic, or true where the variation is programmed in the device: it does not say."""

    heading_deg: float
    pitch_deg: float | None
    roll_deg: float | None
    warning: str | None
    """The status letters that are not N: `heading M, pitch O`."""


Reading = HeadingReading | TurnReading | AttitudeReading | HprReading


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
    # HSC100T: `$HEHDT,123.4*hh` leaves the T out. KVH has its comma too many here as well.
    fields.letter(text("hdg_true"), "T", "unit")
    fields.letter(text("#2"), "", "fields")
    return HeadingReading(heading_true_deg=fields.direction(text("heading")))


def _hcc(text: Text) -> HeadingReading:
    return HeadingReading(heading_mag_deg=fields.direction(text("heading")))


def _rot(text: Text) -> TurnReading:
    """Degrees a minute, minus = bow to port; Autonnic's manual (HSC100T) allows a plus sign."""
    status = fields.letter(text("status"), "AV", "status")
    if status != "A":
        raise FieldFault("void" if status else "status")
    rate = text("rate_of_turn")
    if rate.startswith("+"):
        rate_deg_min = fields.number(rate[1:], 0.0, TURN_LIMIT_DEG_MIN)
    else:
        rate_deg_min = fields.number(rate, -TURN_LIMIT_DEG_MIN, TURN_LIMIT_DEG_MIN)
    return TurnReading(rate_deg_s=None if rate_deg_min is None else rate_deg_min / 60.0)


ANGLE_NAMES: Final = {"PITCH": "pitch", "PTCH": "pitch", "ROLL": "roll", "HEEL": "roll"}
"""Names of XDR transducers. NMEA: a negative angular displacement is anticlockwise, seen forward that is port down."""
_XDR_GROUPS: Final = 10
_XDR_NAMES: Final = tuple(f"{what}{group}" for group in range(_XDR_GROUPS) for what in ("type", "value", "unit", "id"))
_ANGLE_LIMIT_DEG: Final = {"pitch": PITCH_LIMIT_DEG, "roll": ROLL_LIMIT_DEG}


def _xdr(text: Text) -> AttitudeReading:
    """Groups of type, value, unit and name, in any order.

    Groups of other transducers are passed over, but no value may be other than a number: a sender that writes
    `-1.-7` (a plotter in our recordings does) cannot be trusted with its neighbours.
    """
    found: dict[str, float | None] = {}
    for group in range(_XDR_GROUPS):
        kind, value, unit, name = (text(f"{what}{group}") for what in ("type", "value", "unit", "id"))
        number = fields.number(value, float("-inf"), float("inf"))
        angle = ANGLE_NAMES.get(name.upper())
        if angle is None:
            continue
        if angle in found:
            raise FieldFault("duplicate")
        if (kind, unit) != ("A", "D"):
            raise FieldFault("unit")
        if number is not None and abs(number) > _ANGLE_LIMIT_DEG[angle]:
            raise FieldFault("range")
        found[angle] = number
    return AttitudeReading(pitch_deg=found.get("pitch"), roll_deg=found.get("roll"))


_HPR_NAMES: Final = ("heading", "heading_status", "pitch", "pitch_status", "roll", "roll_status")
_ALARMS: Final = "LP"


def _hpr(text: Text) -> HprReading:
    """Heading, pitch, roll, each with its letter: L P alarm, M O warning (low, high), N normal, C tuning.

    With any alarm the device leaves the heading empty. By their size, mils below 360 look like degrees, but the device
    writes degrees with one decimal and mils without: a number without a point is refused.
    """
    letters = {name: fields.letter(text(f"{name}_status"), "LMNOPC", "status") for name in ("heading", "pitch", "roll")}
    if None in letters.values():
        raise FieldFault("status")
    heading_deg = fields.direction(_decimal(text("heading")))
    reading = HprReading(
        heading_deg=heading_deg or 0.0,
        pitch_deg=fields.number(_decimal(text("pitch")), -PITCH_LIMIT_DEG, PITCH_LIMIT_DEG),
        roll_deg=fields.number(_decimal(text("roll")), -ROLL_LIMIT_DEG, ROLL_LIMIT_DEG),
        warning=", ".join(f"{name} {letter}" for name, letter in letters.items() if letter != "N") or None,
    )
    if any(letter in _ALARMS for letter in letters.values() if letter):
        raise FieldFault("alarm")
    if heading_deg is None:
        raise FieldFault("alarm" if reading.warning else "empty")
    return reading


def _decimal(text: str) -> str:
    fields.number(text, float("-inf"), float("inf"))
    if text and "." not in text:
        raise FieldFault("unit")
    return text


def _htm(text: Text) -> HprReading:
    """True North's Revolution sends counts here, no angles (`14223,N,169,N,-43,N`): refused whatever they are."""
    fields.direction(text("heading"))
    raise FieldFault("unit")


HDG: Final[Form[Reading]] = Form(2, 5, _hdg, step=3)
"""KVH ends it after the heading and a comma, all others have the five fields of the standard."""
HDM: Final[Form[Reading]] = Form(1, 3, _hdm)
HDT: Final[Form[Reading]] = Form(1, 3, _hdt)
HCC: Final[Form[Reading]] = Form(1, 1, _hcc, names=("heading",))
ROT: Final[Form[Reading]] = Form(2, 2, _rot)
XDR: Final[Form[Reading]] = Form(4, 4 * _XDR_GROUPS, _xdr, names=_XDR_NAMES, step=4)
HPR: Final[Form[Reading]] = Form(6, 6, _hpr, names=_HPR_NAMES)
HTM: Final[Form[Reading]] = Form(8, 8, _htm, names=(*_HPR_NAMES, "dip", "field"))

Forms = Mapping[str, Form[Reading]]

NMEA: Final[Forms] = {"HDG": HDG, "HDM": HDM, "HDT": HDT, "HCC": HCC, "ROT": ROT, "XDR": XDR}
HSC100: Final[Forms] = {"HDG": HDG, "HDM": HDM, "HDT": HDT, "HCC": HCC, "ROT": ROT}
HMR3000: Final[Forms] = {"HDG": HDG, "HDT": HDT, "XDR": XDR, "PTNTHPR": HPR, "PTNTHTM": HTM}
TCM2: Final[Forms] = {"HDM": HDM}
KVH: Final[Forms] = {"HDG": HDG, "HDM": HDM, "HDT": HDT}

RANK: Final[Mapping[str, int]] = {"PTNTHPR": 5, "HDG": 4, "HDM": 3, "HCC": 2, "HDT": 1}
"""Which heading is used where a device sends the same one in several sentences: the one that brings most with it, then
the magnetic ones (deviation and variation are added ashore, in one place); HDT where it is the only one."""
