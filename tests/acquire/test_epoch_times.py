"""Epochs whose sentences do not carry one time: ZDA and GLL with a clock of their own, decimals, repetitions."""

from dataclasses import dataclass, replace
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.framer import Measurement
from common.messages import ClockPair, Fix
from onboard.devices import Accepted, Line, make_driver
from onboard.devices.gps.driver import ASIDE
from onboard.devices.nmea_fields import DAY_MS, tod_step_ms
from tests.acquire.sentences import MS, S, fixes, gps, pairs, sealed
from tests.cases import CASES, needs_cases

Timed = tuple[int, bytes]
"""Arrival in ms, and the line."""
NOON: Final = 43_200_000


def heard(lines: list[Timed]) -> tuple[list[Fix], list[ClockPair], list[str]]:
    """Fixes, pairs and kinds of a receiver's lines; quiet is looked for every 20 ms, as in the daemon."""
    driver, out, kinds, tick_ms = make_driver(gps()), list[Measurement](), [], 0
    for ms, data in lines:
        while tick_ms + 20 <= ms:
            tick_ms += 20
            out += driver.flush(tick_ms * MS, 0)
        outcome = driver.feed(Line(ms * MS, data))
        assert isinstance(outcome, Accepted), (data, outcome)
        out += outcome.measurements
        kinds.append(outcome.kind)
    out += driver.flush(lines[-1][0] * MS + 10 * S, 0)
    return fixes(tuple(out)), pairs(tuple(out)), kinds


def clock(tod_ms: int, decimals: int) -> str:
    """`hhmmss[.sss]`, cut."""
    second, ms = divmod(tod_ms % DAY_MS, 1000)
    text = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}"
    return f"{text}.{ms:03d}"[: 7 + decimals] if decimals else text


def place(k: int) -> str:
    return f"5020.{1000 + k:05d},N,00408.20000,W"


def gga(k: int, time: str) -> bytes:
    return sealed(f"GPGGA,{time},{place(k)},1,08,1.1,5.0,M,50.0,M,,")


def rmc(k: int, time: str, date: str = "150726") -> bytes:
    return sealed(f"GPRMC,{time},A,{place(k)},{5 + k % 7}.0,90.0,{date},,,A")


def gll(k: int, time: str) -> bytes:
    return sealed(f"GPGLL,{place(k)},{time},A,A")


def zda(time: str, date: str = "15,07,2026") -> bytes:
    return sealed(f"GPZDA,{time},{date},00,00")


@dataclass(frozen=True)
class Added:
    """A sentence that is added to each burst."""

    formatter: str
    shift_ms: int
    """Its time less that of the epoch."""
    decimals: int
    rounded: bool
    after: int
    """Number of the burst's sentences before it."""

    def line(self, k: int, tod_ms: int) -> bytes:
        time_ms = tod_ms + self.shift_ms
        step_ms = 10 ** (3 - self.decimals)
        if self.rounded:
            time_ms += step_ms // 2
        time = clock(time_ms, self.decimals)
        return zda(time) if self.formatter == "ZDA" else gll(k, time)


SHIFTS: Final = (0, -1, 1, 20, 40, 1_000, 2_000, 5_000, 18_000, 3_600_000, 12 * 3_600_000, -7_200_000)
ADDED: Final = st.builds(
    Added,
    formatter=st.sampled_from(["ZDA", "GLL"]),
    shift_ms=st.sampled_from(SHIFTS),
    decimals=st.integers(0, 3),
    rounded=st.booleans(),
    after=st.integers(1, 3),
)


