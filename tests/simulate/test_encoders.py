"""Device lines: right checksums, the layouts of the real devices, today's bytes to the byte."""

import hashlib
import re
from functools import reduce
from typing import Any

import pytest

from common.boat_config import SensorTable
from common.errors import WayfixError
from common.simulation.readings import (
    AisReading,
    FixReading,
    HeadingReading,
    ImuReading,
    RadarReading,
    Reading,
    TurnRateReading,
)
from common.simulation.scenarios import scenario_voyage
from onboard.devices import MODELS, Line, Rejected, make_driver, make_encoder
from onboard.devices.encoder import Surroundings, fixed, place, sealed

UTC_NS = 1_419_995_239_000_000_000
"""2014-12-31 03:07:19."""
AROUND = Surroundings(UTC_NS)


def table(role: str, model: str = "nmea", **settings: Any) -> SensorTable:
    return SensorTable(id=f"{role}1", port="p", role=role, model=model, **settings)


def lines(role: str, reading: Reading, model: str = "nmea", around: Surroundings = AROUND) -> list[str]:
    """What a new device prints at t = 0, every checksum checked."""
    data = make_encoder(table(role, model), around).encode(0.0, reading)
    for sentence in re.findall(rb"[$!]([^*!\r\n]*\*[0-9A-F]{2})", data):
        assert reduce(lambda a, b: a ^ b, sentence[:-3]) == int(sentence[-2:], 16), sentence
    return data.decode("ascii").splitlines()


def test_checksums_of_lines_of_real_devices() -> None:
    assert sealed("HCHDG,123.4,,,,") == b"$HCHDG,123.4,,,,*46\r\n"
    assert sealed("PTNTHPR,354.9,N,5.2,N,0.2,N") == b"$PTNTHPR,354.9,N,5.2,N,0.2,N*3A\r\n"
    assert sealed("C309.8P4.0R-2.9T25.1") == b"$C309.8P4.0R-2.9T25.1*03\r\n"


def test_minutes_never_read_sixty_and_zero_has_no_sign() -> None:
    assert place(-(37 + 59.99999 / 60), 179.9999999999, 4) == "3800.0000,S,18000.0000,E"
    assert place(-1e-12, -0.0, 5) == "0000.00000,N,00000.00000,E"
    assert place(90.0, -180.0, 7) == "9000.0000000,N,18000.0000000,W"
    assert [fixed(value, 1) for value in (-0.04, -0.0, -0.06, 12.34, None)] == ["0.0", "0.0", "-0.1", "12.3", ""]


def test_an_epoch_looks_like_that_of_a_bu_353() -> None:
    # The position and time of a real BU-353 S4; altitude and course differ.
    reading = FixReading(-(37 + 47.0873 / 60), 175 + 18.8938 / 60, 0.0, -0.355, minute_decimals=4)
    gga, gsa, rmc = lines("gps", reading)
    assert gga.startswith("$GPGGA,030719.000,3747.0873,S,17518.8938,E,1,08,1.1,")
    assert gsa == "$GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5*33"
    assert rmc.startswith("$GPRMC,030719.000,A,3747.0873,S,17518.8938,E,0.69,180.00,311214,,,A*")
    # The epoch must fit half a second at 4800 baud.
    assert len(gga + gsa + rmc) + 6 < 480 / 2


def test_a_late_position_has_its_own_utc() -> None:
    gga, _, rmc = lines("gps", FixReading(50.0, -4.0, late_s=0.75))
    assert gga.startswith("$GPGGA,030718.250,")
    assert rmc.startswith("$GPRMC,030718.250,")


def test_a_void_epoch_is_that_of_a_receiver_that_lost_its_fix() -> None:
    gga, gsa, rmc = lines("gps", FixReading(50.0, -4.0, 1.0, 1.0, quality=0, satellites=2, sigma_east_m=3.0))
    assert gga.startswith("$GPGGA,030719.000,,,,,0,02,")
    # As in the recording of a real cold start.
    assert gsa == "$GPGSA,A,1,,,,,,,,,,,,,,,*1E"
    assert rmc.startswith("$GPRMC,030719.000,V,,,,,,,311214,,,N*")


