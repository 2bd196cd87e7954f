"""Sentences of a radar's own target tracker as typed readings: TTM (range and bearing), TLL (position).

    $RATTM,number,distance,bearing,T/R,speed,course,T/R,CPA,TCPA,unit,name,status,reference,hhmmss.ss,A/M/R*hh
    $RATLL,number,ddmm.mmm,N,dddmm.mmm,E,name,hhmmss.ss,status,reference*hh

The unit letter of TTM rules distance, CPA and speed: K km and km/h, N nautical miles and knots, S statute miles and
miles an hour. Directions are true (T) or relative to the bow (R), clockwise. TCPA is in minutes, negative = passed.
"""

from dataclasses import dataclass
from typing import Final

from common.units import METRES_PER_KILOMETRE, METRES_PER_NAUTICAL_MILE, METRES_PER_STATUTE_MILE
from onboard.devices import nmea_fields as fields
from onboard.devices.nmea_fields import FieldFault, Position
from onboard.devices.nmea_parser import Form, Text

LONGEST_NAME: Final = 64
STATUSES: Final = {"L": "lost", "Q": "acquiring", "T": "tracking"}

_UNIT_M: Final = {"K": METRES_PER_KILOMETRE, "N": METRES_PER_NAUTICAL_MILE, "S": METRES_PER_STATUTE_MILE}
_FARTHEST_M: Final = 1e6
_FASTEST_KN: Final = 1000.0
_LONGEST_TCPA_MIN: Final = 100_000.0
"""Largest TCPA, ten weeks in minutes. A Simrad 4G writes 24751376.1, and now and then another such number, where it has
no value."""


@dataclass(frozen=True, slots=True)
class Bearing:
    """A direction, true or relative to the bow; both `None` = not sent."""

    true_deg: float | None = None
    rel_deg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetReading:
    """One target. Everything but its number may be missing."""

    number: int
    status: str | None
    """Status of the target: `lost`, `acquiring` or `tracking`."""
    name: str | None
    tod_ms: int | None
    range_m: float | None = None
    bearing: Bearing = Bearing()
    sog_kn: float | None = None
    course: Bearing = Bearing()
    cpa_m: float | None = None
    tcpa_s: float | None = None
    """Time to the closest point of approach, s; negative = already passed."""
    position: Position | None = None

    @property
    def is_empty(self) -> bool:
        """Neither where the target is, nor the news that it is lost."""
        somewhere = self.range_m is not None or self.bearing != Bearing() or self.position is not None
        return not somewhere and self.status != "lost"


def _ttm(text: Text) -> TargetReading:
    status = _status(text)
    letter = fields.letter(text("unit"), "KNS", "unit")
    range_m = _metres(text("distance"), letter)
    speed_kn = _knots(text("speed"), letter)
    course = _direction(text("course"), text("course_reference"))
    cpa_m = _metres(text("cpa"), letter)
    tcpa_min = fields.number(text("tcpa"), -1e9, 1e9)
    # While it acquires a target, and once it has lost it, the radar fills in speed 0 and its variation for the course;
    # the closest approach is reckoned from these. A range or closest approach of 0 may be a small one, rounded.
    if status in ("acquiring", "lost"):
        speed_kn, course, cpa_m = None, Bearing(), None
    if speed_kn == 0.0:
        course = Bearing()
    if cpa_m is None or tcpa_min is None or abs(tcpa_min) > _LONGEST_TCPA_MIN:
        tcpa_min = None
    fields.letter(text("acquisition"), "AMR", "status")
    return TargetReading(
        number=_number(text),
        status=status,
        name=text("name")[:LONGEST_NAME] or None,
        tod_ms=fields.time_of_day_ms(text("time")),
        range_m=range_m,
        bearing=_direction(text("bearing"), text("bearing_reference")),
        sog_kn=speed_kn,
        course=course,
        cpa_m=cpa_m,
        tcpa_s=None if tcpa_min is None else 60.0 * tcpa_min,
    )


def _tll(text: Text) -> TargetReading:
    return TargetReading(
        number=_number(text),
        status=_status(text),
        name=text("name")[:LONGEST_NAME] or None,
        tod_ms=fields.time_of_day_ms(text("time")),
        position=_position(text),
    )


def _position(text: Text) -> Position | None:
    try:
        return fields.position(text("lat"), text("lat_dir"), text("lon"), text("lon_dir"))
    except FieldFault as fault:
        if fault.reason != fields.ZERO_POSITION:
            raise
        return None  # the news of a lost target is good without a place


def _number(text: Text) -> int:
    number = fields.whole_number(text("number").strip(" "), 0, 9999)  # some radars pad it with blanks
    if number is None:
        raise FieldFault("fields")
    return number


def _status(text: Text) -> str | None:
    status = fields.letter(text("status"), "LQT", "status")
    return None if status is None else STATUSES[status]


def _metres(text: str, letter: str | None) -> float | None:
    """A distance in the unit of `letter`; without a letter it is refused (`unit`)."""
    value = fields.number(text, 0.0, _FARTHEST_M)
    if value is None:
        return None
    metres = value * _unit_m(letter)
    if metres > _FARTHEST_M:
        raise FieldFault("range")
    return metres


def _knots(text: str, letter: str | None) -> float | None:
    """A speed in the unit of `letter` an hour."""
    value = fields.number(text, 0.0, 10.0 * _FASTEST_KN)
    if value is None:
        return None
    knots = value if letter == "N" else value * _unit_m(letter) / METRES_PER_NAUTICAL_MILE
    if knots > _FASTEST_KN:
        raise FieldFault("range")
    return knots


def _unit_m(letter: str | None) -> float:
    if letter is None:
        raise FieldFault("unit")
    return _UNIT_M[letter]


def _direction(text: str, reference: str) -> Bearing:
    value = fields.direction(text)
    letter = fields.letter(reference, "TR", "unit")
    if value is None:
        return Bearing()
    if letter is None:
        raise FieldFault("unit")
    return Bearing(true_deg=value) if letter == "T" else Bearing(rel_deg=value)


_TTM_NAMES: Final = (
    "number", "distance", "bearing", "bearing_reference", "speed", "course", "course_reference", "cpa", "tcpa", "unit",
    "name", "status", "reference", "time", "acquisition",
)  # fmt: skip
_TLL_NAMES: Final = ("number", "lat", "lat_dir", "lon", "lon_dir", "name", "time", "status", "reference")

# Split by our own names: those of pynmea2 differ between its versions. TTM ends after `reference` before NMEA 2.3.
FORMS: Final[dict[str, Form[TargetReading]]] = {
    "TTM": Form(13, 15, _ttm, _TTM_NAMES),
    "TLL": Form(9, 9, _tll, _TLL_NAMES),
}
