"""Boat clock -> UTC: what receivers and boards do to it, pair by pair."""

import random
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.framer import Framer, Identity, Utc
from common.messages import ClockPair, Event
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices import make_driver
from onboard.devices.gps.dates import EARLIEST_UTC_NS, LATEST_UTC_NS, ROLLOVER_NS, Dates
from onboard.devices.gps.driver import GpsDriver
from onboard.reading.utc_clock import UNCERTAINTY_NS, ClockMap
from tests.acquire.sentences import gps, line, measured, pairs, sealed
from tests.cases import CASES, needs_cases

UTC0 = 1_750_000_000 * NS_PER_S


def pair(t_ns: int, utc_ns: int, sensor: str = "gps1") -> ClockPair:
    return ClockPair(sensor=sensor, t_ns=t_ns, utc_ns=utc_ns, source="RMC")


def test_nothing_is_claimed_before_the_first_pair() -> None:
    assert ClockMap().at(5).utc_ns is None
    assert ClockMap().at(5).source == "none"


def test_late_arrivals_do_not_move_the_mapping() -> None:
    mapping, rng = ClockMap(), random.Random(1)
    for k in range(60):
        late_ns = rng.randrange(300) * NS_PER_MS if k != 17 else 0
        assert mapping.add(pair(k * NS_PER_S + late_ns, UTC0 + k * NS_PER_S)) is None
    assert mapping.at(10 * NS_PER_S).utc_ns == UTC0 + 10 * NS_PER_S


def started(mapping: ClockMap) -> ClockMap:
    for k in range(5):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
    return mapping


def test_a_step_is_believed_at_its_third_pair_told_once_and_starts_a_new_epoch() -> None:
    mapping = started(ClockMap())
    told = [mapping.add(pair(k * NS_PER_S, UTC0 + (100 + k) * NS_PER_S)) for k in range(5, 10)]
    assert told == [None, None, 100.0, None, None]
    assert mapping.epoch == 1
    assert mapping.at(7 * NS_PER_S).utc_ns == UTC0 + 107 * NS_PER_S


def test_one_wrong_date_changes_nothing() -> None:
    mapping = started(ClockMap())
    assert mapping.add(pair(5 * NS_PER_S, UTC0 + 86_400 * NS_PER_S)) is None
    assert mapping.add(pair(6 * NS_PER_S, UTC0 + 6 * NS_PER_S)) is None
    assert mapping.epoch == 0
    assert mapping.at(6 * NS_PER_S).utc_ns == UTC0 + 6 * NS_PER_S


def test_two_receivers_that_disagree_do_not_step_to_and_fro() -> None:
    mapping, steps = started(ClockMap()), []
    for k in range(5, 60):
        mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S))
        wrong = ClockPair(sensor="gps2", t_ns=k * NS_PER_S, utc_ns=UTC0 + (k + 50) * NS_PER_S, source="RMC")
        steps.append(mapping.add(wrong))
    assert set(steps) == {None}


def test_a_first_default_date_is_not_believed() -> None:
    mapping = ClockMap()
    mapping.add(pair(0, UTC0 - 10**9 * NS_PER_S))
    assert mapping.at(0).utc_ns is None
    for k in range(1, 4):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
    assert mapping.at(3 * NS_PER_S).utc_ns == UTC0 + 3 * NS_PER_S
    assert mapping.epoch == 0


# A board without a battery clock


def test_a_board_from_1970_learns_utc_after_a_minute_and_no_boat_time_moves() -> None:
    """The boat clock counts from the boot whatever the date; the wall clock has no way in (tests/system)."""
    mapping, grid_ns = ClockMap(), NS_PER_S // 10
    framer = Framer(Identity("b", "0" * 16, "clock", 1), [], 0)
    frames = []
    for t1_ns in range(grid_ns, 90 * NS_PER_S + 1, grid_ns):
        if t1_ns > 60 * NS_PER_S and t1_ns % NS_PER_S == 0:
            assert mapping.add(pair(t1_ns - grid_ns, UTC0 + t1_ns - grid_ns)) is None
        frames.append(framer.tick(t1_ns, mapping.at(framer.t0_ns), mapping.epoch, ()))
    assert [frame.t1_ns for frame in frames] == list(range(grid_ns, 90 * NS_PER_S + 1, grid_ns))
    assert {frame.clk_epoch for frame in frames} == {0}  # the first mapping is no step
    without = [frame for frame in frames if frame.utc_ns is None]
    assert 60 <= len(without) / 10 <= 63
    assert frames[: len(without)] == without
    assert {frame.utc_src for frame in without} == {"none"}
    assert all(frame.utc_ns == UTC0 + frame.t0_ns for frame in frames[len(without) :])


