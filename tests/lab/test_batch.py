"""All runs at once are the same filters as one boat, and what the methods of the laboratory know."""

import math
from itertools import islice

import numpy as np
import pytest

from common.errors import WayfixError
from common.simulation.monte_carlo_runs import draw_runs
from common.simulation.scenario import with_bias
from common.simulation.scenarios import find_scenario
from shore.lab.batch import Profile, Setting, drive, run_method
from shore.lab.methods import METHODS, ORACLE, IntervalKalman, check_methods
from shore.navigation.measurements import TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import Extra, StateSpace


def setting(name: str, runs: int, profile: Profile = "stated", *, biased: bool = False) -> Setting:
    scenario = with_bias(find_scenario(name)) if biased else find_scenario(name)
    return Setting(scenario, draw_runs(scenario, runs, 7), profile)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("biased", [False, True])
def test_a_row_of_a_batch_is_the_boat_alone(name: str, biased: bool) -> None:
    """Into the first turn of Scenario 4.2."""
    each = setting("4.2", 20, biased=biased)
    member = 7
    for batch, alone in islice(zip(drive(name, each), drive(name, each, member), strict=True), 140):
        difference = batch.x[member] - alone.x
        difference[4] = math.remainder(difference[4], math.tau)
        assert np.abs(difference).max() < 1e-9
        assert batch.P[member] == pytest.approx(alone.P, rel=1e-9, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", METHODS)
def test_all_rows_of_a_batch_are_boats_alone(name: str) -> None:
    each = setting("5.2", 20)
    together = np.array([state.x for state in islice(drive(name, each), 300)])
    for member in range(20):
        alone = np.array([state.x for state in islice(drive(name, each, member), 300)])
        difference = together[:, member] - alone
        difference[:, 4] = np.angle(np.exp(1j * difference[:, 4]))
        assert np.abs(difference).max() < 1e-9


def test_dead_reckoning_looks_at_no_fix() -> None:
    each = setting("4.2", 2)
    for state in drive("dead-reckoning", each):
        assert not state.noise
    assert state.P[0, 0, 0] > 20.0


def test_static_fusion_is_the_mean_of_start_and_fixes() -> None:
    each = setting("4.0", 3)
    *_, last = drive("static", each)
    x0, P0 = each.start(last.space)
    weight = 64.0 / P0[0, 0, 0]
    fixes = each.runs.gps[:, 1:, 0]
    mean = (weight * x0[:, 0] + fixes.sum(axis=1)) / (weight + fixes.shape[1])
    assert last.x[:, 0] == pytest.approx(mean, rel=1e-12)
    assert last.P[0, 0, 0] == pytest.approx(1.0 / (1.0 / P0[0, 0, 0] + fixes.shape[1] / 64.0))


def test_the_oracle_is_told_of_the_change() -> None:
    each = setting("5.3", 2)
    states = list(drive(ORACLE, each))
    assert states[299].noise["gps1.east"].variance == pytest.approx(64.0)
    assert states[300].noise["gps1.east"].variance == pytest.approx(400.0)
    assert each.change == 301


def test_biases_left_in_give_filters_eight_states_and_the_oracle_none() -> None:
    each = setting("4.2", 2, biased=True)
    sizes = {name: next(drive(name, each)).space.size for name in ("ukf", "oracle", "oracle-8", "ukf-5")}
    assert sizes == {"ukf": 8, "oracle": 5, "oracle-8": 8, "ukf-5": 5}
    free, known = setting("4.2", 2), each
    assert next(drive(ORACLE, known)).x == pytest.approx(next(drive(ORACLE, free)).x)


def test_compat_starts_at_the_truth_and_stated_about_it() -> None:
    exact, drawn = setting("4.2", 2, "compat"), setting("4.2", 2)
    assert np.array_equal(exact.start(next(drive("ukf", exact)).space)[0][0], exact.runs.truth[0])
    assert not np.array_equal(drawn.start(next(drive("ukf", drawn)).space)[0][0], drawn.runs.truth[0])
    with pytest.raises(WayfixError, match="--profile stated"):
        setting("agile", 2, "compat").start(StateSpace())


def test_the_interval_holds_every_bias_within_its_bounds() -> None:
    bound = math.radians(0.3)
    noise = ProcessNoise(0.004, 0.004, math.radians(0.036))
    facts = FilterFacts({"compass1.heading": Channel(math.radians(1.0) ** 2)}, imu_noise=noise)
    told = FilterFacts(facts.channels, StateSpace((Extra("gyro_bias_rad_s", bound),)), imu_noise=noise)
    rng = np.random.default_rng(1)
    headings = 1.0 + math.radians(1.0) * rng.normal(size=80)

    def run(method: IntervalKalman, bias: float) -> float:
        method.start(np.array([0.0, 0.0, 0.0, 0.0, 1.0]), np.diag([1.0, 1.0, 1.0, 1.0, 1e-4]))
        for heading in headings.tolist():
            method.predict(1.0, ImuInput(0.0, 0.0, bias))
            method.update(TrueHeading(0, "compass1", heading))
        return float(method.estimate.x[4])

    interval = IntervalKalman(told)
    centre = run(interval, 0.0)
    edges = [run(IntervalKalman(facts), bias) for bias in (-bound, bound)]
    assert edges == pytest.approx([centre - interval.half_width_rad, centre + interval.half_width_rad], abs=1e-9)
    exact = IntervalKalman(facts)
    run(exact, 0.0)
    widened = interval.estimate.P[4, 4] - exact.estimate.P[4, 4]
    assert widened == pytest.approx(float(interval.half_width_rad) ** 2 / 3.0)


def test_chunks_of_runs_are_those_runs() -> None:
    whole = setting("4.2", 6)
    part = Setting(whole.scenario, draw_runs(whole.scenario, 2, 7, first=4), "stated")
    all_runs, two = run_method("fuzzy", whole, first=False), run_method("fuzzy", part, first=False)
    assert two.mse["whole"] == pytest.approx(all_runs.mse["whole"][4:], rel=1e-12)
    assert two.nees == pytest.approx(all_runs.nees[4:], rel=1e-9)
    assert two.first is None


def test_names_are_checked() -> None:
    assert check_methods(["ukf", " kf", "ukf", ""]) == ("ukf", "kf")
    for names in (["kalmann"], [""], []):
        with pytest.raises(WayfixError, match="unknown filter"):
            check_methods(names)
