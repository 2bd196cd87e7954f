"""The outlier gate of the station's fuzzy rule: what counts as an outlier, and that a single jump moves nothing."""

import math

import numpy as np
import pytest

from common.units import NS_PER_S
from shore.navigation.filter_registry import build_filter
from shore.navigation.measurements import Position
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.noise.outlier_guard import EMPTY_WIDTHS, FULL_WIDTHS, guarded, not_equal, winsorised
from shore.navigation.sensor_facts import FilterFacts

LEARNED, EXPECTED = 4.0, 5.0
"""R and C_T of a channel, m^2."""


def square_at(widths: float) -> float:
    """A squared innovation so many widths beyond the expected one."""
    return EXPECTED * math.exp(widths * math.sqrt(2.0))


@pytest.mark.parametrize("entries", [1.0, 8.0, 60.0])
def test_equal_is_as_wide_as_the_scatter_of_a_window(entries: float) -> None:
    width = math.sqrt(2.0 / entries)
    for widths, membership in ((0.0, 0.0), (2.49, 0.0), (3.0, 0.5), (3.51, 1.0)):
        assert not_equal(math.exp(widths * width), entries) == pytest.approx(membership)
        assert not_equal(math.exp(-widths * width), entries) == pytest.approx(membership)
    assert not_equal(0.0, entries) == 1.0


@pytest.mark.parametrize("square", [0.0, 1e-9, EXPECTED, square_at(FULL_WIDTHS - 1e-9)])
def test_a_sample_that_a_healthy_sensor_can_show_passes(square: float) -> None:
    """Up to 5.9 sigma; one that is too small to be true is no outlier."""
    assert guarded(LEARNED, square, EXPECTED) == LEARNED
    assert winsorised(square, EXPECTED) == square


def test_an_outlier_raises_r_to_what_it_shows_and_teaches_no_more_than_the_edge() -> None:
    square = square_at(EMPTY_WIDTHS + 1.0)
    assert guarded(LEARNED, square, EXPECTED) == pytest.approx(LEARNED + square - EXPECTED)
    assert winsorised(square, EXPECTED) == pytest.approx(square_at(FULL_WIDTHS))


def test_between_both_half_is_believed() -> None:
    square = square_at(0.5 * (FULL_WIDTHS + EMPTY_WIDTHS))
    assert guarded(LEARNED, square, EXPECTED) == pytest.approx(LEARNED + 0.5 * (square - EXPECTED))


def test_arrays_are_guarded_one_by_one() -> None:
    squares = np.array([0.0, square_at(3.0), square_at(9.0)])
    alone = [guarded(LEARNED, float(square), EXPECTED) for square in squares]
    assert guarded(np.full(3, LEARNED), squares, np.full(3, EXPECTED)) == pytest.approx(np.array(alone), rel=1e-12)


def moved_by_a_jump(name: str) -> float:
    """How far a boat at rest is moved by one fix that is 500 m off, m."""
    each = build_filter(name, FilterFacts({"g.east": Channel(4.0), "g.north": Channel(4.0)}))
    each.start(np.zeros(5), np.diag([4.0, 4.0, 0.01, 0.01, 0.01]))
    rng = np.random.default_rng(5)
    for second in range(100):
        each.predict(1.0, None)
        each.update(Position(second * NS_PER_S, "g", *(2.0 * rng.normal(size=2)).tolist()))
    each.predict(1.0, None)
    before = float(each.estimate.x[0])
    each.update(Position(100 * NS_PER_S, "g", 500.0, 0.0))
    return abs(float(each.estimate.x[0]) - before)


def test_a_single_jump_of_the_gps_moves_nothing() -> None:
    assert moved_by_a_jump("fuzzy") < 0.01 * moved_by_a_jump("ukf")
    assert moved_by_a_jump("fuzzy") < 0.1
