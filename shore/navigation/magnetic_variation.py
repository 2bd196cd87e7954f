"""Magnetic variation where and when the boat is: the World Magnetic Model 2025 of NOAA and BGS, by way of pygeomag.

Variation (geomagnetism: declination) is the direction of magnetic north seen from true north, degrees, east +.
"""

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final, NamedTuple

from pygeomag import GeoMag

from common.events import event
from common.geodesy import LocalPlane
from common.messages import Event
from common.units import NS_PER_S

COEFFICIENTS: Final = "wmm/WMM_2025.COF"
"""Named, because the library's default changes with its version and a replay must not."""
FIRST_YEAR: Final = 2025.0
LAST_YEAR: Final = 2030.0
"""Last year of the model's life. Outside it the nearest year is used: what is wrong then grows by 0.25 deg a year or
less (95 % of the earth), and a receiver that lost 1024 weeks does little harm."""
MIDDLE_YEAR: Final = 0.5 * (FIRST_YEAR + LAST_YEAR)
"""Year that stands for an unknown date: at most 2.5 years, 0.6 deg (95 % of the earth), from any date of the model's
life."""
MOVED_M: Final = 10_000.0
"""Distance after which the variation is calculated again, m: 0.17 deg at most where the horizontal field exceeds 20,000
nT (two thirds of the earth, median 0.03), half the doubt the model itself has there."""
AGED_NS: Final = 24 * 3600 * NS_PER_S
"""Age after which it is calculated again, ns: a day, in which the field turns by less than 0.001 deg; a receiver's date
may have come right meanwhile."""
CAUTION_NT: Final = 6000.0
BLACKOUT_NT: Final = 2000.0
"""Horizontal field below which the model's authors call for caution, and call compasses unreliable."""
UNDATED_AFTER_S: Final = 10.0
"""Time after which a receiver that knows the date has given it, s."""


class _Place(NamedTuple):
    lat_deg: float
    lon_deg: float
    utc_ns: int | None


class Variation:
    """The variation at the newest fix; says which value it gives, and each kind of doubt once."""

    def __init__(self, tell: Callable[[Event], None]) -> None:
        self._model = GeoMag(coefficients_file=COEFFICIENTS)
        self._tell = tell
        self._told: set[str] = set()
        self._place: _Place | None = None
        self._deg: float | None = None
        """Variation at `_place`, deg, east +; `None` = not calculated yet."""
        self._asked_ns: int | None = None

    def see(self, lat_deg: float, lon_deg: float, utc_ns: int | None) -> None:
        """The newest fix and, where the board knows it, UTC."""
        before = self._place
        here = _Place(lat_deg, lon_deg, before.utc_ns if before and utc_ns is None else utc_ns)
        if before is None or _is_far(before, here) or _is_aged(before, here):
            self._place, self._deg = here, None

    def east_deg(self, t_ns: int, sensor: str) -> float | None:
        """Variation in degrees, east +, for a reading of `sensor`; `None` before the first fix."""
        if self._place is None:
            return None
        if self._deg is None:
            self._deg = self._work_out(self._place, t_ns, sensor)
        self._asked_ns = t_ns if self._asked_ns is None else self._asked_ns
        if self._place.utc_ns is None and t_ns - self._asked_ns >= UNDATED_AFTER_S * NS_PER_S:
            self._once("variation-undated", t_ns, sensor, variation_deg=round(self._deg, 2), year=MIDDLE_YEAR)
        return self._deg

    def _work_out(self, place: _Place, t_ns: int, sensor: str) -> float:
        year = MIDDLE_YEAR if place.utc_ns is None else decimal_year(place.utc_ns)
        used_year = min(max(year, FIRST_YEAR), LAST_YEAR)
        field = self._model.calculate(place.lat_deg, place.lon_deg, 0.0, used_year)
        variation_deg, horizontal_nt = round(float(field.d), 2), round(float(field.h))
        if place.utc_ns is not None:
            doubt_deg = round(float(field.calculate_uncertainty().d), 1)
            self._tell(event("variation-used", t_ns, sensor, variation_deg=variation_deg, doubt_deg=doubt_deg))
        if used_year != year:
            self._once("variation-expired", t_ns, sensor, year=round(year, 1), used_year=round(used_year))
        if horizontal_nt < BLACKOUT_NT:
            self._once("compass-useless", t_ns, sensor, field_nt=horizontal_nt)
        elif horizontal_nt < CAUTION_NT:
            self._once("compass-weak", t_ns, sensor, field_nt=horizontal_nt)
        return float(field.d)

    def _once(self, code: str, t_ns: int, sensor: str, **evidence: float) -> None:
        if code not in self._told:
            self._told.add(code)
            self._tell(event(code, t_ns, sensor, **evidence))


def decimal_year(utc_ns: int) -> float:
    """2026.5 = noon of 2 July 2026."""
    date = datetime.fromtimestamp(utc_ns / NS_PER_S, UTC)
    start, end = (datetime(date.year + years, 1, 1, tzinfo=UTC) for years in (0, 1))
    return date.year + (date - start) / (end - start)


def _is_far(a: _Place, b: _Place) -> bool:
    return math.hypot(*LocalPlane(a.lat_deg, a.lon_deg).to_east_north_m(b.lat_deg, b.lon_deg)) > MOVED_M


def _is_aged(a: _Place, b: _Place) -> bool:
    if a.utc_ns is None or b.utc_ns is None:
        return b.utc_ns is not None
    return abs(b.utc_ns - a.utc_ns) > AGED_NS
