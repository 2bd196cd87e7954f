"""When the lines of a recording were sent: the times inside decide, wrong ones do not."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from onboard.devices.nmea_fields import tod_step_ms
from onboard.recorded.line_times import Schedule, on_the_wire, sentence_times, without_long_gaps
from tests.acquire.sentences import sealed

DAY_S = 86_400
HDG = sealed("HCHDG,181.8,,,0.6,E")


def hhmmss(second: float) -> str:
    second %= DAY_S
    return f"{int(second) // 3600:02}{int(second) // 60 % 60:02}{second % 60:05.2f}"


def gga(second: float, quality: int = 1) -> bytes:
    return sealed(f"GPGGA,{hhmmss(second)},5310.81,N,00525.70,E,{quality},08,1.1,2,M,,M,,")


def rmc(second: float, status: str = "A") -> bytes:
    return sealed(f"GPRMC,{hhmmss(second)},{status},5310.81,N,00525.70,E,0.0,0.0,160414,,,A")


def zda(second: float) -> bytes:
    return sealed(f"GPZDA,{hhmmss(second)},16,04,2014,00,00")


GSA, GSV, VTG = sealed("GPGSA,A,3,,,,,,,,,,,,,2.1,1.1,1.7"), sealed("GPGSV,1,1,00"), sealed("GPVTG,,T,,M,0.0,N,0.0,K,A")
DBT, XDR, AIS = sealed("SDDBT,1.8,f,0.5,M,0.3,F"), sealed("IIXDR,C,10.7,C,AIRTEMP"), b"!AIVDM,1,1,,A,1,0*00"


def seconds(*lines: bytes) -> list[float]:
    return [round(t_ns / NS_PER_S, 3) for t_ns in sentence_times(lines).at_ns]


def of(*times: float) -> list[float]:
    """Times of the GGA of a recording that has one other line after each."""
    return seconds(*(line for t in times for line in (gga(t), DBT)))[::2]


def test_the_times_in_the_sentences_are_the_times_apart() -> None:
    assert of(100, 101, 102.2, 105, 105.2) == [0.0, 1.0, 2.2, 5.0, 5.2]


def test_other_lines_are_spread_evenly_and_a_burst_stays_together() -> None:
    lines = [gga(1), GSA, rmc(1), VTG, HDG, DBT, gga(2), GSA, rmc(2), VTG, HDG, DBT]
    assert seconds(*lines) == [0.0] * 4 + [0.667, 0.833] + [1.0] * 4 + [1.667, 1.833]


def test_a_receiver_alone_on_the_line_sends_one_burst_a_second() -> None:
    lines = [line for t in range(3) for line in (gga(t), GSA, GSV, GSV, rmc(t))]
    assert seconds(*lines) == [0.0] * 5 + [1.0] * 5 + [2.0] * 5


def test_what_stands_between_two_sentences_of_one_time_goes_with_them() -> None:
    lines = [gga(1), DBT, XDR, DBT, AIS, AIS, AIS, rmc(1), HDG, HDG, gga(2)]
    assert seconds(*lines) == [0.0] * 8 + [0.8, 0.9, 1.0]


def test_a_compass_that_comes_three_times_shows_that_the_receiver_paused() -> None:
    lines = [gga(1), HDG, HDG, HDG, rmc(1), gga(2)]
    assert seconds(*lines) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]


def test_satellite_tables_before_the_time_belong_to_it() -> None:
    second = [GSA, GSV, GSV]
    lines = [line for t in range(3) for line in (*second, rmc(t), gga(t), HDG, HDG)]
    assert seconds(*lines)[:8] == [0.0] * 5 + [0.714, 0.857, 1.0]


def test_lines_before_the_first_and_after_the_last_time_keep_the_pace() -> None:
    lines = [DBT, DBT, gga(7), DBT, gga(8), DBT, gga(9), DBT, DBT]
    schedule = sentence_times(lines)
    assert seconds(*lines) == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
    assert schedule.first_tod_ms == 6000


def test_midnight() -> None:
    assert of(DAY_S - 2, DAY_S - 1, DAY_S, DAY_S + 1) == [0.0, 1.0, 2.0, 3.0]
    assert sentence_times([DBT, gga(0), DBT, gga(1)]).first_tod_ms == DAY_S * 1000 - 500


@pytest.mark.parametrize(
    ("wrong", "count"),
    [(wrong, count) for wrong in (9000, -9000, 40_000, 40, -40) for count in (1, 2, 5)] + [(5, 1), (-5, 1)],
)
def test_wrong_times_do_not_stall_the_recording(wrong: float, count: int) -> None:
    times = [100.0 + t for t in range(60)]
    for index in range(20, 20 + count):
        times[index] += wrong + 3 * (index - 20)
    found = of(*times)
    assert found[-1] == 59.0
    # Lines of a wrong time lie between their neighbours.
    assert all(abs(at - t) <= 1.01 for t, at in enumerate(found))


def test_a_wrong_time_at_the_beginning_or_the_end_is_no_gap() -> None:
    assert of(40_000, 11, 12, 13, 14)[-1] == 4.0
    assert of(5, 40_000, 40_001, 40_002, 40_003)[-1] == 4.0
    assert of(10, 11, 12, 13, 40_000)[-1] == 4.0


def test_a_clock_that_was_set_back_goes_on() -> None:
    assert of(100, 101, 102, 103, 83, 84, 85, 86, 87, 88) == [float(t) for t in range(10)]
    assert of(100, 101, 102, 103, 101, 102, 103, 104, 105)[-1] <= 8.0


def test_a_receiver_without_fix_has_no_gap_when_it_learns_the_time() -> None:
    cold = [line for t in range(4) for line in (gga(t, quality=0), rmc(t, "V"))]
    warm = [line for t in range(50_000, 50_004) for line in (gga(t), rmc(t))]
    schedule = sentence_times([*cold, *warm])
    assert schedule.at_ns[-1] == 7 * NS_PER_S
    assert schedule.gaps == ()


def test_a_gap_is_kept_and_its_lines_stay_before_it() -> None:
    before = [line for t in range(20) for line in (gga(t), HDG, HDG, HDG)]
    after = [line for t in range(818, 838) for line in (gga(t), HDG, HDG, HDG)]
    schedule = sentence_times([*before, *after])
    assert schedule.at_ns[79] == 19.75 * NS_PER_S
    assert schedule.at_ns[80] == 818 * NS_PER_S
    assert [(gap.line, gap.seconds) for gap in schedule.gaps] == [(80, 798.25)]
    shorter = without_long_gaps(schedule.at_ns, 5 * NS_PER_S)
    assert shorter[80] - shorter[79] == 5 * NS_PER_S
    assert shorter[-1] - shorter[80] == schedule.at_ns[-1] - schedule.at_ns[80]


def test_a_clock_that_stands_still_holds_nothing_up() -> None:
    stuck = [line for _ in range(10) for line in (gga(5), rmc(5), HDG)]
    lines = [gga(4), rmc(4), HDG, *stuck, gga(15), rmc(15), HDG, gga(16)]
    found = seconds(*lines)
    assert found[3::3] == [float(t) for t in range(1, 13)]
    assert found[4::3] == found[3:-1:3]


@pytest.mark.parametrize(
    "lines", [[], [DBT], [gga(1)], [gga(1), rmc(1)], [gga(1), DBT, gga(1), DBT], [b"\xff" * 9] * 3]
)
def test_without_two_times_there_is_none(lines: list[bytes]) -> None:
    assert sentence_times(lines) == Schedule([0] * len(lines))


def test_the_wire_is_never_faster_than_its_baud_rate_and_keeps_the_order() -> None:
    starts = on_the_wire([0, 0, 0, NS_PER_S], [480, 48, 1, 48], 4800)
    assert starts == [0, NS_PER_S, 1_100_000_000, 1_102_083_333]


TIMES = st.one_of(
    st.integers(0, DAY_S - 1).map(float),
    st.integers(1000, 1020).map(float),
    st.floats(0, DAY_S, exclude_max=True, allow_nan=False).map(lambda t: round(t, 2) % DAY_S),
)
LINES = st.lists(
    st.one_of(
        TIMES.map(gga),
        TIMES.map(rmc),
        TIMES.map(zda),
        TIMES.map(lambda t: gga(t, 0)),
        st.sampled_from([GSA, GSV, VTG, DBT, HDG, AIS, b"", b"$GPGGA,9,9", b"garbage"]),
        st.binary(max_size=20),
    ),
    max_size=60,
)


@given(LINES)
def test_every_line_gets_a_time_and_none_goes_back(lines: list[bytes]) -> None:
    at_ns = sentence_times(lines).at_ns
    assert len(at_ns) == len(lines)
    assert at_ns[:1] in ([], [0])
    assert all(before <= after for before, after in pairwise(at_ns))


@given(st.integers(0, DAY_S - 1), st.lists(st.integers(1, 10), min_size=2, max_size=40), st.integers(0, 3))
def test_a_clean_log_keeps_every_difference(start: int, steps: list[int], others: int) -> None:
    times = [start]
    for step in steps:
        times.append(times[-1] + step)
    lines = [line for t in times for line in (gga(t), GSA, rmc(t), *[DBT, XDR, HDG][:others])]
    found = sentence_times(lines)
    assert found.first_tod_ms == start * 1000
    at_ns = found.at_ns[:: 3 + others]
    assert [after - before for before, after in pairwise(at_ns)] == [step * NS_PER_S for step in steps]


@given(st.lists(st.integers(0, 10**10), max_size=30), st.integers(300, 115_200), st.data())
def test_the_wire_delays_and_never_advances(at: list[int], baud: int, data: st.DataObject) -> None:
    at.sort()
    sizes = data.draw(st.lists(st.integers(1, 500), min_size=len(at), max_size=len(at)))
    starts = on_the_wire(at, sizes, baud)
    assert all(start >= wanted for start, wanted in zip(starts, at, strict=True))
    for (a, b), size in zip(pairwise(starts), sizes, strict=False):
        assert b - a >= size * 10 * NS_PER_S // baud


@given(st.integers(0, 86_399_999), st.integers(0, 86_399_999))
def test_a_step_is_the_short_way_round(a: int, b: int) -> None:
    step = tod_step_ms(a, b)
    assert -43_200_000 <= step < 43_200_000
    assert (a + step - b) % 86_400_000 == 0
