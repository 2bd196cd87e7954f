"""States beyond the thesis' five: derivatives, batches, biases that are found, lever arm, compass bias, tilt leak."""

import math

import numpy as np
import pytest

from common.units import NS_PER_S
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.filters import FilterState
from shore.navigation.initial_state import first_of
from shore.navigation.kalman import predict_extended
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise, jacobian, move
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import EXTRA_NAMES, FIVE, Extra, Gaussian, StateSpace
from shore.navigation.ukf import predict_unscented

SIGMAS = (0.02, 0.1, 0.1, 0.2, 1.5, 0.3, 0.3, 0.5)
ERRORS = (
    Extra("gps1_error_east_m", 2.0, lasts_s=150.0),
    Extra("gps1_error_north_m", 2.0, lasts_s=150.0),
    Extra("compass1_bias_rad", 0.03, lasts_s=100.0),
    Extra("compass1_sin_rad", 0.05, 1e-4),
    Extra("compass1_cos_rad", 0.05, 1e-4),
)
ALL = StateSpace((*(Extra(name, sigma) for name, sigma in zip(EXTRA_NAMES, SIGMAS, strict=True)), *ERRORS))
NINE = StateSpace((*ALL.extras[:3], Extra("tilt_leak_per_m", 0.2, limit=0.4)))
QUIET = ProcessNoise(0.004, 0.004, math.radians(0.036))


def some_state(space: StateSpace, seed: int) -> Array:
    x = np.random.default_rng(seed).normal(size=space.size) * 0.3
    x[2:4] += (1.0, -1.5)
    return x


@pytest.mark.parametrize("space", [FIVE, NINE, ALL])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_jacobian_is_the_derivative_of_the_motion(space: StateSpace, seed: int) -> None:
    x, imu, dt_s, step = some_state(space, seed), ImuInput(0.3, -0.2, 0.4), 0.7, 1e-6
    F = jacobian(space, x, dt_s, imu)
    for column in range(space.size):
        apart = np.zeros(space.size)
        apart[column] = step
        slope = (move(space, x + apart, dt_s, imu) - move(space, x - apart, dt_s, imu)) / (2.0 * step)
        assert slope == pytest.approx(F[:, column], abs=1e-8)


@pytest.mark.parametrize("predict", [predict_extended, predict_unscented])
def test_cross_covariance_of_a_narrow_gaussian_is_that_of_the_linear_motion(predict: object) -> None:
    x, imu, P = some_state(ALL, 4), ImuInput(0.3, -0.2, 0.4), 1e-8 * np.diag(np.arange(1.0, ALL.size + 1.0))
    predicted = predict(Gaussian(ALL, x, P), 0.7, imu, QUIET)  # type: ignore[operator]
    assert predicted.cross == pytest.approx(P @ jacobian(ALL, x, 0.7, imu).T, abs=1e-13)


def facts(space: StateSpace, lever: tuple[float, float] | None = None) -> FilterFacts:
    channels = {"g.east": Channel(4.0), "g.north": Channel(4.0), "c.heading": Channel(math.radians(1.0) ** 2)}
    return FilterFacts(channels, space, QUIET, levers={"g": lever} if lever else {})


@pytest.mark.parametrize("name", sorted(REGISTRY))
@pytest.mark.parametrize("space", [FIVE, NINE, ALL])
def test_a_batch_is_its_runs_side_by_side(name: str, space: StateSpace) -> None:
    """100 steps of 20 runs at once and one by one: the same to 1e-9, with R, window and all states."""
    rng, steps, runs = np.random.default_rng(5), 100, 20
    imu = rng.normal(size=(steps, 3, runs)) * np.array([0.05, 0.05, 0.02])[:, np.newaxis]
    fixes = rng.normal(size=(steps, 2, runs)) * 6.0
    headings = 3.0 + rng.normal(size=(steps, runs)) * np.linspace(0.02, 0.5, steps)[:, np.newaxis]
    x, P = first_of(facts(space), (0.0, 0.0, 0.5, 0.5, 3.0), (4.0, 4.0, 0.25, 0.25, 0.01))

    def carry(of: slice | int, start_x: Array, start_P: Array) -> FilterState:
        each = build_filter(name, facts(space, lever=(1.0, -0.5)))
        each.start(start_x, start_P)
        for k in range(steps):
            each.predict(1.0, None if k == 50 else ImuInput(*imu[k, :, of]))
            each.update(Position(k * NS_PER_S, "g", *fixes[k, :, of]))
            if k % 3:
                each.update(TrueHeading(k * NS_PER_S, "c", headings[k, of]))
        return each.estimate

    batch = carry(slice(None), np.stack([x] * runs), np.stack([P] * runs))
    for run in (0, 7, 19):
        alone = carry(run, x, P)
        assert alone.x == pytest.approx(batch.x[run], abs=1e-9)
        assert np.allclose(alone.P, batch.P[run], rtol=1e-9, atol=1e-12)
        for channel, noise in alone.noise.items():
            both = batch.noise[channel]
            assert float(noise.variance) == pytest.approx(np.broadcast_to(both.variance, runs)[run], rel=1e-9)


