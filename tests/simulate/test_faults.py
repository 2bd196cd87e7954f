"""Faults that are injected: what each kind does to readings, while it lasts and not before or after."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.angles import difference_deg
from common.boat_config import BoatConfig, BoatTable, SensorTable
from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.simulation.fault_text import KINDS, SensorFault, fault_of
from common.simulation.faults import Faults, faults_of, with_faults
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading, Timed, TurnRateReading
from common.simulation.scenarios import scenario_voyage

SENSORS = tuple(
    SensorTable(id=f"{role}1", port="a", role=role, rate_hz=10.0) for role in ("gps", "compass", "imu", "gyro")
)
CONFIG = BoatConfig(boat=BoatTable(id="b"), sensor=SENSORS)
ROLES = {sensor.id: sensor.role for sensor in SENSORS}
HERE = LocalPlane(50.0, -1.0)


def reading(sensor: str, t_s: float) -> Reading:
    """A boat that goes north-east and turns."""
    match sensor:
        case "gps1":
            return FixReading(*HERE.to_lat_lon_deg(2.0 * t_s, 2.0 * t_s), 2.0, 2.0)
        case "compass1":
            return HeadingReading((5.0 * t_s) % 360.0)
        case "imu1":
            return ImuReading(0.1 + 0.01 * t_s, 0.2, 5.0 + 0.01 * t_s)
        case _:
            return TurnRateReading(5.0 + 0.01 * t_s)


def spoilt(text: str, seconds: float = 30.0) -> dict[float, Reading]:
    faults = faults_of([text], CONFIG)
    spoiler = Faults(faults, SENSORS)
    sensor = faults[0].sensor
    times = [0.5 * step for step in range(round(2 * seconds))]
    given_ = [spoiler.spoil(Timed(t_s, sensor, reading(sensor, t_s))) for t_s in times]
    return {timed.t_s: timed.reading for timed in given_ if timed is not None}


def moved_m(fix: Reading, t_s: float) -> tuple[float, float]:
    assert isinstance(fix, FixReading)
    east, north = HERE.to_east_north_m(fix.lat_deg, fix.lon_deg)
    return east - 2.0 * t_s, north - 2.0 * t_s


def heading(given_: Reading) -> float:
    assert isinstance(given_, HeadingReading)
    return given_.heading_true_deg


def rate(given_: Reading) -> float:
    if isinstance(given_, ImuReading):
        return given_.yaw_rate_deg_s
    assert isinstance(given_, TurnRateReading)
    return given_.rate_deg_s


@pytest.mark.parametrize("kind", KINDS)
def test_before_and_after_each_reading_is_as_it_was(kind: str) -> None:
    size = {"repeat": "3", "claim": "4", "turned": "90 deg", "delay": "2 s", "clock": "9 s", "carry-off": "1 m/s"}
    sensor = "imu1" if "imu" in KINDS[kind].roles and kind != "noise" else "gps1"
    unit = {"imu1": {"ramp": "1 deg/s2"}, "gps1": {"ramp": "1 m/s"}}[sensor].get(kind, "1 deg/s")
    given_size = size.get(kind, "x10" if kind == "noise" else unit) if KINDS[kind].units is not None else ""
    given_ = spoilt(f"{sensor} {kind} {given_size} at 10 s for 5 s")
    outside = {t_s: each for t_s, each in given_.items() if not 10.0 <= t_s < 15.0}
    assert outside == {t_s: reading(sensor, t_s) for t_s in outside}
    assert len(outside) == 50
    inside = {t_s: each for t_s, each in given_.items() if 10.0 <= t_s < 15.0}
    assert inside != {t_s: reading(sensor, t_s) for t_s in (10.0 + 0.5 * step for step in range(10))}


def test_a_step_moves_the_place_toward_an_angle_and_leaves_the_velocity() -> None:
    fix = spoilt("gps1 step 50 m toward 90 deg at 10 s")[20.0]
    assert moved_m(fix, 20.0) == pytest.approx((50.0, 0.0), abs=0.01)
    assert isinstance(fix, FixReading)
    assert (fix.v_east_m_s, fix.v_north_m_s) == (2.0, 2.0)


def test_a_step_in_metres_a_second_is_one_of_the_velocity() -> None:
    fix = spoilt("gps1 step 2 m/s toward 180 at 10 s")[20.0]
    assert moved_m(fix, 20.0) == pytest.approx((0.0, 0.0), abs=0.01)
    assert isinstance(fix, FixReading)
    assert (fix.v_east_m_s, fix.v_north_m_s) == pytest.approx((2.0, 0.0))


def test_a_ramp_grows_and_its_velocity_stays_true_and_a_carry_off_says_so() -> None:
    for kind, velocity in (("ramp", (2.0, 2.0)), ("carry-off", (2.5, 2.0))):
        fix = spoilt(f"gps1 {kind} 0.5 m/s toward 90 at 10 s")[20.0]
        assert moved_m(fix, 20.0) == pytest.approx((5.0, 0.0), abs=0.01)
        assert isinstance(fix, FixReading)
        assert (fix.v_east_m_s, fix.v_north_m_s) == pytest.approx(velocity)


def test_headings_wrap() -> None:
    given_ = spoilt("compass1 step 350 deg at 10 s")
    assert difference_deg(heading(given_[20.0]), 100.0) == pytest.approx(-10.0)
    assert all(0.0 <= heading(each) < 360.0 for each in given_.values())


def test_a_spike_is_one_reading() -> None:
    given_ = spoilt("compass1 spike 40 deg at 10.2 s")
    off = [t_s for t_s, each in given_.items() if each != reading("compass1", t_s)]
    assert off == [10.5]


def test_stuck_gives_the_last_one_before() -> None:
    assert {heading(each) for t_s, each in spoilt("compass1 stuck at 10 s").items() if t_s >= 10.0} == {47.5}
    assert {heading(each) for each in spoilt("compass1 stuck at 0 s").values()} == {0.0}


def test_repeat_gives_each_several_times() -> None:
    given_ = spoilt("gyro1 repeat 3 at 10 s")
    assert [rate(given_[10.0 + 0.5 * step]) for step in range(7)] == pytest.approx([5.1] * 3 + [5.115] * 3 + [5.13])


def test_a_delay_gives_what_was_and_the_receiver_says_when_it_was() -> None:
    assert heading(spoilt("compass1 delay 3 s at 10 s")[20.0]) == pytest.approx(85.0)
    fix = spoilt("gps1 delay 3 s at 10 s")[20.0]
    assert moved_m(fix, 17.0) == pytest.approx((0.0, 0.0), abs=0.01)
    assert isinstance(fix, FixReading)
    assert fix.late_s == pytest.approx(3.0)
    assert min(spoilt("gps1 delay 3 s at 0 s")) == 3.0, "nothing is old enough before"


def test_mounted_wrongly() -> None:
    turned = spoilt("imu1 turned 90 deg at 0 s")[0.0]
    assert isinstance(turned, ImuReading)
    assert (turned.accel_fwd_m_s2, turned.accel_stb_m_s2) == pytest.approx((0.2, -0.1))
    over = spoilt("imu1 upside-down at 0 s")[0.0]
    assert isinstance(over, ImuReading)
    assert (over.accel_fwd_m_s2, over.accel_stb_m_s2, over.yaw_rate_deg_s) == pytest.approx((0.1, -0.2, -5.0))
    assert over.accel_down_m_s2 == pytest.approx(9.80665)


def test_sign_unit_zero_and_dropout() -> None:
    assert rate(spoilt("gyro1 sign at 0 s")[0.0]) == -5.0
    assert heading(spoilt("compass1 sign at 0 s")[10.0]) == 310.0
    assert rate(spoilt("imu1 unit at 0 s")[0.0]) == pytest.approx(math.radians(5.0))
    fix = spoilt("gps1 unit at 0 s")[0.0]
    assert isinstance(fix, FixReading)
    assert (fix.v_east_m_s, fix.v_north_m_s) == pytest.approx((1.02889, 1.02889), abs=1e-5)
    zero = spoilt("gps1 zero at 0 s")[5.0]
    assert isinstance(zero, FixReading)
    assert (zero.lat_deg, zero.lon_deg, zero.v_east_m_s, zero.v_north_m_s) == (0.0, 0.0, 0.0, 0.0)
    assert [t_s for t_s in spoilt("gps1 dropout at 10 s for 15 s") if 9.0 <= t_s < 26.0] == [9.0, 9.5, 25.0, 25.5]


def test_noise_has_the_size_that_was_asked_and_one_seed_gives_it_again() -> None:
    given_ = spoilt("compass1 noise x5 at 0 s", 2000.0)
    errors = [difference_deg(heading(each), 5.0 * t_s % 360.0) for t_s, each in given_.items()]
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) == pytest.approx(math.sqrt(24.0), rel=0.05)
    assert given_ == spoilt("compass1 noise x5 at 0 s", 2000.0)
    fixes = spoilt("gps1 noise 7 m at 0 s", 2000.0)
    for axis in (0, 1):
        errors = [moved_m(each, t_s)[axis] for t_s, each in fixes.items()]
        assert math.sqrt(sum(error**2 for error in errors) / len(errors)) == pytest.approx(7.0, rel=0.05)


def test_two_faults_of_one_sensor_apply_one_after_the_other() -> None:
    faults = faults_of(["compass1 step 10 deg at 0 s", "compass1 stuck at 5 s"], CONFIG)
    spoiler = Faults(faults, SENSORS)
    given_ = [spoiler.spoil(Timed(float(t), "compass1", HeadingReading(float(t)))) for t in range(8)]
    assert [heading(each.reading) for each in given_ if each] == [10.0, 11.0, 12.0, 13.0, 14.0, 14.0, 14.0, 14.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("compass1 step 30 deg", "is not understood; write SENSOR KIND"),
        ("", "is not understood"),
        ("compass2 step 30 deg at 3 s", "no sensor 'compass2', did you mean compass1?"),
        ("compass1 stop 30 deg at 3 s", "no fault 'stop', did you mean step?"),
        ("compass1 step 30 m at 3 s", "step of a compass needs a number of deg"),
        ("compass1 step at 3 s", "step of a compass needs a number of deg"),
        ("compass1 stuck 3 deg at 3 s", "stuck takes no size"),
        ("gps1 turned 90 deg at 3 s", "turned is for imu; gps1 is a gps"),
        ("gps1 noise x0.5 at 3 s", "x0.5 does not fit noise"),
        ("gps1 step x3 at 3 s", "step of a gps needs"),
        ("imu1 repeat 2.5 at 3 s", "repeat needs a whole number"),
        ("gps1 step 1.2.3 m at 3 s", "'1.2.3' is no number"),
        ("gps1 step 50 m at 1e999 s", "is not understood"),
    ],
)
def test_a_wrong_sentence_says_which_word(text: str, words: str) -> None:
    with pytest.raises(WayfixError) as caught:
        fault_of(text, ROLES)
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["compass1 step 30deg at 120s for 60s", "  compass1  step 30 deg at 120 s for 60 s "])
def test_blanks_do_not_matter(text: str) -> None:
    assert fault_of(text, ROLES) == SensorFault(
        sensor="compass1", kind="step", size=30.0, unit="deg", from_s=120.0, for_s=60.0
    )


@given(st.text(max_size=40))
def test_any_text_is_a_fault_or_one_sentence(text: str) -> None:
    with suppress(WayfixError):
        fault_of(f"gps1 {text}", ROLES)


def test_a_voyage_with_a_fault_differs_in_that_sensor_alone() -> None:
    voyage = scenario_voyage("4.2", seconds=20.0)
    broken = with_faults(voyage, ["compass1 step 30 deg at 5 s for 5 s"])
    for before, after in zip(voyage.readings, broken.readings, strict=True):
        is_off = before.sensor == "compass1" and 5.0 <= before.t_s < 10.0
        assert (before != after) == is_off
    assert with_faults(voyage, []) is voyage
