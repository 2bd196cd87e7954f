"""One Fix for each receiver epoch, whatever the order and the baud rate; time, void fixes, held positions."""

from datetime import UTC, datetime

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from common.framer import Measurement
from common.messages import ClockPair, Fix, RawLine
from onboard.devices import Accepted, Ignored, Line, Rejected, make_driver
from onboard.devices.nmea_fields import DAY_MS
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import GGA, GSA, MS, RMC, S, fixes, gps, line, measured, pairs, sealed


def gga(time: str, place: str = "5020.1000,N,00408.2000,W", quality: str = "1") -> bytes:
    return sealed(f"GPGGA,{time},{place},{quality},08,1.1,5.0,M,50.0,M,,")


def rmc(time: str, sog: str = "5.0", date: str = "150726", status: str = "A", mode: str = "A") -> bytes:
    return sealed(f"GPRMC,{time},{status},5020.1000,N,00408.2000,W,{sog},90.0,{date},,,{mode}")


def run(sentences: list[tuple[float, bytes]], **table: object) -> list[Measurement]:
    """Feed (seconds, sentence) pairs, then flush."""
    driver = make_driver(gps(**table))
    out: list[Measurement] = []
    for t_s, data in sentences:
        out += measured(driver.feed(line(data, round(t_s * S))))
    return [*out, *driver.flush(10**18, 0)]


def test_gga_gsa_rmc_of_one_second_make_one_fix() -> None:
    out = run([(1.0, GGA), (1.1, GSA), (1.15, RMC)], latency_ms=300)
    (fix,) = fixes(tuple(out))
    assert fix == Fix(
        sensor="gps1",
        t_ns=700 * MS,
        lat_deg=-(37 + 47.0873 / 60),
        lon_deg=175 + 18.8938 / 60,
        alt_m=59.9,
        fix_quality=1,
        fix_mode=3,
        status_valid=True,
        satellites=8,
        hdop=1.1,
        pdop=1.8,
        vdop=1.5,
        sog_kn=0.69,
        cog_true_deg=None,
        utc_ns=int(datetime(2014, 12, 31, 3, 7, 19, tzinfo=UTC).timestamp()) * S,
        tod_ms=11_239_000,
    )
    assert [(m.t_ns, m.text.encode()) for m in out if isinstance(m, RawLine)] == [
        (1000 * MS, GGA),
        (1100 * MS, GSA),
        (1150 * MS, RMC),
    ]


def test_the_fix_comes_with_the_next_epoch_or_150_ms_after_the_last_byte() -> None:
    driver = make_driver(gps())
    assert not fixes(measured(driver.feed(line(gga("120000"), 0))))
    assert not fixes(measured(driver.feed(Line(100 * MS, rmc("120000"), 200 * MS))))
    assert driver.flush(349 * MS, 0) == ()
    (fix,) = fixes(driver.flush(350 * MS, 0))
    assert fix.t_ns == 0
    assert driver.flush(400 * MS, 0) == ()
    assert not fixes(measured(driver.feed(line(gga("120001"), 1000 * MS))))
    (second,) = fixes(measured(driver.feed(line(gga("120002"), 1100 * MS))))
    assert second.tod_ms == 43_201_000


def test_a_slow_baud_rate_does_not_split_an_epoch() -> None:
    """4800 baud: GGA 0.16 s, GSV group 0.45 s, then RMC; flushed every 20 ms as the daemon does."""
    gsv = b"$GPGSV,3,1,12,17,72,207,32,28,59,095,31,06,35,347,25,01,29,132,23*7B"
    burst = b"\r\n".join([gga("120000.000"), GSA, gsv, gsv, gsv, rmc("120000.000"), b""])
    driver, splitter = make_driver(gps()), LineSplitter()
    out: list[Measurement] = []
    for tick in range(100):
        now_ns = tick * 20 * MS
        for found in splitter.feed(burst[tick * 10 : tick * 10 + 10], now_ns):
            outcome = driver.feed(found)
            out += outcome.measurements if isinstance(outcome, Accepted) else ()
        out += driver.flush(splitter.complete_until(now_ns), 0)
    (fix,) = fixes(tuple(out))
    assert (fix.sog_kn, fix.fix_mode, fix.fix_quality) == (5.0, 3, 1)
    (pair,) = pairs(tuple(out))
    assert pair.t_ns == fix.t_ns == 0


