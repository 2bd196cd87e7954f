"""Monte Carlo runs in one batch: steps a method through a scenario, all runs as arrays (runs, n), or one as floats.

What is measured comes from `common.simulation.monte_carlo_runs`; what filters is the station's engine. Step 0 is the
start, drawn from P(1) about the truth (`stated`) or at the truth (`compat`, as the thesis does). Each later step
predicts with the IMU sample that ends there, then fuses position and heading.
"""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from common.errors import WayfixError
from common.simulation.filter_tuning import BIAS_ACCEL_M_S2, BIAS_YAW_RATE_DEG_S, Assumed
from common.simulation.manoeuvres import Manoeuvres
from common.simulation.monte_carlo_runs import Runs
from common.simulation.scenario import Scenario
from shore.lab.bound import posterior_bound
from shore.lab.consistency import STATES, ConsistencySums
from shore.lab.methods import METHODS, ORACLE, Method, Stepped
from shore.lab.statistics import spans, squared_errors
from shore.navigation.filters import Filter, FilterState
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array, Number
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import FIVE, Extra, StateSpace

Profile = Literal["stated", "compat"]
PROFILES: Final[tuple[Profile, ...]] = ("stated", "compat")
MEASURED: Final = ("gps1.east", "gps1.north", "compass1.heading")
"""Channels in the order of the three measured components: east, north, heading."""
EIGHT: Final = StateSpace(
    (
        Extra("gyro_bias_rad_s", math.radians(BIAS_YAW_RATE_DEG_S)),
        Extra("accel_bias_fwd_m_s2", BIAS_ACCEL_M_S2),
        Extra("accel_bias_stb_m_s2", BIAS_ACCEL_M_S2),
    )
)
"""State space of a filter whose IMU was not calibrated: the five states and three biases."""
LIVE_STEPS: Final = 200
"""Number of steps of one boat over which its processor time is taken."""
_NS_PER_S: Final = 10**9


@dataclass(frozen=True, slots=True)
class RunTrack:
    """The first run step by step; row 0 is the start. Angles in rad; NaN where a method has no such number."""

    x: Array
    """States: east, north (m), velocities (m/s), heading (rad); (k, 5)."""
    variance: Array
    """R in use for each of `MEASURED`, (k, 3), m^2 and rad^2."""
    dom_ratio: Array
    """Degree of matching of each of `MEASURED`, (k, 3); 1 = as expected."""
    alpha: Array
    """Factor by which R was changed in the step, for each of `MEASURED`, (k, 3)."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a method did with a chunk of runs; row 0 (the start) of the sums over runs is 0."""

    mse: dict[str, Array]
    """Stretch -> mean squared errors of each run, (runs, 3) in the units of `statistics.COMPONENTS`."""
    nees: Array
    """Normalised estimation error squared of each run, mean over its steps, (runs,); 5 expected."""
    nis: Array
    """Normalised innovation squared, likewise, of three measured numbers; 3 expected, NaN without innovations."""
    squares: Array
    """Sum over runs of the squared errors, (k, 3), in the units of `statistics.COMPONENTS`."""
    claimed: Array
    """Sum over runs of the variances that the method claims, (k, 3), in the same units."""
    seconds: float
    """Processor time of all steps of all runs, s."""
    live_us: float
    """Processor time of one step of one boat, us; NaN where it was not taken."""
    first: RunTrack | None