@dataclass(frozen=True)
class Stream:
    """A good stream: GGA and RMC, either order, VTG between them or not."""

    rate_hz: int
    first_ms: int
    gga_first: bool
    has_vtg: bool
    rmc_shift_ms: int
    """-1, 0 or 1: .999 beside .00."""
    count: int = 12

    def bursts(self) -> list[tuple[int, list[bytes]]]:
        """(time of day in ms, lines) of each epoch."""
        found = []
        for k in range(self.count):
            tod_ms = self.first_ms + k * 1000 // self.rate_hz
            one = gga(k, clock(tod_ms, 3)), rmc(k, clock(tod_ms + self.rmc_shift_ms, 3))
            lines = list(one if self.gga_first else one[::-1])
            if self.has_vtg:
                lines.insert(1, sealed(f"GPVTG,90.0,T,,M,{5 + k % 7}.0,N,9.3,K,A"))
            found.append((tod_ms, lines))
        return found

    def lines(self, added: Added | None = None) -> list[Timed]:
        """Sentences of a burst come 8 ms apart, the added one between two of them."""
        found: list[Timed] = []
        for k, (tod_ms, burst) in enumerate(self.bursts()):
            begin_ms = k * 1000 // self.rate_hz
            lines = [(begin_ms + 8 * place, data) for place, data in enumerate(burst)]
            if added is not None:
                after = min(added.after, len(lines))
                lines.insert(after, (lines[after - 1][0] + 4, added.line(k, tod_ms)))
            found += lines
        return found


STREAMS: Final = st.builds(
    Stream,
    rate_hz=st.sampled_from([1, 2, 5, 10]),
    first_ms=st.sampled_from([NOON, NOON + 600, DAY_MS - 3000]),
    gga_first=st.booleans(),
    has_vtg=st.booleans(),
    rmc_shift_ms=st.sampled_from([-1, 0, 1]),
)


def same_fixes(stream: Stream, added: Added) -> None:
    before, after = heard(stream.lines()), heard(stream.lines(added))
    assert len(before[0]) == stream.count
    assert after[0] == before[0]
    assert after[1] == before[1]


@settings(max_examples=60)
@given(STREAMS, ADDED)
def test_a_zda_or_gll_with_whatever_time_leaves_a_good_stream_as_it_was(stream: Stream, added: Added) -> None:
    same_fixes(stream, added)


LOSSES: Final = ((), (0,), (1,), (2,), (0, 2), (0, 1, 2))
"""Which lines of a burst are lost; the added one is in the middle."""


def only_right_fixes(stream: Stream, added: Added, losses: list[tuple[int, ...]]) -> None:
    stream = replace(stream, has_vtg=False)  # a VTG that is left alone may stand before any epoch
    lost: set[int] = set()
    for k, places in enumerate(losses, 4):  # the first bursts are whole: leader and period have to be learned
        if len(places) < 2 or not {3 * k - 3, 3 * k - 1} <= lost:
            lost.update(3 * k + place for place in places)
    found = heard([line for number, line in enumerate(stream.lines(replace(added, after=1))) if number not in lost])[0]
    times = [tod_ms for tod_ms, _ in stream.bursts()]
    numbers = [round((fix.lat_deg - 50 - 20.01 / 60) * 6e6) for fix in found if fix.lat_deg is not None]
    assert numbers == sorted(set(numbers))
    for fix, k in zip(found, numbers, strict=True):
        assert fix.tod_ms is not None
        is_gll_alone = fix.sog_kn is None and fix.fix_quality is None
        # Where both leaders are lost a GLL that is a few ms off, or coarse, may stand for them.
        allowed_ms = 10 ** (3 - added.decimals) + 40 if is_gll_alone else 1
        assert abs(tod_step_ms(fix.tod_ms, times[k] % DAY_MS)) <= allowed_ms
        assert 0 <= fix.t_ns // MS - k * 1000 // stream.rate_hz < 40


@settings(max_examples=60)
@given(STREAMS, ADDED, st.lists(st.sampled_from(LOSSES), max_size=8))
def test_whatever_is_lost_every_fix_has_its_own_time_and_none_comes_twice(
    stream: Stream, added: Added, losses: list[tuple[int, ...]]
) -> None:
    """Both leaders are never lost in two bursts that follow each other: then a GLL a second off looks right."""
    only_right_fixes(stream, added, losses)