def test_what_a_receiver_claims_of_itself_is_sent_after_rmc() -> None:
    reading = FixReading(50.0, -4.0, quality=4, satellites=19, hdop=None, sigma_east_m=0.0142, sigma_north_m=0.011)
    gga, gsa, rmc, gst = lines("gps", reading)
    assert re.search(r",W,4,19,,", gga)
    assert gsa.startswith("$GPGSA,A,3,17,28,06,01,30,20,26,13,03,11,19,23,,,*")
    assert re.search(r",W,,,311214,,,R\*", rmc)
    assert gst.startswith("$GPGST,030719.000,,0.014,0.011,90.0,0.011,0.014,*")


def test_the_talker_is_one_that_the_boats_file_lets_through() -> None:
    for role, formatters, reading in (
        ("gps", ["GNGGA", "GNGSA", "GNRMC"], FixReading(50.0, -4.0)),
        ("compass", ["GNHDG", "GNROT", "GNXDR"], HeadingReading(1.0, roll_deg=2.0, turn_rate_deg_s=0.5)),
        ("radar", ["GNTTM"], RadarReading(1, range_m=100.0, bearing_true_deg=5.0)),
    ):
        data = make_encoder(table(role, talkers=("GN", "GP")), AROUND).encode(0.0, reading)
        assert [line[1:6].decode() for line in data.splitlines()] == formatters


def test_a_compass_sends_what_it_measures_and_no_variation() -> None:
    around = Surroundings(UTC_NS, variation_deg=-2.5)
    assert lines("compass", HeadingReading(120.94), around=around) == ["$HCHDG,123.4,,,,*46"]
    assert lines("compass", HeadingReading(357.46), around=around)[0].startswith("$HCHDG,000.0,")
    assert lines("compass", HeadingReading(7.4, decimals=0))[0].startswith("$HCHDG,007,")
    reading = HeadingReading(1.0, pitch_deg=-1.25, roll_deg=-0.04, turn_rate_deg_s=-0.5)
    hdg, rot, xdr = lines("compass", reading)
    assert rot.startswith("$HCROT,-30.0,A*")
    assert re.fullmatch(r"\$HCXDR,A,-1\.[23],D,PITCH,A,0\.0,D,ROLL\*..", xdr)
    assert lines("compass", reading, "hsc100") == [hdg]


def test_compasses_say_that_their_field_is_disturbed() -> None:
    reading = HeadingReading(309.8, pitch_deg=4.0, roll_deg=-2.9)
    disturbed = HeadingReading(309.8, pitch_deg=4.0, roll_deg=-2.9, disturbed=True)
    assert lines("compass", reading, "tcm2")[0].startswith("$C309.8P4.0R-2.9*")
    assert lines("compass", disturbed, "tcm2")[0].startswith("$C309.8P4.0R-2.9E001*")
    assert lines("compass", HeadingReading(309.8, decimals=0), "tcm2")[0].startswith("$C310.0*")
    assert lines("compass", reading, "hmr3000")[0].startswith("$PTNTHPR,309.8,N,4.0,N,-2.9,N*")
    assert lines("compass", disturbed, "hmr3000")[0].startswith("$PTNTHPR,309.8,O,4.0,N,-2.9,N*")
    # A C100 has no tilt sensors and no warning.
    assert lines("compass", disturbed, "kvh-c100") == ["%309.8"]


def test_an_imu_line_is_that_of_an_arduimu_with_analogs() -> None:
    encoder = make_encoder(table("imu", "arduimu"), AROUND)
    encoder.encode(0.05, ImuReading(0.0, 0.0, 0.0))
    line = encoder.encode(0.15, ImuReading(9.80665 / 4096 * 12, -9.80665 / 4096 * 7, 20.0))
    assert line == (
        b"!!!VER:1.9,AN0:0,AN1:0,AN2:328,AN3:-12,AN4:7,AN5:4096,RLL:0.00,PCH:0.00,YAW:2.00,IMUH:253,TOW:0***\r\n"
    )
    # 20 of them a second fit 38400 baud.
    assert 20 * (len(line) + 20) < 3840