@dataclass(frozen=True, slots=True)
class Setting:
    """A scenario as the filters of one profile meet it."""

    scenario: Scenario
    runs: Runs
    profile: Profile

    @property
    def told(self) -> Assumed:
        """Noise and start that the filters assume."""
        told = self.scenario.assumed if self.profile == "stated" else self.scenario.compat
        if told is None:
            cure = "use --profile stated"
            raise WayfixError("nothing is published about it, so it has no profile compat", self.scenario.name, cure)
        return told

    @property
    def moored(self) -> bool:
        """True when the boat never moves."""
        return isinstance(self.scenario.mission, Manoeuvres) and self.scenario.mission.speed_m_s == 0.0

    @property
    def reference(self) -> str:
        """The method that the others are compared with."""
        return "static" if self.moored else ORACLE

    @property
    def bound(self) -> Array:
        """The posterior Cramer-Rao bound (k, 3) for a start drawn from P(1), in the units of the components."""
        space = EIGHT if self.biased else FIVE
        _, P = self.start(space)
        return posterior_bound(self.runs, P[0].diagonal(), moored=self.moored)

    @property
    def biased(self) -> bool:
        """True when the IMU's biases were left in."""
        return bool(np.any(self.runs.biases))

    @property
    def change(self) -> int | None:
        """First step whose noise is not that of the first one; `None` = it never changes."""
        runs = self.runs
        kinds = np.column_stack((runs.gps_m, runs.compass_sigma_rad, runs.accel_std, runs.gyro_std_rad))[1:]
        other = np.flatnonzero(np.any(kinds != kinds[0], axis=1))
        return int(other[0]) + 1 if len(other) else None

    @property
    def spans(self) -> dict[str, slice]:
        """Stretches of the run that are scored."""
        return spans(len(self.runs.truth), self.change, np.flatnonzero(~self.runs.has_gps), biased=self.biased)

    def space(self, method: Method) -> StateSpace:
        """States of a method here."""
        return EIGHT if self.biased and not (method.five or method.knows_bias) else FIVE

    def told_facts(self, space: StateSpace) -> FilterFacts:
        """Facts that an ordinary filter is given."""
        told = self.told
        variances = (told.gps_east_m**2, told.gps_north_m**2, math.radians(told.compass_deg) ** 2)
        gyro = math.radians(told.gyro_density_deg)
        return _facts(variances, ProcessNoise(told.accel_density, told.accel_density, gyro), space, self.runs.step_s)

    def true_facts(self, step: int, space: StateSpace) -> FilterFacts:
        """Facts that the oracle is given for the step that ends in row `step`."""
        runs = self.runs
        variances = (*np.square(runs.gps_m[step]).tolist(), float(runs.compass_sigma_rad[step]) ** 2)
        root_s = math.sqrt(runs.step_s)
        fwd, stb, gyro = (root_s * float(std) for std in (*runs.accel_std[step], runs.gyro_std_rad[step]))
        return _facts(variances, ProcessNoise(fwd, stb, gyro), space, runs.step_s)

    def start(self, space: StateSpace) -> tuple[Array, Array]:
        """First states (runs, n) and their covariance (runs, n, n); biases start at 0."""
        sigmas = np.array(self.told.start_sigmas)
        x = np.zeros((len(self.runs.imu), space.size))
        x[:, :STATES] = self.runs.truth[0]
        if not self.told.exact_start:
            x[:, :STATES] += sigmas * self.runs.start_noise[:, :STATES]
        variances = np.square([*sigmas, *(extra.sigma for extra in space.extras)])
        return x, np.tile(np.diag(variances), (len(x), 1, 1))


def _facts(variances: tuple[float, ...], imu: ProcessNoise, space: StateSpace, step_s: float) -> FilterFacts:
    channels = {name: Channel(each, 1.0 / step_s) for name, each in zip(MEASURED, variances, strict=True)}
    return FilterFacts(channels, space, imu_noise=imu)


def drive(name: str, setting: Setting, member: int | None = None) -> Iterator[FilterState]:
    """A method's state after each step from row 1 on: of all runs as arrays, or of run `member` as one boat."""
    method, runs = METHODS[name], setting.runs
    space = setting.space(method)
    each = method.build(setting.told_facts(space))
    imu = runs.imu - runs.biases[:, np.newaxis] if method.knows_bias else runs.imu
    x, P = setting.start(space)
    if member is None:
        inputs, fixes, headings = (_by_step(values) for values in (imu, runs.gps, runs.compass_rad[..., np.newaxis]))
        each.start(x, P)
    else:
        inputs, fixes, headings = imu[member], runs.gps[member], runs.compass_rad[member][:, np.newaxis]
        each.start(x[member], P[member])
    for step in range(1, len(runs.truth)):
        if method.knows_noise:
            _tell(each, setting.true_facts(step, space))
        each.predict(runs.step_s, ImuInput(*_numbers(inputs[step])))
        t_ns = round(step * runs.step_s * _NS_PER_S)
        if runs.has_gps[step]:
            east_m, north_m = _numbers(fixes[step])
            each.update(Position(t_ns, "gps1", east_m, north_m))
        if runs.has_compass[step]:
            (heading_rad,) = _numbers(headings[step])
            each.update(TrueHeading(t_ns, "compass1", heading_rad))
        yield each.estimate


def _tell(each: Stepped, facts: FilterFacts) -> None:
    assert isinstance(each, Filter)
    each.facts = facts


def _by_step(values: Array) -> Array:
    """(runs, k, m) -> (k, m, runs), so that one number of all runs lies together."""
    return np.ascontiguousarray(np.moveaxis(values, 0, -1))


def _numbers(values: Array) -> tuple[Number, ...]:
    """Floats of (m,), arrays of (m, runs)."""
    return tuple(values.tolist()) if values.ndim == 1 else tuple(values)


