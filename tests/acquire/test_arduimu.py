"""ArduIMU lines: scales, signs, strictness without a checksum."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.framer import ImuSample
from common.messages import Attitude
from onboard.devices import Accepted, Ignored, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import ARDUIMU, GGA, MS, compass, gps, imu, line, measured

Matrix = list[list[float]]
ANALOGS = "AN0:1,AN1:-2,AN2:164,AN3:-4096,AN4:2048,AN5:4096"


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
        ARDUIMU[2:],
        ARDUIMU[3:],
        b"!!!VER:1.9,AN0:1.00,AN1:-2.25,AN2:164.00,AN3:4096.00,AN4:-2048.00,AN5:-4096.00,TOW:0***",
        b"RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253",
        b"RLL:-15.81,PCH:-47.43,YAW:109.61,",
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
        (ARDUIMU[4:], "marks"),
        (b"!RLL:-15.81,PCH:-47.43,YAW:109.61***", "marks"),
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
        (b"RLL:-15.81,PCH:-47.43", "fields"),
        (b"RLL:-15.81,PCH:-47.43,YAW:109.6", "fields"),
        (b"LL:-15.81,PCH:-47.43,YAW:109.61", "fields"),
        (b"RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH", "fields"),
        (b"RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0", "fields"),
        (b"RLL:-15.81,PCH:-47.43,YAW:189.61", "range"),
        (b"RLL:-15.81,PCH:-47.43,YAW:109.61\xff", "not-ascii"),
    ],
)
def test_damaged_lines(data: bytes, reason: str) -> None:
    assert make_driver(imu()).feed(line(data)) == Rejected(reason, "imu1")


@pytest.mark.parametrize(
    "data",
    [
        b"Welcome to ArduIMU",
        b"???Welcome...***",
        b"???Software Version 1.9***",
        b"???Ground Start complete",
        b"***Air Start complete",
        b"-123.45",
        b"PPPpTm:500,mLc:12,***",
        b"!!!VER:1.9,LAT:1,LON:2,TOW:0***",
        b"COG:116,SOG:0,FIX:1,",
        b"",
    ],
)
def test_other_lines_are_ignored(data: bytes) -> None:
    assert isinstance(make_driver(imu()).feed(line(data)), Ignored)


def matrix_line(roll_deg: float, pitch_deg: float, yaw_deg: float, more: str = "") -> bytes:
    """EX0..EX8 of R = Rz(yaw) Ry(pitch) Rx(roll), multiplied out here axis by axis."""
    r, p, y = (math.radians(angle) for angle in (roll_deg, pitch_deg, yaw_deg))
    about_x: Matrix = [[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]]
    about_y: Matrix = [[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]]
    about_z: Matrix = [[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]]
    elements = [element for row in product(about_z, product(about_y, about_x)) for element in row]
    return f"!!!VER:1.9,{','.join(f'EX{n}:{int(e * 1e7)}' for n, e in enumerate(elements))},{more}TOW:0***".encode()


def product(a: Matrix, b: Matrix) -> Matrix:
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def attitude_of(data: bytes) -> Attitude:
    (found,) = measured(make_driver(imu()).feed(line(data)))
    assert isinstance(found, Attitude)
    return found


def test_axes_of_the_matrix() -> None:
    """Bow to the east; then bow up, so that the forward axis points away from the earth; then starboard side down."""
    east = attitude_of(b"!!!EX0:0,EX1:-10000000,EX2:0,EX3:10000000,EX4:0,EX5:0,EX6:0,EX7:0,EX8:10000000***")
    assert (east.roll_deg, east.pitch_deg, east.yaw_deg) == (0.0, 0.0, 90.0)
    up = attitude_of(b"!!!EX0:8660254,EX1:0,EX2:5000000,EX3:0,EX4:10000000,EX5:0,EX6:-5000000,EX7:0,EX8:8660254***")
    assert up.pitch_deg == pytest.approx(30.0, abs=1e-5)
    assert (up.roll_deg, up.yaw_deg) == (0.0, 0.0)
    down = attitude_of(b"!!!EX0:10000000,EX1:0,EX2:0,EX3:0,EX4:8660254,EX5:-5000000,EX6:0,EX7:5000000,EX8:8660254***")
    assert down.roll_deg == pytest.approx(30.0, abs=1e-5)
    assert (down.pitch_deg, down.yaw_deg) == (0.0, 0.0)


@given(st.floats(-179.0, 179.0), st.floats(-89.0, 89.0), st.floats(-179.0, 179.0))
def test_the_matrix_gives_back_the_angles(roll_deg: float, pitch_deg: float, yaw_deg: float) -> None:
    found = attitude_of(matrix_line(roll_deg, pitch_deg, yaw_deg))
    assert found.roll_deg == pytest.approx(roll_deg, abs=1e-3)
    assert found.pitch_deg == pytest.approx(pitch_deg, abs=1e-3)
    assert found.yaw_deg == pytest.approx(yaw_deg, abs=1e-3)


def test_sent_angles_go_before_the_matrix_and_straight_up_has_no_yaw() -> None:
    sent = attitude_of(matrix_line(5.0, 6.0, 7.0, "RLL:1.00,PCH:2.00,YAW:3.00,"))
    assert (sent.roll_deg, sent.pitch_deg, sent.yaw_deg) == (1.0, 2.0, 3.0)
    up = attitude_of(matrix_line(0.0, 90.0, 0.0))
    assert (up.roll_deg, up.yaw_deg) == (None, None)
    assert up.pitch_deg == pytest.approx(90.0, abs=0.1)


def test_what_is_no_rotation_is_refused() -> None:
    whole = matrix_line(10.0, 20.0, 30.0)
    driver = make_driver(imu())
    assert driver.feed(line(whole.replace(b"EX8:", b"EX8:-"))) == Rejected("rotation", "imu1")
    assert driver.feed(line(whole.replace(b"EX4:8", b"EX4:"))) == Rejected("rotation", "imu1")
    assert driver.feed(line(whole.replace(b"EX4:", b"EX4:8"))) == Rejected("range", "imu1")
    assert driver.feed(line(whole.replace(b"EX4:", b"EX9:"))) == Rejected("fields", "imu1")
    left_handed = b"!!!EX0:10000000,EX1:0,EX2:0,EX3:0,EX4:10000000,EX5:0,EX6:0,EX7:0,EX8:-10000000***"
    assert driver.feed(line(left_handed)) == Rejected("rotation", "imu1")


def test_a_shared_port_is_not_disturbed() -> None:
    """Payloads of AIS may hold any key, and a sentence keeps its own driver and its own fault."""
    driver = make_driver(imu())
    for data in (
        GGA,
        b"!AIVDM,1,1,,A,13RLL:YAW:PCH:,0*00",
        b"$HCHDG,1,RLL:2",
        b"\\s:x*00\\!AIVDM,RLL:",
        b"Roll_Rate: -7",
    ):
        assert not driver.claims(line(data))
    port = PortDecoder([driver, make_driver(gps()), make_driver(compass())])
    assert port.feed(line(GGA[:-1] + b"0")) == Rejected("checksum", "gps1")


@given(st.binary(max_size=600) | st.text("RLPCHYAWEX0123456789:,.-!*", max_size=120).map(str.encode))
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    assert isinstance(make_driver(imu()).feed(line(data)), Accepted | Rejected | Ignored)


def forward(driver: object, an3: int, an5: int) -> float:
    data = f"!!!VER:1.9,AN0:0,AN1:0,AN2:0,AN3:{an3},AN4:0,AN5:{an5}***".encode()
    (sample,) = measured(driver.feed(line(data)))  # type: ignore[attr-defined]
    assert isinstance(sample, ImuSample)
    return sample.accel_fwd_m_s2


def test_the_weight_tells_whether_the_firmware_prints_gravity_or_specific_force() -> None:
    stock, altered = make_driver(imu()), make_driver(imu())
    assert forward(stock, -4096, 4096) == pytest.approx(9.80665)
    assert forward(altered, 4096, -4096) == pytest.approx(9.80665)


def test_a_fall_off_a_wave_does_not_turn_the_accelerometer() -> None:
    driver = make_driver(imu())
    assert [forward(driver, -409, an5) > 0 for an5 in [4096] * 20 + [-3000] * 5 + [100] * 50] == [True] * 75
    # A digit lost from the very first line is forgotten soon.
    driver = make_driver(imu())
    assert [forward(driver, -409, an5) > 0 for an5 in [-4096, 4096, 4096]] == [False, True, True]


def test_semicolons_between_the_pairs() -> None:
    driver = make_driver(imu())
    data = b"!!!AN0:1;AN1:2;AN2:164;AN3:0;AN4:0;AN5:4096;ANX:1.20;ANY:-3.40;***"
    (sample,) = measured(driver.feed(line(data)))
    assert isinstance(sample, ImuSample)
    assert sample.yaw_rate_deg_s == pytest.approx(10.0)
    assert driver.feed(line(data.replace(b"AN1:2;", b"AN1:2,"))) == Rejected("not-a-number", "imu1")
