"""State space of a filter: the thesis' five states (section 4.2), states beyond them, and how each wanders.

x, shape (..., n): `[east_m, north_m, v_east_m_s, v_north_m_s, heading_rad]`, heading clockwise from true north, then
the extra states: those of the motion in the order of `EXTRA_NAMES`, then the errors of single sensors.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from shore.navigation.numbers import Array, Number, sin_cos

BASE_NAMES: Final = ("east_m", "north_m", "v_east_m_s", "v_north_m_s", "heading_rad")
EAST, NORTH, V_EAST, V_NORTH, HEADING = range(len(BASE_NAMES))

UNKNOWN_SPEED_M_S: Final = 1.0
"""1-sigma of each velocity when the receiver gives none: together 1.4 m/s, the hull speed of a boat of 1.2 m."""

EXTRA_NAMES: Final = (
    "gyro_bias_rad_s",
    "accel_bias_fwd_m_s2",
    "accel_bias_stb_m_s2",
    "tilt_leak_per_m",
    "heel_leak",
    "current_east_m_s",
    "current_north_m_s",
    "way_m_s",
)
"""Biases are what the sensor shows too much, and so is the tilt leak (`tilt_leak.py`). The heel leak is how much of
gravity the starboard axis shows in a turn, over speed ahead x yaw rate: a hull that heels outward by 0.15 rad for each
m/s^2 of that shows 0.15 g. The current is where the water flows to; the way is the speed through the water that the
thrust keeps up."""

ERROR_NAMES: Final = ("{}_error_east_m", "{}_error_north_m", "{}_bias_rad", "{}_sin_rad", "{}_cos_rad")
"""States of one sensor ({} = its id), which the motion does not know: the lasting error of a receiver's fixes; a
compass shows too much by bias + sin coefficient x sin(heading) + cos coefficient x cos(heading)."""


class Extra(NamedTuple):
    """A state beyond the thesis' five."""

    name: str
    """Name of the state, one of `EXTRA_NAMES`, or of `ERROR_NAMES` with the id of a sensor."""
    sigma: float
    """1-sigma of the state's prior, whose mean is 0."""
    walk: float = 0.0
    """Density of its random walk, unit / sqrt(s)."""
    limit: float = math.inf
    """Largest magnitude of the state, which is kept within it."""
    lasts_s: float = math.inf
    """Time constant of a Gauss-Markov process (coloured noise), s: the state fades, and sigma is renewed; inf = no."""


