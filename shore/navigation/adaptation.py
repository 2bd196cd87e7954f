"""Adaptation of the measurement noise R, one channel (sensor + component) at a time (thesis chapter 5).

A rule is a pure function: state of the channel + innovation -> new state of the channel. It runs before the update,
with the innovation and the theoretical innovation variance C_T = P_ii + R of the R used so far (Eq. 5.2), and yields
the R with which the update is done. States are immutable, so that a snapshot of a filter is a reference.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

WINDOW_COVERS_S: Final = 20.0
"""A window spans at least this long: above N / 20 samples a second, several squares are averaged into one entry."""


class Channel(NamedTuple):
    """Facts of one channel: the variance R0 it starts from (m^2 or rad^2) and its nominal rate."""

    initial_variance: float
    rate_hz: float = 1.0


class ChannelNoise(NamedTuple):
    """State of one channel."""

    variance: float
    """R in use, m^2 or rad^2."""
    window: tuple[float, ...] = ()
    """Squared innovations, oldest first."""
    pending: tuple[float, ...] = ()
    """Squares not yet averaged into an entry of the window."""
    dom_ratio: float | None = None
    """Degree of matching C_A / C_T at the last adaptation (Eq. 5.10); 1 = as expected."""
    nis: float | None = None
    """Normalised innovation squared of the last update; mean 1 when consistent."""


class NoiseRule(Protocol):
    """How R follows the innovations."""

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: float, theoretical: float) -> ChannelNoise:
        """The channel's state with the R for this update; `theoretical` is C_T with the R used so far."""
        ...


@dataclass(frozen=True, slots=True)
class FixedNoise:
    """R stays what the configuration says."""

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: float, theoretical: float) -> ChannelNoise:
        """`noise` as it is."""
        del channel, innovation, theoretical
        return noise


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


def _ramp_area_moment(foot: float, start: float, stop: float, slope: float) -> tuple[float, float]:
    """Integrals of o(a) and o(a) a over [start, stop] for the straight line o(a) = slope (a - foot)."""
    area = 0.5 * slope * ((stop - foot) ** 2 - (start - foot) ** 2)
    moment = slope * ((stop**3 - start**3) / 3.0 - 0.5 * foot * (stop**2 - start**2))
    return area, moment


def _centroid(first: tuple[float, float], low: float, high: float, height: float, last: tuple[float, float]) -> float:
    """Centroid of a first ramp, a plateau of `height` over [low, high] and a last ramp (Eqs 5.20, 5.22)."""
    area = first[0] + height * (high - low) + last[0]
    moment = first[1] + 0.5 * height * (high * high - low * low) + last[1]
    return moment / area


def fuzzy_alpha(dom_ratio: float, shape: FuzzyShape = THESIS_SHAPE) -> float:
    """The factor on R for a degree of matching (Eqs 5.12-5.23), in closed form.

    Literal, with the thesis' own steps (Table 5.3): 0.812 -> 0.848 at 0.75, 0.88 -> 1 at 0.85, 1 -> 1.12 at 1.15, and
    not monotone: it falls from 1.164 to 1.125 between 1.242 and 1.25, then steps up to 1.147.
    """
    if dom_ratio < 1.0 - shape.ep2:
        return _alpha_small(dom_ratio, shape)
    if dom_ratio <= 1.0 + shape.ep2:
        return 1.0
    return _alpha_large(dom_ratio, shape)


def _alpha_small(dom_ratio: float, shape: FuzzyShape) -> float:
    """Cases 1 and 2 (Eqs 5.19, 5.20): the sample variance is smaller than expected."""
    end_small = 1.0 - shape.al_ep2
    at_small = end_small * dom_ratio / (1.0 - shape.ep2)
    if dom_ratio < 1.0 - shape.ep1:
        return at_small
    foot, width = 1.0 - shape.al_ep1, shape.al_ep1 - shape.al_ep2
    equal = (dom_ratio - 1.0 + shape.ep1) / (shape.ep1 - shape.ep2)
    at_equal = foot + width * equal
    rising = _ramp_area_moment(foot, foot, at_equal, 1.0 / width)
    falling = _ramp_area_moment(end_small, at_small, end_small, -1.0 / end_small)
    return _centroid(rising, at_equal, at_small, equal, falling)


def _alpha_large(dom_ratio: float, shape: FuzzyShape) -> float:
    """Cases 4 and 5 (Eqs 5.22, 5.23): the sample variance is larger than expected."""
    start_large = 1.0 + shape.al_ep2
    span = shape.al_largest - start_large
    large = min(1.0, (dom_ratio - 1.0 - shape.ep2) / (shape.largest - 1.0 - shape.ep2))
    at_large = start_large + span * large
    if dom_ratio > 1.0 + shape.ep1:
        return at_large
    end_equal, width = 1.0 + shape.al_ep1, shape.al_ep1 - shape.al_ep2
    equal = (1.0 + shape.ep1 - dom_ratio) / (shape.ep1 - shape.ep2)
    at_equal = end_equal - width * equal
    rising = _ramp_area_moment(start_large, start_large, at_large, 1.0 / span)
    falling = _ramp_area_moment(end_equal, at_equal, end_equal, -1.0 / width)
    return _centroid(rising, at_large, at_equal, equal, falling)


@dataclass(frozen=True, slots=True)
class FuzzyNoise:
    """R(k) = alpha(DoM(k)) R(k-1) within [floor, ceiling] R0; C_A is a mean square over a window (Eqs 5.3, 5.10, 5.11).

    `pseudo_samples` entries of the first C_T open the window, so that a bad R0 is left from the first step; without
    them the rule waits, as in the thesis, until the window is full.
    """

    window: int
    pseudo_samples: int
    floor: float
    ceiling: float
    shape: FuzzyShape = THESIS_SHAPE

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: float, theoretical: float) -> ChannelNoise:
        """Push the squared innovation; once for each entry of the window R moves by `fuzzy_alpha`."""
        pending = (*noise.pending, innovation * innovation)
        if len(pending) < self.samples_per_entry(channel.rate_hz):
            return noise._replace(pending=pending)
        opening = noise.window or (theoretical,) * self.pseudo_samples
        window = (*opening, sum(pending) / len(pending))[-self.window :]
        if not self.pseudo_samples and len(window) < self.window:
            return noise._replace(window=window, pending=())
        dom_ratio = sum(window) / len(window) / theoretical
        variance = fuzzy_alpha(dom_ratio, self.shape) * noise.variance
        least, most = self.floor * channel.initial_variance, self.ceiling * channel.initial_variance
        return ChannelNoise(min(max(variance, least), most), window, (), dom_ratio, noise.nis)

    def samples_per_entry(self, rate_hz: float) -> int:
        """Squares averaged into one entry, so that the window covers at least 20 s at this rate."""
        return max(1, math.ceil(rate_hz * WINDOW_COVERS_S / self.window - 1e-9))


FUZZY_THESIS: Final = FuzzyNoise(window=30, pseudo_samples=0, floor=1e-3, ceiling=1e4)
"""As in the thesis, which gives no window: 30; R(k) on the right of Eq. 5.11 read as R(k-1), clipped."""

FUZZY: Final = FuzzyNoise(window=60, pseudo_samples=3, floor=0.5, ceiling=1e4)
"""Ours: less noise from the longer window, adapts from the first step, and R cannot collapse."""

NOISE_RULES: Final[Mapping[str, NoiseRule]] = {"fixed": FixedNoise(), "fuzzy-thesis": FUZZY_THESIS, "fuzzy": FUZZY}
