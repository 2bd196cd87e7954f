"""Any boat's file in any world: each sensor at its rate and noise, in order, whatever else is on board."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.settings import read_toml
from common.simulation.quirks import QUIRKS, with_quirks
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Timed, TurnRateReading
from common.simulation.scenario import Outage, Scenario
from common.simulation.scenarios import find_scenario, find_world, scenario_voyage
from common.simulation.sensor_errors import Deviation, Flaws
from common.simulation.sensor_models import Phase
from common.simulation.thesis_tables import POOR, TABLE_5_4
from common.simulation.voyage import Voyage, boat_voyage
from common.simulation.without_ports import frames_of

SPRINGER = read_toml(Path(__file__).parents[2] / "deploy" / "examples" / "springer.toml", BoatConfig)
SENSORS = (
    SensorTable(id="gps1", port="a", role="gps"),
    SensorTable(id="gps2", port="a", role="gps", rate_hz=5.0, sigma_m=0.5, lever_fwd_m=2.0, lever_stb_m=-1.0),
    SensorTable(id="compass1", port="a", role="compass", rate_hz=5.0),
    SensorTable(id="compass2", port="a", role="compass", rate_hz=2.0, sigma_deg=3.0, model="tcm2"),
    SensorTable(id="imu1", port="a", role="imu", rate_hz=10.0, model="arduimu"),
    SensorTable(id="gyro1", port="a", role="gyro", rate_hz=10.0, model="tinkerkit"),
)
BOAT = BoatConfig(boat=BoatTable(id="b", variation_deg=0.0), port=(PortTable(name="a", path="a"),), sensor=SENSORS)


def of(voyage: Voyage, sensor: str) -> list[Timed]:
    return [timed for timed in voyage.readings if timed.sensor == sensor]


def with_sensors(*ids: str) -> BoatConfig:
    return replace(BOAT, sensor=tuple(table for table in SENSORS if table.id in ids))


def errors_m(voyage: Voyage, sensor: str, lever: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """Error of each fix forward and to starboard less the lever arm: (n, 2)."""
    found = []
    for timed in of(voyage, sensor):
        assert isinstance(timed.reading, FixReading)
        truth = voyage.truth.at(np.array([timed.t_s]))
        east, north = voyage.plane.to_east_north_m(timed.reading.lat_deg, timed.reading.lon_deg)
        d_east, d_north = east - truth.east_m[0], north - truth.north_m[0]
        sin, cos = np.sin(truth.heading_rad[0]), np.cos(truth.heading_rad[0])
        found.append((sin * d_east + cos * d_north - lever[0], cos * d_east - sin * d_north - lever[1]))
    return np.array(found)


@pytest.mark.parametrize("world", ["5.3", "real-lake"])
def test_what_a_sensor_measures_does_not_depend_on_the_others(world: str) -> None:
    whole = boat_voyage(find_world(world), BOAT, seed=4, seconds=30.0)
    for sensor in ("gps2", "compass2", "gyro1", "imu1"):
        alone = boat_voyage(find_world(world), with_sensors(sensor), seed=4, seconds=30.0)
        assert of(whole, sensor) == list(alone.readings)
    times = [timed.t_s for timed in whole.readings]
    assert times == sorted(times)
    other = boat_voyage(find_world(world), BOAT, seed=5, seconds=30.0)
    assert of(whole, "compass2") != of(other, "compass2")


@pytest.mark.parametrize("world", ["5.3", "real-coast"])
def test_each_speaks_at_its_own_rate(world: str) -> None:
    voyage = boat_voyage(find_world(world), BOAT, seconds=20.0)
    counts = {table.id: len(of(voyage, table.id)) for table in SENSORS}
    assert counts == {"gps1": 21, "gps2": 101, "compass1": 101, "compass2": 41, "imu1": 200, "gyro1": 200}


def test_the_scenarios_own_sensors_are_those_of_the_three_port_boat() -> None:
    ours = boat_voyage(find_world("5.3"), with_sensors("gps1"), seed=2, seconds=30.0)
    assert list(ours.readings) == of(scenario_voyage("5.3", seed=2, seconds=30.0), "gps1")


def test_other_sensors_have_the_noise_of_their_file_and_follow_the_phases() -> None:
    """Scenario 5.3: GPS noise grows from 8 and 7 m to 20 m after 300 s; so does that of a receiver of 0.5 m."""
    voyage = boat_voyage(find_world("5.3"), with_sensors("gps2"), seed=1, seconds=600.0)
    errors = errors_m(voyage, "gps2", lever=(2.0, -1.0))
    before, after = errors[:1500].std(), errors[1510:].std()
    assert before == pytest.approx(0.5, rel=0.08)
    ratio = np.hypot(POOR.gps_east_m / TABLE_5_4.gps_east_m, POOR.gps_north_m / TABLE_5_4.gps_north_m) / np.sqrt(2.0)
    assert after / before == pytest.approx(ratio, rel=0.08)
    assert np.abs(errors[:1500].mean(axis=0)).max() < 4.0 * 0.5 / np.sqrt(1500)


def test_phases_outages_and_flaws_may_name_any_sensor() -> None:
    quiet = replace(TABLE_5_4, compass_deg=1e-6)
    plain = find_scenario("5.1")
    scenario: Scenario = replace(
        plain,
        phases=(Phase(0.0, TABLE_5_4, of_sensor=(("compass2", quiet),)),),
        outages=(Outage("compass2", 5.0, 5.0), Outage("imu1", 2.0, 1.0)),
        flaws_of=(("compass2", Flaws(deviation=Deviation(A=7.0))),),
    )
    voyage = boat_voyage(scenario, BOAT, seconds=20.0)
    true_deg = voyage.truth.at(np.array([timed.t_s for timed in of(voyage, "compass2")])).heading_rad
    for timed, truth in zip(of(voyage, "compass2"), np.degrees(true_deg), strict=True):
        assert isinstance(timed.reading, HeadingReading)
        assert (truth - timed.reading.heading_true_deg - 7.0 + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-4)
        assert not 5.0 <= timed.t_s < 10.0
    assert len(of(voyage, "compass1")) == 101
    assert not any(2.0 <= timed.t_s < 3.0 for timed in of(voyage, "imu1"))


def test_gyro_and_imu_turn_alike() -> None:
    voyage = boat_voyage(find_world("5.1"), with_sensors("imu1", "gyro1"), seconds=100.0)
    imu = np.array([t.reading.yaw_rate_deg_s for t in of(voyage, "imu1") if isinstance(t.reading, ImuReading)])
    gyro = np.array([t.reading.rate_deg_s for t in of(voyage, "gyro1") if isinstance(t.reading, TurnRateReading)])
    smooth = [rates.reshape(-1, 50).mean(axis=1) for rates in (imu, gyro)]
    assert np.corrcoef(*smooth)[0, 1] > 0.95
    assert np.abs(imu - gyro).max() > 0.0


@pytest.mark.parametrize("world", ["5.1", "real-lake"])
def test_errors_that_the_file_knows_are_in_the_readings(world: str) -> None:
    """The station takes stated biases and deviation off, so the devices of that file must have them."""
    known = tuple(
        replace(table, deviation_deg=10.0, bias_accel_fwd_m_s2=0.3, bias_accel_stb_m_s2=-0.2, bias_yaw_rate_deg_s=2.0)
        for table in SENSORS
    )
    plain, stated = (
        boat_voyage(find_world(world), replace(BOAT, sensor=sensors), seconds=5.0) for sensors in (SENSORS, known)
    )
    for before, after in zip(plain.readings, stated.readings, strict=True):
        match before.reading, after.reading:
            case HeadingReading(one), HeadingReading(other):
                assert (one - other) % 360.0 == pytest.approx(10.0)
            case ImuReading(fwd, stb, yaw_rate), ImuReading() as other_sample:
                assert other_sample.accel_fwd_m_s2 - fwd == pytest.approx(0.3)
                assert other_sample.accel_stb_m_s2 - stb == pytest.approx(-0.2)
                assert other_sample.yaw_rate_deg_s - yaw_rate == pytest.approx(2.0)
            case TurnRateReading(rate), TurnRateReading(other_rate):
                assert other_rate - rate == pytest.approx(2.0)
            case _:
                assert before == after


def test_a_receiver_with_static_navigation_holds_its_fix_while_slow() -> None:
    voyage = boat_voyage(find_world("real-anchor"), with_sensors("gps1"), seed=3, seconds=120.0)
    held = with_quirks(voyage, ["gps1:static-navigation"])
    places = [(t.reading.lat_deg, t.reading.v_east_m_s) for t in held.readings if isinstance(t.reading, FixReading)]
    assert len(places) == len(voyage.readings)
    repeats = sum(a == b for a, b in pairwise(places))
    assert repeats > 0.9 * len(places)
    assert all(speed == 0.0 for place, speed in places[3:] if place == places[2][0])


def test_quirks_change_what_is_printed_and_nothing_else() -> None:
    voyage = boat_voyage(find_world("real-lake"), BOAT, seconds=70.0)
    odd = with_quirks(voyage, ["compass1:whole-degrees", "compass2:disturbed", "gps2:four-decimals"])
    frames = list(frames_of(odd))
    headings = [item for frame in frames for item in frame.headings]
    assert all(
        item.heading_mag_deg == int(item.heading_mag_deg or 0.0) for item in headings if item.sensor == "compass1"
    )
    warned = {item.warning for item in headings if item.sensor == "compass2"}
    assert warned == {None, "E001"}
    for name in ("imu1", "gyro1", "gps1"):
        assert of(odd, name) == of(voyage, name)
    for name in ("compass1", "compass2", "gps2"):
        assert [timed.t_s for timed in of(odd, name)] == [timed.t_s for timed in of(voyage, name)]


@pytest.mark.parametrize(
    ("quirk", "words"),
    [
        ("gps1:no-such", "names no quirk"),
        ("whole-degrees", "names no quirk"),
        ("compass9:whole-degrees", "no sensor 'compass9'"),
        ("gps1:whole-degrees", "is for a compass, gps1 is a gps"),
        ("compass1:disturbed", "is for tcm2 and hmr3000, compass1 is a nmea"),
    ],
)
def test_a_wrong_quirk_is_one_sentence(quirk: str, words: str) -> None:
    voyage = boat_voyage(find_world("5.1"), with_sensors("gps1", "compass1"), seconds=2.0)
    with pytest.raises(WayfixError, match=words):
        with_quirks(voyage, [quirk])
    assert {item.role for item in QUIRKS.values()} <= {"gps", "compass"}


def test_springer_sails_a_real_world_without_ports() -> None:
    """All nine sensors are in the frames, and the latency of each is in the times of arrival."""
    voyage = boat_voyage(find_world("real-coast"), SPRINGER, seconds=30.0)
    frames = list(frames_of(voyage))
    seen = {
        item.sensor
        for f in frames
        for kind in (f.fixes, f.headings, f.imu, f.turn_rates, f.ais, f.radar)
        for item in kind
    }
    assert seen == {table.id for table in SPRINGER.sensor}
    delays = {(frame.t1_ns - fix.t_ns) / 1e9 for frame in frames for fix in frame.fixes}
    assert min(delays) >= 0.75
    assert max(delays) <= 0.9
    assert [frame.seq for frame in frames] == list(range(len(frames)))
    assert isinstance(voyage.plane, LocalPlane)
