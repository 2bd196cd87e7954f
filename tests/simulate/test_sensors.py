"""Error models: the noise is as large as the scenario says, repeatable, and each sensor's own."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from common.errors import WayfixError
from common.simulation import sensor_models as sensors
from common.simulation.motion import Truth
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.simulation.scenario import SOLENT
from common.simulation.scenarios import scenario_voyage
from common.simulation.sensor_models import Draws, Phase, generators, gps_position, imu_samples
from common.simulation.thesis_tables import POOR, TABLE_5_4, TABLE_5_4_BIAS
from common.simulation.voyage import Voyage


@pytest.fixture(scope="module")
def voyage() -> Voyage:
    return scenario_voyage("5.3", seed=7)


def at_rest(count: int, rate_hz: float) -> Truth:
    zero = np.zeros(count)
    return Truth(np.arange(count) / rate_hz, zero, zero, zero, zero, zero)


def within_3_sigma(errors: np.ndarray, std: float) -> bool:
    """A sample standard deviation of n normal draws has a relative 1-sigma of 1 / sqrt(2 n)."""
    return abs(float(errors.std()) / std - 1.0) < 3.0 / math.sqrt(2 * len(errors))


def gps_errors(voyage: Voyage) -> tuple[np.ndarray, np.ndarray]:
    """(times, east and north errors in metres) of all fixes."""
    fixes = [(timed.t_s, timed.reading) for timed in voyage.readings if isinstance(timed.reading, FixReading)]
    t_s = np.array([t for t, _ in fixes])
    truth = voyage.truth.at(t_s)
    places = np.array([SOLENT.to_east_north_m(fix.lat_deg, fix.lon_deg) for _, fix in fixes])
    return t_s, places - np.stack((truth.east_m, truth.north_m), axis=1)


def test_readings_are_in_time_order_at_their_rates(voyage: Voyage) -> None:
    times = [timed.t_s for timed in voyage.readings]
    assert times == sorted(times)
    seconds = round(voyage.seconds)
    assert Counter(timed.sensor for timed in voyage.readings) == {
        "gps1": seconds + 1,
        "compass1": 10 * seconds + 1,
        "imu1": 20 * seconds,
    }


def test_raw_position_errors_of_5_3_are_those_of_the_thesis() -> None:
    errors = [gps_errors(scenario_voyage("5.3", seed)) for seed in range(5)]
    early = np.concatenate([error[t_s <= 300] for t_s, error in errors])
    late = np.concatenate([error[t_s > 300] for t_s, error in errors])
    assert len(early) == 5 * 301
    for axis, std in ((0, 8.0), (1, 7.0)):
        assert within_3_sigma(early[:, axis], std)
        assert within_3_sigma(late[:, axis], 20.0)
    assert np.mean(early[:, 0] ** 2) == pytest.approx(64.0, rel=0.12)
    assert np.mean(early[:, 1] ** 2) == pytest.approx(49.0, rel=0.12)


def test_compass_errors_of_5_3(voyage: Voyage) -> None:
    headings = [(timed.t_s, timed.reading) for timed in voyage.readings if isinstance(timed.reading, HeadingReading)]
    t_s = np.array([t for t, _ in headings])
    truth = np.degrees(voyage.truth.at(t_s).heading_rad)
    errors = (np.array([reading.heading_true_deg for _, reading in headings]) - truth + 180.0) % 360.0 - 180.0
    assert within_3_sigma(errors[t_s <= 300], 0.8)
    assert within_3_sigma(errors[t_s > 300], 5.0)


@pytest.mark.parametrize("rate_hz", [1.0, 20.0])
def test_imu_noise_is_a_density(rate_hz: float) -> None:
    samples = imu_samples(at_rest(20_001, rate_hz), (Phase(0.0, TABLE_5_4),), Draws(3)).values[0]
    assert within_3_sigma(samples[:, 0], 0.004 * math.sqrt(rate_hz))
    assert within_3_sigma(samples[:, 1], 0.004 * math.sqrt(rate_hz))
    assert within_3_sigma(samples[:, 2], 0.036 * math.sqrt(rate_hz))


def test_noise_changes_after_its_time_and_not_at_it() -> None:
    phases = (Phase(0.0, TABLE_5_4), Phase(300.0, POOR))
    times = np.array([0.0, 299.0, 300.0, 300.05, 700.0])
    assert sensors.by_phase(phases, times, lambda errors: errors.gps_east_m).tolist() == [8, 8, 8, 20, 20]


def test_bias_of_table_5_4_is_added_when_asked_for() -> None:
    biased = replace(TABLE_5_4, accel_density=1e-9, gyro_density_deg=1e-9, **TABLE_5_4_BIAS)
    samples = imu_samples(at_rest(50, 20.0), (Phase(0.0, biased),), Draws(3))
    assert samples.values[0].mean(axis=0) == pytest.approx([0.03, 0.02, 0.28], abs=1e-6)


def test_equal_seeds_give_equal_readings_and_others_do_not() -> None:
    one, again, other = (scenario_voyage("5.3", seed, seconds=20.0).readings for seed in (4, 4, 5))
    assert one == again
    assert all(a.reading != b.reading for a, b in zip(one, other, strict=True))


def test_a_shorter_run_is_the_beginning_of_a_longer_one(voyage: Voyage) -> None:
    short = scenario_voyage("5.3", seed=7, seconds=50.0)
    assert short.readings == voyage.readings[: len(short.readings)]
    assert short.seconds == 50.0
    assert short.truth.t_s[-1] == 50.0


def test_another_sensor_leaves_the_noise_of_the_others_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    before = {name: draw.standard_normal(5).tolist() for name, draw in generators(9).items()}
    monkeypatch.setattr(sensors, "STREAMS", (*sensors.STREAMS, "compass2"))
    after = {name: draw.standard_normal(5).tolist() for name, draw in generators(9).items()}
    assert {name: after[name] for name in before} == before
    assert len({tuple(draws) for draws in after.values()}) == len(after)


def test_streams_are_not_correlated(voyage: Voyage) -> None:
    _, errors = gps_errors(voyage)
    rest = at_rest(len(errors) + 1, 1.0)
    draws = Draws(7)
    fixes = gps_position(rest.until(float(len(errors) - 1)), (Phase(0.0, TABLE_5_4),), draws)[0]
    imu = imu_samples(rest, (Phase(0.0, TABLE_5_4),), draws).values[0]
    table = np.corrcoef(np.concatenate((fixes, imu), axis=1).T)
    assert np.abs(table - np.eye(5)).max() < 4.0 / math.sqrt(len(errors))


def test_imu_readings_cover_intervals_that_end_at_their_time(voyage: Voyage) -> None:
    first = next(timed for timed in voyage.readings if isinstance(timed.reading, ImuReading))
    assert first.t_s == pytest.approx(0.05)


def test_unknown_scenario_is_told_with_the_names_there_are() -> None:
    with pytest.raises(WayfixError, match=r"no scenario '9.9'.*5\.3"):
        scenario_voyage("9.9")


def test_seed_7_of_5_3_still_gives_the_readings_it_always_gave() -> None:
    # A new stream or error model must not move the numbers of a seed: the demo's figures hang on them.
    readings = [timed for timed in scenario_voyage("5.3", seed=7).readings if timed.t_s <= 600.0]
    fix, heading, imu = (
        next(timed.reading for timed in reversed(readings) if timed.sensor == sensor)
        for sensor in ("gps1", "compass1", "imu1")
    )
    assert isinstance(fix, FixReading)
    assert isinstance(heading, HeadingReading)
    assert isinstance(imu, ImuReading)
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx((50.76199746257153, -1.2869923686468723), abs=1e-10)
    assert (fix.v_east_m_s, fix.v_north_m_s) == pytest.approx((-1.386692456519469, 0.33721182879262607), abs=1e-9)
    assert heading.heading_true_deg == pytest.approx(295.01519694970597, abs=1e-9)
    assert imu.accel_fwd_m_s2 == pytest.approx(-0.004615717990617345, abs=1e-9)
    assert imu.accel_stb_m_s2 == pytest.approx(0.005272733433308318, abs=1e-9)
    assert imu.yaw_rate_deg_s == pytest.approx(0.0350010230447443, abs=1e-9)
