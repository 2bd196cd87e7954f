"""Unit conversion: the units that cells and column names of a table carry, by quantity.

A factor turns a value of the unit into the unit of the boat: knots, metres, degrees, deg/s, m/s^2, seconds.
"""

import math
import re
from typing import Final

from common.units import STANDARD_GRAVITY_M_S2

_RAD: Final = math.degrees(1.0)
_SPEED: Final = {
    **dict.fromkeys(("kn", "kt", "kts", "knot", "knots"), 1.0),
    **dict.fromkeys(("km/h", "kmh", "kmph", "kph"), 1.0 / 1.852),
    **dict.fromkeys(("m/s", "ms", "mps", "ms-1"), 3600.0 / 1852.0),
    **dict.fromkeys(("cm/s", "cmps"), 36.0 / 1852.0),
    **dict.fromkeys(("mm/s", "mmps"), 3.6 / 1852.0),
    **dict.fromkeys(("mph", "mi/h"), 1609.344 / 1852.0),
    **dict.fromkeys(("ft/s", "fps"), 0.3048 * 3600.0 / 1852.0),
}
_LENGTH: Final = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("ft", "feet", "foot"), 0.3048),
    "km": 1000.0,
    "cm": 0.01,
    "mm": 0.001,
}
_ANGLE: Final = {
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "grad", "grd"), 1.0),
    **dict.fromkeys(("rad", "rads", "radian", "radians"), _RAD),
    **dict.fromkeys(("cdeg", "centideg", "centidegrees"), 0.01),
    **dict.fromkeys(("dege7", "1e-7deg", "deg*1e7"), 1e-7),
    "mrad": _RAD / 1000.0,
    "semicircles": 180.0 / 2.0**31,
}
_RATE: Final = {
    **dict.fromkeys(("deg/s", "deg/sec", "degps", "dps", "degs-1"), 1.0),
    **dict.fromkeys(("rad/s", "rad/sec", "radps", "rps", "rads-1"), _RAD),
    **dict.fromkeys(("deg/min", "degpm"), 1.0 / 60.0),
    **dict.fromkeys(("mrad/s", "mradps"), _RAD / 1000.0),
    **dict.fromkeys(("mdps", "mdeg/s"), 0.001),
    **dict.fromkeys(("cdeg/s",), 0.01),
}
_ACCELERATION: Final = {
    **dict.fromkeys(("m/s2", "m/s/s", "mps2", "ms2", "ms-2", "m/sec2", "m/ss"), 1.0),
    **dict.fromkeys(("g", "gee", "gs"), STANDARD_GRAVITY_M_S2),
    **dict.fromkeys(("mg", "milli-g"), STANDARD_GRAVITY_M_S2 / 1000.0),
    **dict.fromkeys(("cm/s2",), 0.01),
    **dict.fromkeys(("mm/s2",), 0.001),
}
_TIME: Final = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minutes"), 60.0),
    **dict.fromkeys(("h", "hours"), 3600.0),
}
UNITS: Final = {
    "speed": _SPEED,
    "length": _LENGTH,
    "angle": _ANGLE,
    "rate": _RATE,
    "acceleration": _ACCELERATION,
    "time": _TIME,
    "mode": {"d": 1.0},
}
"""Factor of each unit, by quantity and by the unit in small letters without blanks."""
_IN_BRACKETS: Final = re.compile(r"[(\[{]([^)\]}]*)[)\]}]\s*$")
_WORDS: Final = re.compile(r"[\s_.:/]+")
_LONGEST_UNIT: Final = 3
"""Most words of a name that are a unit together: m_s_2."""


def factor_of(unit: str, quantity: str) -> float | None:
    """Factor of a unit as people write it (` km/h`, `m/s²`, `°`); `None` = no unit of this quantity."""
    text = unit.strip().strip("()[]{}").casefold().replace(" ", "").rstrip(".")
    # Micro and degree have two characters each.
    text = text.replace("°", "deg").replace("º", "deg").replace("\u03bc", "u").replace("\u00b5", "u")
    text = text.replace("²", "2").replace("^", "").replace("**", "")
    return UNITS[quantity].get(text)


def unit_of_name(name: str, quantity: str) -> str | None:
    """The unit at the end of a column's name (`Speed [km/h]`, `gyro_z_rad_s`); `None` = it carries none."""
    bracketed = _IN_BRACKETS.search(name)
    if bracketed is not None:
        return bracketed[1].strip() if factor_of(bracketed[1], quantity) is not None else None
    words = [word for word in _WORDS.split(name) if word]
    for count in range(min(_LONGEST_UNIT, len(words) - 1), 0, -1):
        for joint in ("/", ""):
            unit = joint.join(words[-count:])
            if factor_of(unit, quantity) is not None:
                return unit
    return None