@dataclass(frozen=True)
class StateSpace:
    """Which states a filter has: the five, `EXTRA_NAMES` in order, those of sensors; a prior of 0 = no such state."""

    extras: tuple[Extra, ...] = ()
    names: tuple[str, ...] = field(init=False)
    """Names of all n states in the order of x."""

    def __post_init__(self) -> None:
        unknown = [extra.name for extra in self.extras if extra.name not in EXTRA_NAMES and not _is_error(extra.name)]
        if unknown:
            raise ValueError(f"no such state: {', '.join(unknown)}")
        used = sorted((extra for extra in self.extras if extra.sigma > 0.0), key=_rank)
        object.__setattr__(self, "extras", tuple(used))
        object.__setattr__(self, "names", (*BASE_NAMES, *(extra.name for extra in used)))

    @cached_property
    def size(self) -> int:
        """Number of states, the n of x (n,) and P (n, n)."""
        return len(self.names)

    @cached_property
    def _by_name(self) -> dict[str, int]:
        return {name: place for place, name in enumerate(self.names)}

    def index(self, name: str) -> int | None:
        """Place of a state, `None` when it is left out."""
        return self._by_name.get(name)

    @cached_property
    def places(self) -> tuple[int | None, ...]:
        """Place in x of each of `EXTRA_NAMES`, `None` = no such state."""
        return tuple(self.index(name) for name in EXTRA_NAMES)

    @cached_property
    def driving(self) -> int:
        """How many states, the first ones, the motion depends on; the others only fade and wander."""
        own, currents = self.places[:5], self.places[5:7]
        leaks = own[3:] != (None, None)
        places: list[int] = [place for place in (HEADING, *own, *(currents if leaks else ())) if place is not None]
        return max(places) + 1

    @cached_property
    def fading(self) -> Array | None:
        """Rate at which each state fades, 1/s, (n,); `None` = none of them does."""
        rates = np.array([0.0] * len(BASE_NAMES) + [1.0 / extra.lasts_s for extra in self.extras])
        return rates if rates.any() else None

    @cached_property
    def growth(self) -> tuple[tuple[int, float, float], ...]:
        """Place, time constant (inf = none) and variance of what wanders: it tends to that, or gains it each second."""
        return tuple(
            (place, extra.lasts_s, extra.sigma**2 if math.isfinite(extra.lasts_s) else extra.walk**2)
            for place, extra in self.walks
        )

    @cached_property
    def walks(self) -> tuple[tuple[int, Extra], ...]:
        """The states that wander by themselves, and their places."""
        wander = ((place, extra) for place, extra in enumerate(self.extras, len(BASE_NAMES)))
        return tuple((place, extra) for place, extra in wander if extra.walk or math.isfinite(extra.lasts_s))

    def kept(self, dt_s: float) -> Array | None:
        """Share of each state that is left after `dt_s`, (n,); `None` = all of each."""
        if self.fading is None:
            return None
        shares: Array = np.exp(-dt_s * self.fading)
        return shares

    @cached_property
    def noise_entries(self) -> npt.NDArray[np.intp]:
        """Which of the entries that `process_noise` lists stands at each place of Q, (n, n)."""
        entries = np.zeros((self.size, self.size), dtype=np.intp)
        for first, row, place in ((1, EAST, EAST), (4, EAST, V_EAST), (4, V_EAST, EAST), (7, V_EAST, V_EAST)):
            entries[row : row + 2, place : place + 2] = [[first, first + 2], [first + 2, first + 1]]
        entries[HEADING, HEADING] = 10
        for entry, (place, _) in enumerate(self.walks, start=11):
            entries[place, place] = entry
        return entries

    @cached_property
    def limits(self) -> tuple[tuple[int, float], ...]:
        """(place, magnitude) of the bounded states."""
        bounded = ((len(BASE_NAMES) + i, extra.limit) for i, extra in enumerate(self.extras))
        return tuple(item for item in bounded if math.isfinite(item[1]))


def _is_error(name: str) -> bool:
    return any(name.endswith(each.removeprefix("{}")) for each in ERROR_NAMES)


def _rank(extra: Extra) -> int:
    return EXTRA_NAMES.index(extra.name) if extra.name in EXTRA_NAMES else len(EXTRA_NAMES)


FIVE: Final = StateSpace()
"""The thesis' state alone: place, velocity and heading."""


class Gaussian(NamedTuple):
    """What a filter believes."""

    space: StateSpace
    x: Array
    """Mean of the state, (..., n)."""
    P: Array
    """Covariance of the state, (..., n, n)."""


def wrong_with_compass(space: StateSpace, P: Array, compass: str, heading_rad: Number) -> None:
    """Make P (n, n) that of a heading that a compass has shown: both are wrong together."""
    sin, cos = sin_cos(heading_rad)
    for kind, slope in (("bias", 1.0), ("sin", sin), ("cos", cos)):
        wrong_together(space, P, HEADING, f"{compass}_{kind}_rad", slope)


def wrong_together(space: StateSpace, P: Array, place: int, name: str, slope: Number) -> None:
    """What was shown of a state is state + slope x the error of that name, where that is a state too."""
    error = space.index(name)
    if error is not None:
        P[place, place] += slope * slope * P[error, error]
        P[place, error] = P[error, place] = -slope * P[error, error]
