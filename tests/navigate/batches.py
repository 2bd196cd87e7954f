"""Many runs of one mission as arrays, for paired statistics of the noise rules; the oracle is told all noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.units import NS_PER_S
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import FilterFacts
from tests.navigate.voyages import ACCEL_STD, GYRO_STD_DEG, Truth

CHANNELS = ("gps1.east", "gps1.north", "compass1.heading")
TABLE_5_3 = (6.0, 7.0, 0.5)
"""Sigmas the filters are told: m, m, deg."""
GOOD = (8.0, 7.0, 0.8)
POOR = (20.0, 20.0, 5.0)
START_SIGMAS = np.array([1.0, 1.0, 0.1, 0.1, math.radians(0.5)])


@dataclass(frozen=True)
class Batch:
    """Runs of a mission at 1 Hz: inputs (runs, k, 3), measured (runs, k, 3), first errors (runs, 5); truth of noise."""

    truth: Truth
    inputs: Array
    measured: Array
    start: Array
    sigmas: Array
    """(k, 3) m, m, rad."""
    imu_factor: Array
    """(k,), on the noise of the IMU."""


def noisy(truth: Truth, runs: int, sigmas: Sequence[tuple[float, float, float]], imu_factor: Array) -> Batch:
    """`sigmas`: (m, m, deg) for each step."""
    rng = np.random.default_rng(4)
    count = len(truth.states)
    each = np.array(sigmas) * [1.0, 1.0, math.radians(1.0)]
    scale = np.array([ACCEL_STD, ACCEL_STD, math.radians(GYRO_STD_DEG)])
    inputs = truth.inputs + rng.normal(size=(runs, count, 3)) * scale * imu_factor[:, None]
    measured = truth.states[:, [0, 1, 4]] + rng.normal(size=(runs, count, 3)) * each
    return Batch(truth, inputs, measured, rng.normal(size=(runs, 5)) * START_SIGMAS, each, imu_factor)


def facts(sigmas: Array, imu_factor: float = 1.0) -> FilterFacts:
    """`sigmas` in m, m, rad."""
    channels = {name: Channel(float(sigma) ** 2) for name, sigma in zip(CHANNELS, sigmas, strict=True)}
    accel, turn = ACCEL_STD * imu_factor, math.radians(GYRO_STD_DEG) * imu_factor
    return FilterFacts(channels, imu_noise=ProcessNoise(accel, accel, turn))


def told(sigmas: tuple[float, float, float]) -> FilterFacts:
    """`sigmas` in m, m, deg."""
    return facts(np.array(sigmas) * [1.0, 1.0, math.radians(1.0)])


def begin(name: str, batch: Batch, known: FilterFacts, member: int | None = None) -> Filter:
    """A filter of all runs, or of one of them."""
    each = build_filter(name, known)
    x, P = batch.truth.states[0] + batch.start, np.diag(START_SIGMAS**2)
    if member is None:
        each.start(x, np.tile(P, (len(x), 1, 1)))
    else:
        each.start(x[member], P)
    return each


def step(each: Filter, second: int, inputs: Array, measured: Array) -> None:
    """Second number `second`: `inputs` and `measured` (3,) of one run, or (3, runs)."""
    if inputs.ndim == 1:
        inputs, measured = inputs.tolist(), measured.tolist()
    each.predict(1.0, ImuInput(inputs[0], inputs[1], inputs[2]))
    each.update(Position(second * NS_PER_S, "gps1", measured[0], measured[1]))
    each.update(TrueHeading(second * NS_PER_S, "compass1", measured[2]))


@dataclass(frozen=True)
class Outcome:
    """Squared errors (runs, k, 3) in m^2, m^2, deg^2; NEES (runs, k); drive of each channel (k, 3), median of runs."""

    squares: Array
    nees: Array
    drive: Array

    @property
    def mse(self) -> Array:
        """Of each run, (runs, 3)."""
        return np.asarray(self.squares.mean(axis=1))


def follow(name: str, batch: Batch, known: FilterFacts | None) -> Outcome:
    """Filter `name` with constant facts, or the oracle: the fixed filter that is told all noise as it changes."""
    states = batch.truth.states
    each = begin(name, batch, known or facts(batch.sigmas[0]))
    runs, count = batch.inputs.shape[:2]
    squares, nees = np.zeros((runs, count, 3)), np.full((runs, count), 5.0)
    drive = np.ones((count, 3))
    inputs, measured = np.moveaxis(batch.inputs, 0, -1).copy(), np.moveaxis(batch.measured, 0, -1).copy()
    for k in range(1, count):
        if known is None:
            each.facts = facts(batch.sigmas[k], float(batch.imu_factor[k]))
        step(each, k, inputs[k], measured[k])
        error = each.estimate.x - states[k]
        error[:, 4] = np.angle(np.exp(1j * error[:, 4]))
        squares[:, k] = (error[:, [0, 1, 4]] * [1.0, 1.0, math.degrees(1.0)]) ** 2
        nees[:, k] = np.einsum("ri,ri->r", error, np.linalg.solve(each.estimate.P, error[..., None])[..., 0])
        drive[k] = [np.median(each.estimate.noise[channel].drive) for channel in CHANNELS]
    return Outcome(squares, nees, drive)


def ratios(ours: Outcome, oracle: Outcome) -> Array:
    """Of the mean squared errors over all runs, (3,)."""
    return np.asarray(ours.mse.mean(axis=0) / oracle.mse.mean(axis=0))