def test_the_doubt_grows_while_no_receiver_speaks() -> None:
    mapping = started(ClockMap())
    hour = mapping.at(3_604 * NS_PER_S)
    assert hour.utc_ns == UTC0 + 3_604 * NS_PER_S
    assert mapping.at(60 * NS_PER_S).uncertainty_ns == UNCERTAINTY_NS
    assert hour.uncertainty_ns == UNCERTAINTY_NS + 177 * NS_PER_MS


def test_what_the_boat_clock_drifted_meanwhile_is_no_step() -> None:
    mapping = started(ClockMap())
    t_ns = 5 * 3_600 * NS_PER_S
    gained_ns = t_ns * 45 // 1_000_000
    assert gained_ns > 750 * NS_PER_MS
    for k in range(70):
        assert mapping.add(pair(t_ns + k * NS_PER_S + gained_ns, UTC0 + t_ns + k * NS_PER_S)) is None
    assert mapping.epoch == 0
    assert mapping.at(t_ns + gained_ns + 70 * NS_PER_S).utc_ns == UTC0 + t_ns + 70 * NS_PER_S


# Steps, late and early pairs


@pytest.mark.parametrize("step_s", [-1, 1, -3, 18, 3_600, -86_400])
def test_a_step_is_found_through_any_lateness(step_s: int) -> None:
    """-1: a leap second; 18: a receiver that learns of all of them."""
    mapping, rng, told = ClockMap(), random.Random(step_s), []
    for k in range(100):
        late_ns = rng.randrange(400) * NS_PER_MS
        utc_ns = UTC0 + k * NS_PER_S + (step_s * NS_PER_S if k >= 50 else 0)
        told.append(mapping.add(pair(k * NS_PER_S + late_ns, utc_ns)))
    (found,) = [step for step in told if step is not None]
    assert found == pytest.approx(step_s, abs=0.45)
    assert mapping.epoch == 1
    true_ns = UTC0 + (99 + step_s) * NS_PER_S
    assert 0 <= true_ns - (mapping.at(99 * NS_PER_S).utc_ns or 0) < 400 * NS_PER_MS


def test_a_date_that_stands_still_at_midnight_is_no_step() -> None:
    day_ns, before = 86_400 * NS_PER_S, 40
    midnight_ns = UTC0 // day_ns * day_ns + day_ns
    for stuck in (3, 100):  # receivers write the new date some seconds late; others never do
        mapping = ClockMap()
        for k in range(100):
            utc_ns = midnight_ns + (k - before) * NS_PER_S
            is_stuck = before <= k < before + stuck
            assert mapping.add(pair(k * NS_PER_S, utc_ns - day_ns if is_stuck else utc_ns)) is None
        assert mapping.at(99 * NS_PER_S).utc_ns == midnight_ns + (99 - before) * NS_PER_S


def test_the_epochs_that_waited_in_a_busy_board_are_no_step() -> None:
    for rate_hz in (1, 5, 10):
        mapping, period_ns = ClockMap(), NS_PER_S // rate_hz
        for k in range(20 * rate_hz):
            t_ns = k * period_ns
            if 10 * NS_PER_S < t_ns < 14 * NS_PER_S:  # nothing was read for four seconds, then all in one chunk or two
                t_ns = 14 * NS_PER_S - (NS_PER_MS if t_ns < 12 * NS_PER_S else 0)
            assert mapping.add(pair(t_ns, UTC0 + k * period_ns)) is None
        assert mapping.at(0).utc_ns == UTC0


@given(
    st.integers(1, 10),
    st.lists(st.tuples(st.integers(0, 450), st.booleans()), min_size=5, max_size=80),
    st.integers(-50, 50),
)
def test_utc_is_never_ahead_and_never_later_than_the_latest_pair(
    rate_hz: int, arrivals: list[tuple[int, bool]], drift_ppm: int
) -> None:
    """Any lateness, any drift of the crystal, damaged dates in between: no step, and UTC within the lateness."""
    mapping, last_wrong = ClockMap(), -9
    for k, (late_ms, is_damaged) in enumerate(arrivals):
        true_ns = k * NS_PER_S // rate_hz
        t_ns = true_ns + true_ns * drift_ppm // 1_000_000 + late_ms * NS_PER_MS
        is_wrong = is_damaged and k > 2 and k - last_wrong > 3
        last_wrong = k if is_wrong else last_wrong
        assert mapping.add(pair(t_ns, UTC0 + true_ns - (86_400 * NS_PER_S if is_wrong else 0))) is None
        utc_ns = mapping.at(t_ns).utc_ns
        if k > 1:
            assert utc_ns is not None
            error_ns = utc_ns - (UTC0 + t_ns)
            assert -456 * NS_PER_MS <= error_ns <= 5 * NS_PER_MS
    assert mapping.epoch == 0


ANY_PAIRS = st.lists(
    st.tuples(st.sampled_from(["gps1", "gps2", "gps3"]), st.integers(0, 2**50), st.integers(0, 2**62)), max_size=60
)


