"""Interacting multiple models of R: hypotheses R0 x scale for each channel, one of which is true, now and then another.

An interacting multiple model (IMM) in its cheapest form, the generalised pseudo-Bayesian filter of first order (GPB1;
Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 11.6): the
hypotheses are merged into one Gaussian after every scalar update, so that there is one x and one P, and the cost grows
with the number of channels; the full IMM needs a filter for each combination of all channels' hypotheses. Measured,
the full IMM is up to 2 % better.

Letters: p = h P h^T prior variance, R_j the hypotheses, w_j their weights, v innovation. Hypothesis j has the gain
P h / (p + R_j), so the mixture has

    mean        x + P h g v,  g = sum w_j / (p + R_j) = 1 / (p + R) with the R that `variance` reports,
    covariance  P - g P h (P h)^T + s P h (P h)^T,  s = v^2 (variance of 1 / (p + R_j) under w_j), the `spread`.
"""

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from shore.navigation.noise.noise_rule import BeforeUpdate, Channel, ChannelNoise
from shore.navigation.numbers import Array, Number

LONGEST_STAY_S: Final = 10.0
"""A channel slower than this is treated as if it had this interval: transitions stay unlikely."""


@dataclass(frozen=True, slots=True)
class ScaleBank(BeforeUpdate):
    """R = R0 times one of 2^lowest ... 2^highest, `per_octave` of them an octave; all are equally likely at first."""

    lowest: int
    highest: int
    per_octave: int
    near_per_s: float
    """Probability per second that R moves to one of the two neighbours."""
    far_per_s: float
    """Probability per second that R is drawn again from all of them: a sensor fails within one step."""

    def scales(self) -> Array:
        """R_j / R0, shape (J,), rising."""
        count = (self.highest - self.lowest) * self.per_octave + 1
        scales: Array = 2.0 ** np.linspace(self.lowest, self.highest, count)
        return scales

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """Weigh the hypotheses with this innovation; `variance` and `spread` make the update that of the mixture."""
        scales, transitions = _tables(self, channel.rate_hz)
        R = channel.initial_variance * scales.reshape(-1, *(1 for _ in np.shape(innovation)))
        total = prior_variance + R
        square = innovation * innovation
        prior = transitions @ np.array(noise.weights) if noise.weights else np.full(total.shape, 1.0 / len(scales))
        exponent = -0.5 * (np.log(total) + square / total)
        weights = prior * np.exp(exponent - exponent.max(axis=0))
        weights = weights / weights.sum(axis=0)
        slope = weights / total
        gain = slope.sum(axis=0)
        # (slope R).sum / gain is 1 / gain - p without its cancellation when p is far larger than R
        variance, scatter = (slope * R).sum(axis=0) / gain, (weights * (1.0 / total - gain) ** 2).sum(axis=0)
        remembered = tuple(weights if weights.ndim > 1 else weights.tolist())
        return noise._replace(variance=_number(variance), spread=_number(square * scatter), weights=remembered)


@cache
def _tables(bank: ScaleBank, rate_hz: float) -> tuple[Array, Array]:
    """The scales (J,) and the transition probabilities over one interval of the channel, (to, from)."""
    scales = bank.scales()
    count = len(scales)
    interval_s = min(1.0 / rate_hz, LONGEST_STAY_S)
    near, far = bank.near_per_s * interval_s, bank.far_per_s * interval_s
    transitions = np.full((count, count), far / count) + (1.0 - near - far) * np.eye(count)
    for place in range(count):
        # beyond either end there is nothing: the outermost hypotheses keep that half
        for neighbour in (max(place - 1, 0), min(place + 1, count - 1)):
            transitions[neighbour, place] += 0.5 * near
    return scales, transitions


def _number(value: Array) -> Number:
    """A float for one boat, an array for a batch."""
    return value if np.ndim(value) else float(value)


SCALE_BANK: Final = ScaleBank(lowest=-2, highest=8, per_octave=2, near_per_s=0.01, far_per_s=0.001)
"""R0 / 4 to 256 R0 in steps of 1.41; R wanders by a factor of 1.41 in 100 s and breaks once in 17 minutes."""
