"""Magnetic variation where and when the boat is: the board's file, the compass, or the World Magnetic Model.

Variation (geomagnetism: declination) is the direction of magnetic north seen from true north, degrees, east +. The
models are those of NOAA and BGS for their five years each, by way of pygeomag.

The owner wins: what the board's file says is used. A device's own variation is used unless the model contradicts it;
one of 0 is what devices fill in that know none, and says nothing. All else is the model's.
"""

import math
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Final, NamedTuple

from pygeomag import GeoMag

from common.angles import difference_deg
from common.events import event
from common.geodesy import LocalPlane
from common.messages import Event
from common.units import NS_PER_S


class Model(NamedTuple):
    """One World Magnetic Model; its doubt (1-sigma) is sqrt(floor_deg^2 + (slope_nt / H)^2) deg, H horizontal in nT."""

    first_year: float
    coefficients: str
    """The name of its file in pygeomag: the library's default changes with its version, and a replay must not."""
    floor_deg: float
    slope_nt: float


MODELS: Final = (
    # Nobody published such a doubt for WMM2010; it has that of its successor.
    Model(2010.0, "wmm/WMM_2010.COF", 0.23, 5430.0),
    Model(2015.0, "wmm/WMM_2015v2.COF", 0.23, 5430.0),
    Model(2020.0, "wmm/WMM_2020.COF", 0.26, 5625.0),
    Model(2025.0, "wmm/WMM_2025.COF", 0.26, 5417.0),
)
"""The models, oldest first (technical reports of WMM2015, WMM2020 and WMM2025, section on the error model)."""
FIRST_YEAR: Final = MODELS[0].first_year
LAST_YEAR: Final = 2030.0
"""Last year of the newest model's life. Outside the models' years the nearest is used: what is wrong then grows by 0.25
deg a year or less (95 % of the earth)."""
MIDDLE_YEAR: Final = 0.5 * (MODELS[-1].first_year + LAST_YEAR)
"""Year that stands for an unknown date: at most 2.5 years, 0.6 deg (95 % of the earth), from any date of the newest
model's life."""
DOUBTED_DEG: Final = 2.0
"""A device's variation that is further than this from the model's is not used (nor one nearer than twice the model's
own doubt doubted, near a magnetic pole), deg: an old place or year, a sign, or somebody else's boat."""
UNDATED_DEG: Final = 5.0
"""The same while the date is unknown, deg: a recording may be of fifteen years ago, and the field turns by 0.2 deg a
year in Europe."""
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


class _Field(NamedTuple):
    """The field at a place."""

    variation_deg: float
    doubt_deg: float
    horizontal_nt: float
    year: float
    """The year that was wanted."""
    used_year: float
    model: str
    """Name of the model: `WMM2025`."""


class Variation:
    """The variation at the newest fix; says which value of the model it gives, and each kind of doubt once."""

    def __init__(self, tell: Callable[[Event], None], owner_deg: float | None = None) -> None:
        """owner_deg: variation of the board's file, deg, east +; `None` = it says nothing."""
        self._tell = tell
        self._owner_deg = owner_deg
        self._told: set[str] = set()
        self._place: _Place | None = None
        self._field: _Field | None = None
        """The field at `_place`; `None` = not calculated yet."""
        self._is_told = False
        """True once it is said that this field's variation is used."""
        self._asked_ns: int | None = None

    def see(self, lat_deg: float, lon_deg: float, utc_ns: int | None) -> None:
        """The newest fix and, where the board knows it, UTC."""
        before = self._place
        here = _Place(lat_deg, lon_deg, before.utc_ns if before and utc_ns is None else utc_ns)
        if before is None or _is_far(before, here) or _is_aged(before, here):
            self._place, self._field, self._is_told = here, None, False

    def east_deg(self, t_ns: int, sensor: str, sent_deg: float | None = None) -> float | None:
        """Variation in degrees, east +, for a reading of `sensor`, which says `sent_deg` itself.

        `None` = nobody says, and there is no fix for the model yet.
        """
        if self._owner_deg is not None:
            return self._owner_deg
        if self._place is None:
            return sent_deg or None
        if self._field is None:
            self._field = _field_at(self._place)
        if sent_deg and not self._is_contradicted(sent_deg, self._field, t_ns, sensor):
            return sent_deg
        self._say(self._field, self._place, t_ns, sensor)
        return self._field.variation_deg

    def _is_contradicted(self, sent_deg: float, field: _Field, t_ns: int, sensor: str) -> bool:
        apart_deg = abs(difference_deg(sent_deg, field.variation_deg))
        limit_deg = DOUBTED_DEG if self._place is not None and self._place.utc_ns is not None else UNDATED_DEG
        if apart_deg <= max(limit_deg, 2.0 * field.doubt_deg):
            return False
        model_deg = round(field.variation_deg, 2)
        self._once("variation-doubted", t_ns, sensor, sensor=sensor, variation_deg=sent_deg, model_deg=model_deg)
        return True

    def _say(self, field: _Field, place: _Place, t_ns: int, sensor: str) -> None:
        """What there is to say of the model's value, now that it is used."""
        if not self._is_told:
            self._is_told = True
            variation_deg, doubt_deg = round(field.variation_deg, 2), round(field.doubt_deg, 1)
            if place.utc_ns is not None:
                used: dict[str, float | str] = {"variation_deg": variation_deg, "doubt_deg": doubt_deg}
                self._tell(event("variation-used", t_ns, sensor, **used, model=field.model))
            if field.used_year != field.year:
                years = {"year": round(field.year, 1), "used_year": round(field.used_year)}
                self._once("variation-expired", t_ns, sensor, **years)
            horizontal_nt = round(field.horizontal_nt)
            if horizontal_nt < BLACKOUT_NT:
                self._once("compass-useless", t_ns, sensor, field_nt=horizontal_nt)
            elif horizontal_nt < CAUTION_NT:
                self._once("compass-weak", t_ns, sensor, field_nt=horizontal_nt)
        self._asked_ns = t_ns if self._asked_ns is None else self._asked_ns
        if place.utc_ns is None and t_ns - self._asked_ns >= UNDATED_AFTER_S * NS_PER_S:
            variation_deg = round(field.variation_deg, 2)
            self._once("variation-undated", t_ns, sensor, variation_deg=variation_deg, year=MIDDLE_YEAR)

    def _once(self, code: str, t_ns: int, source: str, **evidence: float | str) -> None:
        """Say it once; a doubt of a device, once for each."""
        key = f"{code} {evidence.get('sensor', '')}"
        if key not in self._told:
            self._told.add(key)
            self._tell(event(code, t_ns, source, **evidence))


def _field_at(place: _Place) -> _Field:
    year = MIDDLE_YEAR if place.utc_ns is None else decimal_year(place.utc_ns)
    used_year = min(max(year, FIRST_YEAR), LAST_YEAR)
    model = max(model for model in MODELS if model.first_year <= used_year)
    found = GeoMag(coefficients_file=model.coefficients).calculate(place.lat_deg, place.lon_deg, 0.0, used_year)
    horizontal_nt = float(found.h)
    doubt_deg = math.hypot(model.floor_deg, model.slope_nt / max(horizontal_nt, 1.0))
    return _Field(float(found.d), doubt_deg, horizontal_nt, year, used_year, f"WMM{model.first_year:.0f}")


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
