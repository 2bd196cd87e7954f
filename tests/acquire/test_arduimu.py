"""ArduIMU lines: scales, signs, strictness without a checksum."""

import pytest

from common.messages import Attitude
from onboard.devices import Accepted, Ignored, ImuSample, Rejected, make_driver
from tests.acquire.sentences import ARDUIMU, MS, imu, line, measured

ANALOGS = "AN0:1,AN1:-2,AN2:164,AN3:4096,AN4:-2048,AN5:-4096"


def test_scales_and_signs_of_the_raw_counts() -> None:
    (sample,) = measured(make_driver(imu(latency_ms=5)).feed(line(f"!!!VER:1.9,{ANALOGS},TOW:0***".encode(), 20 * MS)))
    assert isinstance(sample, ImuSample)
    assert sample.t_ns == 15 * MS
    assert sample.accel_fwd_m_s2 == pytest.approx(9.80665)
    assert sample.accel_stb_m_s2 == pytest.approx(-9.80665 / 2)
    assert sample.yaw_rate_deg_s == pytest.approx(10.0)


def test_attitude_and_magnetometer_of_real_lines() -> None:
    driver = make_driver(imu())
    (first,) = measured(driver.feed(line(ARDUIMU, 7000)))
    assert first == Attitude(sensor="imu1", t_ns=7000, roll_deg=-15.81, pitch_deg=-47.43, yaw_deg=109.61)
    second = b"!!!VER:1.9,MGX:555,MGY:-51,MGZ:139,MGH:2.79,TOW:582655000***"
    (found,) = measured(driver.feed(line(second)))
    assert found == Attitude(sensor="imu1", t_ns=0, mag_fwd_counts=555, mag_stb_counts=-51, mag_down_counts=139)


def test_both_kinds_in_one_line_and_the_health_byte() -> None:
    data = f"!!!VER:1.9,{ANALOGS},RLL:1.00,PCH:2.00,YAW:-3.00,IMUH:5,TOW:0***".encode()
    sample, attitude = measured(make_driver(imu()).feed(line(data)))
    assert isinstance(sample, ImuSample)
    assert isinstance(attitude, Attitude)
    assert attitude.warning == "IMUH 5"
    silent = make_driver(imu()).feed(line(f"!!!{ANALOGS},IMUH:253***".encode()))
    assert len(measured(silent)) == 1


@pytest.mark.parametrize(
    "data",
    [
        b"!!!VER:1.8.1,RLL:1.12,PCH:-0.07,YAW:34.03,IMUH:253,LAT:499247361,LON:-1193955623, ALT:3525,COG:0***",
        b"!!VER:1.9,RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0***",
        b"!!!RLL:-15.81,PCH:-47.43,***",
    ],
)
def test_tolerated_oddities(data: bytes) -> None:
    driver = make_driver(imu())
    assert driver.claims(line(data))
    assert isinstance(driver.feed(line(data)), Accepted)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (ARDUIMU[:-1], "marks"),
        (ARDUIMU[2:], "marks"),
        (b"!!!VER:1.9,RLL:-15.81***x", "marks"),
        (b"!!!RLL:1.0,RLL:1.0***", "duplicate"),
        (b"!!!VER:1.9,VER:1.9,RLL:1.0***", "duplicate"),
        (b"!!!RLL:1.0PCH:2.0***", "not-a-number"),
        (b"!!!RLL:nan***", "not-a-number"),
        (b"!!!RLL:1e1***", "not-a-number"),
        (b"!!!RLL:+1***", "not-a-number"),
        (b"!!!RLL:1_0***", "not-a-number"),
        (b"!!!RLL:***", "not-a-number"),
        (b"!!!VER:x,RLL:1.0***", "not-a-number"),
        (b"!!!RLL 1.0***", "fields"),
        (b"!!!RLL:1.0,,PCH:1.0***", "fields"),
        (b"!!!RLL:1.0,  PCH:1.0***", "fields"),
        (b"!!!RLL:1.0,CH:2.0,\xff:1***", "not-ascii"),
        (b"!!!!RLL:1.0***", "fields"),
        (b"!!!***", "fields"),
        (b"!!!AN0:1,AN1:1,AN2:1,AN3:1,AN4:1***", "fields"),
        (b"!!!AN0:1,AN1:1,AN2:1,AN3:1,AN4:1,AN5:32768***", "range"),
        (b"!!!RLL:180.5***", "range"),
        (b"!!!PCH:-90.5***", "range"),
        (b"!!!RLL:1.0,TOW:" + b"9" * 600 + b"***", "too-long"),
        (ARDUIMU[:-3] + ARDUIMU, "not-a-number"),
    ],
)
def test_damaged_lines(data: bytes, reason: str) -> None:
    assert make_driver(imu()).feed(line(data)) == Rejected(reason, "imu1")


@pytest.mark.parametrize(
    "data",
    [b"Welcome to ArduIMU", b"PPPpTm:500,mLc:12,***", b"!!!VER:1.9,LAT:1,LON:2,TOW:0***", b"", b"RLL:1,PCH:2"],
)
def test_other_lines_are_ignored(data: bytes) -> None:
    assert isinstance(make_driver(imu()).feed(line(data)), Ignored)
