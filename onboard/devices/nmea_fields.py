"""Field parsers of NMEA sentences, strict: text in, value or `None` (empty field) out.

Nothing is guessed: a number is `-?digits[.digits]` and nothing else (no exponent, `nan`, underscore, plus sign, blank),
and every value has a range. What does not pass raises `FieldFault`, which `nmea_parser.read` and the readers of dates
and bursts catch.
"""

import re
from dataclasses import dataclass
from typing import Final

from common.units import METRES_PER_NAUTICAL_MILE

_NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?")
_DIGITS = re.compile(r"[0-9]+")
_LATITUDE = re.compile(r"([0-9]{2})([0-9]{2}(?:\.[0-9]+)?)")
_LONGITUDE = re.compile(r"([0-9]{3})([0-9]{2}(?:\.[0-9]+)?)")
_TIME = re.compile(r"([0-9]{2})([0-9]{2})([0-9]{2})(?:\.([0-9]+))?")

UNKNOWN_DILUTION: Final = 99.0
"""Receivers write 99.9 or 99.99 where no dilution is known; 0.0 is no dilution either."""
DAY_MS: Final = 86_400_000
ZERO_POSITION: Final = "zero-position"
"""Reason of a sentence whose place is 0, 0."""


class FieldFault(Exception):  # noqa: N818  a signal between parsers, never an error that a person sees
    """A field that cannot be used; `reason` is the word of the counters."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Position:
    """A position field group: degrees, north + and east +."""

    lat_deg: float
    lon_deg: float
    text: str
    """The fields as they were sent: with equal texts the position was repeated to the digit."""
    step_m: float
    """Length of one step of the last latitude digit, m."""


def number(text: str, low: float, high: float) -> float | None:
    """A number in [low, high], else `not-a-number` or `range`."""
    if not text:
        return None
    if not _NUMBER.fullmatch(text):
        raise FieldFault("not-a-number")
    value = float(text) + 0.0  # no minus before a zero
    if not low <= value <= high:
        raise FieldFault("range")
    return value


def whole_number(text: str, low: int, high: int) -> int | None:
    """A whole number: digits only."""
    if not text:
        return None
    if not _DIGITS.fullmatch(text):
        raise FieldFault("not-a-number")
    value = int(text) if len(text) <= 9 else high + 1
    if not low <= value <= high:
        raise FieldFault("range")
    return value


def letter(text: str, allowed: str, reason: str) -> str | None:
    """One of the letters `allowed`, else `reason`."""
    if not text:
        return None
    if len(text) != 1 or text not in allowed:
        raise FieldFault(reason)
    return text


def unit(value: float | None, text: str, wanted: str) -> float | None:
    """`value`, provided that its unit letter is the one wanted; the letter of an empty value may be absent."""
    if letter(text, wanted, "unit") is None and value is not None:
        raise FieldFault("unit")
    return value


def direction(text: str) -> float | None:
    """Degrees clockwise from north in [0, 360); 360 becomes 0."""
    value = number(text, 0.0, 360.0)
    return 0.0 if value == 360.0 else value


def east_positive(text: str, side: str) -> float | None:
    """Deviation or variation in degrees, E = +, W = -; a value without its letter is refused, unless it is 0.

    Some autopilots write the sign and always E (`-16.9,E`); a sign before W may mean either.
    """
    value = number(text, -180.0, 180.0)
    if letter(side, "EW", "hemisphere") is None and value:
        raise FieldFault("hemisphere")
    if value is None or not side:
        return None
    if value < 0.0 and side == "W":
        raise FieldFault("hemisphere")
    return -value if side == "W" else value


def dilution(text: str) -> float | None:
    """Dilution of precision; the receivers' codes for unknown become `None`."""
    value = number(text, 0.0, 99_999.0)
    return None if value is None or value == 0.0 or value >= UNKNOWN_DILUTION else value


def position(lat: str, north_south: str, lon: str, east_west: str) -> Position | None:
    """`ddmm.mmmm,N,dddmm.mmmm,E`, all of it or nothing of it (`fields`); letters alone are an empty position.

    0, 0 to the last digit is what devices fill in that know no place: `zero-position`.
    """
    if letter(north_south, "NS", "hemisphere") is None and lat:
        raise FieldFault("hemisphere")
    if letter(east_west, "EW", "hemisphere") is None and lon:
        raise FieldFault("hemisphere")
    if not lat and not lon:
        return None
    if not lat or not lon:
        raise FieldFault("fields")
    lat_deg, lon_deg = _degrees(lat, _LATITUDE, 90.0), _degrees(lon, _LONGITUDE, 180.0)
    if lat_deg == 0.0 and lon_deg == 0.0:
        raise FieldFault(ZERO_POSITION)
    return Position(
        lat_deg=-lat_deg if north_south == "S" else lat_deg,
        lon_deg=-lon_deg if east_west == "W" else lon_deg,
        text=f"{lat}{north_south}{lon}{east_west}",
        step_m=METRES_PER_NAUTICAL_MILE * 10.0 ** -len(lat.partition(".")[2]),
    )


def _degrees(text: str, form: re.Pattern[str], limit_deg: float) -> float:
    match = form.fullmatch(text)
    if match is None:
        raise FieldFault("not-a-number")
    minutes = float(match[2])
    value = int(match[1]) + minutes / 60.0
    if minutes >= 60.0 or value > limit_deg:
        raise FieldFault("range")
    return value


def time_step_ms(text: str) -> int:
    """How finely a time of day is written, ms: 1000 without decimals, 1 with three or more."""
    return (1000, 100, 10, 1)[min(3, len(text.partition(".")[2]))]


def time_of_day_ms(text: str) -> int | None:
    """`hhmmss[.sss]` as milliseconds since midnight UTC, further digits cut off; second 60 only as 23:59:60."""
    if not text:
        return None
    match = _TIME.fullmatch(text)
    if match is None:
        raise FieldFault("time")
    hour, minute, second = int(match[1]), int(match[2]), int(match[3])
    leap = (hour, minute, second) == (23, 59, 60)
    if hour > 23 or minute > 59 or (second > 59 and not leap):
        raise FieldFault("time")
    return ((hour * 60 + minute) * 60 + second) * 1000 + int((match[4] or "")[:3].ljust(3, "0"))


def tod_step_ms(before_ms: int, after_ms: int) -> int:
    """Step from one time of day to another, ms, -12 h to +12 h."""
    return (after_ms - before_ms + DAY_MS // 2) % DAY_MS - DAY_MS // 2
