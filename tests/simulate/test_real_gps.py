"""A real receiver: size and duration of its errors, what it claims, quality, velocity, latency, lever arm."""

from dataclasses import replace

import numpy as np
import pytest

from common.boat_config import SensorTable
from common.simulation.motion import Truth, grid
from common.simulation.readings import FixReading
from common.simulation.real_gps import (
    OPEN_SKY,
    RTK,
    UERE_M,
    Loss,
    Receiver,
    drawn_receiver,
    frozen,
    position_error_m,
    position_sigma_m,
    qualities,
)
from common.simulation.scenarios_real import REAL_SCENARIOS, RealScenario
from common.simulation.sensor_models import Draws
from tests.simulate.hulls import circling, still

LAKE, FAST, SURVEY = REAL_SCENARIOS[0], REAL_SCENARIOS[5], REAL_SCENARIOS[6]


def table(rate_hz: float = 1.0, number: int = 1, **fields: float) -> SensorTable:
    return SensorTable(id=f"gps{number}", port="gps", role="gps", rate_hz=rate_hz, **fields)  # type: ignore[arg-type]


def fixes(scenario: RealScenario, truth: Truth, seed: int, sensor: SensorTable) -> tuple[np.ndarray, list[FixReading]]:
    """Times and fixes; quality 0 included."""
    rows = list(scenario.readings(truth, sensor, Draws(seed)))
    assert all(timed.sensor == sensor.id for timed in rows)
    return np.array([timed.t_s for timed in rows]), [row.reading for row in rows if isinstance(row.reading, FixReading)]


def errors_m(scenario: RealScenario, truth: Truth, seed: int, sensor: SensorTable) -> np.ndarray:
    t_s, found = fixes(scenario, truth, seed, sensor)
    seen = truth.at(t_s)
    places = np.array([scenario.plane.to_east_north_m(fix.lat_deg, fix.lon_deg) for fix in found])
    return places - np.stack((seen.east_m, seen.north_m), axis=1)


def receiver(**changes: float) -> Receiver:
    steady = replace(drawn_receiver(np.random.default_rng(1), OPEN_SKY), late_s=0.0, velocity_lag_s=0.0)
    return replace(steady, **changes)  # type: ignore[arg-type]


def test_white_part_and_duration_are_those_of_the_receiver() -> None:
    made = receiver(lasts_s=40.0, white_share=0.3, sky_share=0.0)
    t_s = grid(600.0, 1.0)
    unit = np.stack([position_error_m(Draws(seed), "gps1", t_s, np.ones_like(t_s), made) for seed in range(200)])
    # 200 boats, two axes: a sigma to 3.5 %, at 2 sigma, of samples that last.
    assert unit.std() == pytest.approx(1.0, rel=0.035)
    # Third differences leave the white part, weights 1, 3, 3, 1, and a little of what lasts 40 s.
    third = np.diff(unit, n=3, axis=1).var() / 20.0
    assert third == pytest.approx(0.3**2, rel=0.15)
    for lag in (10, 40, 80):
        seen = (unit[:, :-lag] * unit[:, lag:]).mean()
        assert seen == pytest.approx(0.91 * np.exp(-lag / 40.0), abs=0.05)


def test_receivers_of_one_boat_share_the_sky() -> None:
    made, t_s = receiver(sky_share=0.6, white_share=0.1), grid(60.0, 1.0)
    pairs = []
    for seed in range(300):
        draws = Draws(seed)
        pairs.append([position_error_m(draws, name, t_s, np.ones_like(t_s), made)[30] for name in ("gps1", "gps2")])
    first, second = np.array(pairs).transpose(1, 0, 2).reshape(2, -1)
    assert np.corrcoef(first, second)[0, 1] == pytest.approx(0.6, abs=0.08)


