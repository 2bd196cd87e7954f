"""Innovation-based adaptation of the measurement noise R, a channel (sensor + component) at a time (thesis chapter 5).

A rule is a pure function: state of the channel + innovation -> new state of the channel. It runs before the update,
with the innovation and its prior variance h P h^T, so that C_T = h P h^T + R of the R used so far (Eq. 5.2), and
yields the R with which the update is done. States are immutable, so that a snapshot of a filter is a reference. All
numbers are floats for one boat, arrays (runs,) for a batch.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from shore.navigation.noise.own_scatter import Scatter
from shore.navigation.numbers import Number

WINDOW_COVERS_S: Final = 20.0
"""A window of N entries spans at least this long: above N / 20 samples a second, several samples make one entry."""


class Channel(NamedTuple):
    """Facts of one channel."""

    initial_variance: float
    """R0, the variance that it starts from, m^2 or rad^2."""
    rate_hz: float = 1.0
    """Nominal rate of its measurements."""


class ChannelNoise(NamedTuple):
    """State of one channel."""

    variance: Number
    """Measurement noise R in use, a variance, m^2 or rad^2."""
    window: tuple[Number, ...] = ()
    """What the rule remembers of the innovations: their squares, oldest first, or sums over them."""
    pending: tuple[Number, ...] = ()
    """Squares not yet averaged into an entry of the window."""
    dom_ratio: Number | None = None
    """Degree of matching C_A / C_T at the last adaptation (Eq. 5.10); 1 = as expected."""
    nis: Number | None = None
    """Normalised innovation squared of the last update; mean 1 when consistent."""
    spread: Number = 0.0
    """Variance of the gain per P h between the members of a bank, times the innovation squared."""
    is_held: bool = False
    """True while the opening is filtered again: R stays as it is."""
    drive: Number = 1.0
    """Factor on the noise density of the input that this channel sees: the gyro's by headings, the accelerometers' by
    positions."""
    negatives: Number = 0.0
    """Outcomes of covariance matching that were not positive (Eq. 5.6)."""
    weights: tuple[Number, ...] = ()
    """Probabilities of a bank's J hypotheses; of a batch (J, runs)."""
    lag: tuple[Number, ...] = ()
    """Mean of the normalised innovations and their lagged covariance, see `noise.process_noise`."""
    scatter: Scatter | None = None
    """Own scatter of the sensor, which bounds R; `None` = the rule is not bounded, or nothing was measured."""


class NoiseRule(Protocol):
    """How R follows the innovations."""

    @property
    def reviews(self) -> bool:
        """True when `review` is to be called."""
        ...

    @property
    def is_bounded(self) -> bool:
        """True when the filter bounds the R of this rule by the sensor's own scatter."""
        ...

    @property
    def drives(self) -> bool:
        """True when the rule sets `ChannelNoise.drive`."""
        ...

    @property
    def filters_again(self) -> bool:
        """True when the opening is to be filtered again with the R that `held` gives."""
        ...

    def held(self, channel: Channel, noise: ChannelNoise) -> ChannelNoise:
        """A state to filter the opening again with: memory of innovations empty, R held at the best known value."""
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
    def is_bounded(self) -> bool:
        """A rule that learns R from innovations cannot tell a bad sensor from a bad prediction."""
        return True

    @property
    def drives(self) -> bool:
        """The process noise is left alone."""
        return False

    @property
    def filters_again(self) -> bool:
        """The opening is filtered once."""
        return False

    def held(self, channel: Channel, noise: ChannelNoise) -> ChannelNoise:
        """`noise` as it is."""
        del channel
        return noise

    def review(
        self, channel: Channel, noise: ChannelNoise, residual: Number, posterior_variance: Number
    ) -> ChannelNoise:
        """`noise` as it is."""
        del channel, residual, posterior_variance
        return noise


@dataclass(frozen=True, slots=True)
class FixedNoise(BeforeUpdate):
    """R is what the configuration says."""

    @property
    def is_bounded(self) -> bool:
        """Nothing is learned."""
        return False

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """`noise` with the configured R."""
        del innovation, prior_variance
        return noise._replace(variance=channel.initial_variance)
