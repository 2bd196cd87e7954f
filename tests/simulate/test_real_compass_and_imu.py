"""Real compasses, inertial units and gyros: deviation, heeling error, duration, biases, and attitude in long turns."""

import numpy as np
import pytest

from common.boat_config import SensorTable
from common.simulation.motion import Truth
from common.simulation.readings import HeadingReading, ImuReading, TurnRateReading
from common.simulation.real_compass import DEVIATION_DEG, Compass, drawn_compass, felt_tilt_deg, seen_heading_deg
from common.simulation.scenarios_real import REAL_SCENARIOS, RealScenario
from common.simulation.sensor_errors import Deviation
from common.simulation.sensor_models import Draws
from common.units import STANDARD_GRAVITY_M_S2 as G
from tests.simulate.hulls import circling, rolling, still

LAKE = REAL_SCENARIOS[0]
COMPASS = SensorTable(id="compass1", port="p", role="compass", rate_hz=5.0)
IMU = SensorTable(id="imu1", port="p", role="imu", rate_hz=10.0)
GYRO = SensorTable(id="gyro1", port="p", role="gyro", rate_hz=10.0)


def headings(truth: Truth, seed: int) -> list[HeadingReading]:
    rows = LAKE.readings(truth, COMPASS, Draws(seed))
    return [timed.reading for timed in rows if isinstance(timed.reading, HeadingReading)]


def samples(truth: Truth, seed: int, sensor: SensorTable = IMU) -> list[ImuReading]:
    return [row.reading for row in LAKE.readings(truth, sensor, Draws(seed)) if isinstance(row.reading, ImuReading)]


def compass(**changes: float) -> Compass:
    quiet = {"lasting_deg": 0.0, "lasts_s": 60.0, "white_deg": 0.0, "damping_s": 0.0, "late_s": 0.0, "heeling": 0.0}
    return Compass(deviation=Deviation(A=1.0, B=4.0), askew_deg=(0.0, 0.0), turn_rate_deg_s=0.0, **{**quiet, **changes})


def test_compasses_are_drawn_within_what_the_docstring_says() -> None:
    made = [drawn_compass(np.random.default_rng(seed)) for seed in range(500)]
    coefficients = np.array([[getattr(one.deviation, name) for name in "ABCDE"] for one in made])
    # A standard deviation of 500 draws has a 1-sigma of 3.2 %.
    np.testing.assert_allclose(coefficients.std(axis=0), DEVIATION_DEG, rtol=0.1)
    headings_rad = np.radians(np.arange(0.0, 360.0, 5.0))
    largest = [np.abs(one.deviation.at(headings_rad)).max() for one in made]
    assert 4.0 < np.percentile(largest, 25) < np.percentile(largest, 75) < 9.0
    assert all(0.2 <= abs(one.heeling) <= 0.8 and 0.0 <= one.late_s <= 0.3 for one in made)


def test_what_is_shown_is_less_by_the_deviation_and_by_the_heel() -> None:
    for heading_deg, expected in ((0.0, 1.0), (90.0, 5.0), (270.0, -3.0)):
        truth = still(1.0, heading_deg)
        shown, _ = seen_heading_deg(truth, truth.t_s, compass())
        np.testing.assert_allclose(shown, heading_deg - expected, atol=1e-9)
    heeled = still(1.0, 0.0, roll_deg=10.0)
    np.testing.assert_allclose(seen_heading_deg(heeled, heeled.t_s, compass(heeling=0.5))[0], -6.0, atol=1e-9)
    heeled = still(1.0, 90.0, roll_deg=10.0)
    np.testing.assert_allclose(seen_heading_deg(heeled, heeled.t_s, compass(heeling=0.5))[0], 85.0, atol=1e-9)


def test_rolling_shows_in_the_heading_at_north_and_not_at_east() -> None:
    north, east = ([r.heading_true_deg for r in headings(rolling(60.0, at, 12.0, 0.3), 2)] for at in (0.0, 90.0))
    swing = [np.degrees(np.angle(np.exp(1j * np.radians(values)))).std() for values in (north, east)]
    assert swing[0] > 1.3 * swing[1]


