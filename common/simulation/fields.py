"""Currents, tides and wind: vector fields over the local plane and time.

A field is any callable (east_m, north_m, t_s) -> (v_east_m_s, v_north_m_s): the velocity of the water at a place, `t_s`
seconds after the start of the voyage. Fields take floats, or arrays of one shape (many boats at once). What pushes a
boat is their sum: `Sum((current, Leeway(wind, 0.03)))`. A field from a file: `field_file.py`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

Number = float | npt.NDArray[np.float64]
VectorField = Callable[[Number, Number, Number], tuple[Number, Number]]
"""Called with (east_m, north_m, t_s); gives the velocity (east_m_s, north_m_s) in the direction of the flow."""

SEMI_DIURNAL_S: Final = 12.4206 * 3600.0
"""From one high water to the next: the principal lunar tide."""


def _sin(angle_rad: Number) -> Number:
    """Sine of an array, or of a float by the C library: its last bit decides whether a seed gives the same readings."""
    return math.sin(angle_rad) if isinstance(angle_rad, float) else np.sin(angle_rad)


def towards(speed_m_s: Number, direction_rad: Number) -> tuple[Number, Number]:
    """(east, north) of a flow *to* a direction clockwise from north."""
    cos = math.cos(direction_rad) if isinstance(direction_rad, float) else np.cos(direction_rad)
    return speed_m_s * _sin(direction_rad), speed_m_s * cos


@dataclass(frozen=True, slots=True)
class Uniform:
    """The same everywhere and always; a speed of 0 is still water."""

    speed_m_s: float
    towards_deg: float

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:
        """Velocity at a place and time."""
        east, north = towards(self.speed_m_s, math.radians(self.towards_deg))
        none = 0.0 * (east_m + north_m + t_s)  # gives an array its shape
        return east + none, north + none


STILL: Final = Uniform(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class WavyCurrent:
    """A current along a coast: constant drift, and a set that swings with the easting.

    set = towards_deg + swing_deg sin(2 pi east_m / wavelength_m): where the water flows *to*, clockwise from north.
    """

    drift_m_s: float
    towards_deg: float
    swing_deg: float = 0.0
    wavelength_m: float = 800.0

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:  # noqa: ARG002
        """Velocity of the water at a place."""
        swing = self.swing_deg * _sin(math.tau * east_m / self.wavelength_m)
        set_deg = self.towards_deg + swing
        return towards(self.drift_m_s, math.radians(set_deg) if isinstance(set_deg, float) else np.radians(set_deg))


@dataclass(frozen=True, slots=True)
class TidePeaks:
    """Greatest speeds of a tide, `up_m` from the mouth in the direction of the flood."""

    up_m: float
    flood_m_s: float
    ebb_m_s: float


SOUTHAMPTON_WATER: Final = (TidePeaks(0.0, 0.7, 1.0), TidePeaks(500.0, 0.5, 0.5), TidePeaks(1000.0, 0.25, 0.25))
"""Section 4.3.3.1: 0.7 m/s on the flood and 1.0 m/s on the ebb at the mouth, 0.5 m/s in the estuary, 0.25 m/s towards
the head of the rivers. The distances are ours, on the thesis' scale of 1:5."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tide:
    """A semi-diurnal tide curve along one axis: a sine from slack to slack, whose halves have their own peaks.

    speed = flood sin(p) for sin(p) >= 0, else ebb sin(p), p = 2 pi (t_s - slack_s) / period_s: positive speeds flow
    `flood_towards_deg`. Between the places of `peaks` the peaks change linearly, beyond the outermost not at all; one
    entry makes the tide equal everywhere.
    """

    flood_towards_deg: float
    slack_s: float
    """A slack water after which the flood begins, in s after the start of the voyage (negative = before)."""
    peaks: tuple[TidePeaks, ...] = SOUTHAMPTON_WATER[:1]
    mouth: tuple[float, float] = (0.0, 0.0)
    """Place from which `up_m` counts: (east_m, north_m)."""
    period_s: float = SEMI_DIURNAL_S

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:
        """Velocity of the water at a place and time."""
        direction = math.radians(self.flood_towards_deg)
        up_east, up_north = towards(1.0, direction)
        up = (east_m - self.mouth[0]) * up_east + (north_m - self.mouth[1]) * up_north
        places = [each.up_m for each in self.peaks]
        flood = np.interp(up, places, [each.flood_m_s for each in self.peaks])
        ebb = np.interp(up, places, [each.ebb_m_s for each in self.peaks])
        phase = _sin(math.tau * (t_s - self.slack_s) / self.period_s)
        speed: Number = np.maximum(phase, 0.0) * flood + np.minimum(phase, 0.0) * ebb
        return towards(speed, direction)


@dataclass(frozen=True, slots=True)
class Leeway:
    """What the wind does to the boat: a fraction of the wind's own velocity, downwind."""

    wind: VectorField
    """Velocity of the air: (east_m_s, north_m_s) where it blows *to*."""
    coefficient: float
    """Leeway as a fraction of the wind's velocity, some 0.02 to 0.04 for a small boat."""

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:
        """Velocity that the wind adds."""
        east, north = self.wind(east_m, north_m, t_s)
        return self.coefficient * east, self.coefficient * north


@dataclass(frozen=True, slots=True)
class Sum:
    """Several fields at once."""

    fields: tuple[VectorField, ...]

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:
        """Velocity of all together."""
        parts = [field(east_m, north_m, t_s) for field in self.fields]
        return sum((east for east, _ in parts), 0.0 * east_m), sum((north for _, north in parts), 0.0 * north_m)
