"""Adaptation of the measurement noise R, one channel (sensor + component) at a time (thesis chapter 5).

A rule is a pure function: state of the channel + innovation -> new state of the channel. It runs before the update,
with the innovation and its prior variance h P h^T, so that C_T = h P h^T + R of the R used so far (Eq. 5.2), and
yields the R with which the update is done. States are immutable, so that a snapshot of a filter is a reference. All
numbers are floats for one boat, arrays (runs,) for a batch.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from shore.navigation.numbers import Number, choose, clip

WINDOW_COVERS_S: Final = 20.0
"""A window spans at least this long: above N / 20 samples a second, several squares are averaged into one entry."""


class Channel(NamedTuple):
    """Facts of one channel: the variance R0 it starts from (m^2 or rad^2) and its nominal rate."""

    initial_variance: float
    rate_hz: float = 1.0


class ChannelNoise(NamedTuple):
    """State of one channel."""

    variance: Number
    """R in use, m^2 or rad^2."""
    window: tuple[Number, ...] = ()
    """Squared innovations, oldest first."""
    pending: tuple[Number, ...] = ()
    """Squares not yet averaged into an entry of the window."""
    dom_ratio: Number | None = None
    """Degree of matching C_A / C_T at the last adaptation (Eq. 5.10); 1 = as expected."""
    nis: Number | None = None
    """Normalised innovation squared of the last update; mean 1 when consistent."""
    spread: Number = 0.0
    """Variance of the gain per P h between the members of a bank, times the innovation squared."""
    drive: Number = 1.0
    """Factor on the noise density of the input that this channel sees: the gyro's by headings, the accelerometers' by
    positions."""


class NoiseRule(Protocol):
    """How R follows the innovations."""

    @property
    def reviews(self) -> bool:
        """True when `review` is to be called."""
        ...

    @property
    def drives(self) -> bool:
        """True when the rule sets `ChannelNoise.drive`."""
        ...

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """The channel's state with the R for this update; C_T = prior_variance + noise.variance."""
        ...

    def review(
        self, channel: Channel, noise: ChannelNoise, residual: Number, posterior_variance: Number
    ) -> ChannelNoise:
        """The channel's state after the update: residual = measured - h x+, posterior_variance = h P+ h^T."""
        ...


class BeforeUpdate:
    """A rule that needs only the innovation."""

    __slots__ = ()

    @property
    def reviews(self) -> bool:
        """Nothing is done after the update."""
        return False

    @property
    def drives(self) -> bool:
        """The process noise is left alone."""
        return False

    def review(
        self, channel: Channel, noise: ChannelNoise, residual: Number, posterior_variance: Number
    ) -> ChannelNoise:
        """`noise` as it is."""
        del channel, residual, posterior_variance
        return noise


@dataclass(frozen=True, slots=True)
class FixedNoise(BeforeUpdate):
    """R is what the configuration says."""

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """`noise` with the configured R."""
        del innovation, prior_variance
        return noise._replace(variance=channel.initial_variance)


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
class FuzzyNoise(BeforeUpdate):
    """R(k) = alpha(DoM(k)) R(k-1) within [floor, ceiling] R0; C_A is a mean square over a window (Eqs 5.3, 5.10, 5.11).

    `pseudo_samples` entries of the first C_T open the window, so that a bad R0 is left from the first step; without
    them the rule waits, as in the thesis, until the window is full.
    """

    window: int
    pseudo_samples: int
    floor: float
    ceiling: float
    shape: FuzzyShape = THESIS_SHAPE

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """Push the squared innovation; once for each entry of the window R moves by `fuzzy_alpha`."""
        pending = (*noise.pending, innovation * innovation)
        if len(pending) < self.samples_per_entry(channel.rate_hz):
            return noise._replace(pending=pending)
        theoretical = prior_variance + noise.variance
        opening = noise.window or (theoretical,) * self.pseudo_samples
        window = (*opening, sum(pending) / len(pending))[-self.window :]
        if not self.pseudo_samples and len(window) < self.window:
            return noise._replace(window=window, pending=())
        dom_ratio = sum(window) / len(window) / theoretical
        variance = fuzzy_alpha(dom_ratio, self.shape) * noise.variance
        least, most = self.floor * channel.initial_variance, self.ceiling * channel.initial_variance
        variance = clip(variance, least, most)
        return noise._replace(variance=variance, window=window, pending=(), dom_ratio=dom_ratio)

    def samples_per_entry(self, rate_hz: float) -> int:
        """Squares averaged into one entry, so that the window covers at least 20 s at this rate."""
        return max(1, math.ceil(rate_hz * WINDOW_COVERS_S / self.window - 1e-9))


FUZZY_THESIS: Final = FuzzyNoise(window=30, pseudo_samples=0, floor=1e-3, ceiling=1e4)
"""As in the thesis, which gives no window: 30; R(k) on the right of Eq. 5.11 read as R(k-1), clipped."""

FUZZY: Final = FuzzyNoise(window=60, pseudo_samples=3, floor=0.5, ceiling=1e4)
"""Ours: less noise from the longer window, adapts from the first step, and R cannot collapse."""

NOISE_RULES: Final[Mapping[str, NoiseRule]] = {"fixed": FixedNoise(), "fuzzy-thesis": FUZZY_THESIS, "fuzzy": FUZZY}
