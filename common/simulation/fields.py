"""Water that moves: the current as a vector field over the local plane."""

import math
from collections.abc import Callable
from dataclasses import dataclass

CurrentField = Callable[[float, float], tuple[float, float]]
"""(east_m, north_m) -> velocity of the water (east_m_s, north_m_s)."""


@dataclass(frozen=True, slots=True)
class WavyCurrent:
    """A current of constant drift whose set swings with the easting; a swing of 0 makes it uniform.

    set = towards_deg + swing_deg sin(2 pi east_m / wavelength_m): where the water flows *to*, clockwise from north.
    """

    drift_m_s: float
    towards_deg: float
    swing_deg: float = 0.0
    wavelength_m: float = 800.0

    def __call__(self, east_m: float, north_m: float) -> tuple[float, float]:  # noqa: ARG002 - a field has two axes
        """Velocity of the water at a place."""
        swing = self.swing_deg * math.sin(math.tau * east_m / self.wavelength_m)
        set_rad = math.radians(self.towards_deg + swing)
        return self.drift_m_s * math.sin(set_rad), self.drift_m_s * math.cos(set_rad)
