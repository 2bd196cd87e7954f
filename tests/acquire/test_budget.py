from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from onboard.budget import ByteBudget


def test_a_burst_of_one_second_passes_and_the_surplus_does_not() -> None:
    budget = ByteBudget(10_000)
    assert budget.take(10_000, 0) == 10_000
    assert budget.take(100, 0) == 0
    assert budget.take(10_000, NS_PER_S // 2) == 5_000


def test_a_full_read_passes_on_a_slow_port() -> None:
    assert ByteBudget(100).take(4096, 0) == 4096


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