def test_constant_biases_are_found_within_their_own_sigma() -> None:
    """A slalom with known truth: each bias ends within 4 of its sigmas, and each sigma has shrunk."""
    rng, bias = np.random.default_rng(6), np.array([0.03, 0.02, math.radians(0.28)])
    extras = (Extra("gyro_bias_rad_s", 0.005), Extra("accel_bias_fwd_m_s2", 0.04), Extra("accel_bias_stb_m_s2", 0.04))
    each = build_filter("ukf", facts(StateSpace(extras)))
    truth = np.array([0.0, 0.0, 0.0, 1.0, 0.0])
    each.start(*first_of(each.facts, truth.tolist(), (4.0, 4.0, 0.25, 0.25, 1e-3)))
    for k in range(400):
        rate = math.radians(3.0) * (1 if k % 60 < 30 else -1)
        truth = move(FIVE, truth, 1.0, ImuInput(0.0, rate, rate))
        noise = rng.normal(size=3) * [0.004, 0.004, math.radians(0.036)]
        each.predict(1.0, ImuInput(*(np.array([0.0, rate, rate]) + bias + noise)))
        each.update(Position(0, "g", *(truth[:2] + rng.normal(size=2) * 2.0)))
        each.update(TrueHeading(0, "c", truth[4] + rng.normal() * math.radians(1.0)))
    found, sigma = each.estimate.x[5:], np.sqrt(each.estimate.P.diagonal()[5:])
    assert (np.abs(found - bias[[2, 0, 1]]) < 4.0 * sigma).all()
    assert (sigma < [math.radians(0.02), 0.002, 0.002]).all()


def test_antenna_away_from_the_reference_point() -> None:
    """2 m ahead and 1 m to port: on course 90 the fix lies 2 m east and 1 m north of the boat."""
    each = build_filter("ukf", facts(FIVE, lever=(2.0, -1.0)))
    each.start(np.array([0.0, 0.0, 0.0, 0.0, math.pi / 2]), np.diag([1e4, 1e4, 1.0, 1.0, 1e-8]))
    each.update(Position(0, "g", 12.0, 21.0))
    assert each.estimate.x[:2] == pytest.approx([10.0, 20.0], abs=0.02)


def test_a_lever_arm_tells_the_heading_of_a_turning_boat_on_the_spot() -> None:
    each = build_filter("ekf", facts(FIVE, lever=(10.0, 0.0)))
    each.start(np.array([0.0, 0.0, 0.0, 0.0, 0.0]), np.diag([1e-6, 1e-6, 1e-6, 1e-6, 0.04]))
    each.update(Position(0, "g", 10.0 * math.sin(0.1), 10.0 * math.cos(0.1)))
    assert 0.0 < each.estimate.x[4] <= 0.1


def test_compass_bias_is_told_apart_by_a_compass_that_is_right() -> None:
    space = StateSpace((Extra("c_bias_rad", 0.2),))
    each = build_filter("ukf", facts(space, lever=(20.0, 0.0)))
    each.start(*first_of(each.facts, (0.0, 0.0, 0.0, 0.0, 0.15), (1e-6, 1e-6, 1e-6, 1e-6, 1e-4), compass="c"))
    for _ in range(50):
        each.update(Position(0, "g", 0.0, 20.0))
        each.update(TrueHeading(0, "c", 0.15))
    assert each.estimate.x[4] == pytest.approx(0.0, abs=0.03)
    assert each.estimate.x[5] == pytest.approx(0.15, abs=0.03)


def test_a_wrong_tilt_leak_does_not_run_away() -> None:
    """c < 0 feeds on itself: unbounded, the states overflowed within 10 s of a start at an unknown speed."""
    each = build_filter("ukf", facts(NINE))
    each.start(*first_of(each.facts, (0.0, 0.0, 0.0, 0.0, 0.0), (64.0, 64.0, 2.25, 2.25, 1e-4)))
    rng = np.random.default_rng(8)
    for k in range(1200):
        each.predict(0.05, ImuInput(0.0, 0.0, 0.0))
        if k % 20 == 19:
            each.update(Position(0, "g", *(rng.normal(size=2) * 8.0)))
        assert each.estimate.healthy
        assert np.abs(each.estimate.x[2:4]).max() < 20.0
    assert abs(each.estimate.x[8]) <= 0.4


def test_a_prior_of_nothing_is_no_state() -> None:
    space = StateSpace(
        (Extra("tilt_leak_per_m", 0.0), Extra("accel_bias_fwd_m_s2", 0.1), Extra("gyro_bias_rad_s", 0.1))
    )
    assert space.names[5:] == ("gyro_bias_rad_s", "accel_bias_fwd_m_s2")
    with pytest.raises(ValueError, match="no such state: drag"):
        StateSpace((Extra("drag", 1.0),))
