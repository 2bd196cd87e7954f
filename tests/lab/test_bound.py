"""The posterior Cramer-Rao bound where it is known by other means."""

from dataclasses import replace

import numpy as np
import pytest

from common.simulation.monte_carlo_runs import Runs, draw_runs
from common.simulation.scenario import with_bias
from common.simulation.scenarios import find_scenario
from shore.lab.batch import EIGHT, Setting
from shore.lab.bound import _derivatives, posterior_bound
from shore.navigation.motion_model import ImuInput, move


def runs_of(name: str) -> Runs:
    return draw_runs(find_scenario(name), 1, 1)


def test_it_settles_at_the_riccati_equation_on_a_straight_line() -> None:
    """Its solution for white acceleration held over a step is P. R. Kalata's (IEEE Trans. AES 20, 1984)."""
    runs = runs_of("4.1")
    bounds = posterior_bound(runs, np.array([1.0, 1.0, 0.01, 0.01, 1e-4]))
    for place in range(2):
        R = runs.gps_m[-1, place] ** 2
        index = runs.accel_std[-1, place] * runs.step_s**2 / runs.gps_m[-1, place]
        root = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
        assert bounds[-1, place] == pytest.approx((1.0 - root**2) * R, rel=1e-6)
    q, r = runs.gyro_std_rad[-1] ** 2, runs.compass_sigma_rad[-1] ** 2
    prior = 0.5 * (q + np.sqrt(q * q + 4.0 * q * r))
    assert bounds[-1, 2] == pytest.approx(np.degrees(np.degrees(prior * r / (prior + r))), rel=1e-6)


def test_a_moored_boat_has_the_bound_of_a_mean() -> None:
    runs = runs_of("4.0")
    bounds = posterior_bound(runs, np.array([400.0, 400.0, 1e-4, 1e-4, 1e-4]), moored=True)
    steps = np.arange(len(bounds))
    assert bounds[:, 0] == pytest.approx(1.0 / (1.0 / 400.0 + steps / 64.0))
    assert bounds[:, 1] == pytest.approx(1.0 / (1.0 / 400.0 + steps / 49.0))


def test_it_is_the_studys() -> None:
    expected = {"4.1": (0.485, 0.368, 0.0183), "4.4-T1": (2.11, 1.73, 0.0347), "5.2": (8.28, 8.27, 0.186)}
    for name, values in expected.items():
        scenario = find_scenario(name)
        found = Setting(scenario, draw_runs(scenario, 1, 1), "stated").bound[1:].mean(axis=0)
        assert found == pytest.approx(values, rel=0.03), name


def test_no_reading_no_information() -> None:
    runs = runs_of("4.1")
    silent = replace(runs, has_gps=np.arange(len(runs.truth)) < 300, has_compass=np.arange(len(runs.truth)) < 300)
    start = np.array([1.0, 1.0, 0.01, 0.01, 1e-4])
    with_all, without = posterior_bound(runs, start), posterior_bound(silent, start)
    assert np.array_equal(with_all[:300], without[:300])
    assert np.all(np.diff(without[300:], axis=0) > 0.0)
    q = np.degrees(runs.gyro_std_rad[-1]) ** 2
    assert np.diff(without[300:, 2]) == pytest.approx(np.full(len(without) - 301, q))


def test_its_derivatives_are_those_of_the_filters_motion() -> None:
    """In a turn at full throttle, by differences."""
    x, inputs, step_s = np.array([3.0, 4.0, 1.0, -2.0, 0.7, 0.0, 0.0, 0.0]), np.array([0.5, -0.3, 0.4]), 0.8
    F, B = _derivatives(0.7, inputs, step_s, 8)
    tiny = 1e-6
    for place in range(8):
        nudge = np.eye(8)[place] * tiny
        ahead, behind = (move(EIGHT, x + sign * nudge, step_s, ImuInput(*inputs.tolist())) for sign in (1.0, -1.0))
        assert F[:, place] == pytest.approx((ahead - behind) / (2.0 * tiny), abs=1e-8)
    for place in range(3):
        nudge = np.eye(3)[place] * tiny
        ahead, behind = (move(EIGHT, x, step_s, ImuInput(*(inputs + sign * nudge).tolist())) for sign in (1.0, -1.0))
        assert B[:, place] == pytest.approx((ahead - behind) / (2.0 * tiny), abs=1e-8)


def test_biases_to_be_found_cost_information_that_comes_back() -> None:
    scenario = find_scenario("4.4-T1")
    known = Setting(scenario, draw_runs(scenario, 1, 1), "stated").bound
    biased = with_bias(scenario)
    to_find = Setting(biased, draw_runs(biased, 1, 1), "stated").bound
    assert np.all(to_find[1:] >= known[1:] * (1.0 - 1e-9))
    assert to_find[50, 0] > 1.5 * known[50, 0]
    assert to_find[-1] == pytest.approx(known[-1], rel=0.08)
    assert len(EIGHT.names) == 8
