"""The laboratory's statistics on distributions whose answers are known."""

import math

import numpy as np
import pytest

from shore.lab.statistics import (
    mean_of,
    oddness,
    ratio_of,
    running_rms,
    spans,
    squared_errors,
    student,
    window_variance,
)


@pytest.mark.parametrize(
    ("degrees", "tabled"), [(1, 12.706), (4, 2.776), (5, 2.571), (10, 2.228), (30, 2.042), (199, 1.972)]
)
def test_student_is_the_tabled_one(degrees: int, tabled: float) -> None:
    assert student(degrees) == pytest.approx(tabled, abs=0.006)


def test_an_interval_of_a_mean_holds_the_truth_in_95_percent() -> None:
    rng = np.random.default_rng(1)
    samples = rng.gamma(4.0, 0.25, size=(4000, 50))
    intervals = [mean_of(each).interval for each in samples]
    assert 0.93 < np.mean([low < 1.0 < high for low, high in intervals]) < 0.965


def test_a_ratio_of_paired_runs_has_the_narrow_interval_of_pairs() -> None:
    rng = np.random.default_rng(2)
    low = rng.gamma(4.0, 0.25, size=(2000, 60))
    high = 1.2 * low * np.exp(rng.normal(0.0, 0.1, low.shape) - 0.005)
    found = [ratio_of(a, b) for a, b in zip(high, low, strict=True)]
    assert np.mean([each.value for each in found]) == pytest.approx(1.2, abs=0.004)
    assert 0.93 < np.mean([each.interval.low < 1.2 < each.interval.high for each in found]) < 0.965
    unpaired = [ratio_of(a, b) for a, b in zip(high, np.roll(low, 1, axis=1), strict=True)]
    widths = [np.mean([each.interval.high - each.interval.low for each in group]) for group in (found, unpaired)]
    assert widths[0] < 0.4 * widths[1]


def test_a_method_against_itself_is_exactly_one() -> None:
    samples = np.random.default_rng(3).gamma(2.0, size=20)
    assert ratio_of(samples, samples) == (1.0, (1.0, 1.0))


def test_oddness_counts_deviations_of_the_logarithm() -> None:
    samples = np.exp(np.random.default_rng(4).normal(0.5, 0.2, 20_000))
    assert oddness(math.exp(0.5 + 0.4), samples) == pytest.approx(2.0, abs=0.05)
    assert oddness(math.exp(0.5 - 0.6), samples) == pytest.approx(-3.0, abs=0.05)


def test_errors_are_wrapped_across_north() -> None:
    truth = np.array([10.0, 20.0, 0.0, 0.0, math.radians(359.0)])
    estimates = np.array([[11.0, 18.0, 0.0, 0.0, math.radians(2.0)], [10.0, 20.0, 0.0, 0.0, math.radians(-3.0)]])
    assert squared_errors(estimates, truth) == pytest.approx(np.array([[1.0, 4.0, 9.0], [0.0, 0.0, 4.0]]))


def test_a_run_with_a_change_has_three_parts_that_join() -> None:
    parts = spans(711, 301, np.array([], dtype=np.int_), biased=False)
    assert parts == {
        "whole": slice(1, 711),
        "before": slice(1, 301),
        "transient": slice(301, 351),
        "after": slice(351, 711),
    }
    silent = spans(100, None, np.array([40, 41, 42]), biased=True)
    assert silent == {"whole": slice(1, 100), "outage": slice(40, 43), "second half": slice(50, 100)}


def test_running_rms_and_window_variance_by_hand() -> None:
    errors = np.array([1.0, 3.0, 5.0, 7.0])
    assert running_rms(errors**2) == pytest.approx([1.0, math.sqrt(5.0), math.sqrt(35 / 3), math.sqrt(21.0)])
    assert window_variance(errors, 2) == pytest.approx([1.0, 5.0, 17.0, 37.0])
    assert window_variance(errors, 9) == pytest.approx([1.0, 5.0, 35 / 3, 21.0])
