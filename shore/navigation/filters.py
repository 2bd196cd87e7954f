"""Adaptive Kalman filter: predict, update with innovation and lever arm, checkpoint (snapshot, restore).

A filter is a prediction (linear, extended or unscented) joined with a rule for its noise. Its whole memory is one
immutable `FilterState`, so a snapshot costs nothing and a restore is exact. One engine for a boat and for many runs:
the states are arrays (..., n), and measurements and inputs are floats for one boat, arrays (runs,) for a batch.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np

from shore.navigation.judge import Evidence, Judge
from shore.navigation.kalman import (
    Predicted,
    prior_variance,
    symmetric,
    update_scalar,
    wrap_heading,
)
from shore.navigation.measurements import Measurement, PseudoMeasurement, Scalar, is_angle
from shore.navigation.motion_model import ImuInput, Input, ProcessNoise, speed_ahead, with_trim
from shore.navigation.noise.noise_rule import Channel, ChannelNoise, NoiseRule
from shore.navigation.noise.own_scatter import Scatter, bound, widest
from shore.navigation.numbers import Array, Number, clip, larger, smaller
from shore.navigation.refilter_start import Assumed, Opening, Operation, Passed
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import Gaussian, StateSpace
from shore.navigation.trust.boat_trust import before_prediction, fuse
from shore.navigation.trust.inputs import PredictionStep, drives, passed
from shore.navigation.trust.memory import Regard, Trust

PLAIN: Final = Regard()
"""A measurement that is what its channel says."""
Predict = Callable[[Gaussian, float, Input | None, ProcessNoise], Predicted]


class FilterState(NamedTuple):
    """Everything a filter remembers; never changed in place."""

    space: StateSpace
    """State space, which names the components of `x`."""
    x: Array
    """Mean of the state, (..., n)."""
    P: Array
    """Covariance of the state, (..., n, n)."""
    noise: Mapping[str, ChannelNoise]
    """R and its window for each channel measured so far."""
    repairs: int = 0
    """Number of predictions before which P needed jitter to be factored."""
    opening: Opening | None = None
    """What happened since the start, while it may have to be filtered again."""
    judge: Judge | None = None
    """The judge of its sensors, with all it has heard; `None` = every measurement is fused."""
    trust: Trust | None = None
    """What a real boat's filter remembers of its sensors; `None` = every sensor is what its channel says."""

    @property
    def gaussian(self) -> Gaussian:
        """What it believes."""
        return Gaussian(self.space, self.x, self.P)

    @property
    def healthy(self) -> bool:
        """All numbers finite and all variances positive."""
        total = float(np.add.reduce(self.x, axis=None)) + float(np.add.reduce(self.P, axis=None))
        return math.isfinite(total) and float(min(self.P.diagonal(axis1=-2, axis2=-1).flat)) > 0.0


class Observer(Protocol):
    """Follows the predictions of a filter, which goes forward only then."""

    def started(self) -> None:
        """The filter has its first state; what was before is over."""
        ...

    def passed(self, before: FilterState, predicted: Predicted) -> None:
        """One prediction has been made."""
        ...

    def repeats(self) -> None:
        """The opening is filtered again: all predictions since the start follow once more."""
        ...


