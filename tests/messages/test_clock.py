"""The boat clock: whole microseconds, scaled about its start."""

import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import common.clock
from common.clock import BoatClock, boottime_ns, machine_clock_id, whole_us


@given(st.integers(-(2**62), 2**62))
def test_whole_us_rounds_down_by_less_than_one_microsecond(t_ns: int) -> None:
    assert whole_us(t_ns) % 1000 == 0
    assert 0 <= t_ns - whole_us(t_ns) < 1000


@pytest.fixture
def boottime(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The machine's time, set by the test."""
    now = [1_000_000_000_123]
    monkeypatch.setattr(common.clock, "boottime_ns", lambda: now[0])
    return now


@pytest.mark.parametrize(("rate", "elapsed_s"), [(1.0, 2), (10.0, 20), (0.5, 1)])
def test_boat_seconds_pass_at_the_rate(boottime: list[int], rate: float, elapsed_s: int) -> None:
    clock = BoatClock(rate)
    before = clock.now_ns()
    boottime[0] += 2_000_000_000
    assert clock.now_ns() - before == elapsed_s * 1_000_000_000
    assert clock.now_ns() % 1000 == 0


def test_two_clocks_with_one_start_and_rate_agree(boottime: list[int]) -> None:
    first = BoatClock(7.0, boottime[0])
    boottime[0] += 333_333_333
    assert BoatClock(7.0, first.t_start_ns).now_ns() == first.now_ns()


def test_waiting_takes_less_real_time_at_a_higher_rate(boottime: list[int]) -> None:
    clock = BoatClock(10.0)
    assert clock.seconds_until(clock.now_ns() + 5_000_000_000) == pytest.approx(0.5)
    assert clock.seconds_until(clock.now_ns() - 1) == 0.0


def test_the_real_clock_moves_forward_with_time() -> None:
    clock = BoatClock()
    first, machine = clock.now_ns(), boottime_ns()
    time.sleep(0.01)
    assert 10_000_000 <= clock.now_ns() - first < 5_000_000_000
    assert abs(first - machine) < 1_000_000_000


def test_the_machine_has_one_clock_id_that_fits_a_frame() -> None:
    assert machine_clock_id() == machine_clock_id()
    assert 0 < len(machine_clock_id()) <= 64


def test_without_a_boot_id_times_are_never_compared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(common.clock, "_BOOT_ID_FILE", tmp_path / "none")
    assert machine_clock_id() != machine_clock_id()
