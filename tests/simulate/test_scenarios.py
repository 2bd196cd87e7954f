"""The scenarios by name: what the thesis states, what ours are for, and that each plays on the virtual boat."""

import math
import string

import numpy as np
import pytest

from common.errors import WayfixError
from common.simulation.motion import Mission
from common.simulation.readings import FixReading, ImuReading
from common.simulation.scenario import realistic, with_bias, with_drift, with_noise
from common.simulation.scenarios import SCENARIOS, WORLDS, find_scenario, find_world, scenario_voyage
from common.simulation.scenarios_own import BUOYS
from common.simulation.thesis_tables import TABLE_4_1, TABLE_5_3, compat

NAMES = (
    "4.0 4.1 4.2 4.3-0.5 4.3-0.3 4.3-0.15 4.4-T1 4.4-T2 4.4-T3 5.1 5.2 5.3 "
    "roadford agile uncalibrated imu-noise imu-and-gps-noise tidal-outage"
)


def test_names_are_those_of_the_thesis_then_ours() -> None:
    assert list(SCENARIOS) == NAMES.split()
    groups = [scenario.group for scenario in SCENARIOS.values()]
    assert groups == sorted(groups, key=groups.index)
    assert all(name == scenario.name and scenario.text for name, scenario in SCENARIOS.items())


def test_real_boats_sail_on_the_virtual_boat_and_not_in_the_laboratory() -> None:
    real = [name for name in WORLDS if name not in SCENARIOS]
    assert real == [name for name in WORLDS if name.startswith("real-")]
    for name in real:
        assert find_world(name).name == name
        first, other = (scenario_voyage(name, seed, seconds=5.0) for seed in (1, 2))
        assert {timed.sensor for timed in first.readings} == {"gps1", "compass1", "imu1"}
        assert first.readings != other.readings
        assert first.truth.heading_rad[0] != other.truth.heading_rad[0]
        with pytest.raises(WayfixError, match="another track for each seed"):
            find_scenario(name, "wayfix lab run")


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_ends_and_plays_on_the_virtual_boat(name: str) -> None:
    scenario = find_scenario(name)
    truth = scenario.truth()
    assert 250.0 <= truth.t_s[-1] <= 1200.0
    voyage = scenario_voyage(name, seed=2, seconds=10.0)
    fixes = [timed.reading for timed in voyage.readings if isinstance(timed.reading, FixReading)]
    assert len(fixes) == 11
    assert sum(isinstance(timed.reading, ImuReading) for timed in voyage.readings) == 200
    east, north = voyage.plane.to_east_north_m(fixes[0].lat_deg, fixes[0].lon_deg)
    assert math.dist((east, north), (truth.east_m[0], truth.north_m[0])) < 5 * scenario.phases[0].errors.gps_east_m
    assert set(voyage.boat.id) <= set(string.ascii_letters + string.digits + "-.")


@pytest.mark.parametrize(
    ("name", "start", "drift", "set_deg"),
    [
        ("4.3-0.5", (365.0, 728.0, 150.0), 0.5, 140.0),
        ("4.3-0.15", (365.0, 728.0, 150.0), 0.15, 140.0),
        ("4.4-T1", (765.0, 728.0, 210.0), 0.5, None),
        ("4.4-T3", (765.0, 728.0, 210.0), 0.5, None),
    ],
)
def test_starts_of_eqs_4_56_and_4_57_with_the_current(
    name: str, start: tuple[float, float, float], drift: float, set_deg: float | None
) -> None:
    scenario = find_scenario(name)
    truth = scenario.truth()
    east, north = (float(speed) for speed in scenario.current(start[0], start[1], 0.0))
    assert (truth.east_m[0], truth.north_m[0]) == start[:2]
    assert np.degrees(truth.heading_rad[0]) == pytest.approx(start[2])
    assert math.hypot(east, north) == pytest.approx(drift)
    if set_deg is not None:
        assert math.degrees(math.atan2(east, north)) == pytest.approx(set_deg)
    assert truth.v_east_m_s[0] == pytest.approx(math.sin(math.radians(start[2])) + east)
    assert truth.v_north_m_s[0] == pytest.approx(math.cos(math.radians(start[2])) + north)


@pytest.mark.parametrize("name", ["4.3-0.5", "4.3-0.3", "4.3-0.15", "4.4-T1", "4.4-T2", "4.4-T3", "roadford", "agile"])
def test_every_waypoint_is_cleared_in_its_order(name: str) -> None:
    scenario = find_scenario(name)
    truth, mission = scenario.truth(), scenario.mission
    assert isinstance(mission, Mission)
    first = 0
    # Roadford is cut after 20 minutes, on its second round.
    for east, north in mission.waypoints[:6] if name == "roadford" else mission.waypoints:
        near = np.hypot(truth.east_m[first:] - east, truth.north_m[first:] - north) < mission.clearance_m
        assert near.any(), (east, north)
        first += int(np.argmax(near))


