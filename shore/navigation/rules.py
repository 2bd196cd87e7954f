"""The rules for the noise by name."""

from collections.abc import Mapping
from typing import Final

from shore.navigation.adaptation import FixedNoise, NoiseRule
from shore.navigation.drive import FUZZY_QR
from shore.navigation.fuzzy import FUZZY, FUZZY_THESIS
from shore.navigation.matching import INNOVATION_MATCHING, RESIDUAL_MATCHING
from shore.navigation.scales import SCALE_BANK

NOISE_RULES: Final[Mapping[str, NoiseRule]] = {
    "fixed": FixedNoise(),
    "fuzzy-thesis": FUZZY_THESIS,
    "fuzzy": FUZZY,
    "fuzzy-qr": FUZZY_QR,
    "iae": INNOVATION_MATCHING,
    "rae": RESIDUAL_MATCHING,
    "imm": SCALE_BANK,
}
"""Name -> rule."""