@given(ANY_PAIRS)
def test_any_pairs_in_any_order(said: list[tuple[str, int, int]]) -> None:
    told: list[Event] = []
    mapping, steps = ClockMap(told.append), 0
    for sensor, t_ns, utc_ns in said:
        steps += mapping.add(pair(t_ns, utc_ns, sensor)) is not None
        assert mapping.epoch == steps
        doubt_ns = mapping.at(t_ns).uncertainty_ns
        assert doubt_ns is None or doubt_ns >= UNCERTAINTY_NS
    assert len(told) <= 3


# Two receivers


def test_receivers_that_disagree_are_told_once_and_the_first_holds() -> None:
    told: list[Event] = []
    mapping = started(ClockMap(told.append))
    for k in range(5, 65):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
        for part in range(5):  # the other one is five times as fast
            t_ns = k * NS_PER_S + part * NS_PER_S // 5
            assert mapping.add(pair(t_ns, UTC0 + t_ns + 50 * NS_PER_S, "gps2")) is None
    assert [(item.code, item.source) for item in told] == [("receivers-disagree", "gps2")]
    assert told[0].text == "gps2 and gps1 give UTC 50.0 s apart; that of gps1 holds"


def test_when_the_first_falls_silent_the_other_is_one_step_and_holds_from_then_on() -> None:
    mapping = started(ClockMap())
    steps = [mapping.add(pair(k * NS_PER_S, UTC0 + (k + 50) * NS_PER_S, "gps2")) for k in range(5, 40)]
    assert [step for step in steps if step is not None] == [50.0]
    assert steps.index(50.0) + 5 == 15  # ten seconds after gps1 was heard last
    for k in range(40, 60):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + (k + 50) * NS_PER_S, "gps2")) is None
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S)) is None
    assert mapping.epoch == 1


def test_a_receiver_that_jumps_alone_is_not_followed_while_another_holds() -> None:
    mapping = started(ClockMap())
    for k in range(5, 60):
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S, "gps2")) is None
        jumped = 3_600 * NS_PER_S if k > 20 else 0
        assert mapping.add(pair(k * NS_PER_S, UTC0 + k * NS_PER_S + jumped)) is None
    assert mapping.epoch == 0


# Real sentences: midnight and the leap second


def rmc(utc: str, date: str) -> bytes:
    return sealed(f"GPRMC,{utc},A,3747.0873,S,17518.8938,E,0.69,181.39,{date},,,A")


def mapped(*sentences: tuple[str, str]) -> tuple[ClockMap, list[float]]:
    """One RMC a second through driver and mapping; the steps."""
    driver, mapping, steps = GpsDriver(gps()), ClockMap(), []
    for k, sentence in enumerate(sentences):
        for each in pairs(measured(driver.feed(line(rmc(*sentence), k * NS_PER_S)))):
            step_s = mapping.add(each)
            steps += [] if step_s is None else [step_s]
    return mapping, steps


def utc_text(mapping: ClockMap, second: int) -> str:
    utc_ns = mapping.at(second * NS_PER_S).utc_ns
    assert utc_ns is not None
    return f"{datetime.fromtimestamp(utc_ns / NS_PER_S, UTC):%d %H:%M:%S}"


def test_midnight_even_when_the_date_comes_a_second_late() -> None:
    evening = [(f"2359{second}", "310726") for second in range(50, 60)]
    for odd in ("010826", "310726"):
        mapping, steps = mapped(*evening, ("000000", odd), *((f"0000{s:02}", "010826") for s in range(1, 10)))
        assert steps == []
        assert [utc_text(mapping, second) for second in (9, 10, 19)] == ["31 23:59:59", "01 00:00:00", "01 00:00:09"]


def test_a_leap_second_is_one_step_of_minus_one() -> None:
    evening = [(f"2359{second}", "311226") for second in range(50, 61)]
    mapping, steps = mapped(*evening, *((f"0000{second:02}", "010127") for second in range(20)))
    assert steps == [-1.0]
    assert mapping.epoch == 1
    assert utc_text(mapping, 30) == "01 00:00:19"


# Dates that cannot be


NOW_NS = 1_795_000_000 * NS_PER_S
"""November 2026."""
NO_UTC = Utc(None, None, "none")


def judged(dates: Dates, utc_ns: int, known_ns: int | None = None, count: int = 12) -> list[ClockPair | None]:
    known = NO_UTC if known_ns is None else Utc(known_ns, 0, "gnss")
    return [dates.judge(pair(k, utc_ns), known) for k in range(count)]


def test_a_possible_date_passes_as_it_is() -> None:
    told: list[Event] = []
    dates = Dates(told.append, ["gps1"])
    for utc_ns in (EARLIEST_UTC_NS, NOW_NS, LATEST_UTC_NS - 1):
        assert judged(dates, utc_ns) == [pair(k, utc_ns) for k in range(12)]
    assert told == []


