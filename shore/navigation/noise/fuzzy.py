"""Fuzzy adaptation of R by the station's rule: a long window, a short one that watches it, and an outlier guard.

Like the literal rule of the thesis (`fuzzy_thesis.py`) it looks at the degree of matching C_A / C_T between the
innovations seen and the innovations expected.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

from shore.navigation.noise.noise_rule import WINDOW_COVERS_S, BeforeUpdate, Channel, ChannelNoise
from shore.navigation.noise.outlier_guard import guarded, not_equal, winsorised
from shore.navigation.numbers import Number, choose, clip


class Memory(NamedTuple):
    """What our rule remembers of a channel: sums over its samples that fade; kept in `ChannelNoise.window`.

    A sample has the weight g = R / C_T: where the state itself is unknown, an innovation says nothing about R.
    """

    learned: Number
    """R of the long window, m^2 or rad^2: excess / weight within the limits."""
    weight: Number
    """Sum of g over the long window, in samples."""
    excess: Number
    """Sum of g (innovation squared - prior variance) over the long window, m^2 or rad^2."""
    short_weight: Number = 0.0
    """Sum of g over the short window, in samples."""
    short_square: Number = 0.0
    """Sum of g innovation squared over the short window, m^2 or rad^2."""
    short_prior: Number = 0.0
    """Sum of g prior variance over the short window, m^2 or rad^2."""


@dataclass(frozen=True, slots=True)
class FuzzyNoise(BeforeUpdate):
    """The station's rule: R matches C_T to C_A over a long window, and fuzzy sets say when that window is out of date.

    The long window (about 60 samples, opened by `pseudo_samples` that say R0) sets R = C_A - mean prior variance, so
    that its own DoM is 1. A short one (about 8) watches: its DoM against R(k-1) belongs to "equal", "small" or "large".
    If equal, the long window goes on; if small or large, the short one takes its place; in between both are blended by
    their memberships. What the sets are, and how they keep a single jump of the GPS from moving the boat, stands in
    `outlier_guard.py`.

    R stays within [floor, ceiling] R0. Of a fast channel several samples weigh as one, so that the long window covers
    at least 20 s. What was done before R was known is cured by the filter, see `navigation.refilter_start`.
    """

    long: float = 60.0
    """Memory of the long window, in samples."""
    short: float = 8.0
    """Memory of the short window, in samples."""
    pseudo_samples: float = 3.0
    """Samples that R0 counts for."""
    floor: float = 0.25
    """R0 may be four times too large. Not more: successive errors that are alike make small innovations, which would be
    taken for precision."""
    ceiling: float = 1e4

    @property
    def filters_again(self) -> bool:
        """The opening is filtered again with the R learned in it."""
        return True

    def held(self, channel: Channel, noise: ChannelNoise) -> ChannelNoise:
        """Windows as at the start, and R held at what has been learned."""
        learned = noise.window[0]
        return ChannelNoise(learned, self._first(channel)._replace(learned=learned), is_held=True)

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """Put the sample into both windows, blend them, and take R from the long one."""
        memory = noise.window or self._first(channel)
        before, weight, excess, short_weight, short_square, short_prior = memory
        expected = prior_variance + before
        square = innovation * innovation
        learnable = winsorised(square, expected)
        entry = min(1.0, self.long / (WINDOW_COVERS_S * channel.rate_hz))
        share = entry * before / expected
        fade = 1.0 - entry / self.short
        short_weight, short_square, short_prior = fade * short_weight, fade * short_square, fade * short_prior
        new_weight, new_square = short_weight + share, short_square + share * learnable
        new_prior = short_prior + share * prior_variance
        dom_ratio = new_square / (new_prior + new_weight * before)
        stale = not_equal(dom_ratio, self._entries(new_weight))
        stays = (1.0 - stale) * (1.0 - entry / self.long)
        weight = stays * weight + stale * short_weight + share
        # What is too small is divided, not subtracted: P that a too large R has raised would leave nothing of R.
        fresh = choose(dom_ratio < 1.0, short_weight * before * dom_ratio, short_square - short_prior)
        shown = before * learnable / expected if noise.is_held else learnable - prior_variance
        excess = stays * excess + stale * fresh + share * shown
        learned = before if noise.is_held else self._limited(channel, excess / weight)
        is_plain = isinstance(square, float) and square <= learnable
        variance = learned if is_plain else self._limited(channel, guarded(learned, square, expected))
        window = Memory(learned, weight, excess, new_weight, new_square, new_prior)
        return noise._replace(variance=variance, window=window, dom_ratio=dom_ratio)

    def _first(self, channel: Channel) -> Memory:
        return Memory(channel.initial_variance, self.pseudo_samples, self.pseudo_samples * channel.initial_variance)

    def _limited(self, channel: Channel, variance: Number) -> Number:
        return clip(variance, self.floor * channel.initial_variance, self.ceiling * channel.initial_variance)

    def _entries(self, weight: Number) -> Number:
        """Number of equal entries that scatter like a fading window of this total weight."""
        return weight * (2.0 * self.short - 1.0) / (2.0 * self.short - weight)


FUZZY: Final = FuzzyNoise()
"""The station's rule. Each number may be 30 % off without harm."""
