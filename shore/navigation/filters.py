"""The filters by name, and the one interface they share: predict, update, snapshot, restore.

A filter is a prediction (linear or unscented) joined with a rule for R. Its whole memory is one immutable
`FilterState`, so a snapshot costs nothing and a restore is exact.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from common.errors import WayfixError
from common.sensors import ROLES, BoatConfig, SensorTable
from shore.navigation.adaptation import NOISE_RULES, Channel, ChannelNoise, NoiseRule
from shore.navigation.kalman import predict_linear, update_scalar
from shore.navigation.models import EAST, FREE_NOISE, HEADING, NORTH, STILL, Array, ImuInput, ProcessNoise, wrapped
from shore.navigation.ukf import predict_unscented

Predict = Callable[[Array, Array, float, ImuInput, ProcessNoise], tuple[Array, Array, int]]

COURSE_SIGMA_DEG: Final = 20.0
"""A course over ground taken as heading (boats without compass): leeway, current and sideways motion of the antenna."""


@dataclass(frozen=True, slots=True)
class FilterState:
    """Everything a filter remembers; never changed in place."""

    x: Array
    """State (5,), see `models.STATE_NAMES`."""
    P: Array
    """Its covariance (5, 5)."""
    noise: Mapping[str, ChannelNoise]
    """R and its window for each channel measured so far."""
    repairs: int = 0
    """Predictions before which P needed jitter to be factored."""

    @property
    def healthy(self) -> bool:
        """All numbers finite and all variances positive."""
        total = float(self.x.sum()) + float(self.P.sum())
        return math.isfinite(total) and float(self.P.diagonal().min()) > 0.0


@dataclass(frozen=True, slots=True)
class FilterFacts:
    """What a filter must know of the boat's sensors."""

    channels: Mapping[str, Channel]
    """`gps1.east`, `gps1.north`, `gps1.course`, `compass1.heading`, ..."""
    imu_noise: ProcessNoise = FREE_NOISE
    """While an IMU sample covers the step."""
    free_noise: ProcessNoise = FREE_NOISE
    """While none does."""


class Filter:
    """One filter of one boat. Positions in m on the local plane, headings in rad clockwise from true north."""

    def __init__(self, name: str, predict: Predict, rule: NoiseRule, facts: FilterFacts) -> None:
        self.name = name
        self._predict = predict
        self._rule = rule
        self._facts = facts
        self._state: FilterState | None = None

    @property
    def estimate(self) -> FilterState:
        """The newest state."""
        if self._state is None:
            raise RuntimeError(f"filter {self.name} has not been started")
        return self._state

    def start(self, x: Array, P: Array) -> None:
        """Begin at state `x` with covariance `P`; R begins at the configured variances."""
        self._state = FilterState(x, P, {})

    def snapshot(self) -> FilterState:
        """The state, to be given back to `restore`."""
        return self.estimate

    def restore(self, state: FilterState) -> None:
        """Continue from a snapshot, bit for bit."""
        self._state = state

    def predict(self, dt_s: float, imu: ImuInput | None) -> None:
        """Move on by `dt_s` > 0; `imu` is the mean over the step, `None` = nothing measured."""
        state = self.estimate
        noise = self._facts.free_noise if imu is None else self._facts.imu_noise
        x, P, repairs = self._predict(state.x, state.P, dt_s, imu or STILL, noise)
        self._state = FilterState(x, P, state.noise, state.repairs + repairs)

    def update_position(self, sensor: str, east_m: float, north_m: float) -> None:
        """Fuse a position: two independent scalars."""
        self._update(f"{sensor}.east", EAST, east_m - float(self.estimate.x[EAST]))
        self._update(f"{sensor}.north", NORTH, north_m - float(self.estimate.x[NORTH]))

    def update_heading(self, sensor: str, heading_rad: float) -> None:
        """Fuse a true heading."""
        self._update(f"{sensor}.heading", HEADING, wrapped(heading_rad - float(self.estimate.x[HEADING])))

    def update_course(self, sensor: str, course_rad: float) -> None:
        """Fuse a course over ground in place of a heading (boats without compass)."""
        self._update(f"{sensor}.course", HEADING, wrapped(course_rad - float(self.estimate.x[HEADING])))

    def _update(self, name: str, index: int, innovation: float) -> None:
        """Adapt R of the channel, then update with it (order of thesis section 5.1.2)."""
        innovation = float(innovation)
        state, channel = self.estimate, self._facts.channels[name]
        noise = state.noise.get(name) or ChannelNoise(channel.initial_variance)
        prior_variance = float(state.P[index, index])
        noise = self._rule.adapt(channel, noise, innovation, prior_variance + noise.variance)
        nis = innovation * innovation / (prior_variance + noise.variance)
        x, P = update_scalar(state.x, state.P, index, innovation, noise.variance)
        channels = {**state.noise, name: noise._replace(nis=nis)}
        self._state = replace(state, x=x, P=P, noise=channels)


REGISTRY: Final[Mapping[str, tuple[Predict, str]]] = {
    "kf": (predict_linear, "fixed"),
    "ukf": (predict_unscented, "fixed"),
    "fuzzy-thesis": (predict_unscented, "fuzzy-thesis"),
    "fuzzy": (predict_unscented, "fuzzy"),
}
"""Name -> prediction, rule for R."""


def build_filter(name: str, facts: FilterFacts) -> Filter:
    """A filter of the registry.

    Raises: WayfixError for an unknown name.
    """
    if name not in REGISTRY:
        raise WayfixError(f"unknown filter {name!r}", "--filters", f"use one or more of {', '.join(REGISTRY)}")
    predict, rule = REGISTRY[name]
    return Filter(name, predict, NOISE_RULES[rule], facts)


def facts_of(config: BoatConfig) -> FilterFacts:
    """What the boat's configuration says: R0 from the sigmas, process noise from the densities of the first IMU."""
    channels: dict[str, Channel] = {}
    for sensor in config.with_role("gps"):
        for component in ("east", "north"):
            channels[f"{sensor.id}.{component}"] = Channel(sensor.sigma_m**2, _rate_hz(sensor))
        channels[f"{sensor.id}.course"] = Channel(math.radians(COURSE_SIGMA_DEG) ** 2, _rate_hz(sensor))
    for sensor in config.with_role("compass"):
        channels[f"{sensor.id}.heading"] = Channel(math.radians(sensor.sigma_deg) ** 2, _rate_hz(sensor))
    return FilterFacts(channels, _imu_noise(config))


def _rate_hz(sensor: SensorTable) -> float:
    return sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz


def _imu_noise(config: BoatConfig) -> ProcessNoise:
    """Densities while the IMU delivers: an axis that is not used moves freely."""
    for imu in config.with_role("imu")[:1]:
        return ProcessNoise(
            imu.accel_density if "accel_fwd" in imu.use else FREE_NOISE.accel_fwd,
            imu.accel_density if "accel_stb" in imu.use else FREE_NOISE.accel_stb,
            math.radians(imu.gyro_density_deg) if "yaw_rate" in imu.use else FREE_NOISE.yaw_rate,
        )
    return FREE_NOISE
