"""Unit conversions at the edges (decoders, views); everything between them is SI."""

from typing import Final

METRES_PER_NAUTICAL_MILE: Final = 1852.0
METRES_PER_STATUTE_MILE: Final = 1609.344
METRES_PER_KILOMETRE: Final = 1000.0
M_S_PER_KN: Final = METRES_PER_NAUTICAL_MILE / 3600.0
"""Speed of one knot, m/s."""
STANDARD_GRAVITY_M_S2: Final = 9.80665
NS_PER_S: Final = 1_000_000_000
NS_PER_MS: Final = 1_000_000
NS_PER_US: Final = 1_000
