"""TTM and TLL: units, status, what a real plotter fills in where it has no value."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import SensorTable
from common.messages import RadarTarget, RawLine
from onboard.devices import Accepted, Driver, PortDecoder, Rejected, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import GGA, MS, line, measured, recording, sealed
from tests.cases import CASES, needs_cases

MOVING = b"$RATTM,01,0.52,247.9,T,11.3,235.8,T,0.11,-2.7,N,1 (Broadband 4G - 2782 B),T,,135647,M*6E"
STILL = b"$RATTM,01,0.48,263.6,T,0.0,2.9,T,0.48,,N,1 (Broadband 4G - 2782 B),T,,134601,M*51"
PLACE = b"$RATLL,01,5812.6870,N,01131.9502,E,1 (Broadband 4G - 2782 B),134601,T,*5F"
NAME = "1 (Broadband 4G - 2782 B)"


def driver(*talkers: str, latency_ms: float = 0.0) -> Driver:
    return make_driver(SensorTable(id="radar1", port="p", role="radar", talkers=talkers, latency_ms=latency_ms))


def target(data: bytes) -> RadarTarget:
    found, raw = measured(driver().feed(line(data)))
    assert isinstance(found, RadarTarget)
    assert raw == RawLine(sensor="radar1", t_ns=0, text=data.decode())
    return found


def test_a_moving_target() -> None:
    found, raw = measured(driver(latency_ms=500).feed(line(MOVING, 2000 * MS)))
    assert isinstance(found, RadarTarget)
    assert found.range_m == pytest.approx(963.04)
    assert found.cpa_m == pytest.approx(203.72)
    assert found.tcpa_s == pytest.approx(-162.0)
    assert found.tod_ms == (13 * 3600 + 56 * 60 + 47) * 1000
    assert (found.t_ns, found.number, found.name, found.status) == (1500 * MS, 1, NAME, "tracking")
    assert (found.bearing_true_deg, found.course_true_deg, found.sog_kn) == (247.9, 235.8, 11.3)
    assert found.bearing_rel_deg is found.course_rel_deg is found.lat_deg is found.lon_deg is None
    assert raw == RawLine(sensor="radar1", t_ns=2000 * MS, text=MOVING.decode())


def test_a_still_target_has_a_speed_but_no_course() -> None:
    found = target(STILL)
    assert (found.sog_kn, found.course_true_deg, found.tcpa_s) == (0.0, None, None)
    assert found.cpa_m == pytest.approx(888.96)


def test_a_position() -> None:
    found = target(PLACE)
    assert found.lat_deg == pytest.approx(58 + 12.6870 / 60)
    assert found.lon_deg == pytest.approx(11 + 31.9502 / 60)
    assert (found.number, found.name, found.status) == (1, NAME, "tracking")
    assert found.tod_ms == (13 * 3600 + 46 * 60 + 1) * 1000
    assert found.range_m is found.bearing_true_deg is found.sog_kn is None


@pytest.mark.parametrize(
    ("unit", "range_m", "sog_kn"),
    [("N", 3704.0, 10.0), ("K", 2000.0, 10.0 / 1.852), ("S", 3218.688, 10.0 * 1.609344 / 1.852)],
)
def test_one_letter_rules_distance_cpa_and_speed(unit: str, range_m: float, sog_kn: float) -> None:
    found = target(sealed(f"RATTM,12,2,10.0,R,10,20.0,R,1,12.5,{unit},,T,R,101112.50,A"))
    assert found.range_m == pytest.approx(range_m)
    assert found.cpa_m == pytest.approx(range_m / 2)
    assert found.sog_kn == pytest.approx(sog_kn)
    assert (found.bearing_rel_deg, found.course_rel_deg) == (10.0, 20.0)
    assert (found.bearing_true_deg, found.course_true_deg, found.name) == (None, None, None)
    assert found.tcpa_s == 750.0
    assert found.tod_ms == (10 * 3600 + 11 * 60 + 12) * 1000 + 500


@pytest.mark.parametrize(("letter", "status"), [("Q", "acquiring"), ("L", "lost")])
def test_speed_and_course_are_no_measurement_unless_tracking(letter: str, status: str) -> None:
    found = target(sealed(f"RATTM,03,0.49,278.2,T,0.0,2.9,T,,24751376.1,N,x,{letter},,135624,M"))
    assert (found.status, found.sog_kn, found.course_true_deg, found.tcpa_s) == (status, None, None, None)
    assert found.range_m == pytest.approx(907.48)


def test_tcpa_without_sense_is_missing() -> None:
    assert target(sealed("RATTM,1,1,2,T,3,4,T,1,24751376.1,N,x,T,,,")).tcpa_s is None
    assert target(sealed("RATTM,1,1,2,T,3,4,T,1,-100001,N,x,T,,,")).tcpa_s is None
    assert target(sealed("RATTM,1,1,2,T,3,4,T,,5,N,x,T,,,")).tcpa_s is None


def test_old_forms_and_long_names() -> None:
    assert target(sealed("RATTM,1,1,360.0,T,3,4,T,1,5,N,x,T,")).bearing_true_deg == 0.0
    name = "n" * 80
    assert target(sealed(f"RATTM,1,1,2,T,3,4,T,1,5,N,{name},T,")).name == name[:64]


def test_a_lost_target_needs_no_place() -> None:
    assert target(sealed("RATTM,7,,,,,,,,,,,L,,,")).status == "lost"
    assert target(sealed("RATLL,7,,,,,,,L,")).status == "lost"


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("RATTM,7,,,,,,,,,,,T,,,", "empty"),
        ("RATLL,7,,,,,,,T,", "empty"),
        ("RATTM,,1,2,T,3,4,T,1,5,N,x,T,,,", "fields"),
        ("RATTM,1,1,2,T,3,4,T,1,5,N,x", "fields"),
        ("RATTM,1,1,2,T,3,4,T,1,5,N,x,y,T,,,", "fields"),
        ("RATTM,1,1,2,T,3,4,T,1,5,,x,T,,,", "unit"),
        ("RATTM,1,,2,T,3,4,T,,5,,x,T,,,", "unit"),
        ("RATTM,1,1,2,T,3,4,T,1,5,M,x,T,,,", "unit"),
        ("RATTM,1,1,2,,3,4,T,1,5,N,x,T,,,", "unit"),
        ("RATTM,1,1,2,M,3,4,T,1,5,N,x,T,,,", "unit"),
        ("RATTM,1,1,2,T,3,4,,1,5,N,x,T,,,", "unit"),
        ("RATTM,1,1,2,T,3,4,T,1,5,N,x,A,,,", "status"),
        ("RATTM,1,1,2,T,3,4,T,1,5,N,x,T,,,x", "status"),
        ("RATTM,1,1,2,T,3,4,T,1,5,N,x,T,,256060,A", "time"),
        ("RATTM,1,nan,2,T,3,4,T,1,5,N,x,T,,,", "not-a-number"),
        ("RATTM,1,-1,2,T,3,4,T,1,5,N,x,T,,,", "range"),
        ("RATTM,1,600,2,T,3,4,T,1,5,N,x,T,,,", "range"),
        ("RATTM,1,1,361,T,3,4,T,1,5,N,x,T,,,", "range"),
        ("RATTM,1,1,2,T,1001,4,T,1,5,N,x,T,,,", "range"),
        ("RATTM,10000,1,2,T,3,4,T,1,5,N,x,T,,,", "range"),
        ("RATLL,1,5812.6870,N,,,x,134601,T,", "fields"),
        ("RATLL,1,5812.6870,,01131.9502,E,x,134601,T,", "hemisphere"),
        ("RATLL,1,5862.6870,N,01131.9502,E,x,134601,T,", "range"),
        ("RATLL,1,5812.6870,N,01131.9502,E,x,134601,V,", "status"),
        ("RATLL,1,5812.6870,N,01131.9502,E,x,134601", "fields"),
    ],
)
def test_refusals(body: str, reason: str) -> None:
    assert driver().claims(line(sealed(body)))
    assert driver().feed(line(sealed(body))) == Rejected(reason, "radar1")


def test_claims() -> None:
    assert driver("RA").claims(line(MOVING))
    assert not driver("II").claims(line(MOVING))
    assert not driver().claims(line(GGA))
    assert driver().feed(line(MOVING[:-1] + b"F")) == Rejected("checksum", "radar1")


@pytest.mark.parametrize(
    ("name", "kinds", "statuses"),
    [
        ("1-2000", {"TTM": 57, "TLL": 57}, {"tracking": 43, "acquiring": 14}),
        ("20001-40000", {"TTM": 466, "TLL": 466}, {"tracking": 443, "acquiring": 15, "lost": 8}),
    ],
)
def test_every_target_of_the_recordings(name: str, kinds: dict[str, int], statuses: dict[str, int]) -> None:
    port = PortDecoder([driver()])
    counts: Counter[str] = Counter()
    found: list[RadarTarget] = []
    for one in LineSplitter().feed(recording(f"radar-ttm-nmea/RadarLogs_lines_{name}.txt"), 0):
        outcome = port.feed(one)
        assert not isinstance(outcome, Rejected), (outcome, one.data)
        if isinstance(outcome, Accepted):
            counts[outcome.kind] += 1
            found += [measurement for measurement in outcome.measurements if isinstance(measurement, RadarTarget)]
    assert counts == kinds
    tracks = [one for one in found if one.lat_deg is None]
    assert Counter(one.status for one in tracks) == statuses
    assert all((one.sog_kn is None) == (one.status != "tracking") for one in tracks)
    assert all(one.tcpa_s is None or abs(one.tcpa_s) < 86_400 for one in tracks)
    assert all(one.lat_deg is None or abs(one.lat_deg - 58.21) < 0.05 for one in found)


@given(
    st.integers(0, 9999),
    st.integers(0, 50_000),
    st.integers(0, 3600),
    st.integers(1, 9999),
    st.sampled_from("TR"),
    st.integers(-999, 999),
    st.sampled_from("KNS"),
)
def test_round_trip(number: int, distance: int, bearing: int, speed: int, reference: str, tcpa: int, unit: str) -> None:
    data = sealed(
        f"RATTM,{number:02d},{distance / 100:.2f},{bearing / 10:.1f},{reference},{speed / 10:.1f},{bearing / 10:.1f},"
        f"{reference},{distance / 200:.3f},{tcpa / 10:.1f},{unit},t,T,,000000.00,A"
    )
    metres = {"K": 1000.0, "N": 1852.0, "S": 1609.344}[unit]
    found = target(data)
    assert found.number == number
    assert found.range_m == pytest.approx(distance / 100 * metres)
    assert found.cpa_m == pytest.approx(distance / 200 * metres)
    assert found.sog_kn == pytest.approx(speed / 10 * metres / 1852.0)
    assert found.tcpa_s == pytest.approx(6.0 * tcpa)
    directions = (found.bearing_true_deg, found.course_true_deg, found.bearing_rel_deg, found.course_rel_deg)
    wanted = (bearing % 3600) / 10
    assert directions == ((wanted, wanted, None, None) if reference == "T" else (None, None, wanted, wanted))


@given(st.binary(max_size=100) | st.text("0123456789,.-TRNKSLQ", max_size=90).map(lambda t: sealed(f"RATTM,{t}")))
def test_arbitrary_bytes_never_raise(data: bytes) -> None:
    assert isinstance(driver().feed(line(data)), Accepted | Rejected)


def test_nothing_reckoned_from_a_speed_that_is_none() -> None:
    data = sealed("RATTM,01,0.48,263.6,T,0.0,2.9,T,0.48,1.0,N,X,Q,,134601,M")
    found = target(data)
    assert (found.status, found.sog_kn, found.cpa_m, found.tcpa_s) == ("acquiring", None, None, None)
    assert found.range_m is not None


@needs_cases
def test_ttm_number_with_space() -> None:
    lines = (CASES / "board" / "ttm-number-with-space.nmea").read_bytes().splitlines()
    assert [target(data).number for data in lines] == [1, 2, 3, 1, 2, 3]


def test_a_place_of_zero_is_none_and_the_news_of_a_lost_target_stays() -> None:
    place = "0000.0000,N,00000.0000,E"
    assert target(sealed(f"RATLL,01,{place},,134601,L,")).lat_deg is None
    assert driver().feed(line(sealed(f"RATLL,01,{place},,134601,T,"))) == Rejected("empty", "radar1")
