"""Noise adaptation rules by name."""

from collections.abc import Mapping
from typing import Final

from shore.navigation.noise.covariance_matching import INNOVATION_MATCHING, RESIDUAL_MATCHING
from shore.navigation.noise.fuzzy import FUZZY
from shore.navigation.noise.fuzzy_thesis import FUZZY_THESIS
from shore.navigation.noise.noise_rule import FixedNoise, NoiseRule
from shore.navigation.noise.process_noise import FUZZY_QR
from shore.navigation.noise.scale_bank import SCALE_BANK

NOISE_RULES: Final[Mapping[str, NoiseRule]] = {
    "fixed": FixedNoise(),
    "fuzzy-thesis": FUZZY_THESIS,
    "fuzzy": FUZZY,
    "fuzzy-qr": FUZZY_QR,
    "iae": INNOVATION_MATCHING,
    "rae": RESIDUAL_MATCHING,
    "imm": SCALE_BANK,
}
"""All rules for the measurement noise, by name."""
