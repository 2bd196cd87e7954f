"""Covariance matching (thesis section 5.1.1): R is solved for, so that theory and sample agree.

Before the update from innovations (Eqs 5.3, 5.6), after it from residuals (Eqs 5.8, 5.9). The thesis' reason for a
fuzzy rule instead is that Eq. 5.6 can yield a negative variance; such outcomes are counted, and R stays at its floor.
"""

import math
from dataclasses import dataclass
from typing import Final

from shore.navigation.noise.noise_rule import WINDOW_COVERS_S, BeforeUpdate, Channel, ChannelNoise
from shore.navigation.numbers import Number, choose, clip


@dataclass(frozen=True, slots=True)
class InnovationMatching(BeforeUpdate):
    """R = C_A - h P h^T, C_A the mean squared innovation over a window (Eq. 5.6), within [floor, ceiling] R0.

    R0 serves until the window is full.
    """

    samples: int
    floor: float
    ceiling: float

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """R for this update; the window holds its innovation."""
        return matched(self, channel, noise, innovation, -prior_variance)


@dataclass(frozen=True, slots=True)
class ResidualMatching(BeforeUpdate):
    """R = C_A + h P+ h^T, C_A the mean squared residual over a window (Eq. 5.9, which prints P- for P+).

    Never negative; what is found after one update serves the next one.
    """

    samples: int
    floor: float
    ceiling: float

    @property
    def reviews(self) -> bool:
        """Residuals exist only after the update."""
        return True

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """`noise` as it is."""
        del channel, innovation, prior_variance
        return noise

    def review(
        self, channel: Channel, noise: ChannelNoise, residual: Number, posterior_variance: Number
    ) -> ChannelNoise:
        """R for the next update."""
        return matched(self, channel, noise, residual, posterior_variance)


def matched(
    rule: InnovationMatching | ResidualMatching, channel: Channel, noise: ChannelNoise, apart: Number, variance: Number
) -> ChannelNoise:
    """R = mean of the squares of `apart` + `variance` once the window is full; what is not positive is counted."""
    # at a high rate 30 samples would be a moment: as long as the windows of the fuzzy rules
    length = max(rule.samples, math.ceil(channel.rate_hz * WINDOW_COVERS_S - 1e-9))
    window = (*noise.window, apart * apart)[-length:]
    if len(window) < length:
        return noise._replace(window=window)
    outcome = sum(window) / length + variance
    least, most = rule.floor * channel.initial_variance, rule.ceiling * channel.initial_variance
    negatives = noise.negatives + choose(outcome <= 0.0, 1.0, 0.0)
    return noise._replace(window=window, variance=clip(outcome, least, most), negatives=negatives)


INNOVATION_MATCHING: Final = InnovationMatching(samples=30, floor=1e-3, ceiling=1e4)
RESIDUAL_MATCHING: Final = ResidualMatching(samples=30, floor=1e-3, ceiling=1e4)
"""Window and limits of the literal fuzzy rule, so that they can be compared."""