def test_receivers_are_drawn_within_what_the_docstring_says() -> None:
    made = [drawn_receiver(np.random.default_rng(seed), OPEN_SKY) for seed in range(400)]
    for name, low, high in (
        ("lasts_s", 20.0, 600.0),
        ("white_share", 0.05, 0.4),
        ("truth_over_hdop", 0.77, 1.3),
        ("gst_over_truth", 0.77, 1.3),
        ("velocity_m_s", 0.02, 0.06),
    ):
        values = [getattr(one, name) for one in made]
        assert low <= min(values) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(values) <= high
    assert np.mean([one.late_s > 0.0 for one in made]) == pytest.approx(0.3, abs=0.07)
    assert max(one.late_s for one in made) <= 0.5
    assert np.mean([one.course_held_m_s > 0.0 for one in made]) == pytest.approx(0.5, abs=0.08)
    assert {one.quality for one in made} == {1, 2}
    assert all(drawn_receiver(np.random.default_rng(seed), RTK).sends_gst for seed in range(5))


def test_what_a_receiver_claims_tells_its_error_within_30_per_cent() -> None:
    truth, hdop_ratio, gst_ratio, size_m = still(200.0), [], [], []
    for seed in range(150):
        _, found = fixes(LAKE, truth, seed, table(0.05))
        error = np.array([LAKE.plane.to_east_north_m(fix.lat_deg, fix.lon_deg) for fix in found])
        by_hdop = np.array([UERE_M[fix.quality] * (fix.hdop or np.nan) for fix in found])
        hdop_ratio.append((error / by_hdop[:, np.newaxis]) ** 2)
        gst = np.array([np.nan if fix.sigma_east_m is None else fix.sigma_east_m for fix in found])
        gst_ratio.append((error / gst[:, np.newaxis]) ** 2)
        size_m.append((error**2).mean())
    # The studies' 1.5 to 1.7 m on an axis, drawn from 0.7 to 3.4 m.
    assert 1.2 < np.sqrt(np.mean(size_m)) < 2.2
    # Over 150 boats, two axes, two or three independent errors each: 1-sigma 0.03, of 60 with GST 0.05.
    assert np.sqrt(np.mean(hdop_ratio)) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.nanmean(gst_ratio)) == pytest.approx(1.0, abs=0.2)
    assert 0.2 < np.mean(np.isfinite(gst_ratio)) < 0.6


def test_hdop_wanders_slowly() -> None:
    _, found = fixes(LAKE, still(600.0), 1, table(1.0))
    hdop = np.array([fix.hdop for fix in found])
    assert 0.04 < np.log(hdop).std() < 0.25
    assert np.abs(np.diff(hdop)).max() < 0.15
    assert {fix.satellites for fix in found} <= set(range(4, 15))


def test_rtk_falls_to_float_single_and_none_and_its_error_with_it() -> None:
    seen: dict[int, list[np.ndarray]] = {}
    for seed in range(1, 7):
        truth = SURVEY.truth(seed)
        _, found = fixes(SURVEY, truth, seed, table(1.0))
        for fix, error in zip(found, errors_m(SURVEY, truth, seed, table(1.0)), strict=True):
            seen.setdefault(fix.quality, []).append(error)
            assert (fix.v_east_m_s is None) == (fix.quality == 0)
    share = {quality: len(rows) for quality, rows in seen.items()}
    assert share[4] > 0.5 * sum(share.values())
    assert all(share[quality] > 20 for quality in (0, 1, 5))
    spread = {quality: float(np.median(np.abs(rows))) for quality, rows in seen.items()}
    # At fixed it is the mast that swings with the hull, beside the centimetre of the receiver.
    assert spread[4] < 0.05 < spread[5] < spread[1] < 3.0


def test_losses_are_the_same_at_any_rate_and_worsening_takes_seconds() -> None:
    losses = (Loss(1, 60.0, 20.0),)
    slow, fast = (qualities(np.random.default_rng(3), grid(600.0, rate), 4, losses) for rate in (1.0, 10.0))
    np.testing.assert_array_equal(slow, fast[::10])
    assert {1, 4} == set(slow.tolist())
    t_s, quality = grid(20.0, 1.0), np.array([4] * 5 + [1] * 10 + [4] * 6)
    sigma = position_sigma_m(t_s, quality, np.ones(21), receiver(truth_over_hdop=1.0))
    assert sigma[4] == pytest.approx(UERE_M[4])
    assert sigma[5] < 0.4 * UERE_M[1] < 0.9 * UERE_M[1] < sigma[14]
    assert sigma[15] == pytest.approx(UERE_M[4])


