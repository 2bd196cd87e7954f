"""Cell parsers of a table: numbers with units, angles in degrees, minutes and seconds, letters of a hemisphere.

Pure. What cannot be read raises `Rejected` and nothing else.
"""

import math
import re
from typing import Final, NamedTuple

from shore.imports.line_counts import Rejected

_NOTHING: Final = frozenset(("", "nan", "null", "none", "na", "n/a", "nil", "undefined", "#n/a", "#nv"))
_BLANKED: Final = re.compile(r"[-.*?_:\s]*")
"""A cell without a value: `--.--`, `***`."""
_NUMBER: Final = re.compile(r"([+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+(?![0-9]))?)\s*(.*)", re.DOTALL)
_SCIENTIFIC: Final = re.compile(r"([0-9]+)(?:\.[0-9]*)?[eE][+-]?[0-9]+")
_COMMA: Final = re.compile(r"(?<=[0-9]),(?=[0-9])|^,(?=[0-9])|(?<=[-+]),(?=[0-9])")
_GROUPS: Final = {
    ".,": re.compile(r"([+-]?[1-9][0-9]{0,2})((?:,[0-9]{3})+)(?![0-9,])"),
    ",.": re.compile(r"([+-]?[1-9][0-9]{0,2})((?:\.[0-9]{3})+)(?![0-9.])"),
}
"""Digits in groups of three, by the marks of a table: that of the decimals, and that of the thousands."""
_SIDES: Final = {"N": 1.0, "S": -1.0, "E": 1.0, "W": -1.0}
_LETTER_WORDS: Final = {"NORTH": "N", "SOUTH": "S", "EAST": "E", "WEST": "W"}
_PART: Final = re.compile(r"[0-9]+(?:\.[0-9]*)?|\.[0-9]+")
_BETWEEN: Final = re.compile(r"(?:deg|min|sec|[\s°º:'’′\"”″`\u00b4-])*", re.IGNORECASE)
_PLACE: Final = re.compile(r"([NSns])\s*([0-9].*?)[\s,;/]*([EWew])\s*([0-9].*)", re.DOTALL)
_POINT: Final = re.compile(r"POINT\s*[ZM]{0,2}\s*\(\s*([0-9.eE+-]+)\s+([0-9.eE+-]+)[0-9.eE+\s-]*\)", re.IGNORECASE)
"""A point of maps (WKT): the longitude first."""
_PLACE_AFTER: Final = re.compile(r"([^NSns]+[NSns])[\s,;/]*([^NSns]+[EWew])", re.DOTALL)


class Angle(NamedTuple):
    """An angle as it stands in a cell."""

    value: float
    """Degrees, + north or east; or the bare number, when `is_bare`."""
    is_bare: bool
    """True = one number without a letter, in whatever form the table has it."""
    has_side: bool
    """True = a letter or a sign says the hemisphere."""
    digits: int = 0
    """Number of digits before the point of a single number, 0 for several: ddmm.mmmm has four or five."""
    has_letter: bool = False


def is_nothing(text: str) -> bool:
    """True for a cell that stands for no value."""
    return text.casefold() in _NOTHING or _BLANKED.fullmatch(text) is not None


def with_point(text: str, decimal: str) -> str:
    """A number as Python reads it; decimal: the mark of a table before decimals, and behind it that of thousands."""
    if len(decimal) > 1:
        text = _GROUPS[decimal].sub(lambda match: match[1] + match[2].replace(decimal[1], ""), text)
    return _COMMA.sub(".", text) if decimal[0] == "," and "." not in text else text


def number_and_unit(text: str, decimal: str) -> tuple[float, str]:
    """A number and what stands behind it; raises Rejected."""
    text = with_point(text, decimal)
    match = _NUMBER.fullmatch(text)
    value = float(match[1]) if match is not None else math.nan
    if match is None or not math.isfinite(value):
        raise Rejected("not a number")
    return value, match[2].strip()


def letter_of(text: str) -> str | None:
    """N, S, E or W of a cell that is such a letter or word; `None` = it is none."""
    text = text.strip().upper()
    text = _LETTER_WORDS.get(text, text)
    return text if text in _SIDES else None


def angle_in(text: str, axis: str, decimal: str) -> Angle:
    """Latitude or longitude of a cell: -8.74, 8.74 W, W 8°44.4', 8 44 24 W; raises Rejected.

    axis: `NS` or `EW`, the letters that belong to it.
    """
    rest = with_point(text.strip(), decimal)
    rest, letter = _without_letter(rest, axis)
    sign = -1.0 if rest[:1] in ("-", "\u2212") else 1.0
    is_signed = rest[:1] in ("-", "+", "\u2212")
    rest = rest[1:] if is_signed else rest
    has_side = letter is not None or is_signed
    if letter is None and _SCIENTIFIC.fullmatch(rest) is not None:
        value = float(rest)
        return Angle(sign * value, is_bare=True, has_side=has_side, digits=len(str(int(min(value, 1e9)))))
    parts = _PART.findall(rest)
    if not 1 <= len(parts) <= 3 or not _BETWEEN.fullmatch(_PART.sub("", rest)):
        raise Rejected("no angle")
    if letter is not None and sign < 0.0:
        raise Rejected("a minus and a letter contradict each other")
    sign *= 1.0 if letter is None else _SIDES[letter]
    has_letter = letter is not None
    if len(parts) == 1:
        digits = len(parts[0].partition(".")[0])
        return Angle(sign * float(parts[0]), is_bare=True, has_side=has_side, digits=digits, has_letter=has_letter)
    if any("." in part for part in parts[:-1]) or any(float(part) >= 60.0 for part in parts[1:]):
        raise Rejected("no degrees, minutes and seconds")
    value = sum(float(part) / 60.0**place for place, part in enumerate(parts))
    return Angle(sign * value, is_bare=False, has_side=has_side, has_letter=has_letter)


def from_packed(value: float) -> float:
    """ddmm.mmmm (NMEA: degrees times 100, plus minutes) -> degrees; raises Rejected for minutes of 60 or more."""
    degrees, minutes = divmod(abs(value), 100.0)
    if minutes >= 60.0:
        raise Rejected("no ddmm.mmmm: 60 minutes or more")
    return math.copysign(degrees + minutes / 60.0, value)


def both_in(text: str) -> tuple[str, str]:
    """The latitude and the longitude of one cell (`N42 13.8 W8 44.4`, `42.23, -8.74`); raises Rejected."""
    if (match := _POINT.fullmatch(text.strip())) is not None:
        return match[2], match[1]
    if (match := _PLACE.fullmatch(text)) is not None:
        return match[1] + match[2], match[3] + match[4]
    if (match := _PLACE_AFTER.fullmatch(text)) is not None:
        return match[1], match[2]
    for between in (r"\s*[;/]\s*", r",\s+", r",", r"\s+"):
        halves = re.split(between, text.strip("()[] "))
        if len(halves) == 2:
            return halves[0], halves[1]
    raise Rejected("no latitude and longitude")


def _without_letter(text: str, axis: str) -> tuple[str, str | None]:
    """The text without the letter before or behind it, and that letter; raises Rejected for one of the other axis."""
    for place in (0, -1):
        letter = text[place : place + 1 or None].upper()
        if letter and letter in _SIDES and not (letter == "S" and place == -1 and axis == "EW"):
            if letter not in axis:
                raise Rejected("a letter of the other axis")
            return text.strip()[1:].strip() if place == 0 else text[:-1].strip(), letter
    if text[-1:].upper() == "O" or text[:1].upper() == "O":
        raise Rejected("O is east in German and west in French and Spanish: write E or W")
    return text, None