class _Record:
    """Gathers what a method does."""

    def __init__(self, setting: Setting) -> None:
        count, steps = setting.runs.imu.shape[:2]
        self._truth = setting.runs.truth
        self.squares = np.zeros((count, steps, 3))
        self.claimed = np.zeros((steps, 3))
        self.consistency = ConsistencySums(count)
        self.x = np.full((steps, STATES), np.nan)
        self.noise = np.full((3, steps, 3), np.nan)

    def begin(self, setting: Setting, name: str) -> None:
        """Row 0 of the first run."""
        x, _ = setting.start(FIVE)
        self.x[0] = x[0]
        channels = setting.told_facts(FIVE).channels
        if not METHODS[name].knows_noise:
            self.noise[0, 0] = [channels[channel].initial_variance for channel in MEASURED]

    def take(self, step: int, state: FilterState, is_measured: tuple[bool, bool, bool]) -> None:
        """One step of all runs."""
        self.squares[:, step] = squared_errors(state.x, self._truth[step])
        self.consistency.add_state(state.x, state.P, self._truth[step])
        variances = state.P.diagonal(axis1=-2, axis2=-1)[:, [0, 1, 4]].sum(axis=0)
        self.claimed[step] = variances * np.square([1.0, 1.0, np.degrees(1.0)])
        self.x[step] = state.x[0, :STATES]
        for place, channel in enumerate(MEASURED):
            noise = state.noise.get(channel)
            if noise is None:
                continue
            self.noise[0, step, place] = _first(noise.variance)
            self.noise[1, step, place] = _first(noise.dom_ratio)
            if is_measured[place] and noise.nis is not None:
                self.consistency.add_innovation(noise.nis)

    def track(self) -> RunTrack:
        """The first run."""
        variance, dom_ratio, alpha = self.noise
        alpha[1:] = variance[1:] / variance[:-1]
        return RunTrack(self.x, variance, dom_ratio, alpha)


def _first(value: Number | None) -> float:
    """Values of the first run; NaN when there is none."""
    if value is None:
        return math.nan
    return float(value[0]) if isinstance(value, np.ndarray) else value


def run_method(name: str, setting: Setting, *, first: bool) -> Outcome:
    """All runs of a setting with one method; `first`: these are the first runs, so keep a track and time one boat."""
    record = _Record(setting)
    record.begin(setting, name)
    runs = setting.runs
    states = drive(name, setting)
    seconds = 0.0
    for step in range(1, len(runs.truth)):
        start_s = time.thread_time()
        state = next(states)
        seconds += time.thread_time() - start_s
        fix, heading = bool(runs.has_gps[step]), bool(runs.has_compass[step])
        record.take(step, state, (fix, fix, heading))
    return Outcome(
        mse={span: record.squares[:, rows].mean(axis=1) for span, rows in setting.spans.items()},
        nees=record.consistency.mean_nees,
        nis=record.consistency.mean_nis,
        squares=record.squares.sum(axis=0),
        claimed=record.claimed,
        seconds=seconds,
        live_us=_live_us(name, setting) if first else math.nan,
        first=record.track() if first else None,
    )


def _live_us(name: str, setting: Setting) -> float:
    """Median processor time of a step of one boat, us."""
    states = drive(name, setting, member=0)
    times_s = []
    for _ in range(min(LIVE_STEPS, len(setting.runs.truth) - 1)):
        start_s = time.thread_time()
        next(states)
        times_s.append(time.thread_time() - start_s)
    return float(np.median(times_s)) * 1e6


def raw_outcome(setting: Setting, *, first: bool) -> Outcome:
    """The sensors themselves, as a method: errors of fixes and headings at the steps that have them."""
    runs = setting.runs
    readings = np.zeros((*runs.imu.shape[:2], STATES))
    readings[..., :2], readings[..., 4] = runs.gps, runs.compass_rad
    squares = squared_errors(readings - runs.truth, np.zeros(STATES))
    missing = np.column_stack((~runs.has_gps, ~runs.has_gps, ~runs.has_compass))
    squares[:, missing] = np.nan
    squares[:, 0] = 0.0
    count, steps = squares.shape[:2]
    none = np.full(count, np.nan)
    track = np.where(missing[:, [0, 1, 0, 0, 2]], np.nan, readings[0])
    blank = np.full((steps, 3), np.nan)
    return Outcome(
        mse={span: _mean_of_given(squares[:, rows], missing[rows]) for span, rows in setting.spans.items()},
        nees=none,
        nis=none,
        squares=squares.sum(axis=0),
        claimed=blank,
        seconds=math.nan,
        live_us=math.nan,
        first=RunTrack(track, blank, blank, blank) if first else None,
    )


def _mean_of_given(squares: Array, missing: npt.NDArray[np.bool_]) -> Array:
    """Mean over the steps (runs, k, 3) -> (runs, 3); NaN where none of them has a reading."""
    sums = np.where(missing, 0.0, squares).sum(axis=1)
    given = (~missing).sum(axis=0)
    means: Array = np.where(given > 0, sums / np.maximum(given, 1), np.nan)
    return means


def merged(parts: list[Outcome]) -> Outcome:
    """One outcome of several chunks, in the order of the runs."""
    return Outcome(
        mse={span: np.concatenate([part.mse[span] for part in parts]) for span in parts[0].mse},
        nees=np.concatenate([part.nees for part in parts]),
        nis=np.concatenate([part.nis for part in parts]),
        squares=sum((part.squares for part in parts[1:]), parts[0].squares),
        claimed=sum((part.claimed for part in parts[1:]), parts[0].claimed),
        seconds=sum(part.seconds for part in parts),
        live_us=parts[0].live_us,
        first=parts[0].first,
    )
