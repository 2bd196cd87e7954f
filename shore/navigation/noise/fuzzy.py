"""Fuzzy adaptation of R: the thesis' rule as printed (Eqs 5.10-5.23), and the station's with a soft outlier gate.

Both look at the degree of matching C_A / C_T between the innovations seen and the innovations expected.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from shore.navigation.noise.noise_rule import BeforeUpdate, Channel, ChannelNoise
from shore.navigation.numbers import Number, choose, clip, larger, log, smaller, sqrt

WINDOW_COVERS_S: Final = 20.0
"""A window of N entries spans at least this long: above N / 20 samples a second, several samples make one entry."""


@dataclass(frozen=True, slots=True)
class FuzzyShape:
    """Thresholds of the membership functions (Table 5.3)."""

    ep1: float = 0.25
    ep2: float = 0.15
    largest: float = 7.0
    al_ep1: float = 0.2
    al_ep2: float = 0.08
    al_largest: float = 5.0


THESIS_SHAPE: Final = FuzzyShape()


def _ramp_area_moment(foot: float, start: Number, stop: Number, slope: Number) -> tuple[Number, Number]:
    """Integrals of o(a) and o(a) a over [start, stop] for the straight line o(a) = slope (a - foot)."""
    area = 0.5 * slope * ((stop - foot) ** 2 - (start - foot) ** 2)
    moment = slope * ((stop**3 - start**3) / 3.0 - 0.5 * foot * (stop**2 - start**2))
    return area, moment


def _centroid(
    first: tuple[Number, Number], low: Number, high: Number, height: Number, last: tuple[Number, Number]
) -> Number:
    """Centroid of a first ramp, a plateau of `height` over [low, high] and a last ramp (Eqs 5.20, 5.22)."""
    area = first[0] + height * (high - low) + last[0]
    moment = first[1] + 0.5 * height * (high * high - low * low) + last[1]
    return moment / area


def fuzzy_alpha(dom_ratio: Number, shape: FuzzyShape = THESIS_SHAPE) -> Number:
    """The factor on R for a degree of matching (Eqs 5.12-5.23), in closed form.

    Literal, with the thesis' own steps (Table 5.3): 0.812 -> 0.848 at 0.75, 0.88 -> 1 at 0.85, 1 -> 1.12 at 1.15, and
    not monotone: it falls from 1.164 to 1.125 between 1.242 and 1.25, then steps up to 1.147.
    """
    small, large = 1.0 - shape.ep2, 1.0 + shape.ep2
    if isinstance(dom_ratio, float):
        if small <= dom_ratio <= large:
            return 1.0
        return _alpha_small(dom_ratio, shape) if dom_ratio < small else _alpha_large(dom_ratio, shape)
    outside = choose(dom_ratio < small, _alpha_small(dom_ratio, shape), _alpha_large(dom_ratio, shape))
    return choose((dom_ratio >= small) & (dom_ratio <= large), 1.0, outside)


def _alpha_small(dom_ratio: Number, shape: FuzzyShape) -> Number:
    """Cases 1 and 2 (Eqs 5.19, 5.20): the sample variance is smaller than expected."""
    end_small = 1.0 - shape.al_ep2
    at_small = end_small * dom_ratio / (1.0 - shape.ep2)
    foot, width = 1.0 - shape.al_ep1, shape.al_ep1 - shape.al_ep2
    equal = clip((dom_ratio - 1.0 + shape.ep1) / (shape.ep1 - shape.ep2), 0.0, 1.0)
    at_equal = foot + width * equal
    rising = _ramp_area_moment(foot, foot, at_equal, 1.0 / width)
    falling = _ramp_area_moment(end_small, at_small, end_small, -1.0 / end_small)
    return choose(dom_ratio < 1.0 - shape.ep1, at_small, _centroid(rising, at_equal, at_small, equal, falling))


def _alpha_large(dom_ratio: Number, shape: FuzzyShape) -> Number:
    """Cases 4 and 5 (Eqs 5.22, 5.23): the sample variance is larger than expected."""
    start_large = 1.0 + shape.al_ep2
    span = shape.al_largest - start_large
    # the lower bound only keeps the centroid finite where another case answers
    large = clip((dom_ratio - 1.0 - shape.ep2) / (shape.largest - 1.0 - shape.ep2), 1e-12, 1.0)
    at_large = start_large + span * large
    end_equal, width = 1.0 + shape.al_ep1, shape.al_ep1 - shape.al_ep2
    equal = clip((1.0 + shape.ep1 - dom_ratio) / (shape.ep1 - shape.ep2), 0.0, 1.0)
    at_equal = end_equal - width * equal
    rising = _ramp_area_moment(start_large, start_large, at_large, 1.0 / span)
    falling = _ramp_area_moment(end_equal, at_equal, end_equal, -1.0 / width)
    return choose(dom_ratio > 1.0 + shape.ep1, at_large, _centroid(rising, at_large, at_equal, equal, falling))


@dataclass(frozen=True, slots=True)
class ThesisFuzzyNoise(BeforeUpdate):
    """R(k) = alpha(DoM(k)) R(k-1) within [floor, ceiling] R0; C_A is a mean square over a window (Eqs 5.3, 5.10, 5.11).

    Nothing moves until the window is full.
    """

    window: int
    floor: float
    ceiling: float
    shape: FuzzyShape = THESIS_SHAPE

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """Push the squared innovation; once for each entry of the window R moves by `fuzzy_alpha`."""
        pending = (*noise.pending, innovation * innovation)
        if len(pending) < self.samples_per_entry(channel.rate_hz):
            return noise._replace(pending=pending)
        window = (*noise.window, sum(pending) / len(pending))[-self.window :]
        if len(window) < self.window:
            return noise._replace(window=window, pending=())
        dom_ratio = sum(window) / self.window / (prior_variance + noise.variance)
        variance = fuzzy_alpha(dom_ratio, self.shape) * noise.variance
        least, most = self.floor * channel.initial_variance, self.ceiling * channel.initial_variance
        return noise._replace(variance=clip(variance, least, most), window=window, pending=(), dom_ratio=dom_ratio)

    def samples_per_entry(self, rate_hz: float) -> int:
        """Squares averaged into one entry, so that the window covers at least 20 s at this rate."""
        return max(1, math.ceil(rate_hz * WINDOW_COVERS_S / self.window - 1e-9))


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
    The sets know the scatter of a window: n squares of a healthy sensor have log DoM = 0 +- sqrt(2 / n), so "equal"
    is full within 2.5 and empty beyond 3.5 of these widths. If equal, the long window goes on; if small or large, the
    short one takes its place; in between both are blended by their memberships. The newest sample alone is a window of
    n = 1: if large, R of this one update rises to what it shows, and the windows take it as the edge of "equal", so
    that a jump of the GPS neither moves the boat nor is remembered for long.

    R stays within [floor, ceiling] R0. Of a fast channel several samples weigh as one, so that the long window covers
    at least 20 s. What was done before R was known is cured by the filter, see `navigation.restart`.
    """

    long: float = 60.0
    """Memory of the long window, in samples."""
    short: float = 8.0
    """Memory of the short window, in samples."""
    pseudo_samples: float = 3.0
    """Samples that R0 counts for."""
    full: float = 2.5
    """Distance up to which the set "equal" is full, in widths sqrt(2 / n) of log DoM."""
    empty: float = 3.5
    """Distance from which on the set "equal" is empty, in the same widths."""
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
        kept = smaller(square, math.exp(self.full * math.sqrt(2.0)) * expected)
        entry = min(1.0, self.long / (WINDOW_COVERS_S * channel.rate_hz))
        share = entry * before / expected
        fade = 1.0 - entry / self.short
        short_weight, short_square, short_prior = fade * short_weight, fade * short_square, fade * short_prior
        new_weight, new_square = short_weight + share, short_square + share * kept
        new_prior = short_prior + share * prior_variance
        dom_ratio = new_square / (new_prior + new_weight * before)
        stale = self.not_equal(dom_ratio, self._entries(new_weight))
        stays = (1.0 - stale) * (1.0 - entry / self.long)
        weight = stays * weight + stale * short_weight + share
        # What is too small is divided, not subtracted: P that a too large R has raised would leave nothing of R.
        fresh = choose(dom_ratio < 1.0, short_weight * before * dom_ratio, short_square - short_prior)
        shown = before * kept / expected if noise.is_held else kept - prior_variance
        excess = stays * excess + stale * fresh + share * shown
        learned = before if noise.is_held else self._limited(channel, excess / weight)
        is_plain = isinstance(square, float) and square <= kept
        variance = learned if is_plain else self._guarded(channel, learned, square, expected)
        window = Memory(learned, weight, excess, new_weight, new_square, new_prior)
        return noise._replace(variance=variance, window=window, dom_ratio=dom_ratio)

    def not_equal(self, dom_ratio: Number, entries: Number) -> Number:
        """Membership of "small or large": 0 = what `entries` samples of a healthy sensor show, 1 = certainly not."""
        dom_ratio = larger(dom_ratio, 1e-30)
        widths = log(larger(dom_ratio, 1.0 / dom_ratio)) * sqrt(0.5 * entries)
        return clip((widths - self.full) / (self.empty - self.full), 0.0, 1.0)

    def _first(self, channel: Channel) -> Memory:
        return Memory(channel.initial_variance, self.pseudo_samples, self.pseudo_samples * channel.initial_variance)

    def _limited(self, channel: Channel, variance: Number) -> Number:
        return clip(variance, self.floor * channel.initial_variance, self.ceiling * channel.initial_variance)

    def _entries(self, weight: Number) -> Number:
        """Number of equal entries that scatter like a fading window of this total weight."""
        return weight * (2.0 * self.short - 1.0) / (2.0 * self.short - weight)

    def _guarded(self, channel: Channel, learned: Number, square: Number, expected: Number) -> Number:
        """R of this update: what the newest sample alone shows, as far as it is "large"."""
        large = self.not_equal(larger(square / expected, 1.0), 1.0)
        shown = learned + large * (square - expected)
        return self._limited(channel, shown)


FUZZY_THESIS: Final = ThesisFuzzyNoise(window=30, floor=1e-3, ceiling=1e4)
"""As in the thesis, which gives no window: 30; R(k) on the right of Eq. 5.11 read as R(k-1), clipped."""

FUZZY: Final = FuzzyNoise()
"""The station's rule. Each number may be 30 % off without harm."""
