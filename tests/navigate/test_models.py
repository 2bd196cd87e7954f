"""Motion model: rotation, mid heading, process noise."""

import math

import numpy as np
import pytest

from shore.navigation.filters import Predict
from shore.navigation.kalman import predict_extended, predict_linear
from shore.navigation.motion_model import FREE_NOISE, ImuInput, ProcessNoise, body_to_plane, move, process_noise
from shore.navigation.numbers import wrapped
from shore.navigation.state_space import FIVE, Extra, Gaussian, StateSpace
from shore.navigation.ukf import predict_unscented


@pytest.mark.parametrize(
    ("heading_deg", "forward", "starboard"),
    [(0, (0, 1), (1, 0)), (90, (1, 0), (0, -1)), (180, (0, -1), (-1, 0)), (270, (-1, 0), (0, 1))],
)
def test_forward_and_starboard_on_the_four_courses(
    heading_deg: float, forward: tuple[int, int], starboard: tuple[int, int]
) -> None:
    heading = math.radians(heading_deg)
    assert body_to_plane(1.0, 0.0, heading) == pytest.approx(forward, abs=1e-12)
    assert body_to_plane(0.0, 1.0, heading) == pytest.approx(starboard, abs=1e-12)
    # It is its own inverse: a reflection, since east-north and forward-starboard are of opposite hand.
    assert body_to_plane(*body_to_plane(0.3, -0.7, heading), heading) == pytest.approx((0.3, -0.7))


def test_steady_turn_to_starboard_is_a_circle() -> None:
    """A constant starboard (centripetal) acceleration and yaw rate: one full turn leads back to the start."""
    speed, rate, dt = 2.0, math.radians(6.0), 0.05
    x = np.array([10.0, 20.0, 0.0, speed, 0.0])
    for _ in range(round(15.0 / dt)):
        x = move(FIVE, x, dt, ImuInput(0.0, speed * rate, rate))
    assert x[4] == pytest.approx(math.pi / 2)
    assert x[2:4] == pytest.approx([speed, 0.0], abs=1e-3)
    radius = speed / rate
    assert x[:2] == pytest.approx([10.0 + radius, 20.0 + radius], abs=1e-2)
    for _ in range(round(45.0 / dt)):
        x = move(FIVE, x, dt, ImuInput(0.0, speed * rate, rate))
    assert x[:2] == pytest.approx([10.0, 20.0], abs=1e-2)


@pytest.mark.parametrize("dt", [0.2, 1.0])
def test_mid_heading_follows_a_turn_that_the_first_heading_does_not(dt: float) -> None:
    """4 m/s and 15 deg/s: with the mid heading the speed stays, with the heading of the start it grows outwards."""
    speed, rate = 4.0, math.radians(15.0)
    chord = 2.0 * speed * math.sin(0.5 * rate * dt) / dt  # mean acceleration of the step, square to the mid heading
    ours = first = np.array([0.0, 0.0, 0.0, speed, 0.0])
    for _ in range(round(12.0 / dt)):
        ours = move(FIVE, ours, dt, ImuInput(0.0, chord, rate))
        straight = move(FIVE, first, dt, ImuInput(0.0, chord, 0.0))
        straight[4] = first[4] + rate * dt
        first = straight
    assert math.hypot(*ours[2:4]) == pytest.approx(speed, abs=1e-9)
    assert ours[2:4] == pytest.approx([0.0, -speed], abs=1e-9)
    assert math.hypot(first[2], first[3] + speed) > 0.1 * dt


def test_batches_are_single_states_side_by_side() -> None:
    rng = np.random.default_rng(1)
    states = rng.normal(size=(4, 3, 5))
    imu = ImuInput(0.3, -0.2, 0.1)
    noise = ProcessNoise(0.1, 0.2, 0.3)
    moved, Q = move(FIVE, states, 0.4, imu), process_noise(FIVE, states[..., 4], 0.4, noise)
    for index in np.ndindex(4, 3):
        assert np.array_equal(moved[index], move(FIVE, states[index], 0.4, imu))
        assert np.array_equal(Q[index], process_noise(FIVE, float(states[index][4]), 0.4, noise))


def test_process_noise_at_one_second_is_eq_4_29_with_q_squared() -> None:
    q1, q2, T = 0.0039, math.radians(0.033), 1.0
    expected = np.array(
        [
            [(0.5 * T * T * q1) ** 2, 0, 0.5 * T**3 * q1**2, 0, 0],
            [0, (0.5 * T * T * q1) ** 2, 0, 0.5 * T**3 * q1**2, 0],
            [0.5 * T**3 * q1**2, 0, (T * q1) ** 2, 0, 0],
            [0, 0.5 * T**3 * q1**2, 0, (T * q1) ** 2, 0],
            [0, 0, 0, 0, q2**2],
        ]
    )
    for heading in (0.0, 0.7, 3.0):
        assert np.allclose(process_noise(FIVE, heading, T, ProcessNoise(q1, q1, q2)), expected, rtol=1e-12, atol=1e-22)


def test_unequal_axes_turn_with_the_bow() -> None:
    """Forward noise points north on course 0 and east on course 90."""
    noise = ProcessNoise(0.3, 0.1, 0.0)
    assert process_noise(FIVE, 0.0, 1.0, noise)[3, 3] == pytest.approx(0.09)
    east = process_noise(FIVE, math.pi / 2, 1.0, noise)
    assert (east[2, 2], east[3, 3]) == pytest.approx((0.09, 0.01))
    slanted = process_noise(FIVE, math.pi / 4, 1.0, noise)
    assert slanted[2, 3] == pytest.approx(0.04)
    assert np.linalg.eigvalsh(slanted).min() > -1e-15


def test_every_walk_adds_its_own_variance_and_states_without_one_none() -> None:
    walks = {"gyro_bias_rad_s": 0.2, "accel_bias_stb_m_s2": 0.0, "tilt_leak_per_m": 0.3}
    space = StateSpace(tuple(Extra(name, 1.0, walk) for name, walk in walks.items()))
    noise = ProcessNoise(0.3, 0.1, 0.5)
    Q = process_noise(space, 0.7, 2.0, noise)
    assert np.array_equal(Q[:5, :5], process_noise(FIVE, 0.7, 2.0, noise))
    assert Q[4, 4] == pytest.approx(0.5)
    assert Q.diagonal()[5:] == pytest.approx([0.08, 0.0, 0.18])
    assert np.count_nonzero(Q[5:]) == np.count_nonzero(Q[:, 5:]) == 2


@pytest.mark.parametrize("predict", [predict_linear, predict_extended, predict_unscented])
def test_spread_after_a_minute_does_not_depend_on_the_rate(predict: Predict) -> None:
    noise = ProcessNoise(0.05, 0.02, math.radians(0.1))
    after = {}
    for rate in (1, 10, 100):
        x, P = np.array([0.0, 0.0, 1.0, 1.0, 0.5]), np.diag([9.0, 9.0, 0.25, 0.25, 1e-3])
        for _ in range(60 * rate):
            x, P, _, _ = predict(Gaussian(FIVE, x, P), 1.0 / rate, ImuInput(0.02, 0.01, 0.01), noise)
        after[rate] = P.diagonal()
    assert after[1] == pytest.approx(after[100], rel=0.02)
    assert after[10] == pytest.approx(after[100], rel=0.02)


def test_wrap_of_infinity_is_reportable() -> None:
    assert math.isnan(wrapped(math.inf))
    assert wrapped(-math.pi) == math.pi


def test_free_motion_spectral_density_is_the_documented_one() -> None:
    assert FREE_NOISE.accel_fwd**2 == pytest.approx(0.2)
