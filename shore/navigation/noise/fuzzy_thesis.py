"""The literal rule of the thesis, filter `fuzzy-thesis`: fuzzy adaptation of R as printed (Eqs 5.10-5.23).

It looks at the degree of matching C_A / C_T between the innovations seen, whose squares are averaged over a window of
N entries, and the innovations expected. Of a fast channel the samples are decimated: several squares make one entry.
"""

import math
from dataclasses import dataclass
from typing import Final

from shore.navigation.noise.noise_rule import WINDOW_COVERS_S, BeforeUpdate, Channel, ChannelNoise
from shore.navigation.numbers import Number, choose, clip


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

    @property
    def is_bounded(self) -> bool:
        """As printed: the thesis has no bound."""
        return False

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


FUZZY_THESIS: Final = ThesisFuzzyNoise(window=30, floor=1e-3, ceiling=1e4)
"""As in the thesis, which gives no window: 30; R(k) on the right of Eq. 5.11 read as R(k-1), clipped."""