def test_an_imu_line_has_all_axes_and_the_units_own_attitude() -> None:
    reading = ImuReading(
        0.0, 0.0, 0.0, -4.0, roll_rate_deg_s=10.0, pitch_rate_deg_s=-5.0, roll_deg=-0.004, pitch_deg=3.0
    )
    (line,) = lines("imu", reading, "arduimu")
    assert "AN0:164,AN1:-82,AN2:0," in line
    assert "AN5:1671,RLL:0.00,PCH:3.00," in line


def test_an_imu_saturates_like_its_converter() -> None:
    (line,) = lines("imu", ImuReading(1000.0, -1000.0, 1e6), "arduimu")
    assert "AN2:32767,AN3:-32768,AN4:32767," in line


def test_a_gyro_line_is_that_of_the_sketch() -> None:
    encoder = make_encoder(table("gyro", "tinkerkit"), AROUND)
    assert encoder.encode(81.2, TurnRateReading(-1.0004)).startswith(b"$PWFXG,81200,A,-1000,440*")
    saturated = encoder.encode(2**32 / 1000 + 0.05, TurnRateReading(1500.001))
    assert saturated.startswith(b"$PWFXG,50,S,1500001,440*")
    outcome = make_driver(table("gyro", "tinkerkit")).feed(Line(0, saturated.rstrip()))
    assert outcome == Rejected("saturated", "gyro1")


def test_radar_lines_are_those_of_a_simrad_4g() -> None:
    ttm, tll = lines(
        "radar",
        RadarReading(
            1, range_m=889.0, bearing_true_deg=263.6, sog_m_s=0.0, course_true_deg=2.9,
            lat_deg=58 + 12.687 / 60, lon_deg=11 + 31.9502 / 60, name="1 (Broadband 4G - 2782 B)",
        ),
    )  # fmt: skip
    assert ttm.startswith("$RATTM,01,0.48,263.6,T,0.0,2.9,T,,,N,1 (Broadband 4G - 2782 B),T,,030719,M*")
    assert tll.startswith("$RATLL,01,5812.6870,N,01131.9502,E,1 (Broadband 4G - 2782 B),030719,T,*")
    (lost,) = lines("radar", RadarReading(7, status="lost", name="Stena, *Öland*"))
    assert lost.startswith("$RATTM,07,,,T,,,T,,,N,Stena land,L,,030719,M*")


def test_ais_sentences_go_out_as_they_came() -> None:
    sentence = "!AIVDM,1,1,,B,,0*25"
    assert make_encoder(table("ais"), AROUND).encode(0.0, AisReading(sentence)) == sentence.encode() + b"\r\n"


def test_every_model_has_a_driver_and_an_encoder() -> None:
    for role, model in MODELS:
        assert callable(make_driver(table(role, model)).feed)
        assert callable(make_encoder(table(role, model), AROUND).encode)
    with pytest.raises(WayfixError, match="no driver"):
        make_encoder(table("gyro", "arduimu"), AROUND)


DIGESTS = {
    1: ("bda22a80f5b6f5d3", "7e089c9531a6df80", "2600f4da4edb9289"),
    2: ("8426018f19f6e64c", "138cf6275ead2d4f", "e7a5390644ae000c"),
    3: ("5869d0b5c4358ec2", "aa445e794110f889", "95d0b80626e5d15c"),
}
"""Seed -> SHA-256, its first 16 digits, of what GPS, compass and IMU say in the first 60 s of scenario 5.3, as it
was when the boat could have no other sensors."""


@pytest.mark.parametrize("seed", DIGESTS)
def test_the_bytes_of_the_boat_of_three_ports_stay_as_they_were(seed: int) -> None:
    voyage = scenario_voyage("5.3", seed, 60.0)
    around = Surroundings(UTC_NS, voyage.boat.variation_deg or 0.0)
    found = []
    for one in (table("gps"), table("compass"), table("imu", "arduimu")):
        encoder = make_encoder(one, around)
        mine = (timed for timed in voyage.readings if timed.sensor == one.id)
        data = b"".join(encoder.encode(timed.t_s, timed.reading) for timed in mine)
        found.append(hashlib.sha256(data).hexdigest()[:16])
    assert tuple(found) == DIGESTS[seed]