def test_a_compass_is_late_and_damped() -> None:
    truth = circling(60.0, 1.0, 10.0)
    straight = seen_heading_deg(truth, truth.t_s, compass())[0]
    late = seen_heading_deg(truth, truth.t_s, compass(late_s=0.3))[0]
    damped = seen_heading_deg(truth, truth.t_s, compass(damping_s=0.4))[0]
    assert np.median((straight - late)[200:]) == pytest.approx(3.0, abs=0.3)
    assert np.median((straight - damped)[200:]) == pytest.approx(4.0, abs=0.5)


def test_the_error_lasts_and_has_a_white_part() -> None:
    slow, at_rest = SensorTable(id="compass1", port="p", role="compass", rate_hz=1.0), still(300.0, 45.0)
    growth, white = [], []
    for seed in range(100):
        made = drawn_compass(Draws(seed).of("compass1 made")[0])
        found = [timed.reading for timed in LAKE.readings(at_rest, slow, Draws(seed))]
        shown = [reading.heading_true_deg for reading in found if isinstance(reading, HeadingReading)]
        error = np.degrees(np.unwrap(np.radians(shown)))
        steps = {lag: float(((error[lag:] - error[:-lag]) ** 2).mean()) for lag in (1, 60)}
        # Growth of a Gauss-Markov error over a lag: 2 sigma^2 (1 - exp(-lag / time)); the white part adds 2 sigma^2.
        lasting = {lag: 2.0 * made.lasting_deg**2 * (1.0 - np.exp(-lag / made.lasts_s)) for lag in (1, 60)}
        white.append((steps[1] - lasting[1]) / (2.0 * made.white_deg**2))
        growth.append((steps[60] - 2.0 * made.white_deg**2) / lasting[60])
    assert np.mean(white) == pytest.approx(1.0, abs=0.08)
    # Some four independent steps of 60 s and a chi2 of one degree each: 1-sigma 0.07 over 100 boats.
    assert np.mean(growth) == pytest.approx(1.0, abs=0.15)


def test_tilt_is_that_of_apparent_gravity() -> None:
    turn = circling(20.0, 5.0, 10.0)
    expected = -np.degrees(np.arctan(5.0 * np.radians(10.0) / G))
    np.testing.assert_allclose(felt_tilt_deg(turn, np.array([10.0])), [[expected, 0.0]], atol=0.05)
    tilted = still(5.0, roll_deg=8.0, pitch_deg=-3.0)
    np.testing.assert_allclose(felt_tilt_deg(tilted, np.array([4.0])), [[8.0, -3.0]], atol=0.05)
    shown = headings(tilted, 1)
    assert np.mean([reading.roll_deg for reading in shown]) == pytest.approx(8.0, abs=2.0)
    assert np.mean([reading.pitch_deg for reading in shown]) == pytest.approx(-3.0, abs=2.0)


def test_rate_of_turn_has_the_sign_of_the_turn() -> None:
    for turn_deg_s in (8.0, -8.0):
        rates = [reading.turn_rate_deg_s for reading in headings(circling(30.0, 1.0, turn_deg_s), 1)][10:]
        assert np.median(np.array(rates, dtype=float)) == pytest.approx(turn_deg_s, rel=0.3)


def test_at_rest_an_imu_shows_bias_noise_and_what_it_is_askew() -> None:
    truth, means, scatter = still(20.0), [], []
    for seed in range(150):
        found = samples(truth, seed)
        values = np.array(
            [(r.accel_fwd_m_s2, r.accel_stb_m_s2, r.accel_down_m_s2 + G, r.yaw_rate_deg_s) for r in found]
        )
        means.append(values.mean(axis=0))
        scatter.append(np.sqrt((np.diff(values, axis=0) ** 2).mean(axis=0) / 2.0 / 10.0))
    fwd, stb, down, yaw = np.array(means).std(axis=0)
    # 1 deg askew is 0.17 m/s^2 beside 0.1 of bias; 150 draws, to 2 sigma of their spread.
    assert [fwd, stb] == pytest.approx([0.2, 0.2], rel=0.15)
    assert down == pytest.approx(np.hypot(0.1, 0.005 * G), rel=0.15)
    assert yaw == pytest.approx(0.4, rel=0.15)
    densities = np.array(scatter)
    assert (densities[:, :3] > 0.009).all()
    assert (densities[:, :3] < 0.05).all()
    assert densities[:, 3].mean() == pytest.approx(0.01, rel=0.05)