def test_a_sentence_after_the_flush_makes_no_second_fix() -> None:
    driver = make_driver(gps())
    driver.feed(line(gga("120000"), 0))
    assert len(fixes(driver.flush(200 * MS, 0))) == 1
    late = measured(driver.feed(line(rmc("120000"), 300 * MS)))
    assert len(pairs(late)) == 1
    assert driver.flush(10**18, 0) == ()


def test_position_comes_from_gga_else_rmc_else_gll() -> None:
    gll = sealed("GPGLL,5000.0000,N,00400.0000,W,120000,A,A")
    place = "5010.0000,N,00410.0000,W"
    found = [fixes(tuple(run(list(enumerate(group)))))[0].lat_deg for group in (
        [gll, rmc("120000"), gga("120000", place)], [gll, rmc("120000")], [gll],
    )]  # fmt: skip
    assert found == [pytest.approx(50 + 10 / 60), pytest.approx(50 + 20.1 / 60), pytest.approx(50.0)]


def test_vtg_serves_where_rmc_has_no_speed_and_course_needs_1_kn() -> None:
    vtg = sealed("GPVTG,77.5,T,,M,1.5,N,2.8,K,A")
    (fix,) = fixes(tuple(run([(0, gga("120000")), (0.01, vtg)])))
    assert (fix.sog_kn, fix.cog_true_deg) == (1.5, 77.5)
    (fix,) = fixes(tuple(run([(0, vtg), (0.01, gga("120000")), (0.02, rmc("120000", sog="0.9"))])))
    assert (fix.sog_kn, fix.cog_true_deg) == (0.9, None)


def test_one_antenna_with_four_talkers_is_one_fix() -> None:
    gnss = [gga("120000")]
    gnss += [sealed(f"{talker}GSA,A,3,,,,,,,,,,,,,2.0,1.0,1.7,1") for talker in ("GP", "GL", "GA", "GN")]
    gnss += [sealed("GNRMC,120000,A,5020.1000,N,00408.2000,W,5.0,90.0,150726,,,A")]
    assert len(fixes(tuple(run([(i / 100, data) for i, data in enumerate(gnss)])))) == 1


@pytest.mark.parametrize(
    "group",
    [
        [b"$GPRMC,,V,,,,,,,,,,N*53", b"$GPVTG,,,,,,,,,N*30", b"$GPGGA,,,,,,0,00,99.99,,,,,,*48"],
        [b"$GPGGA,235947.050,,,,,0,00,,,M,0.0,M,,0000*5D", b"$GPRMC,235947.050,V,,,,,,,281006,,*29"],
        [gga("120000", quality="0"), rmc("120000", status="V", mode="N")],
        [sealed("GPRMC,120000,V,0000.0000,N,00000.0000,E,,,150726,,")],
    ],
)
def test_void_epochs_have_no_position(group: list[bytes]) -> None:
    out = tuple(run([(i / 100, data) for i, data in enumerate(group)]))
    (fix,) = fixes(out)
    assert (fix.lat_deg, fix.lon_deg, fix.utc_ns, fix.usable) == (None, None, None, False)
    assert pairs(out) == []


def test_empty_epochs_of_a_cold_receiver_are_one_fix_a_second() -> None:
    group = [b"$GPRMC,,V,,,,,,,,,,N*53", b"$GPVTG,,,,,,,,,N*30", b"$GPGGA,,,,,,0,00,99.99,,,,,,*48"]
    out = run([(second + i / 100, data) for second in range(5) for i, data in enumerate(group)])
    assert [fix.t_ns for fix in fixes(tuple(out))] == [second * S for second in range(5)]


@pytest.mark.parametrize("quality", ["6", "7", "8"])
def test_estimated_manual_and_simulated_positions_are_kept_but_not_usable(quality: str) -> None:
    (fix,) = fixes(tuple(run([(0, gga("120000", quality=quality))])))
    assert fix.lat_deg is not None
    assert not fix.usable
    mode = {"6": "E", "7": "M", "8": "S"}[quality]
    out = tuple(run([(0, rmc("120000", mode=mode))]))
    assert fixes(out)[0].fix_quality == int(quality)
    assert pairs(out) == []