@pytest.mark.parametrize("formatter", ["ZDA", "GLL"])
@pytest.mark.parametrize("shift_ms", SHIFTS)
@pytest.mark.parametrize("rate_hz", [1, 5, 10])
def test_the_kinds_that_receivers_send(formatter: str, shift_ms: int, rate_hz: int) -> None:
    stream = Stream(rate_hz, NOON + 400, gga_first=True, has_vtg=True, rmc_shift_ms=0)
    for decimals in (0, 2):
        same_fixes(stream, Added(formatter, shift_ms, decimals, rounded=False, after=1))


def case(name: str, bursts: list[int], period_ms: int) -> tuple[list[Fix], list[ClockPair], list[str]]:
    """A file of the cases; its bursts have so many lines each, 10 ms apart."""
    data = (CASES / "board" / name).read_bytes().splitlines()
    lines: list[Timed] = []
    for k in range(len(data) // len(bursts)):
        burst = data[k * len(bursts) : (k + 1) * len(bursts)]
        lines += [(k * period_ms + ms, one) for ms, one in zip(bursts, burst, strict=True) if b"GSV" not in one]
    return heard(lines)


@needs_cases
@pytest.mark.parametrize(
    ("name", "count", "period_ms"),
    [
        ("zda-transmit-time.nmea", 10, 1000),
        ("zda-two-seconds-ahead.nmea", 10, 1000),
        ("gll-whole-seconds-5hz.nmea", 20, 200),
    ],
)
def test_one_fix_an_epoch(name: str, count: int, period_ms: int) -> None:
    found, _, kinds = case(name, [0, 10, 20, 30], period_ms)
    assert [fix.t_ns for fix in found] == [k * period_ms * MS for k in range(count)]
    assert [fix.tod_ms for fix in found] == [NOON + k * period_ms for k in range(count)]
    noon_ns = 1_796_040_000 * S
    assert [fix.utc_ns for fix in found] == [noon_ns + k * period_ms * MS for k in range(count)]
    assert not any(kind.endswith(ASIDE) for kind in kinds)


@needs_cases
@pytest.mark.parametrize("name", ["gll-local-time.nmea", "zda-local-time.nmea"])
def test_a_clock_in_local_time_makes_no_fix_of_its_own(name: str) -> None:
    """Shore cases; the plotter's HDT is left out."""
    data = [one for one in (CASES / "shore" / name).read_bytes().splitlines() if b"HDT" not in one]
    found, _, kinds = heard([(k // 2 * 1000 + 30 * (k % 2), one) for k, one in enumerate(data)])
    assert [fix.tod_ms for fix in found] == [36_480_000 + 1000 * k for k in range(len(data) // 2)]
    assert kinds.count(f"GLL {ASIDE}") == (len(found) - 1 if name.startswith("gll") else 0)


@needs_cases
def test_what_a_plotter_repeats_is_no_second_fix() -> None:
    data = [one for one in (CASES / "shore" / "plotter-repeats.nmea").read_bytes().splitlines() if b"HDT" not in one]
    lines, ms = list[Timed](), 0
    for one in data:
        # The receiver's RMC begins a burst every 2 s; the other lines follow 0.3 s apart.
        ms = (ms // 2000 + 1) * 2000 if one.startswith(b"$GPRMC") else ms + 250
        lines.append((ms, one))
    found, _, kinds = heard(lines)
    times = [fix.tod_ms for fix in found]
    assert times == [36_480_000 + 2000 * k for k in range(len(times))]
    assert len(times) == sum(one.startswith(b"$GPRMC") for one in data)
    assert kinds.count(f"RMC {ASIDE}") > 100


def test_a_repetition_under_the_same_talker_is_set_aside_and_a_clock_that_is_set_back_is_not() -> None:
    old = rmc(0, "120000")
    lines = [(0, old), (1000, rmc(1, "120001")), (1300, old), (2000, rmc(2, "120002")), (3000, rmc(9, "115959"))]
    found, _, kinds = heard(lines)
    assert [fix.tod_ms for fix in found] == [NOON, NOON + 1000, NOON + 2000, NOON - 1000]
    assert kinds == ["RMC", "RMC", f"RMC {ASIDE}", "RMC", "RMC"]


def test_a_gll_between_two_rmc_is_a_fix_once_a_leader_has_confirmed_it() -> None:
    """Old receivers send RMC and GLL of alternate seconds."""
    lines = [
        (1000 * k, rmc(k, clock(NOON + 1000 * k, 0)) if k % 2 == 0 else gll(k, clock(NOON + 1000 * k, 0)))
        for k in range(9)
    ]
    found, _, _ = heard(lines)
    assert [fix.tod_ms for fix in found] == [NOON + 1000 * k for k in range(9)]
    assert [fix.t_ns for fix in found] == [k * S for k in range(9)]


def test_gll_alone_makes_fixes_and_again_ten_seconds_after_the_last_rmc() -> None:
    lines = [(1000 * k, gll(k, clock(NOON + 1000 * k, 2))) for k in range(5)]
    assert len(heard(lines)[0]) == 5
    local = [(1000 * k, gll(k, clock(NOON + 7_200_000 + 1000 * k, 2))) for k in range(1, 15)]
    found, _, _ = heard([(0, rmc(0, "120000")), *local])
    assert [fix.t_ns for fix in found] == [0, *(k * S for k in range(10, 15))]


@pytest.mark.parametrize("order", [0, 1])
def test_999_beside_00_over_midnight_keeps_the_date(order: int) -> None:
    lines = [(0, gga(0, "235959.999")), (10, rmc(0, "000000.00", "160726"))]
    if order:
        lines = [(0, rmc(0, "235959.999", "150726")), (10, gga(0, "000000.00"))]
    (fix,), (pair,), _ = heard(lines)
    midnight_ns = 1_784_160_000 * S
    assert fix.utc_ns is not None
    assert abs(fix.utc_ns - midnight_ns) <= MS
    assert pair.utc_ns == fix.utc_ns


@pytest.mark.parametrize(("time", "date"), [("235959.50", "15,07,2026"), ("000001.50", "16,07,2026")])
def test_a_zda_on_the_other_side_of_midnight_dates_the_epoch_right(time: str, date: str) -> None:
    found, (pair, *_), _ = heard([(0, gga(0, "235959.50")), (20, zda(time, date))])
    assert pair.utc_ns == found[0].utc_ns == 1_784_159_999_500 * MS
    assert pair.source == "ZDA"


def test_zda_gives_no_time_of_its_own_beside_epochs() -> None:
    """Two seconds ahead, without any RMC: the pair has GGA's time."""
    lines = []
    for k in range(3):
        lines += [(1000 * k, gga(k, f"12000{k}")), (1000 * k + 20, zda(f"12000{k + 2}"))]
    found, clocks, _ = heard(lines)
    assert [pair.utc_ns for pair in clocks] == [fix.utc_ns for fix in found]
    assert [pair.t_ns for pair in clocks] == [k * S for k in range(3)]


def test_the_strategies_hold_a_stream_that_the_old_rule_split() -> None:
    """By exact milliseconds this made a second fix: times of one burst do differ here."""
    stream = Stream(5, NOON, gga_first=True, has_vtg=False, rmc_shift_ms=-1)
    times = {data.split(b",")[1 if b"GLL" not in data else 5] for _, data in stream.lines(Added("GLL", 0, 0, False, 1))}
    assert len(times) > 2 * stream.count
    same_fixes(replace(stream, count=4), Added("GLL", 0, 0, rounded=False, after=1))
