"""Specific force and angular rates of a hull that rolls and pitches: signs, size, means over an interval."""

import numpy as np
import pytest

from common.simulation.motion import Truth, grid
from common.simulation.scenarios_real import REAL_SCENARIOS
from common.simulation.sensor_models import body_motion
from common.simulation.specific_force import body_motion_3d
from common.units import STANDARD_GRAVITY_M_S2 as G
from tests.simulate.hulls import circling, rolling, still


def test_a_level_boat_at_rest_feels_only_what_holds_it_up() -> None:
    np.testing.assert_allclose(body_motion_3d(still(1.0)).force_m_s2, [[0.0, 0.0, -G]] * 20, atol=1e-12)


def test_tilt_shows_gravity_with_the_signs_of_the_interface() -> None:
    bow_up, starboard_down = body_motion_3d(still(1.0, pitch_deg=10.0)), body_motion_3d(still(1.0, roll_deg=10.0))
    sin, cos = np.sin(np.radians(10.0)), np.cos(np.radians(10.0))
    np.testing.assert_allclose(bow_up.force_m_s2[3], [G * sin, 0.0, -G * cos], atol=1e-12)
    np.testing.assert_allclose(starboard_down.force_m_s2[3], [0.0, -G * sin, -G * cos], atol=1e-12)


def test_in_a_turn_to_starboard_outward_heel_adds_to_the_force() -> None:
    level, heeled = circling(10.0, 5.0, 10.0), circling(10.0, 5.0, 10.0, roll_deg=-7.0)
    push = 5.0 * np.radians(10.0)
    np.testing.assert_allclose(body_motion_3d(level).force_m_s2[:, 1], push, rtol=1e-4)
    expected = push * np.cos(np.radians(7.0)) + G * np.sin(np.radians(7.0))
    np.testing.assert_allclose(body_motion_3d(heeled).force_m_s2[:, 1], expected, rtol=1e-4)
    rates = np.degrees(body_motion_3d(heeled).rate_rad_s[0])
    np.testing.assert_allclose(rates, [0.0, 10.0 * np.sin(np.radians(-7.0)), 10.0 * np.cos(np.radians(7.0))], atol=1e-9)


def test_rolling_on_the_spot_is_a_roll_rate_and_nothing_else() -> None:
    truth = rolling(10.0, 30.0, 5.0, 0.3)
    rates = body_motion_3d(truth).rate_rad_s
    assert truth.roll_rad is not None
    np.testing.assert_allclose(rates[:, 0], np.diff(truth.roll_rad) / 0.05, atol=1e-12)
    assert np.abs(rates[:, 1:]).max() < 1e-12


@pytest.mark.parametrize("name", ["real-coast", "real-10ms"])
def test_the_force_is_as_large_as_acceleration_less_gravity(name: str) -> None:
    truth = next(scenario for scenario in REAL_SCENARIOS if scenario.name == name).truth(1, 60.0)
    a_east, a_north = np.diff(truth.v_east_m_s) / 0.05, np.diff(truth.v_north_m_s) / 0.05
    size = np.linalg.norm(body_motion_3d(truth).force_m_s2, axis=1)
    np.testing.assert_allclose(size, np.sqrt(a_east**2 + a_north**2 + G**2), rtol=1e-12)


def test_a_level_hull_feels_what_the_thesis_models_feel() -> None:
    truth = REAL_SCENARIOS[0].truth(1, 60.0)
    flat = Truth(truth.t_s, truth.east_m, truth.north_m, truth.v_east_m_s, truth.v_north_m_s, truth.heading_rad)
    motion = body_motion_3d(flat)
    accel_fwd, accel_stb, yaw_rate = body_motion(flat)
    np.testing.assert_allclose(motion.force_m_s2[:, :2], np.stack((accel_fwd, accel_stb), axis=1), atol=1e-12)
    np.testing.assert_allclose(motion.rate_rad_s[:, 2], yaw_rate, atol=1e-12)


def test_means_over_longer_intervals_are_means_of_the_shorter() -> None:
    motion = body_motion_3d(REAL_SCENARIOS[1].truth(1, 60.0))
    by_step = motion.mean(motion.force_m_s2, motion.t_s)
    np.testing.assert_allclose(by_step, motion.force_m_s2, atol=1e-9)
    slow = motion.mean(motion.force_m_s2, grid(60.0, 1.0))
    np.testing.assert_allclose(slow, motion.force_m_s2.reshape(60, 20, 3).mean(axis=1), atol=1e-9)
