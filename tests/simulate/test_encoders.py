"""Device lines: right checksums, the layouts of the real devices, and values that survive up to the resolution."""

import math
import re
from functools import reduce

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.angles import difference_deg
from common.boat_config import SensorTable
from common.framer import ImuSample
from common.messages import Fix, Heading
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.units import M_S_PER_KN
from onboard.devices.driver import Accepted, Line
from onboard.devices.registry import make_driver
from onboard.virtual.encoders import ArduImuEncoder, CompassEncoder, Encoded, GpsEncoder, nmea

UTC_NS = 1_419_995_239_000_000_000
"""2014-12-31 03:07:19."""

latitudes = st.floats(-90.0, 90.0)
longitudes = st.floats(-180.0, 180.0)


def decoded(role: str, model: str, encoded: Encoded) -> list[object]:
    """What the daemon's own driver makes of the bytes."""
    driver = make_driver(SensorTable(id=f"{role}1", port="p", role=role, model=model))
    found: list[object] = []
    for k, data in enumerate(encoded.data.splitlines()):
        line = Line(1_000_000 * k, data)
        assert driver.claims(line)
        outcome = driver.feed(line)
        assert isinstance(outcome, Accepted), outcome
        found += outcome.measurements
    return [*found, *driver.flush(10**12, 0)]


def only(kind: type, found: list[object]) -> object:
    (one,) = (item for item in found if isinstance(item, kind))
    return one


def assert_checksums(data: bytes) -> None:
    assert data.endswith(b"\r\n")
    for sentence in data.split(b"\r\n")[:-1]:
        match = re.fullmatch(rb"\$([^*$]*)\*([0-9A-F]{2})", sentence)
        assert match, sentence
        assert reduce(lambda a, b: a ^ b, match[1]) == int(match[2], 16)


def test_checksums_of_lines_of_real_devices() -> None:
    assert nmea("HCHDG,123.4,,,,") == b"$HCHDG,123.4,,,,*46\r\n"
    assert nmea("GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5") == (
        b"$GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5*33\r\n"
    )


def test_epoch_looks_like_a_bu_353() -> None:
    # The position and time of a real BU-353 S4; altitude and course differ.
    reading = FixReading(-(37 + 47.0873 / 60), 175 + 18.8938 / 60)
    encoded = GpsEncoder(UTC_NS, decimals=4).encode(0.0, reading)
    gga, gsa, rmc = encoded.data.decode().splitlines()
    assert gga.startswith("$GPGGA,030719.000,3747.0873,S,17518.8938,E,1,08,")
    assert gsa == "$GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5*33"
    assert rmc.startswith("$GPRMC,030719.000,A,3747.0873,S,17518.8938,E,,,311214,,,A*")
    # The epoch must fit a second at 4800 baud.
    assert len(encoded.data) < 480 / 2


@given(latitudes, longitudes, st.integers(0, 10**6), st.integers(3, 7))
def test_position_survives_to_the_last_digit(lat: float, lon: float, tenths: int, decimals: int) -> None:
    encoded = GpsEncoder(UTC_NS, decimals).encode(tenths / 10, FixReading(lat, lon))
    assert_checksums(encoded.data)
    half_unit = 0.5 * 10**-decimals / 60 + 1e-12
    assert encoded.values["lat_deg"] == pytest.approx(lat, abs=half_unit)
    assert encoded.values["lon_deg"] == pytest.approx(lon, abs=half_unit)
    match = re.search(rb"GGA,[\d.]+,(\d\d)(\d\d\.\d+),([NS]),(\d{3})(\d\d\.\d+),([EW]),", encoded.data)
    assert match
    assert float(match[2]) < 60
    assert float(match[5]) < 60
    again = (int(match[1]) + float(match[2]) / 60) * (-1 if match[3] == b"S" else 1)
    assert again == pytest.approx(encoded.values["lat_deg"], abs=1e-12)


