"""When each record of an imported recording was."""

from array import array

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from shore.imports.record_times import NO_TIME, Plan
from tests.station.imports import T0


def test_a_plan_of_plain_times_is_the_times() -> None:
    plan = Plan(array("q", [T0, T0 + 5000, T0 + 4000, T0 + NS_PER_S]), 1.0)
    assert [plan.at(number) for number in range(4)] == [T0, T0 + 5000, T0 + 4000, T0 + NS_PER_S]
    assert plan.doubted == set()


def seconds(*values: float | None) -> "array[int]":
    return array("q", (NO_TIME if value is None else round(value * NS_PER_S) for value in values))


def planned(plan: Plan, count: int) -> list[float | None]:
    return [None if (t_ns := plan.at(number)) is None else t_ns / NS_PER_S for number in range(count)]


def test_single_wrong_times_are_left_out() -> None:
    assert planned(Plan(seconds(1, 2, 900_000, 3, 4, 5), 1.0), 6) == [1, 2, None, 3, 4, 5]
    assert planned(Plan(seconds(101, 102, 3, 103, 104, 105), 1.0), 6) == [101, 102, None, 103, 104, 105]


def test_a_step_back_that_lasts_moves_utc_not_boat_time() -> None:
    plan = Plan(seconds(101, 102, 103, 51, 52, 53), 1.0)
    assert planned(plan, 6) == [101, 102, 103, 104, 105, 106]
    assert [plan.epoch(number) for number in (2, 3)] == [0, 1]
    assert plan.shift_ns(3) == 53 * NS_PER_S


def test_a_step_ahead_that_lasts_is_a_gap() -> None:
    assert planned(Plan(seconds(1, 2, 1000, 1001, 1002), 1.0), 5) == [1, 2, 1000, 1001, 1002]


DAY_S = 86_400


@pytest.mark.parametrize(
    "before",
    [
        [315_964_800.0 + second for second in range(5)],  # 1980, and longer than what follows
        [30.0, 31.0, 32.0],
        [2_000_000_000.0 + second for second in range(3)],
        [2_000_000_000.0 + second for second in range(2)] + [40.0, 41.0],
    ],
)
def test_a_clock_that_was_set_dates_nothing(before: list[float]) -> None:
    after = [1_700_000_000.0 + second for second in range(4)]
    plan = Plan(seconds(*before, *after), 1.0)
    times = [plan.at(number) for number in range(len(before) + 4)]
    used = [t_ns for t_ns in times if t_ns is not None]
    assert used[-1] - used[0] == (len(used) - 1) * NS_PER_S
    assert used[-1] - plan.shift_of_date_ns == after[-1] * NS_PER_S
    assert plan.shift_ns(len(before)) == plan.shift_of_date_ns
    assert plan.misdated == len(used) - 4
    assert len(plan.doubted) == len(times) - len(used) <= 2


def test_a_clock_that_went_wrong_on_the_way_goes_on_evenly() -> None:
    plan = Plan(seconds(*range(10**9, 10**9 + 5), *range(5), *range(10**9 + 10, 10**9 + 15)), 1.0)
    assert planned(plan, 15) == list(range(10**9, 10**9 + 15))
    assert (plan.shift_of_date_ns, plan.misdated) == (0, 5)


def test_a_gap_of_months_stays_a_gap() -> None:
    plan = Plan(seconds(*range(3), *range(365 * DAY_S, 365 * DAY_S + 3)), 1.0)
    assert planned(plan, 6) == [0, 1, 2, 365 * DAY_S, 365 * DAY_S + 1, 365 * DAY_S + 2]
    assert planned(Plan(seconds(*range(3), *range(367 * DAY_S, 367 * DAY_S + 3)), 1.0), 6) == list(range(6))


def test_records_without_time_lie_between_those_with() -> None:
    assert planned(Plan(seconds(None, 1, None, None, 4, None), 1.0), 6) == [None, 1, 2, 3, 4, 5.5]
    assert planned(Plan(seconds(1, 2, 3, None, 1000), 1.0), 5) == [1, 2, 3, 3.5, 1000]
    assert planned(Plan(seconds(None, None), 4.0), 2) == [0, 0.25]
    assert planned(Plan(seconds(5, 5, 6), 1.0, spread=True, is_utc=False), 3) == [0, 0.5, 1]


@given(st.lists(st.none() | st.integers(-4 * 10**18, 4 * 10**18), max_size=40), st.booleans(), st.booleans())
def test_any_times_make_a_plan(times: list[int | None], spread: bool, is_utc: bool) -> None:
    plan = Plan(array("q", (NO_TIME if t is None else t for t in times)), 1.0, spread=spread, is_utc=is_utc)
    for number in range(len(times)):
        t_ns = plan.at(number)
        assert t_ns is None or (t_ns % 1000 == 0 and abs(t_ns) < 2**63)