def test_a_week_rollover_is_told_once_and_not_used_without_proof() -> None:
    told: list[Event] = []
    dates = Dates(told.append)
    assert set(judged(dates, NOW_NS - ROLLOVER_NS, count=50)) == {None}
    assert [item.code for item in told] == ["week-rollover"]
    assert told[0].text == (
        "gps1 gives the date 2007-04-04, which is past; if its GPS weeks have begun anew, it is 2026-11-18: not used"
    )
    assert set(judged(dates, NOW_NS - ROLLOVER_NS, NOW_NS + 3_600 * NS_PER_S)) == {None}  # another hour proves nothing


def test_a_week_rollover_is_repaired_where_the_known_utc_proves_it_or_the_boards_file_says_so() -> None:
    for dates_of, known_ns in ((Dates, NOW_NS + NS_PER_S), (lambda tell: Dates(tell, ["gps1"]), None)):
        told: list[Event] = []
        (repaired,) = set(judged(dates_of(told.append), NOW_NS - ROLLOVER_NS, known_ns, count=1))
        assert repaired is not None
        assert (repaired.utc_ns, repaired.source) == (NOW_NS, "RMC+1024w")
        judged(dates_of(told.append), NOW_NS - ROLLOVER_NS, known_ns, count=50)
        assert [item.code for item in told] == ["week-rollover-repaired"]
        assert "2026-11-18 is used" in told[0].text


@needs_cases
@pytest.mark.parametrize("repaired", [True, False])
def test_two_rollovers(repaired: bool) -> None:
    """The date is 2048 weeks old: repaired where the board's file says so, else offered."""
    told: list[Event] = []
    driver, dates = make_driver(gps()), Dates(told.append, ["gps1"] if repaired else [])
    used: list[ClockPair | None] = []
    for k, data in enumerate((CASES / "board" / "two-rollovers.nmea").read_bytes().splitlines()):
        used += [dates.judge(one, NO_UTC) for one in pairs(measured(driver.feed(line(data, k * NS_PER_S))))]
    noon_ns = int(datetime(2026, 8, 29, 12, tzinfo=UTC).timestamp()) * NS_PER_S
    assert used == [
        ClockPair(sensor="gps1", t_ns=k * NS_PER_S, utc_ns=noon_ns + k * NS_PER_S, source="RMC+2048w")
        if repaired
        else None
        for k in range(12)
    ]
    assert [item.code for item in told] == ["week-rollover-repaired" if repaired else "week-rollover"]
    assert "1987-05-30" in told[0].text
    assert "2026-08-29" in told[0].text


def test_a_rollover_at_sea_moves_nothing() -> None:
    told: list[Event] = []
    dates, mapping = Dates(told.append), ClockMap(told.append)
    for k in range(200):
        said_ns = NOW_NS + k * NS_PER_S - (ROLLOVER_NS if k >= 100 else 0)
        use = dates.judge(pair(k * NS_PER_S, said_ns), mapping.at(k * NS_PER_S))
        assert use is not None
        assert mapping.add(use) is None
    assert mapping.epoch == 0
    assert mapping.at(199 * NS_PER_S).utc_ns == NOW_NS + 199 * NS_PER_S
    assert [item.code for item in told] == ["week-rollover-repaired"]


@pytest.mark.parametrize("utc_ns", [0, 315_964_800 * NS_PER_S, LATEST_UTC_NS, 2**62])
def test_what_no_turn_of_the_weeks_explains_is_refused(utc_ns: int) -> None:
    told: list[Event] = []
    assert set(judged(Dates(told.append, ["gps1"]), utc_ns, NOW_NS)) == {None}
    assert [item.code for item in told] == ["date-refused"]


def test_a_few_odd_dates_of_a_receiver_just_woken_are_not_told() -> None:
    told: list[Event] = []
    dates = Dates(told.append)
    for _ in range(5):
        judged(dates, NOW_NS - ROLLOVER_NS, count=9)
        judged(dates, 0, count=9)
        judged(dates, NOW_NS, count=1)
    assert told == []


@given(st.integers(0, 2**62), st.one_of(st.none(), st.integers(0, 2**62)), st.booleans())
def test_nothing_impossible_ever_passes(utc_ns: int, known_ns: int | None, is_configured: bool) -> None:
    dates = Dates(lambda _: None, ["gps1"] if is_configured else ())
    for use in judged(dates, utc_ns, known_ns):
        assert use is None or EARLIEST_UTC_NS <= use.utc_ns < LATEST_UTC_NS
        assert use is None or use.utc_ns - utc_ns in (0, ROLLOVER_NS, 2 * ROLLOVER_NS)
