from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from onboard.reading.byte_budget import ByteBudget


def test_a_burst_of_one_second_passes_and_the_surplus_does_not() -> None:
    budget = ByteBudget(10_000)
    assert budget.take(10_000, 0) == 10_000
    assert budget.take(100, 0) == 0
    assert budget.take(10_000, NS_PER_S // 20) == 0
    assert budget.take(10_000, NS_PER_S // 2) == 5_000


def test_a_full_read_passes_on_a_slow_port() -> None:
    assert ByteBudget(100).take(4096, 0) == 4096


def test_an_empty_bucket_gives_whole_lines_worth_or_nothing() -> None:
    budget = ByteBudget(2000)
    budget.take(10_000, 0)
    grants = [budget.take(4096, k * NS_PER_S // 1000) for k in range(1, 2001)]
    assert {grant for grant in grants if grant} <= set(range(1024, 1030))
    assert 3 <= sum(grant > 0 for grant in grants) <= 4


def test_calm_only_when_the_bucket_is_nearly_full_again() -> None:
    budget = ByteBudget(10_000)
    budget.take(20_000, 0)
    assert not budget.calm(NS_PER_S // 2)
    assert budget.calm(NS_PER_S)


@given(st.lists(st.tuples(st.integers(0, 200_000_000), st.integers(0, 4096)), max_size=200), st.integers(100, 100_000))
def test_never_more_than_burst_plus_rate(steps: list[tuple[int, int]], rate: int) -> None:
    budget = ByteBudget(rate)
    t_ns = total = 0
    for dt_ns, count in steps:
        t_ns += dt_ns
        allowed = budget.take(count, t_ns)
        assert 0 <= allowed <= count
        total += allowed
    assert total <= max(rate, 4096) + rate * t_ns / NS_PER_S + 1
