"""The tilt leak: how a hull lifts its bow with speed, what that adds to the acceleration, and how restless it is."""

import math

import numpy as np
import pytest

from shore.navigation.motion_model import ImuInput, ProcessNoise, move, with_trim
from shore.navigation.numbers import Array
from shore.navigation.state_space import FIVE, V_NORTH, Extra, StateSpace
from shore.navigation.tilt_leak import LARGEST_LIFT_M2_S2, TRIM_UNREST, accel_by_speed, lift

LEAKY = StateSpace((Extra("tilt_leak_per_m", 0.2, limit=0.4),))


def test_the_bow_rises_with_the_square_of_a_small_speed_and_to_an_end() -> None:
    assert lift(0.1) == pytest.approx(0.01, rel=1e-6)
    assert lift(-0.1) == pytest.approx(-0.01, rel=1e-6)
    assert lift(30.0) == LARGEST_LIFT_M2_S2
    assert lift(np.array([-0.1, 30.0])) == pytest.approx(np.array([lift(-0.1), lift(30.0)]))


def test_a_filter_takes_the_leak_off_what_the_forward_axis_shows() -> None:
    """Northwards at 2 m/s, c = 0.1 1/m: 0.1 L of the 0.5 m/s^2 shown is gravity."""
    x = np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.1])
    moved = move(LEAKY, x, 1.0, ImuInput(0.5, 0.0, 0.0))
    assert moved[V_NORTH] == pytest.approx(2.0 + 0.5 - 0.1 * 9.0 * math.tanh(4.0 / 9.0))


@pytest.mark.parametrize("along", [-4.0, -0.5, 0.0, 1.0, 3.0, 20.0])
def test_the_derivative_is_that_of_the_acceleration(along: float) -> None:
    step = 1e-5
    slope = -0.2 * (lift(along + step) - lift(along - step)) / (2.0 * step)
    assert accel_by_speed(0.2, along, lift(along)) == pytest.approx(slope, abs=1e-5)


def at_speed(speed_m_s: float | Array) -> ProcessNoise:
    return with_trim(LEAKY, speed_m_s, ProcessNoise(0.1, 0.1, 0.01))


def test_the_forward_axis_is_noisier_the_higher_the_bow() -> None:
    quiet = ProcessNoise(0.1, 0.1, 0.01)
    assert at_speed(0.0).accel_fwd == pytest.approx(0.1)
    assert at_speed(1.0).accel_fwd == pytest.approx(math.hypot(0.1, TRIM_UNREST * 0.2), rel=0.01)
    assert at_speed(-30.0).accel_fwd == pytest.approx(math.hypot(0.1, TRIM_UNREST * 0.2 * LARGEST_LIFT_M2_S2))
    assert at_speed(1.0)[1:] == quiet[1:]
    assert with_trim(FIVE, 1.0, quiet) == quiet


def test_a_batch_has_the_trim_of_each_run() -> None:
    alone = [at_speed(speed).accel_fwd for speed in (0.0, 1.0, 2.0)]
    assert at_speed(np.array([0.0, 1.0, 2.0])).accel_fwd == pytest.approx(np.array(alone))
