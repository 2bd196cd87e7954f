"""Baselines of the laboratory by name, dead reckoning and an oracle among them, beside the station's filters.

All of them are the station's engine, some with a part taken away: dead reckoning never updates, static fusion never
predicts, the oracle is given the true noise of every step. The interval filter carries bounds beside it.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Protocol

import numpy as np

from common.errors import WayfixError
from common.words import did_you_mean
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.filters import FilterState
from shore.navigation.kalman import prior_variance
from shore.navigation.measurements import Measurement, TrueHeading
from shore.navigation.motion_model import ImuInput
from shore.navigation.noise.noise_rule import ChannelNoise
from shore.navigation.numbers import Array, Number, square
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import FIVE, HEADING

ORACLE: Final = "oracle"


class Stepped(Protocol):
    """What the laboratory asks of a method; `Filter` has it."""

    @property
    def estimate(self) -> FilterState:
        """The newest state."""
        ...

    def start(self, x: Array, P: Array) -> None:
        """Begin at state `x` (..., n) with covariance `P` (..., n, n)."""
        ...

    def predict(self, dt_s: float, imu: ImuInput | None) -> object:
        """Move on by `dt_s`."""
        ...

    def update(self, measured: Measurement) -> None:
        """Fuse one measurement."""
        ...


class _Around:
    """A method made of one of the station's filters."""

    def __init__(self, name: str, facts: FilterFacts) -> None:
        self._filter = build_filter(name, facts)

    @property
    def estimate(self) -> FilterState:
        """The newest state."""
        return self._filter.estimate

    def start(self, x: Array, P: Array) -> None:
        """Begin at a state."""
        self._filter.start(x, P)

    def predict(self, dt_s: float, imu: ImuInput | None) -> object:
        """Move on by `dt_s`."""
        return self._filter.predict(dt_s, imu)

    def update(self, measured: Measurement) -> None:
        """Fuse one measurement."""
        self._filter.update(measured)


class DeadReckoning(_Around):
    """Eqs 2.2, 2.3: velocity and position from the accelerations, heading from the yaw rate, nothing else."""

    def update(self, measured: Measurement) -> None:
        """Nothing is looked at on the way."""


class StaticFusion(_Around):
    """A moored boat: the recursive Bayesian mean of fixes and headings, Eqs 4.1-4.9."""

    def predict(self, dt_s: float, imu: ImuInput | None) -> None:
        """A moored boat does not move."""


class IntervalKalman(_Around):
    """Interval Kalman filter of the heading (Table 2.6; G. Chen, J. Wang, L. S. Shieh, IEEE Trans. AES 33, 1997).

    The gyro's bias is anything within +- the 1-sigma of its prior; the gain is that of the centre. Every bias in the
    interval gives one Kalman filter, and their estimates fill an interval about the one without bias, whose half width
    grows by bound dt in a prediction and shrinks by 1 - K in an update. P of the heading holds the interval as an even
    spread over it.
    """

    def __init__(self, facts: FilterFacts) -> None:
        priors = {extra.name: extra.sigma for extra in facts.space.extras}
        super().__init__("kf", replace(facts, space=FIVE))
        self._bound_rad_s = priors.get("gyro_bias_rad_s", 0.0)
        self.half_width_rad: Number = 0.0

    @property
    def estimate(self) -> FilterState:
        """The newest state, the interval included in P."""
        state = self._filter.estimate
        widening = np.zeros_like(state.P)
        widening[..., HEADING, HEADING] = 1.0
        return state._replace(P=state.P + square(self.half_width_rad**2 / 3.0) * widening)

    def start(self, x: Array, P: Array) -> None:
        """Begin at a state, without an interval yet; states of biases are not looked at."""
        five = FIVE.size
        super().start(x[..., :five], P[..., :five, :five])
        self.half_width_rad = 0.0

    def predict(self, dt_s: float, imu: ImuInput | None) -> object:
        """Move on by `dt_s`."""
        self.half_width_rad = self.half_width_rad + self._bound_rad_s * dt_s
        return super().predict(dt_s, imu)

    def update(self, measured: Measurement) -> None:
        """Fuse one measurement."""
        before = prior_variance(self._filter.estimate.P, ((HEADING, 1.0),))
        super().update(measured)
        if isinstance(measured, TrueHeading):
            noise: ChannelNoise = self._filter.estimate.noise[f"{measured.sensor}.heading"]
            self.half_width_rad = self.half_width_rad * (noise.variance / (before + noise.variance))


@dataclass(frozen=True, slots=True)
class Method:
    """How to make a method, and what it is allowed to know."""

    text: str
    build: Callable[[FilterFacts], Stepped]
    knows_noise: bool = False
    """True when the method is given the true noise of each step instead of a table's values."""
    knows_bias: bool = False
    """True when the IMU's true biases are removed before it; else it has states for those that were left in."""
    five: bool = False
    """True when it has no states for biases, even where they were left in."""


_TEXTS: Final[Mapping[str, str]] = {
    "kf": "Kalman filter, R and Q as told",
    "ekf": "extended Kalman filter, R and Q as told",
    "ukf": "unscented Kalman filter, R and Q as told",
    "fuzzy-thesis": "UKF, R by the fuzzy rule as printed (Eqs 5.10-5.23)",
    "fuzzy": "UKF, R by our improved fuzzy rule",
    "iae": "UKF, R by innovation matching (Eq. 5.6)",
    "rae": "UKF, R by residual matching (Eq. 5.9)",
    "imm": "UKF, a bank over scales of R",
    "fuzzy-qr": "UKF, fuzzy rule on R and Q",
}

METHODS: Final[Mapping[str, Method]] = {
    **{name: Method(_TEXTS.get(name, "a filter of the station"), partial(build_filter, name)) for name in REGISTRY},
    ORACLE: Method("UKF told the true R and Q of each step, biases removed", partial(build_filter, "ukf"), True, True),
    "oracle-8": Method("the same, but has to find the biases itself", partial(build_filter, "ukf"), True),
    "ukf-5": Method("UKF without bias states, even where biases were left in", partial(build_filter, "ukf"), five=True),
    "dead-reckoning": Method("IMU only (Eqs 2.2, 2.3)", partial(DeadReckoning, "kf"), five=True),
    "static": Method("recursive mean of fixes of a moored boat (Eqs 4.1-4.9)", partial(StaticFusion, "kf"), five=True),
    "interval-kf": Method("KF, heading within bounds of the gyro's bias (Table 2.6)", IntervalKalman),
}
"""All methods of the laboratory, by name."""


def check_methods(names: Iterable[str]) -> tuple[str, ...]:
    """The names once each, in order; raises WayfixError for one that there is not."""
    unique = tuple(dict.fromkeys(name.strip() for name in names if name.strip()))
    for name in unique or ("",):
        if name not in METHODS:
            near, known = did_you_mean(name, METHODS), ", ".join(METHODS)
            raise WayfixError(f"unknown filter {name!r}{near}", "--filters", f"use one or more of {known}")
    return unique