@given(latitudes, st.floats(-179.9, 179.9), st.floats(-30.0, 30.0), st.floats(-30.0, 30.0))
def test_the_gps_driver_reads_what_was_encoded(lat: float, lon: float, v_east: float, v_north: float) -> None:
    encoded = GpsEncoder(UTC_NS).encode(5.0, FixReading(lat, lon, v_east, v_north))
    fix = only(Fix, decoded("gps", "nmea", encoded))
    assert isinstance(fix, Fix)
    assert fix.usable
    assert fix.sog_kn is not None
    assert fix.utc_ns == encoded.values["utc_ns"] == UTC_NS + 5_000_000_000
    assert (fix.lat_deg, fix.lon_deg) == pytest.approx(
        (encoded.values["lat_deg"], encoded.values["lon_deg"]), abs=1e-11
    )
    assert fix.sog_kn == encoded.values["sog_kn"]
    # The driver takes no course of a boat that hardly moves.
    if fix.cog_true_deg is not None or fix.sog_kn > 3.0:
        assert fix.cog_true_deg == encoded.values["cog_true_deg"]
    assert fix.sog_kn == pytest.approx(math.hypot(v_east, v_north) / M_S_PER_KN, abs=0.0051)


@given(st.floats(0.0, 360.0, exclude_max=True), st.floats(-30.0, 30.0))
def test_heading_survives_to_a_tenth_and_carries_the_variation(heading: float, variation: float) -> None:
    encoded = CompassEncoder(variation).encode(0.0, HeadingReading(heading))
    assert_checksums(encoded.data)
    assert re.fullmatch(rb"\$HCHDG,\d{3}\.\d,,,,\*..\r\n", encoded.data)
    magnetic = encoded.values["heading_mag_deg"]
    assert magnetic is not None
    assert 0.0 <= magnetic < 360.0
    # true = magnetic + variation, east positive
    assert abs(difference_deg(magnetic + variation, heading)) <= 0.05 + 1e-9
    read = only(Heading, decoded("compass", "nmea", encoded))
    assert isinstance(read, Heading)
    assert read.heading_mag_deg == magnetic


@given(st.floats(-78.0, 78.0), st.floats(-78.0, 78.0), st.floats(-1990.0, 1990.0))
def test_imu_sample_survives_to_a_count(fwd: float, stb: float, rate: float) -> None:
    encoded = ArduImuEncoder().encode(0.05, ImuReading(fwd, stb, rate))
    half_count = 0.5 * 9.80665 / 4096
    assert encoded.values["accel_fwd_m_s2"] == pytest.approx(fwd, abs=half_count * 1.001)
    assert encoded.values["accel_stb_m_s2"] == pytest.approx(stb, abs=half_count * 1.001)
    assert encoded.values["yaw_rate_deg_s"] == pytest.approx(rate, abs=0.5 / 16.4 * 1.001)
    sample = only(ImuSample, decoded("imu", "arduimu", encoded))
    assert isinstance(sample, ImuSample)
    assert (sample.accel_fwd_m_s2, sample.accel_stb_m_s2, sample.yaw_rate_deg_s) == pytest.approx(
        (encoded.values["accel_fwd_m_s2"], encoded.values["accel_stb_m_s2"], encoded.values["yaw_rate_deg_s"])
    )


def test_imu_line_is_that_of_an_arduimu_with_analogs() -> None:
    encoder = ArduImuEncoder()
    encoder.encode(0.05, ImuReading(0.0, 0.0, 0.0))
    line = encoder.encode(0.15, ImuReading(9.80665 / 4096 * 12, -9.80665 / 4096 * 7, 20.0)).data
    assert line == (
        b"!!!VER:1.9,AN0:0,AN1:0,AN2:328,AN3:-12,AN4:7,AN5:4096,RLL:0.00,PCH:0.00,YAW:2.00,IMUH:253,TOW:0***\r\n"
    )
    # 20 of them a second fit 38400 baud.
    assert 20 * (len(line) + 20) < 3840


def test_imu_saturates_like_its_converter() -> None:
    values = ArduImuEncoder().encode(0.0, ImuReading(1000.0, -1000.0, 1e6)).values
    assert values["yaw_rate_deg_s"] == pytest.approx(32767 / 16.4)
    assert values["accel_fwd_m_s2"] == pytest.approx(8 * 9.80665)