def test_status_v_with_a_position_is_kept_but_not_usable() -> None:
    (fix,) = fixes(tuple(run([(0, rmc("120000", status="V", mode="E"))])))
    assert fix.lat_deg is not None
    assert not fix.usable


def test_clock_pair_has_the_time_of_the_first_byte_less_the_latency_and_comes_once() -> None:
    zda = sealed("GPZDA,120000,15,07,2026,00,00")
    out = tuple(run([(1.0, gga("120000")), (1.1, rmc("120000")), (1.12, zda)], latency_ms=200))
    noon_ns = int(datetime(2026, 7, 15, 12, tzinfo=UTC).timestamp()) * S
    assert pairs(out) == [ClockPair(sensor="gps1", t_ns=800 * MS, utc_ns=noon_ns, source="RMC")]
    (pair,) = pairs(tuple(run([(1.0, zda)])))
    assert (pair.utc_ns, pair.source) == (noon_ns, "ZDA")


@pytest.mark.parametrize(
    "data",
    [
        rmc("120000", status="V"),
        rmc("235960", date="311226"),
        sealed("GPZDA,120000,,,,00,00"),
        rmc("120000", date=""),
    ],
)
def test_no_clock_pair_without_a_date_or_from_an_invalid_fix(data: bytes) -> None:
    assert pairs(tuple(run([(0, data)]))) == []


def test_zda_alone_is_no_fix() -> None:
    assert fixes(tuple(run([(0, sealed("GPZDA,120000,15,07,2026,00,00"))]))) == []


def test_midnight_without_rmc_invents_no_date() -> None:
    out = tuple(run([(0, gga("235959")), (0.01, rmc("235959")), (1, gga("000000"))]))
    before, after = fixes(out)
    assert before.utc_ns == int(datetime(2026, 7, 15, 23, 59, 59, tzinfo=UTC).timestamp()) * S
    assert (after.utc_ns, after.tod_ms) == (None, 0)


def held(sog: str | None, places: list[str], step_s: float = 1.0) -> list[bool]:
    """The held flag of a run of epochs, one for each place."""
    sentences = []
    for number, place in enumerate(places):
        time = f"12{int(number * step_s) // 60:02d}{number * step_s % 60:06.3f}"
        sentences.append((number * step_s, gga(time, f"{place},N,00408.2000,W")))
        if sog is not None:
            sentences.append((number * step_s + 0.01, sealed(f"GPVTG,90.0,T,,M,{sog},N,,K,A")))
    return [fix.held for fix in fixes(tuple(run(sentences)))]


def test_a_position_repeated_while_the_boat_moves_is_held() -> None:
    assert held("5.0", ["5020.1000", "5020.1000", "5020.1000", "5020.1010"]) == [False, True, True, False]
    assert held("1.0", ["5020.1000", "5020.1000"]) == [False, True]


def test_a_moored_boat_is_not_held() -> None:
    assert not any(held("0.4", ["5020.1000"] * 30))


def test_slow_motion_within_the_resolution_is_not_held() -> None:
    assert held("1.0", ["5020.1000"] * 8, step_s=0.1) == [False] * 8
    assert held("2.0", ["5020.10"] * 10) == [False] * 10


def test_without_speed_ten_seconds_of_the_same_digits_are_held_if_the_digits_are_fine() -> None:
    assert held(None, ["5020.1000"] * 12) == [False] * 10 + [True] * 2
    assert not any(held(None, ["5020.100"] * 30))


def test_a_receiver_whose_time_stands_still_is_held() -> None:
    out = run([(second, gga("120000")) for second in range(3)])
    assert [fix.held for fix in fixes(tuple(out))] == [False, True, True]