def test_velocity_is_smoothed_held_or_still() -> None:
    walk = np.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.2], [-0.05, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(frozen(walk, receiver(course_held_m_s=0.0, still_m_s=0.0)), walk, atol=1e-12)
    held = frozen(walk, receiver(course_held_m_s=0.4, still_m_s=0.0))
    np.testing.assert_allclose(held[2:4], [[0.2, 0.0], [0.05, 0.0]], atol=1e-12)
    still_m_s = frozen(walk, receiver(course_held_m_s=0.0, still_m_s=0.1))
    np.testing.assert_allclose(still_m_s[2:4], [[0.0, 0.2], [0.0, 0.0]], atol=1e-12)


def test_an_untold_latency_leaves_the_fix_behind_the_boat() -> None:
    rtk = replace(FAST, reception=RTK)
    lags = []
    for seed in range(1, 13):
        truth = rtk.truth(seed, 120.0)
        t_s, found = fixes(rtk, truth, seed, table(2.0))
        seen, error = truth.at(t_s), errors_m(rtk, truth, seed, table(2.0))
        speed = np.hypot(seen.v_east_m_s, seen.v_north_m_s)
        along = (error[:, 0] * seen.v_east_m_s + error[:, 1] * seen.v_north_m_s) / speed
        fixed = np.array([fix.quality == 4 for fix in found])
        lags.append((found[0].late_s, -float(np.median((along / speed)[fixed]))))
    told, measured = np.array(lags).T
    assert (told > 0.0).any()
    np.testing.assert_allclose(measured, told, atol=0.02)


def test_lever_arm_and_mast_move_the_antenna() -> None:
    rtk, truth = replace(SURVEY, reception=replace(RTK, losses=())), circling(120.0, 2.0, 6.0)
    sensor = table(1.0, lever_fwd_m=3.0, lever_stb_m=-1.0)
    seed = next(s for s in range(20) if drawn_receiver(Draws(s).of("gps1 made")[0], RTK).late_s == 0.0)
    error, t_s = errors_m(rtk, truth, seed, sensor), grid(120.0, 1.0)
    sin, cos = np.sin(truth.at(t_s).heading_rad), np.cos(truth.at(t_s).heading_rad)
    body = np.stack((sin * error[:, 0] + cos * error[:, 1], cos * error[:, 0] - sin * error[:, 1]), axis=1)
    np.testing.assert_allclose(body.mean(axis=0), [3.0, -1.0], atol=0.02)
    _, found = fixes(rtk, truth, seed, sensor)
    sideways = np.array([(fix.v_east_m_s, fix.v_north_m_s) for fix in found], dtype=np.float64)
    to_starboard = cos * sideways[:, 0] - sin * sideways[:, 1]
    # The antenna is 3 m ahead of the point it turns about: 0.31 m/s to starboard.
    assert to_starboard[1:].mean() == pytest.approx(3.0 * np.radians(6.0), abs=0.02)


def test_readings_depend_on_seed_and_sensor_alone() -> None:
    truth = LAKE.truth(4, 120.0)
    alone = list(LAKE.readings(truth, table(5.0), Draws(4)))
    shared = Draws(4)
    for other in ("compass", "imu", "gyro"):
        list(LAKE.readings(truth, SensorTable(id=f"{other}1", port="p", role=other), shared))
    list(LAKE.readings(truth, table(5.0, number=2), shared))
    assert list(LAKE.readings(truth, table(5.0), shared)) == alone
    assert list(LAKE.readings(truth.until(60.0), table(5.0), Draws(4))) == alone[:301]
    assert list(LAKE.readings(truth, table(5.0), Draws(5))) != alone
