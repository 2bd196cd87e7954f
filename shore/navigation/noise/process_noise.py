"""Fuzzy adaptation of the process noise Q beside that of R (the future work of the paper's section 6).

A wrong R and a wrong Q both make the innovations larger or smaller than expected, so their size cannot tell one from
the other. Their order can. With a Q that is too small the filter trusts the IMU too much and lags, and its innovations
keep their sign: their autocovariance is proportional to the error of the gain (Mehra, *On the identification of
variances and adaptive Kalman filtering*, IEEE Transactions on Automatic Control 15, 1970). With an R that is too small
they change sign too often; an R that is too large is corrected by the rule for R before it is seen here.
"""

from dataclasses import dataclass
from typing import Final

from shore.navigation.noise.fuzzy import FUZZY
from shore.navigation.noise.noise_rule import Channel, ChannelNoise, NoiseRule
from shore.navigation.numbers import Number, clip, exp, larger, log, smaller, sqrt

LEAST_GAIN: Final = 1e-12
"""A filter that is certain of its state: nothing is learned, and nothing is divided by 0."""


@dataclass(frozen=True, slots=True)
class FuzzyDrive:
    """The density of an input = the configured one times `ChannelNoise.drive`, 1 <= drive <= most.

    Two rules. If the lagged covariance of the innovations is *large*, drive rises; if it is not, drive returns to 1,
    the configured density. Both act by their memberships.

    All times are in the filter's own memory, 1 / K samples with K = p / (p + R), so that the rule is the same at any
    rate. With n = innovation / sqrt(p + R), m = the mean of n over the memory, c = the mean of n(k) m(k-1) over it:
    white innovations give c the standard deviation K / (2 - K). The set *large* counts in these.
    """

    r_rule: NoiseRule
    """The rule for R."""
    large_from: float
    """Number of standard deviations of c from which on the set *large* begins."""
    large_at: float
    """Number of standard deviations of c from which on the set *large* is full."""
    rise: float
    """Growth of log drive within one memory while *large* is full."""
    fall: float
    """Part of log drive that is lost within one memory while it is empty."""
    most: float
    """Largest drive, a factor on the density."""
    largest_step: float
    """Largest change of log drive in one update: without an IMU, K is near 1."""

    @property
    def reviews(self) -> bool:
        """True when the rule for R reviews."""
        return self.r_rule.reviews

    @property
    def is_bounded(self) -> bool:
        """True when the R of the rule for R is bounded."""
        return self.r_rule.is_bounded

    @property
    def drives(self) -> bool:
        """True: it sets `ChannelNoise.drive`."""
        return True

    @property
    def filters_again(self) -> bool:
        """True when the rule for R asks for it."""
        return self.r_rule.filters_again

    def held(self, channel: Channel, noise: ChannelNoise) -> ChannelNoise:
        """What the rule for R holds; the drive begins again at 1, for what it saw was the lag of a wrong R."""
        return self.r_rule.held(channel, noise)._replace(drive=1.0, lag=())

    def adapt(self, channel: Channel, noise: ChannelNoise, innovation: Number, prior_variance: Number) -> ChannelNoise:
        """R by the rule for R; the drive for the predictions that follow."""
        adapted = self.r_rule.adapt(channel, noise, innovation, prior_variance)
        theoretical = prior_variance + adapted.variance
        K = larger(prior_variance / theoretical, LEAST_GAIN)
        normalised = innovation / sqrt(theoretical)
        mean, covariance = noise.lag or (0.0 * theoretical, 0.0 * theoretical)
        covariance = covariance + K * (normalised * mean - covariance)
        mean = mean + K * (normalised - mean)
        step = self.step(covariance * (2.0 - K) / K, K, noise.drive)
        # evidence that was acted upon is spent, else it would drive on far beyond the truth
        lag = (mean, covariance * exp(smaller(step, -step)))
        return adapted._replace(drive=clip(noise.drive * exp(step), 1.0, self.most), lag=lag)

    def step(self, deviations: Number, K: Number, drive: Number) -> Number:
        """Change of log drive; `deviations` = c in standard deviations."""
        large = clip((deviations - self.large_from) / (self.large_at - self.large_from), 0.0, 1.0)
        wanted = K * (self.rise * large - self.fall * (1.0 - large) * log(drive))
        return clip(wanted, -self.largest_step, self.largest_step)

    def review(
        self, channel: Channel, noise: ChannelNoise, residual: Number, posterior_variance: Number
    ) -> ChannelNoise:
        """Review as the rule for R does."""
        return self.r_rule.review(channel, noise, residual, posterior_variance)


FUZZY_QR: Final = FuzzyDrive(
    r_rule=FUZZY, large_from=2.0, large_at=5.0, rise=5.0, fall=0.1, most=20.0, largest_step=0.3
)
"""The rule for R and Q: a compass of 1 deg and 1 Hz sees half of a fivefold IMU noise in a minute, a GPS of 8 m in two.

Each number may be 30 % off without harm; a smaller `large_from` is quicker and costs more while the IMU is healthy.
"""
