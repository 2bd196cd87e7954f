"""CVM and CTM of the thesis against the closed form of a line and a circle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.angles import difference_rad
from common.simulation.manoeuvres import Manoeuvres, Turn, constant_velocity, coordinated_turn, follow
from common.simulation.motion import grid
from common.simulation.scenarios import find_scenario
from common.simulation.sensor_models import body_motion

rates = st.floats(0.001, 1.0).flatmap(lambda rate: st.sampled_from((rate, -rate)))


def test_scenario_4_1_is_the_line_of_its_start() -> None:
    track = find_scenario("4.1").truth()
    root = math.sqrt(0.5)
    assert track.t_s[-1] == pytest.approx(699.0)  # 700 time steps, the first one at t = 0
    assert track.east_m == pytest.approx(125.0 + root * track.t_s)
    assert track.north_m == pytest.approx(628.0 - root * track.t_s)
    assert np.degrees(track.heading_rad) == pytest.approx(135.0)


@given(rates, st.floats(0.01, 20.0), st.floats(-7.0, 7.0), st.floats(0.1, 10.0))
def test_a_turn_is_an_arc_of_radius_v_over_w(rate: float, step_s: float, heading: float, speed: float) -> None:
    before = np.array([3.0, -4.0, speed * math.sin(heading), speed * math.cos(heading)])
    after = coordinated_turn(rate, step_s) @ before
    # The centre lies v / w to starboard of the bow (to port for w < 0).
    radius = speed / rate
    centre = np.array([3.0 + radius * math.cos(heading), -4.0 - radius * math.sin(heading)])
    turned = heading + rate * step_s
    place = centre - radius * np.array([math.cos(turned), -math.sin(turned)])
    assert after[:2] == pytest.approx(place, abs=1e-9 * max(1.0, abs(radius)))
    assert after[2:] == pytest.approx([speed * math.sin(turned), speed * math.cos(turned)], abs=1e-9 * speed)


@given(rates, st.floats(0.01, 5.0))
def test_two_half_steps_are_one_step(rate: float, step_s: float) -> None:
    half = coordinated_turn(rate, step_s / 2)
    assert half @ half == pytest.approx(coordinated_turn(rate, step_s), abs=1e-9)


def test_a_turn_of_no_rate_is_the_constant_velocity_model() -> None:
    assert np.array_equal(coordinated_turn(0.0, 2.0), constant_velocity(2.0))
    assert coordinated_turn(1e-7, 2.0) == pytest.approx(constant_velocity(2.0), abs=1e-6)


def test_scenario_4_2_turns_to_port_by_105_and_90_degrees() -> None:
    track = find_scenario("4.2").truth()
    seconds = track.at(grid(299.0, 1.0))
    turned = np.degrees(np.diff(seconds.heading_rad))
    assert len(seconds.t_s) == 300
    # Time step k of the thesis is t = k - 1: anticlockwise from k = 115 to 150 and from 225 to 255.
    assert np.flatnonzero(np.abs(turned) > 1e-9).tolist() == [*range(114, 149), *range(224, 254)]
    assert turned[turned < -1e-9] == pytest.approx(-3.0)
    assert np.degrees(track.heading_rad[-1]) == pytest.approx(70.0 - 105.0 - 90.0)


def test_in_the_turns_the_bow_stays_on_the_course_and_the_push_comes_from_port() -> None:
    # A heading that turned against its velocity (Eq. 4.40 with 4.41 as printed) would fail here, on no straight leg.
    track = find_scenario("4.2").truth()
    course = np.arctan2(track.v_east_m_s, track.v_north_m_s)
    off = [difference_rad(a, b) for a, b in zip(course, track.heading_rad, strict=True)]
    assert np.abs(off).max() < 1e-9
    fwd, stb, yaw_rate = body_motion(track)
    turning = np.abs(yaw_rate) > 1e-6
    assert stb[turning] == pytest.approx(-math.radians(3.0), rel=1e-4)
    assert np.abs(stb[~turning]).max() < 1e-9
    assert np.abs(fwd).max() < 1e-9


def test_a_moored_boat_stays() -> None:
    track = follow(Manoeuvres(start=(1.0, 2.0), heading_deg=30.0, duration_s=5.0, speed_m_s=0.0))
    assert set(track.east_m) == {1.0}
    assert set(track.v_north_m_s) == {0.0}


def test_turns_to_both_sides_cancel() -> None:
    turns = (Turn(1.0, 4.0, 10.0), Turn(5.0, 8.0, -10.0))
    track = follow(Manoeuvres(start=(0.0, 0.0), heading_deg=350.0, duration_s=10.0, turns=turns))
    assert np.degrees(track.heading_rad.max()) == pytest.approx(380.0)
    assert np.degrees(track.heading_rad[-1]) == pytest.approx(350.0)
