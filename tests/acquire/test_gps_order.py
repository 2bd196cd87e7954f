"""Sentences without time before or after the position, and other devices on the port, at real line times."""

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.messages import Fix
from onboard.devices import PortDecoder, make_driver
from onboard.reading.line_splitter import LineSplitter
from tests.acquire.sentences import MS, S, compass, fixes, gps, measured, sealed

FOREIGN = ["IIMWV,45.0,R,12.5,N,A", "IIVHW,,T,,M,5.1,N,,K", "SDDBT,7.7,f,2.3,M,1.3,F", "IIMTW,17.9,C"]


def gga(k: int, rate_hz: int = 1) -> str:
    return f"GPGGA,{clock(k, rate_hz)},4807.{380 + k:04d},N,01131.0000,E,1,08,0.9,545.4,M,46.9,M,,"


def rmc(k: int, status: str = "A") -> str:
    return f"GPRMC,{clock(k)},{status},4807.{380 + k:04d},N,01131.0000,E,{k + 2}.0,84.4,230326,,,A"


def vtg(k: int) -> str:
    return f"GPVTG,84.4,T,,M,{k + 2}.0,N,9.63,K,A"


def gsa(k: int) -> str:
    return f"GPGSA,A,{1 + k % 3},04,05,,09,12,,,24,,,,,2.5,1.3,2.1"


def clock(k: int, rate_hz: int = 1) -> str:
    return f"1200{k // rate_hz:02d}.{k % rate_hz * 100 // rate_hz:02d}"


def fixes_of(bursts: list[list[str]], baud: int = 4800, period_ns: int = S, tick_ns: int = 100 * MS) -> list[Fix]:
    """Each burst begins on its own period; bytes come in portions at the baud rate, ticks flush as the daemon does."""
    decoder = PortDecoder([make_driver(gps()), make_driver(compass())])
    splitter, found, tick = LineSplitter(), [], 0
    for k, burst in enumerate(bursts):
        data = b"".join(sealed(body) + b"\r\n" for body in burst)
        for begin in range(0, len(data), 8):
            now_ns = k * period_ns + (begin + 8) * 10 * S // baud
            while tick + tick_ns <= now_ns:
                tick += tick_ns
                found += fixes(decoder.flush(splitter.complete_until(tick)))
            for line in splitter.feed(data[begin : begin + 8], now_ns):
                outcome = decoder.feed(line)
                if hasattr(outcome, "measurements"):
                    found += fixes(measured(outcome))
    return found + fixes(decoder.flush(tick + 10 * S))


def speeds(found: list[Fix]) -> list[float | None]:
    return [fix.sog_kn for fix in found]


ORDERS = {
    "VTG first": lambda k: [vtg(k), gga(k)],
    "VTG last": lambda k: [gga(k), vtg(k)],
    "VTG between": lambda k: [gga(k), vtg(k), f"GPZDA,{clock(k)},23,03,2026,00,00"],
    "GNSS compass": lambda k: [gga(k), "GPHDT,123.4,T", "GPROT,-3.0,A", vtg(k), f"GPZDA,{clock(k)},23,03,2026,00,00"],
    "GSV tables": lambda k: [vtg(k), gga(k), "GPGSV,1,1,01,04,50,100,30", "GPGSV,1,1,01,05,50,100,30"],
}


@pytest.mark.parametrize("order", ORDERS)
def test_speed_belongs_to_its_own_epoch_whatever_the_order(order: str) -> None:
    found = fixes_of([ORDERS[order](k) for k in range(8)], baud=9600)
    assert speeds(found) == [k + 2.0 for k in range(8)]


@pytest.mark.parametrize("vtg_first", [True, False])
def test_the_same_at_ten_hertz(vtg_first: bool) -> None:
    bursts = [[vtg(k), gga(k, 10)] if vtg_first else [gga(k, 10), vtg(k)] for k in range(30)]
    found = fixes_of(bursts, baud=38400, period_ns=100 * MS)
    assert speeds(found) == [k + 2.0 for k in range(30)]


@pytest.mark.parametrize("lines", range(5))
def test_other_devices_between_the_sentences_of_an_epoch_do_not_cut_it(lines: int) -> None:
    found = fixes_of([[gga(k), *FOREIGN[:lines], rmc(k)] for k in range(6)])
    assert speeds(found) == [k + 2.0 for k in range(6)]
    assert all(fix.utc_ns is not None and fix.status_valid for fix in found)


def test_a_void_status_behind_other_devices_is_not_missed() -> None:
    found = fixes_of([[gga(k), *FOREIGN, rmc(k, "V")] for k in range(6)])
    assert [fix.usable for fix in found] == [False] * 6


def test_no_fix_of_a_leading_gsa_is_not_missed() -> None:
    found = fixes_of([[gsa(k), gga(k)] for k in range(9)])
    assert [fix.fix_mode for fix in found] == [1 + k % 3 for k in range(9)]
    assert [fix.usable for fix in found] == [k % 3 > 0 for k in range(9)]


def test_a_port_without_quiet_delays_a_fix_by_no_more_than_half_a_second() -> None:
    decoder = PortDecoder([make_driver(gps()), make_driver(compass())])
    splitter = LineSplitter()
    for line in splitter.feed(sealed(gga(0)) + b"\r\n", 0):
        decoder.feed(line)
    for now_ms in range(20, 1000, 20):
        for line in splitter.feed(sealed("HCHDG,123.4,,,,") + b"\r\n", now_ms * MS):
            decoder.feed(line)
        if found := fixes(decoder.flush(splitter.complete_until(now_ms * MS))):
            assert now_ms <= 500
            assert found[0].t_ns == 0
            return
    raise AssertionError("no fix")


@given(st.permutations(["gga", "rmc", "vtg", "gsa"]), st.sampled_from([4800, 9600, 38400]), st.integers(0, 2))
def test_any_order_of_a_burst_gives_one_whole_fix_an_epoch(order: list[str], baud: int, foreign: int) -> None:
    make: dict[str, Callable[[int], str]] = {"gga": gga, "rmc": rmc, "vtg": vtg, "gsa": lambda _: gsa(1)}
    found = fixes_of([[make[name](k) for name in order] + FOREIGN[:foreign] for k in range(5)], baud)
    assert speeds(found) == [k + 2.0 for k in range(5)]
    assert all(fix.fix_mode == 2 and fix.utc_ns is not None for fix in found)