def test_what_the_filters_are_told() -> None:
    assert find_scenario("4.4-T2").assumed is TABLE_4_1
    assert find_scenario("5.2").assumed is TABLE_5_3
    assert (TABLE_5_3.gps_east_m, TABLE_5_3.gps_north_m, TABLE_5_3.compass_deg) == (6.0, 7.0, 0.5)
    # The boat's file has one number for both axes.
    facts = find_scenario("5.3").facts
    assert (facts.sigma_m, facts.sigma_deg, facts.accel_density, facts.gyro_density_deg) == (6.5, 0.5, 0.0039, 0.033)
    # P(1) of Eq. 4.39, variances in m^2, m^2/s^2 and deg^2.
    variances = np.square(TABLE_4_1.start_sigmas)
    assert [*variances[:4], math.degrees(math.sqrt(variances[4])) ** 2] == pytest.approx([1, 1, 0.01, 0.01, 0.25])


def test_the_boats_file_is_sure_of_a_calibrated_imu_only() -> None:
    scenario = find_scenario("5.3")
    for other in (with_bias(scenario), with_drift(scenario), realistic(scenario), find_scenario("uncalibrated")):
        assert (other.facts.bias_accel_sigma_m_s2, other.facts.bias_yaw_rate_sigma_deg_s) == (0.04, 0.3)
    # The mean of a minute of white noise.
    assert scenario.facts.bias_accel_sigma_m_s2 == pytest.approx(0.0039 / math.sqrt(60.0))
    assert scenario.facts.bias_yaw_rate_sigma_deg_s == pytest.approx(0.033 / math.sqrt(60.0))


def test_profile_compat_has_q_unsquared_and_in_4_3_and_4_4_the_true_r() -> None:
    told = find_scenario("4.3-0.5").compat
    assert told is not None
    assert (told.gps_east_m, told.gps_north_m, told.compass_deg) == (8.0, 7.0, 1.0)
    assert told.accel_density**2 == pytest.approx(0.0039)
    assert told.gyro_density_deg**2 == pytest.approx(0.033)
    assert told.exact_start
    assert find_scenario("5.3").compat == compat(TABLE_5_3)
    assert all(find_scenario(name).compat is None for name in ("4.0", "roadford", "agile", "tidal-outage"))


def test_roadford_lies_where_the_degrees_of_table_5_9_say() -> None:
    assert np.array(BUOYS) == pytest.approx(np.array([(184.2, 159.3), (276.6, 463.9), (24.0, 390.1)]), abs=0.06)
    scenario = find_scenario("roadford")
    assert scenario.truth().t_s[-1] == pytest.approx(1200.0)
    assert "simulation" in scenario.text
    east, north = scenario.current(0.0, 0.0, 0.0)
    assert math.degrees(math.atan2(north, -east)) == pytest.approx(45.0, abs=15.0)  # to the north-west
    assert scenario.plane.origin_lat_deg == pytest.approx(50.69538, abs=1e-5)
    assert scenario.plane.origin_lon_deg == pytest.approx(-4.23666, abs=1e-5)


def test_tidal_outage_lasts_8_minutes_in_which_the_current_changes() -> None:
    scenario = find_scenario("tidal-outage")
    voyage = scenario_voyage("tidal-outage", seed=1)
    times = [timed.t_s for timed in voyage.readings if timed.sensor == "gps1"]
    assert max(np.diff(times)) == pytest.approx(481.0)
    assert [t for t in times if 300.0 <= t < 780.0] == []
    ends = scenario.truth().at(np.array([300.0, 780.0]))
    before, after = (
        math.hypot(*map(float, scenario.current(float(ends.east_m[k]), float(ends.north_m[k]), float(ends.t_s[k]))))
        for k in (0, 1)
    )
    assert after > 2.5 * before
    here = (float(ends.east_m[1]), float(ends.north_m[1]))
    assert np.hypot(*scenario.current(*here, 780.0)) > 1.05 * np.hypot(*scenario.current(*here, 300.0))


def test_variants_change_what_they_name_only() -> None:
    scenario = find_scenario("5.3")
    loud = with_noise(scenario, compass_deg=9.0)
    assert [phase.errors.compass_deg for phase in loud.phases] == [9.0, 9.0]
    assert [phase.after_s for phase in loud.phases] == [0.0, 300.0]
    assert loud.phases[1].errors.gps_east_m == 20.0
    assert realistic(scenario).mission is scenario.mission


def test_unknown_name_is_told_where_it_was_given() -> None:
    with pytest.raises(
        WayfixError, match=r"^lab run: there is no scenario '5.4', did you mean 5.3\?; choose one of: 4.0, 4.1"
    ):
        find_scenario("5.4", "lab run")