class Filter:
    """One filter of one boat, or of a batch of runs; positions in m on the local plane, headings in rad from north."""

    def __init__(
        self,
        name: str,
        predict: Predict,
        rule: NoiseRule,
        facts: FilterFacts,
        *,
        observer: Observer | None = None,
        judge: Judge | None = None,
    ) -> None:
        self.name = name
        self.facts = facts
        """Facts of the sensors; they may be exchanged between two steps, when a sensor changes."""
        self._predict = predict
        self._rule = rule
        self._observer = observer
        self._judge = judge
        """The judge that each start begins with: it has heard nothing yet."""
        self._state: FilterState | None = None

    @property
    def estimate(self) -> FilterState:
        """The newest state."""
        if self._state is None:
            raise RuntimeError(f"filter {self.name} has not been started")
        return self._state

    def start(self, x: Array, P: Array, read_from: Mapping[int, str] | None = None) -> None:
        """Begin at state `x` (..., n) with covariance `P` (..., n, n); R begins at the configured variances.

        `read_from`: component -> channel whose first sample it is, so that its variance in `P` is that of the channel.
        """
        space = self.facts.space
        if self.facts.boat is None:
            opening = Opening.at(x, P, read_from or {}) if self._rule.filters_again else None
            self._state = FilterState(space, x, P, {}, opening=opening, judge=self._judge)
        else:
            trust = Trust(Gaussian(space, x, P))
            self._state = FilterState(space, x, P, {}, judge=self._judge, trust=trust)
        if self._observer is not None:
            self._observer.started()

    def snapshot(self) -> FilterState:
        """The state, to be given back to `restore`."""
        return self.estimate

    def restore(self, state: FilterState) -> None:
        """Continue from a snapshot, bit for bit.

        Raises: ValueError for any but the newest state while an observer follows.
        """
        if self._observer is not None and state is not self._state:
            raise ValueError(f"filter {self.name} is observed, so it cannot go back")
        self._state = state

    def predict(self, dt_s: float, imu: ImuInput | None) -> Predicted:
        """Move on by `dt_s` > 0; `imu` is the mean over the step, `None` = nothing measured.

        Raises: ValueError for a step that is not above 0, or no number.
        """
        if not 0.0 < dt_s < math.inf:
            raise ValueError(f"filter {self.name} cannot move on by {dt_s} s: give a finite step above 0")
        predicted = self._pass(dt_s, imu)
        self._note(Passed(dt_s, imu))
        return predicted

    def update(self, measured: Measurement) -> None:
        """Fuse one measurement: its components are independent scalars."""
        self._fuse(measured)
        self._note(measured)

    def assume(self, known: PseudoMeasurement) -> None:
        """Fuse what nothing measured: no rule adapts its variance."""
        self.fuse_known(known)
        self._note(Assumed(known))

    def _note(self, operation: Operation) -> None:
        """Keep what was done during the opening; filter it again when that is due."""
        state = self.estimate
        if state.opening is None:
            return
        opening = state.opening.then(operation)
        if not isinstance(operation, Passed) and opening.is_due:
            self._filter_again(opening)
            following = opening.later()
        else:
            following = None if opening.is_over else opening
        self._state = self.estimate._replace(opening=following)

    def _filter_again(self, opening: Opening) -> None:
        """All operations since the start, with the R learned so far; leaves the windows of a filter that knew it."""
        if self._observer is not None:
            self._observer.repeats()
        state, channels = self.estimate, self.facts.channels
        noise = {name: _held(self._rule, channels[name], each) for name, each in state.noise.items()}
        P = opening.P.copy()
        for place, name in opening.read_from.items():
            if name in noise:
                P[..., place, place] += noise[name].variance - channels[name].initial_variance
        self._state = FilterState(state.space, opening.x, P, noise, state.repairs, judge=self._judge)
        for operation in opening.operations:
            if isinstance(operation, Passed):
                self._pass(*operation)
            elif isinstance(operation, Assumed):
                self.fuse_known(operation.known)
            else:
                self._fuse(operation)
        noise = {name: each._replace(is_held=False) for name, each in self.estimate.noise.items()}
        self._state = self.estimate._replace(noise=noise)

    def _pass(self, dt_s: float, imu: ImuInput | None) -> Predicted:
        boat = self.facts.boat
        if boat is not None and self.estimate.trust is not None:
            before_prediction(boat, self)
        state = self.estimate
        before = state.gaussian
        needs_speed = boat is not None or before.space.places[3] is not None
        ahead = speed_ahead(before.space, before.x) if needs_speed else 0.0
        noise = self.facts.free_noise
        if imu is not None:
            noise = with_trim(before.space, ahead, self._driven(self.facts.imu_noise))
        if boat is None or state.trust is None:
            return self._moved(self._predict(before, dt_s, imu, noise))
        step = PredictionStep(before, float(ahead), dt_s, imu)
        used, noise = drives(boat, step, state.trust, noise)
        predicted = self._moved(self._predict(before, dt_s, used, noise))
        passed(boat, self, step)
        return predicted

    def _moved(self, predicted: Predicted) -> Predicted:
        """Take over what was predicted."""
        state = self.estimate
        self._state = state._replace(x=predicted.x, P=predicted.P, repairs=state.repairs + predicted.repairs)
        if self._observer is not None:
            self._observer.passed(state, predicted)
        return predicted

    def _fuse(self, measured: Measurement) -> None:
        if self.facts.boat is None:
            self.fuse_parts(measured, [PLAIN] * len(measured.parts))
        else:
            fuse(self.facts.boat, self, measured)

    @property
    def gaussian(self) -> Gaussian:
        """What it believes."""
        return self.estimate.gaussian

    @property
    def trust(self) -> Trust:
        """What it remembers of the sensors of a real boat."""
        trust = self.estimate.trust
        assert trust is not None
        return trust

    def remember(self, trust: Trust) -> None:
        """Exchange what it remembers of the sensors."""
        self._state = self.estimate._replace(trust=trust)

    def scatter_of(self, channel: str) -> tuple[float, float] | None:
        """Own white variance of a channel (m^2 or rad^2), and the weight of what it was learned from."""
        noise = self.estimate.noise.get(channel)
        if noise is None or noise.scatter is None:
            return None
        return float(noise.scatter.variance), noise.scatter.weight

    def variance_of(self, channel: str) -> float | None:
        """R in use of a channel (m^2 or rad^2); `None` = nothing measured."""
        noise = self.estimate.noise.get(channel)
        return None if noise is None else float(noise.variance)

    def forget(self, sensor: str) -> None:
        """Forget the noise that was learned of a sensor's channels."""
        kept = {name: each for name, each in self.estimate.noise.items() if name.rpartition(".")[0] != sensor}
        self._state = self.estimate._replace(noise=kept)

    def recast(self, x: Array, F: Array, Q: Array) -> None:
        """Exchange the state: its errors become F errors + noise of covariance Q, (n, n) each."""
        P = self.estimate.P
        cross = P @ F.T
        self._moved(Predicted(wrap_heading(x), symmetric(F @ cross + Q), lambda: cross))

    def fuse_parts(self, measured: Measurement, regards: Sequence[Regard]) -> None:
        """Fuse the components of a measurement, each as it is regarded."""
        lever = self.facts.levers.get(measured.sensor)
        for component, regard in zip(measured.parts, regards, strict=True):
            state = self.estimate
            self._update(component(state.space, state.x, lever), measured.t_ns, regard)

    def fuse_known(self, known: PseudoMeasurement, *, has_tail: bool = False) -> None:
        """Fuse what no rule adapts. has_tail: beyond 4 sigma the variance grows with the innovation."""
        for component in known.parts:
            state = self.estimate
            if (scalar := component(state.space, state.x)) is not None:
                before = Gaussian(state.space, scalar.x, state.P)
                R: Number = scalar.variance
                if has_tail:
                    R = R + tail(scalar.innovation, prior_variance(state.P, scalar.row) + R)
                x, P = update_scalar(before, scalar.row, scalar.innovation, R)
                self._state = state._replace(x=x, P=P)

    def _update(self, scalar: Scalar, t_ns: int, regard: Regard) -> None:
        """Ask the judge, adapt R of the channel, then update with it (order of thesis section 5.1.2)."""
        row, innovation, name, measured = scalar
        state, channel, is_boat = self.estimate, self.facts.channels[name], self.facts.boat is not None
        noise = state.noise.get(name) or ChannelNoise(channel.initial_variance)
        prior = prior_variance(state.P, row)
        judge, scale = state.judge, None
        if judge is not None:
            evidence = Evidence(t_ns, name, innovation, prior, noise.variance, state.gaussian)
            judge, scale = judge.hear(evidence)
            if scale is None:
                self._state = state._replace(judge=judge)
                return
        scatter = None
        if is_boat or self._rule.is_bounded:
            claimed = channel.initial_variance if regard.claimed is None else regard.claimed
            scatter = noise.scatter or Scatter.first(claimed, is_angle=is_angle(name), is_white=is_boat)
            scatter = scatter.then((t_ns, measured), counts=not noise.is_held)
            if is_boat:
                # R begins at what the sensor itself shows, and follows it
                channel = channel._replace(initial_variance=float(scatter.variance))
                noise = noise if noise.scatter else ChannelNoise(channel.initial_variance)
        noise = self._rule.adapt(channel, noise, innovation, prior)
        bounded, spread = _within(noise.variance, channel, scatter, is_boat), noise.spread
        R = bounded
        if is_boat:
            R = regard.factor * R + regard.more
        if scale is not None:
            R = scale * R
        if is_boat:
            R = R + tail(innovation, prior + R)
        if R is not bounded:
            # far beyond p, the gains p / (p + R) of a bank fall as 1 / R, and so does their scatter
            spread = spread * (bounded / R) ** 2
        x, P = update_scalar(state.gaussian, row, innovation, R, spread, considered=regard.considered)
        theoretical = prior + R
        noise = noise._replace(variance=bounded, nis=innovation * innovation / theoretical, scatter=scatter)
        if self._rule.reviews:
            noise = self._rule.review(channel, noise, innovation * (R / theoretical), prior * R / theoretical)
            noise = noise._replace(variance=_within(noise.variance, channel, scatter, is_boat))
        channels = {**state.noise, name: noise}
        self._state = state._replace(x=x, P=P, noise=channels, judge=judge)

    def _driven(self, noise: ProcessNoise) -> ProcessNoise:
        """The densities of the inputs, raised by what the channels that see them ask for."""
        if not self._rule.drives:
            return noise
        accel: Number = 1.0
        turn: Number = 1.0
        for name, channel in self.estimate.noise.items():
            if is_angle(name):
                turn = larger(turn, channel.drive)
            else:
                accel = larger(accel, channel.drive)
        return ProcessNoise(noise.accel_fwd * accel, noise.accel_stb * accel, noise.yaw_rate * turn)


def tail(innovation: Number, S: Number) -> Number:
    """What R gains beyond 4 sigma, like the tail of Huber's function: a jump moves the state no more than 4 sigma do.

    S: variance of the innovation.
    """
    return 0.25 * larger(innovation * innovation - 16.0 * S, 0.0 * S)


def _held(rule: NoiseRule, channel: Channel, noise: ChannelNoise) -> ChannelNoise:
    """R as the rule holds it, within the bound; the scatter's sums know the opening's readings already."""
    held = rule.held(channel, noise)
    variance = _within(held.variance, channel, noise.scatter)
    return held._replace(variance=variance, scatter=noise.scatter and noise.scatter._replace(readings=()))


def _within(variance: Number, channel: Channel, scatter: Scatter | None, is_boat: bool = False) -> Number:
    """R within the bound of the sensor's own scatter, and of a real boat's sensor not below that scatter."""
    if scatter is None:
        return variance
    if is_boat:
        return clip(variance, scatter.variance, widest(scatter))
    return smaller(variance, bound(channel.initial_variance, scatter))