def test_talkers_and_other_sentences() -> None:
    driver = make_driver(gps(talkers=("GP",)))
    assert driver.claims(line(GGA))
    assert not driver.claims(line(sealed("GNGGA,1")))
    assert not driver.claims(line(sealed("GPHDT,1.0,T")))
    assert not driver.claims(line(b"$PSRFTXT,WAAS Enable"))
    gsv = b"$GPGSV,3,3,12,11,12,132,04,08,38,008,,02,35,348,,03,14,091,*73"
    assert driver.feed(line(gsv)) == Ignored("GSV")
    assert driver.feed(line(GGA[:-1] + b"0")) == Rejected("checksum", "gps1")


def gns(time: str, place: str = "5020.1000,N,00408.2000,W", modes: str = "AANN", talker: str = "GN") -> bytes:
    return sealed(f"{talker}GNS,{time},{place},{modes},12,0.9,6.0,50.0,,")


def test_gns_stands_between_gga_and_rmc() -> None:
    place = "5010.0000,N,00410.0000,W"
    (fix,) = fixes(tuple(run([(0, rmc("120000")), (0.01, gns("120000", place, "RRNN"))])))
    assert fix.lat_deg == pytest.approx(50 + 10 / 60)
    assert (fix.fix_quality, fix.satellites) == (4, 12)
    assert (fix.hdop, fix.alt_m, fix.status_valid) == (0.9, 6.0, True)
    (fix,) = fixes(tuple(run([(0, gns("120000", place)), (0.01, gga("120000"))])))
    assert fix.lat_deg == pytest.approx(50 + 20.1 / 60)
    assert fix.satellites == 8
    (fix,) = fixes(tuple(run([(0, gga("120000", ",,,", "0")), (0.01, gns("120000"))])))
    assert (fix.fix_quality, fix.usable) == (1, True)


def test_void_gns_has_no_position() -> None:
    (fix,) = fixes(tuple(run([(0, gns("120000", modes="NNNN")), (0.01, rmc("120000", status="V", mode="N"))])))
    assert (fix.lat_deg, fix.fix_quality, fix.usable) == (None, 0, False)


def test_gns_of_each_constellation_behind_the_one_of_all_is_the_same_fix() -> None:
    """NMEA 4: GNGNS with the position, then GPGNS and GLGNS with hardly any field."""
    group = [gns("120000"), gns("120000", ",,,", "", "GP"), gns("120000", ",,,", "", "GL")]
    for order in (group, group[::-1]):
        (fix,) = fixes(tuple(run([(i / 100, data) for i, data in enumerate(order)])))
        assert fix.lat_deg == pytest.approx(50 + 20.1 / 60)
        assert fix.fix_quality == 1


def test_gga_of_two_talkers_is_one_fix_cold_or_not() -> None:
    """SiRFstarV writes GPGGA and GLGGA in one epoch, without time before the first fix."""
    body = "120000,5020.1000,N,00408.2000,W,1,08,1.1,5.0,M,50.0,M,,"
    warm = [sealed(f"GPGGA,{body}"), sealed(f"GLGGA,{body}"), rmc("120000")]
    cold = [sealed("GPGGA,,,,,,0,00,,,,,,,"), sealed("GLGGA,,,,,,0,00,,,,,,,"), sealed("GNRMC,,V,,,,,,,,,,N")]
    for group in (warm, cold):
        out = run([(second + i / 100, data) for second in range(3) for i, data in enumerate(group)])
        assert len(fixes(tuple(out))) == 3


def test_gsa_without_a_fix_gives_way_to_one_with() -> None:
    out = [gga("120000")]
    out += [sealed("GPGSA,A,1,,,,,,,,,,,,,99.9,99.9,99.9"), sealed("GLGSA,A,3,70,,,,,,,,,,,,2.0,1.0,1.7")]
    (fix,) = fixes(tuple(run([(i / 100, data) for i, data in enumerate(out)])))
    assert (fix.fix_mode, fix.pdop, fix.usable) == (3, 2.0, True)


