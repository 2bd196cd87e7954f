"""The simulated boat: its track, and that its inertial samples are the derivative of it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.angles import difference_rad
from common.simulation.fields import STILL
from common.simulation.motion import Mission, Truth, cleared, grid, sail, turn_direction
from common.simulation.scenarios_thesis import SOLENT_TIDE, TRACK_1
from common.simulation.sensor_models import body_motion


@pytest.fixture(scope="module")
def track() -> Truth:
    return sail(TRACK_1, SOLENT_TIDE)


def test_mission_of_scenario_5_3_ends_within_the_clearance_of_the_end_point(track: Truth) -> None:
    assert 690 <= track.t_s[-1] <= 730
    assert math.dist((track.east_m[-1], track.north_m[-1]), (30.0, 250.0)) < 20.0
    for waypoint in TRACK_1.waypoints:
        assert np.hypot(track.east_m - waypoint[0], track.north_m - waypoint[1]).min() < 20.0


def test_first_velocity_has_the_current_in_it(track: Truth) -> None:
    east, north = SOLENT_TIDE(765.0, 728.0, 0.0)
    assert track.v_east_m_s[0] == pytest.approx(east - 0.5, abs=1e-4)
    assert track.v_north_m_s[0] == pytest.approx(north - 0.866, abs=1e-4)
    assert math.hypot(east, north) == pytest.approx(0.5)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 20.0, 50.0])
def test_integrated_imu_gives_back_the_truth_through_the_turns(track: Truth, rate_hz: float) -> None:
    truth = track.at(grid(float(track.t_s[-1]), rate_hz))
    fwd, stb, yaw_rate = body_motion(truth)
    step = 1.0 / rate_hz
    east, north = truth.east_m[0], truth.north_m[0]
    v_east, v_north, heading = truth.v_east_m_s[0], truth.v_north_m_s[0], truth.heading_rad[0]
    position, velocity = [], []
    for k in range(len(fwd)):
        # resolved at the heading in the middle of the interval
        middle = heading + 0.5 * step * yaw_rate[k]
        a_east = math.sin(middle) * fwd[k] + math.cos(middle) * stb[k]
        a_north = math.cos(middle) * fwd[k] - math.sin(middle) * stb[k]
        east += step * v_east + 0.5 * step**2 * a_east
        north += step * v_north + 0.5 * step**2 * a_north
        v_east += step * a_east
        v_north += step * a_north
        heading += step * yaw_rate[k]
        position.append((east - truth.east_m[k + 1], north - truth.north_m[k + 1]))
        velocity.append((v_east - truth.v_east_m_s[k + 1], v_north - truth.v_north_m_s[k + 1]))
    assert np.abs(velocity).max() < 1e-9
    # At the truth's own 20 Hz nothing is lost; a slower step bends more than a constant acceleration does.
    assert np.abs(position).max() < {1.0: 0.02, 20.0: 1e-9}.get(rate_hz, 1e-4)
    assert heading == pytest.approx(truth.heading_rad[-1], abs=1e-9)


def test_a_turn_to_starboard_accelerates_to_starboard() -> None:
    # From north to east in still water: the yaw rate is +3 deg/s, the acceleration v w to starboard, none forward.
    mission = Mission(start=(0.0, 0.0), waypoints=((500.0, 0.0),), heading_deg=0.0)
    fwd, stb, yaw_rate = body_motion(sail(mission, STILL).until(20.0))
    assert np.degrees(yaw_rate) == pytest.approx(3.0)
    assert stb == pytest.approx(math.radians(3.0), rel=1e-5)
    assert fwd == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-20.0, 20.0), st.floats(-3.1, 3.1))
def test_turn_rule_goes_the_short_way_and_never_chatters(heading: float, bearing: float) -> None:
    band = math.radians(3.0)
    turn = turn_direction(heading, bearing, band)
    before, after = difference_rad(heading, bearing), difference_rad(heading + turn * band, bearing)
    if abs(before) <= band:
        assert turn == 0
    else:
        assert abs(after) < abs(before)
        assert after * before >= -1e-12


def test_a_boat_that_cannot_reach_its_waypoint_is_stopped() -> None:
    # A waypoint abeam, nearer than the turn radius of 57 m.
    wide = Mission(
        start=(0.0, 0.0),
        waypoints=((15.0, 0.0),),
        heading_deg=0.0,
        clearance_m=1.0,
        turn_rate_deg_s=1.0,
        longest_s=300.0,
    )
    assert sail(wide, STILL).t_s[-1] == pytest.approx(300.0)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0.0, math.tau), st.floats(0.1, 100.0))
def test_a_waypoint_is_cleared_within_its_circle_only(east: float, north: float, bearing: float, d: float) -> None:
    # Eq. 4.54: nearer than d, whatever the direction.
    for share, expected in ((0.999, True), (1.001, False)):
        place = (east + share * d * math.sin(bearing), north + share * d * math.cos(bearing))
        assert cleared(place, (east, north), d) is expected


def test_the_helm_goes_for_the_next_waypoint_where_the_first_is_cleared() -> None:
    mission = Mission(start=(0.0, 0.0), waypoints=((0.0, 100.0), (100.0, 100.0)), heading_deg=0.0)
    track = sail(mission, STILL)
    turning = np.flatnonzero(track.heading_rad > 0.0)[0]
    # The helm decides once a second, so up to 1 m late.
    assert 80.0 < track.north_m[turning] < 81.2


def test_a_field_that_changes_in_time_pushes_with_its_value_of_the_time() -> None:
    mission = Mission(start=(0.0, 0.0), waypoints=((0.0, 1e4),), heading_deg=0.0, longest_s=100.0)
    track = sail(mission, lambda east, north, t_s: (0.0 * east, 0.01 * t_s + 0.0 * north))
    assert track.v_north_m_s == pytest.approx(1.0 + 0.01 * track.t_s)
    assert track.north_m[-1] == pytest.approx(100.0 + 0.005 * 100.0**2)
