"""GST: what a receiver claims of its own error joins the fix of the same UTC, and never disturbs it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.codec import decode_frame, encode_frame
from common.framer import Measurement
from common.messages import Fix, Frame
from onboard.devices import Accepted, Line, Rejected, make_driver
from tests.acquire.sentences import GGA, GSA, MS, RMC, S, fixes, gps, line, measured, recording, sealed

AT = "030719.000"
GST = sealed(f"GPGST,{AT},4.0,8.7,4.7,132.3,6.8,7.2,14.0")
SIGMAS = (7.2, 6.8)


def only_fix(sentences: list[bytes]) -> Fix:
    driver = make_driver(gps())
    out: list[Measurement] = []
    for number, data in enumerate(sentences):
        out += measured(driver.feed(line(data, S + number * MS)))
    (fix,) = fixes((*out, *driver.flush(10**18, 0)))
    return fix


def sigmas(fields: str) -> tuple[float | None, float | None]:
    """East and north of the fields after the time."""
    fix = only_fix([GGA, sealed(f"GNGST,{AT},{fields}"), RMC])
    return fix.sigma_east_m, fix.sigma_north_m


@pytest.mark.parametrize("place", range(4))
def test_it_joins_the_epoch_of_its_time_wherever_it_stands(place: int) -> None:
    burst = [GGA, GSA, RMC]
    with_gst = only_fix([*burst[:place], GST, *burst[place:]])
    assert (with_gst.sigma_east_m, with_gst.sigma_north_m) == SIGMAS
    without = only_fix(burst)
    assert (without.sigma_east_m, without.sigma_north_m) == (None, None)


def test_nothing_else_of_a_fix_depends_on_it() -> None:
    driver, bare = make_driver(gps()), make_driver(gps())
    for second in range(3):
        epoch = [data.replace(b"030719", b"03072%d" % second)[:-3] for data in (GGA, GST, RMC)]
        for number, data in enumerate(sealed(one[1:].decode()) for one in epoch):
            t_ns = second * S + number * 100 * MS
            found = fixes(measured(driver.feed(Line(t_ns, data, t_ns + 50 * MS))))
            if number == 1:
                assert found == []
                continue
            wanted = fixes(measured(bare.feed(Line(t_ns, data, t_ns + 50 * MS))))
            assert [fix.t_ns for fix in found] == [fix.t_ns for fix in wanted]
            assert all((fix.sigma_east_m, fix.sigma_north_m) == SIGMAS for fix in found)


def test_one_that_comes_after_the_fix_is_not_waited_for_and_makes_none() -> None:
    driver = make_driver(gps())
    for number, data in enumerate((GGA, RMC)):
        measured(driver.feed(line(data, number * MS)))
    (fix,) = fixes(driver.flush(151 * MS, 0))
    assert fix.sigma_east_m is None
    assert not fixes(measured(driver.feed(line(GST, 200 * MS))))
    assert driver.flush(10**18, 0) == ()


@pytest.mark.parametrize("time", ["030718.000", "030719.100", ""])
def test_one_of_another_time_or_of_none_is_left_out(time: str) -> None:
    fix = only_fix([GGA, sealed(f"GPGST,{time},4.0,8.7,4.7,132.3,6.8,7.2,14.0"), RMC])
    assert (fix.sigma_east_m, fix.sigma_north_m) == (None, None)


def test_a_fix_without_a_place_has_no_sigma() -> None:
    void = [sealed(f"GPGGA,{AT},,,,,0,00,,,M,0.0,M,,0000"), GST, sealed(f"GPRMC,{AT},V,,,,,,,311214,,")]
    fix = only_fix(void)
    assert (fix.lat_deg, fix.sigma_east_m, fix.sigma_north_m) == (None, None, None)


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        # u-blox leaves the ellipse out.
        ("1.8,,,,1.7,1.3,2.2", (1.3, 1.7)),
        (",,,,0.011,0.014,", (0.014, 0.011)),
        # Zeros, kilometres, one axis alone, nothing: not known.
        ("0,0,0,0,0,0,0", (None, None)),
        ("12,,,,3750000,3750000,3750000", (None, None)),
        ("1.8,,,,1.7,,", (None, None)),
        ("1.8,,,,1.7,-1.3,", (None, None)),
        (",,,,,,", (None, None)),
        # An ellipse stands in for axes that are not there, or make no sense.
        ("1.8,5.0,2.0,0.0,,,", (2.0, 5.0)),
        ("1.8,5.0,2.0,90.0,0.0,0.0,", (5.0, 2.0)),
        ("1.8,5.0,2.0,270.0,,,", (5.0, 2.0)),
        ("1.8,5.0,2.0,,,,", (None, None)),
        ("1.8,5.0,0.0,45.0,,,", (math.sqrt(12.5), math.sqrt(12.5))),
    ],
)
def test_what_is_believed(fields: str, wanted: tuple[float | None, float | None]) -> None:
    for found, value in zip(sigmas(fields), wanted, strict=True):
        assert found == (None if value is None else pytest.approx(value))


def test_the_ellipse_of_a_real_receiver_is_its_axes() -> None:
    east_m, north_m = sigmas("004.0,008.7,004.7,132.3,,,")
    assert east_m == pytest.approx(7.2, abs=0.06)
    assert north_m == pytest.approx(6.8, abs=0.06)


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        (f"GPGST,{AT},4.0,8.7,4.7,132.3,6.8,7.2", "fields"),
        (f"GPGST,{AT},4.0,8.7,4.7,132.3,6.8,nan,14.0", "not-a-number"),
        (f"GPGST,{AT},4.0,8.7,4.7,1e3,6.8,7.2,14.0", "not-a-number"),
        ("GPGST,250000,4.0,8.7,4.7,132.3,6.8,7.2,14.0", "time"),
    ],
)
def test_a_bad_one_is_counted_and_its_epoch_is_whole(body: str, reason: str) -> None:
    driver = make_driver(gps())
    measured(driver.feed(line(GGA)))
    assert driver.feed(line(sealed(body), 10 * MS)) == Rejected(reason, "gps1")
    measured(driver.feed(line(RMC, 20 * MS)))
    (fix,) = fixes(driver.flush(10**18, 0))
    assert (fix.satellites, fix.sog_kn, fix.sigma_east_m) == (8, 0.69, None)


numbers = st.one_of(
    st.just(""), st.floats(-1e4, 1e4).map(lambda value: f"{value:.4f}"), st.sampled_from(["0.001", "1000"])
)


@given(st.lists(numbers, min_size=7, max_size=7))
def test_whatever_it_says_the_frame_can_be_sent(values: list[str]) -> None:
    driver = make_driver(gps())
    for data in (GGA, sealed(f"GPGST,{AT},{','.join(values)}"), RMC):
        driver.feed(line(data))
    (fix,) = fixes(driver.flush(10**18, 0))
    assert (fix.sigma_east_m is None) == (fix.sigma_north_m is None)
    frame = Frame(boat_id="b", boot_id="0", seq=0, clock_id="c", start_no=1, t0_ns=0, t1_ns=1000, fixes=(fix,))
    assert decode_frame(encode_frame(frame)).fixes == (fix,)


def test_a_real_receiver_claims_metres() -> None:
    driver, found, lines = make_driver(gps()), [], recording("gpsd-receivers/quectel-L70.log").splitlines()
    sent = 0
    for number, data in enumerate(lines):
        t_ns = number * 20 * MS
        if not driver.claims(line(data, t_ns)):
            continue
        outcome = driver.feed(line(data, t_ns))
        if b"GST," in data:
            assert isinstance(outcome, Accepted), data
            sent += 1
        if isinstance(outcome, Accepted):
            found += fixes(outcome.measurements)
    found += fixes(driver.flush(10**18, 0))
    claims = [(fix.sigma_east_m, fix.sigma_north_m) for fix in found if fix.sigma_east_m is not None]
    assert sent == len(claims) == 16
    assert claims[:2] == [(7.2, 6.8), (7.1, 6.7)]