def test_zda_is_not_believed_beside_rmc() -> None:
    """An AC12 dates its ZDA 2 s ahead of the RMC of the same second."""
    zda = "GPZDA,1200{:02d},15,07,2026,00,00"
    sentences = [(0.0, rmc("120000")), (0.1, sealed(zda.format(2))), (1.0, rmc("120001")), (1.1, sealed(zda.format(3)))]
    assert [pair.source for pair in pairs(tuple(run(sentences)))] == ["RMC", "RMC"]
    late = [*sentences, (11.5, sealed(zda.format(12)))]
    assert [pair.source for pair in pairs(tuple(run(late)))] == ["RMC", "RMC", "ZDA"]


def test_the_banner_of_a_receiver_is_ignored_and_empty_sentences_are_void() -> None:
    driver = make_driver(gps())
    assert driver.feed(line(sealed("GPTXT,01,01,02,u-blox ag - www.u-blox.com"))) == Ignored("TXT")
    assert driver.feed(line(sealed("GNTXT,01,01,02,ANTSTATUS=OK"))) == Ignored("TXT")
    group = [
        "GNRMC,,V,,,,,,,,,,N,V",
        "GNVTG,,,,,,,,,N",
        "GNGGA,,,,,,0,00,99.99,,,,,,",
        "GNGNS,,,,,,NNNN,00,99.99,,,,,V",
    ]
    group += ["GNGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99,1", "GNGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99,2"]
    (fix,) = fixes(tuple(run([(i / 100, sealed(body)) for i, body in enumerate([*group, "GNGLL,,,,,,V,N"])])))
    assert (fix.lat_deg, fix.hdop, fix.pdop, fix.fix_mode, fix.usable) == (None, None, None, 1, False)


# One step of the last digit is 1e-5 minute: values are drawn as whole steps, so that the text says them exactly.
@given(
    st.integers(-90 * 60 * 10**5, 90 * 60 * 10**5),
    st.integers(-180 * 60 * 10**5, 180 * 60 * 10**5),
    st.integers(0, DAY_MS - 1),
)
def test_every_position_and_time_comes_back(lat_steps: int, lon_steps: int, tod_ms: int) -> None:
    assume((lat_steps, lon_steps) != (0, 0))
    place = f"{angle(lat_steps, 2)},{'NS'[lat_steps < 0]},{angle(lon_steps, 3)},{'EW'[lon_steps < 0]}"
    seconds, ms = divmod(tod_ms, 1000)
    time = f"{seconds // 3600:02d}{seconds // 60 % 60:02d}{seconds % 60:02d}.{ms:03d}"
    bodies = [
        f"GPGGA,{time},{place},1,08,1.1,5.0,M,50.0,M,,",
        f"GNGNS,{time},{place},AN,08,1.1,5.0,50.0,,",
        f"GPRMC,{time},A,{place},5.0,90.0,150726,,,A",
        f"GPGLL,{place},{time},A,A",
    ]
    for body in bodies:
        (fix,) = fixes(tuple(run([(0, sealed(body))])))
        assert fix.tod_ms == tod_ms
        assert fix.lat_deg == pytest.approx(lat_steps / 6e6, abs=1e-11)
        assert fix.lon_deg == pytest.approx(lon_steps / 6e6, abs=1e-11)
        assert fix.usable


def angle(steps: int, digits: int) -> str:
    """Steps of 1e-5 minute as `ddmm.mmmmm`."""
    degrees, rest = divmod(abs(steps), 60 * 10**5)
    return f"{degrees:0{digits}d}{rest // 10**5:02d}.{rest % 10**5:05d}"


@given(st.lists(st.binary(max_size=90) | st.sampled_from([GGA, RMC, GSA, gns("120000")]), max_size=12))
def test_no_bytes_make_it_raise(data: list[bytes]) -> None:
    driver = make_driver(gps())
    for number, one in enumerate(data):
        assert isinstance(driver.feed(line(one, number * 100 * MS)), Accepted | Rejected | Ignored)
    driver.flush(10**18, 0)


def test_gll_without_status() -> None:
    (fix,) = fixes(tuple(run([(0.0, sealed("GPGLL,4807.0380,N,01131.0000,E"))])))
    assert fix.usable
    assert fix.lat_deg == pytest.approx(48.1173)
    driver = make_driver(gps())
    assert driver.feed(line(sealed("GPGLL,4807.0380,N,01131.0000,E,120000"))) == Rejected("status", "gps1")
