"""KVH C100: its own lines without checksum in their one form, and NMEA with and without checksum."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import Heading
from onboard.devices import Accepted, Line, Rejected, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import MS, compass, heading, line, sealed


def kvh(data: bytes) -> object:
    driver = make_driver(compass(model="kvh-c100"))
    assert driver.claims(line(data))
    return driver.feed(line(data))


@pytest.mark.parametrize(
    ("data", "kind", "value", "pitch", "roll"),
    [
        (b"%0012,-034,1234", "KVH", 123.4, 1.2, -3.4),
        (b"%-900,1800,0000", "KVH", 0.0, -90.0, 180.0),
        (b"%0000,0000,3600", "KVH", 0.0, 0.0, 0.0),
        (b"%123.4", "KVH", 123.4, None, None),
        (b"%007.0", "KVH", 7.0, None, None),
        (b"$HCHDM,123.4,M*2D", "HDM", 123.4, None, None),
        (sealed("HCHDM,123.4,M,"), "HDM", 123.4, None, None),
        (sealed("HCHDG,123.4,"), "HDG", 123.4, None, None),
        (b"$HCHDM,123.4,M", "HDM", 123.4, None, None),
        (b"$HCHDM,003.4,M,", "HDM", 3.4, None, None),
        (b"$HCHDM,360.0,M", "HDM", 0.0, None, None),
    ],
)
def test_headings(data: bytes, kind: str, value: float, pitch: float | None, roll: float | None) -> None:
    wanted = Heading(sensor="compass1", t_ns=0, heading_mag_deg=value, pitch_deg=pitch, roll_deg=roll)
    assert kvh(data) == Accepted("compass1", kind, (wanted,))


def test_true_heading_of_the_family() -> None:
    driver = make_driver(compass(model="kvh-c100"))
    assert heading(driver.feed(line(sealed("HCHDT,123.4,T,")))).heading_true_deg == 123.4


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"%", "form"),
        (b"%1234", "form"),
        (b"%23.4", "form"),
        (b"%0123.4", "form"),
        (b"%-23.4", "form"),
        (b"%123.4*2D", "form"),
        (b"%123.4 ", "form"),
        (b"%123.4%123.4", "form"),
        (b"%0012,0034", "form"),
        (b"%0012,0034,123.4", "form"),
        (b"%012,0034,1234", "form"),
        (b"%-0012,0034,1234", "form"),
        (b"%+012,0034,1234", "form"),
        (b"%0012,0034,-234", "form"),
        (b"%0012,0034,1234,", "form"),
        (b"%0012,0034,12\xff4", "form"),
        (b"%" + b"1" * 80, "too-long"),
        (b"%360.1", "range"),
        (b"%0000,0000,3601", "range"),
        (b"%0901,0000,1234", "range"),
        (b"%0000,1801,1234", "range"),
        (b"$HCHDM,360.1,M", "range"),
        (b"$HCHDM,23.4,M", "no-checksum"),
        (b"$HCHDM,0123.4,M", "no-checksum"),
        (b"$HCHDM,123.45,M", "no-checksum"),
        (b"$HCHDM,123.4,T", "no-checksum"),
        (b"$HCHDM,123.4,M,,", "no-checksum"),
        (b"$HCHDM,123.4,M*", "no-checksum"),
        (b"$HCHDM,123.4,M*2", "no-checksum"),
        (b"$HCHDM,123.4,", "no-checksum"),
        (b"$IIHDM,123.4,M", "no-checksum"),
        (b"$HCHDG,123.4,", "no-checksum"),
        (b"$HCHDM,123.4,M*2E", "checksum"),
        (b"$HCHDM,123.4,M$HCHDM,123.4,M", "run-together"),
    ],
)
def test_refusals(data: bytes, reason: str) -> None:
    assert kvh(data) == Rejected(reason, "compass1")


def test_a_unit_that_has_sent_a_checksum_is_held_to_it() -> None:
    driver = make_driver(compass(model="kvh-c100"))
    bare = line(b"$HCHDM,123.4,M")
    assert isinstance(driver.feed(bare), Accepted)
    # A wrong checksum proves nothing.
    assert driver.feed(line(b"$HCHDM,123.4,M*2E")) == Rejected("checksum", "compass1")
    assert isinstance(driver.feed(bare), Accepted)
    assert isinstance(driver.feed(line(b"$HCHDM,123.4,M*2D")), Accepted)
    assert driver.feed(bare) == Rejected("no-checksum", "compass1")


def test_lines_that_end_with_cr_alone_and_the_latency() -> None:
    driver = make_driver(compass(model="kvh-c100", latency_ms=30))
    lines = LineSplitter().feed(b"%123.4\r%123.5\r%0012,0034,1236\r\n", 100 * MS)
    found = [heading(driver.feed(one)) for one in lines]
    assert [one.heading_mag_deg for one in found] == [123.4, 123.5, 123.6]
    assert {one.t_ns for one in found} == {70 * MS}
    assert heading(driver.feed(Line(100 * MS, b"$HCHDM,123.4,M"))).t_ns == 70 * MS
    assert driver.flush(10**18, 0) == ()


def characters(tenths: int) -> str:
    """Four characters, a minus among them: from -99.9 to 999.9."""
    return f"{tenths:04d}"


@given(st.integers(0, 3599), st.integers(-900, 900), st.integers(-999, 1800))
def test_round_trip(azimuth: int, pitch: int, roll: int) -> None:
    driver = make_driver(compass(model="kvh-c100"))
    data = f"%{characters(pitch)},{characters(roll)},{characters(azimuth)}"
    found = heading(driver.feed(line(data.encode())))
    assert (found.heading_mag_deg, found.pitch_deg, found.roll_deg) == (azimuth / 10, pitch / 10, roll / 10)
    for alone in (f"%{azimuth / 10:05.1f}", f"$HCHDM,{azimuth / 10:05.1f},M"):
        assert heading(driver.feed(line(alone.encode()))).heading_mag_deg == azimuth / 10