def test_scale_and_signs_in_a_turn() -> None:
    found = samples(circling(60.0, 5.0, 10.0, roll_deg=-7.0), 1)
    assert np.mean([r.accel_stb_m_s2 for r in found]) > 1.5
    assert np.mean([r.yaw_rate_deg_s for r in found]) == pytest.approx(10.0, abs=1.5)
    assert np.mean([r.accel_down_m_s2 for r in found]) == pytest.approx(-G, abs=0.6)
    known = SensorTable(id="imu1", port="p", role="imu", rate_hz=10.0, bias_accel_fwd_m_s2=0.5, bias_yaw_rate_deg_s=2.0)
    shifted = samples(circling(60.0, 5.0, 10.0, roll_deg=-7.0), 1, known)
    assert shifted[7].accel_fwd_m_s2 - found[7].accel_fwd_m_s2 == pytest.approx(0.5)
    assert shifted[7].yaw_rate_deg_s - found[7].yaw_rate_deg_s == pytest.approx(2.0)


def test_its_own_attitude_is_right_at_first_and_levels_itself_in_a_long_turn() -> None:
    straight, turn = circling(60.0, 6.0, 0.001), circling(90.0, 6.0, 8.0, roll_deg=-6.0)
    assert np.mean([r.roll_deg for r in samples(straight, 1)]) == pytest.approx(0.0, abs=3.0)
    roll = np.array([r.roll_deg for r in samples(turn, 1)], dtype=float)
    # Apparent gravity: the list itself and the centripetal acceleration.
    felt = -6.0 - np.degrees(np.arctan(6.0 * np.radians(8.0) / G))
    assert roll[-200:].mean() == pytest.approx(felt, abs=3.0)
    waves = np.array([r.roll_deg for r in samples(rolling(120.0, 0.0, 8.0, 0.3), 1)], dtype=float)
    assert waves[300:].std() == pytest.approx(8.0 / np.sqrt(2.0), rel=0.1)


def test_a_gyro_is_an_imu_without_the_rest() -> None:
    rows = list(LAKE.readings(circling(60.0, 2.0, 6.0), GYRO, Draws(3)))
    rates = [timed.reading.rate_deg_s for timed in rows if isinstance(timed.reading, TurnRateReading)]
    assert len(rates) == 600
    assert rows[0].t_s == pytest.approx(0.1)
    assert np.mean(rates) == pytest.approx(6.0, abs=1.5)


@pytest.mark.parametrize("scenario", REAL_SCENARIOS, ids=lambda scenario: scenario.name)
def test_every_sensor_in_every_scenario_gives_finite_readings_in_order(scenario: RealScenario) -> None:
    for seed in (1, 2):
        truth = scenario.truth(seed, 30.0)
        for sensor in (COMPASS, IMU, GYRO):
            rows = list(scenario.readings(truth, sensor, Draws(seed)))
            assert [timed.t_s for timed in rows] == sorted({timed.t_s for timed in rows})
            names = type(rows[0].reading).__slots__
            values = [getattr(row.reading, name) for row in rows for name in names]
            assert np.isfinite([float(value) for value in values]).all()
            again = list(scenario.readings(truth, sensor, Draws(seed)))
            assert again == rows
            half = list(scenario.readings(truth.until(15.0), sensor, Draws(seed)))
            assert half == rows[: len(half)]
            assert len(half) > 0.45 * len(rows)
