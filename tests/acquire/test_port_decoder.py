"""Several sensors on one port, and the registry."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.framer import Measurement
from onboard.devices import (
    Accepted,
    Ignored,
    Line,
    Outcome,
    PortDecoder,
    Rejected,
    make_driver,
    recognised,
)
from tests.acquire.sentences import ARDUIMU, GGA, compass, fixes, gps, imu, line, sealed


def decoder() -> PortDecoder:
    return PortDecoder([make_driver(gps(talkers=("GP", "GN"))), make_driver(compass()), make_driver(imu())])


@pytest.mark.parametrize(
    ("data", "sensor"),
    [(GGA, "gps1"), (b"$HCHDT,86.2,T*15", "compass1"), (sealed("GPHDT,86.2,T"), "compass1"), (ARDUIMU, "imu1")],
)
def test_each_line_finds_its_sensor(data: bytes, sensor: str) -> None:
    outcome = decoder().feed(line(data))
    assert isinstance(outcome, Accepted)
    assert outcome.sensor == sensor


@pytest.mark.parametrize(
    ("data", "outcome"),
    [
        (GGA[:-1] + b"0", Rejected("checksum", "gps1")),
        (GGA[:20], Rejected("no-checksum", "gps1")),
        (b"$HCHDT,86.2,T*16", Rejected("checksum", "compass1")),
        (ARDUIMU[:-2], Rejected("marks", "imu1")),
        (b"$GPXTE,,,,,N,N*5F", Rejected("checksum")),
        (b"$GPXTE,,,,,N,N*5E", Ignored("XTE")),
        (sealed("IIGGA,120000"), Ignored("GGA")),
        (b"!AIVDM,1,1,,B,,0*25", Ignored("VDM")),
        (b"$PSRFTXT,WAAS Enable", Ignored("PSRFTXT")),
        (b"$PTNTHPR,354.9,N,5.2,N,0.2,N*3A", Ignored("PTNTHPR")),
        (b"$PTNTHPR,354.9,N,5.2,N,0.2,N*3B", Rejected("checksum")),
        (GGA[1:], Rejected("not-nmea")),
        (b"\x80\xfe\x00", Rejected("not-ascii")),
        (b"Welcome", Ignored("text")),
        (b"# a comment", Ignored("text")),
    ],
)
def test_what_no_sensor_takes(data: bytes, outcome: Outcome) -> None:
    assert decoder().feed(line(data)) == outcome


def test_the_first_sensor_in_file_order_takes_the_line() -> None:
    port = PortDecoder([make_driver(compass(id="compass1", talkers=("II",))), make_driver(compass(id="compass2"))])
    first, second = port.feed(line(sealed("IIHDT,1.0,T"))), port.feed(line(sealed("HCHDT,1.0,T")))
    assert isinstance(first, Accepted)
    assert isinstance(second, Accepted)
    assert (first.sensor, second.sensor) == ("compass1", "compass2")


def test_flush_gathers_from_all_drivers() -> None:
    port = decoder()
    port.feed(line(GGA))
    assert len(fixes(port.flush(10**18))) == 1


@given(st.binary(max_size=600) | st.binary(max_size=80).map(lambda tail: b"$GPGGA," + tail + b"*00"))
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    port = decoder()
    assert isinstance(port.feed(line(data)), Accepted | Rejected | Ignored)
    for driver in port.drivers:
        assert isinstance(driver.feed(line(data)), Accepted | Rejected | Ignored)
    port.flush(10**18)


@given(
    st.text(st.sampled_from("0123456789.,-NSEWAVMTK"), max_size=90),
    st.sampled_from(["GPGGA", "GPRMC", "HCHDG", "GPZDA"]),
)
def test_right_checksum_over_any_fields_never_raises(fields: str, address: str) -> None:
    assert isinstance(decoder().feed(line(sealed(f"{address},{fields}"))), Accepted | Rejected | Ignored)


def test_an_unknown_model_is_told_with_the_known_ones() -> None:
    with pytest.raises(WayfixError, match=r'role "imu" with model "mpu".*known: "arduimu"'):
        make_driver(imu(model="mpu"))
    with pytest.raises(WayfixError, match=r'role "gyro" with model "nmea".*known: "tinkerkit"'):
        make_driver(gps(id="gyro1", role="gyro"))


def test_lines_of_another_model_are_recognised() -> None:
    port = decoder()
    for data in (b"$C309.8P4.0R-2.9T25.1*03", b"$C310.2P4.2R-2.6T25.1*0C"):
        assert isinstance(port.feed(line(data)), Ignored)
    assert recognised(port.unclaimed) == ("compass", "tcm2")
    assert recognised([line(b"!AIVDM,1,1,,A,B3KLehP0B@LTN6`Vl;rrBE063P06,0*5A")]) == ("ais", "nmea")
    assert recognised([line(b"hello"), line(b"\xff\xfe")]) is None


def test_a_fault_of_ours_costs_its_line_only_and_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    class Broken:
        sensor = "gps1"

        def claims(self, line: Line) -> bool:
            return line.data.startswith(b"$GP")

        def feed(self, line: Line) -> Outcome:
            raise ZeroDivisionError

        def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
            return ()

    port = PortDecoder([Broken(), make_driver(compass())])
    assert [port.feed(line(GGA)) for _ in range(3)] == [Rejected("driver-fault", "gps1")] * 3
    assert isinstance(port.feed(line(sealed("HCHDG,123.4,,,,"))), Accepted)
    assert len(caplog.records) == 1
    assert "GPGGA" in caplog.text
