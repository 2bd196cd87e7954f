"""What sensors do beside white noise: each flaw has the size it claims and nothing else changes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.simulation.fields import STILL
from common.simulation.motion import Array, Mission, Truth, sail
from common.simulation.sensor_errors import Deviation, Drift, Flaws, drift_path, gauss_markov
from common.simulation.sensor_models import Draws, Phase, compass_heading_deg, gps_position, imu_samples
from common.simulation.thesis_tables import REALISTIC, TABLE_3_3, TABLE_3_4, TABLE_5_4, budget_m

WHITE = (Phase(0.0, TABLE_5_4),)
SILENT = (
    Phase(
        0.0,
        replace(TABLE_5_4, gps_east_m=0.0, gps_north_m=0.0, compass_deg=0.0, accel_density=0.0, gyro_density_deg=0.0),
    ),
)
RUNS = 1500


def seeds(count: int = RUNS) -> Draws:
    return Draws(*np.random.SeedSequence(11).spawn(count))


def at_rest(seconds: int) -> Truth:
    zero = np.zeros(seconds + 1)
    return Truth(np.arange(seconds + 1.0), zero, zero, zero, zero, zero)


@pytest.fixture(scope="module")
def circle() -> Truth:
    """A full turn to starboard in 120 s, then on to the north."""
    mission = Mission(start=(0.0, 0.0), waypoints=((0.0, -300.0), (0.0, 500.0)), heading_deg=0.0, longest_s=150.0)
    return sail(mission, STILL)


def within_4_sigma(values: Array, std: float) -> bool:
    """Sample standard deviation over the first axis, each column."""
    return bool(np.all(np.abs(values.std(axis=0) / std - 1.0) < 4.0 / math.sqrt(2 * len(values))))


def test_gauss_markov_keeps_its_sigma_and_forgets_with_its_time() -> None:
    t_s = np.array([0.0, 1.0, 3.0, 30.0, 40.0])
    path = drift_path(gauss_markov(2.0, 10.0), t_s, np.random.default_rng(1).standard_normal((20_000, 5, 1)))[..., 0]
    assert within_4_sigma(path, 2.0)
    shared = np.corrcoef(path.T)
    expected = np.exp(-np.abs(t_s[:, np.newaxis] - t_s) / 10.0)
    assert np.abs(shared - expected).max() < 4.0 / math.sqrt(len(path))


def test_a_random_walk_spreads_with_the_root_of_time_at_any_step() -> None:
    t_s = np.array([0.0, 0.5, 4.0, 100.0])
    path = drift_path(Drift(0.3), t_s, np.random.default_rng(2).standard_normal((20_000, 4, 1)))[..., 0]
    assert np.all(path[:, 0] == 0.0)
    assert within_4_sigma(path[:, 1:] / np.sqrt(t_s[1:]), 0.3)


def test_a_drift_without_density_is_none() -> None:
    assert not drift_path(Drift(), np.arange(3.0), np.ones((2, 3, 1))).any()


def test_imu_bias_is_drawn_once_a_run_and_scale_acts_on_the_motion(circle: Truth) -> None:
    flaws = Flaws(turn_on=(0.03, 0.02, 0.28), scale=(0.0, 0.01, 0.02))
    samples = imu_samples(circle.until(20.0), SILENT, seeds(), flaws)
    true = imu_samples(circle.until(20.0), SILENT, seeds(1)).values[0]
    error = samples.values - true - samples.turn_on[:, np.newaxis]
    assert within_4_sigma(samples.turn_on, 1.0) is False
    assert within_4_sigma(samples.turn_on / flaws.turn_on, 1.0)
    turning = np.abs(true[:, 2]) > 1.0
    assert turning.any()
    assert within_4_sigma((error[:, turning, 2] / true[turning, 2])[:, [0, -1]], 0.02)
    assert within_4_sigma((error[:, turning, 1] / true[turning, 1])[:, [0, -1]], 0.01)
    assert np.abs(error[..., 0]).max() < 1e-12


def test_in_run_drift_of_the_imu_has_its_sigma_beside_the_white_noise() -> None:
    flaws = Flaws(accel_drift=gauss_markov(0.005, 600.0), gyro_drift_deg=gauss_markov(0.01, 600.0))
    error = imu_samples(at_rest(300), SILENT, seeds(), flaws).values
    assert within_4_sigma((error[:, [0, 299]] / [0.005, 0.005, 0.01]).reshape(RUNS, -1), 1.0)
    both = imu_samples(at_rest(300), WHITE, seeds(), flaws).values
    assert within_4_sigma(both[:, 299, 2:], math.hypot(0.036, 0.01))


def test_slow_gps_error_adds_to_the_white_noise_and_leaves_its_draws_alone() -> None:
    flaws = Flaws(gps_drift_m=gauss_markov(6.0, 300.0))
    plain, slow = (gps_position(at_rest(60), WHITE, seeds(), each) for each in (Flaws(), flaws))
    wander = slow - plain
    assert within_4_sigma(slow[:, 60] / [10.0, math.hypot(7.0, 6.0)], 1.0)
    one_minute = [np.corrcoef(wander[:, 0, axis], wander[:, 60, axis])[0, 1] for axis in (0, 1)]
    assert one_minute == pytest.approx(2 * [math.exp(-0.2)], abs=0.05)


@given(st.floats(-7.0, 7.0))
def test_deviation_is_what_true_heading_has_more_than_the_compass(heading: float) -> None:
    deviation = Deviation(A=1.0, B=2.0, C=-3.0, D=0.5, E=0.25)
    truth = replace(at_rest(0), heading_rad=np.array([heading]))
    (measured,) = compass_heading_deg(truth, SILENT, Draws(1), Flaws(deviation=deviation))[0]
    expected = (
        1.0
        + 2.0 * math.sin(heading)
        - 3.0 * math.cos(heading)
        + 0.5 * math.sin(2 * heading)
        + 0.25 * math.cos(2 * heading)
    )
    difference = (math.degrees(heading) - measured + 180.0) % 360.0 - 180.0
    assert difference == pytest.approx(expected, abs=1e-9)


def test_a_late_sensor_shows_what_was(circle: Truth) -> None:
    flaws = Flaws(gps_latency_s=2.0, compass_latency_s=1.0)
    seen = circle.at(np.arange(0.0, 60.0))
    late_fix = gps_position(seen, SILENT, Draws(1), flaws)[0]
    late_heading = compass_heading_deg(seen, SILENT, Draws(1), flaws)[0]
    assert late_fix[2:, 1] == pytest.approx(seen.north_m[:-2])
    assert late_fix[0, 1] == seen.north_m[0]
    assert late_heading[1:] == pytest.approx(np.degrees(seen.heading_rad[:-1]) % 360.0)


def test_preset_realistic_spends_the_budget_of_table_3_3() -> None:
    least, greatest = (
        0.5 * math.hypot(*(getattr(row, name) for row in TABLE_3_3)) for name in ("least_m", "greatest_m")
    )
    total = math.hypot(budget_m(is_slow=True), budget_m(is_slow=False))
    assert least < total < greatest
    assert least < TABLE_3_4.gps_north_m < TABLE_3_4.gps_east_m < greatest
    assert REALISTIC.gps_drift_m.sigma == pytest.approx(budget_m(is_slow=True))
