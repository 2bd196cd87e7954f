"""Angles: the wrap keeps the direction, differences go the short way, the mean crosses north."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.angles import difference_deg, difference_rad, heading_deg, heading_rad, wrap_deg, wrap_rad

any_rad = st.floats(-1e6, 1e6)
any_deg = st.floats(-1e6, 1e6)


def same_direction(a_rad: float, b_rad: float) -> bool:
    return math.hypot(math.sin(a_rad) - math.sin(b_rad), math.cos(a_rad) - math.cos(b_rad)) < 1e-8


@given(any_rad)
def test_wrap_rad_is_in_range_and_keeps_the_direction(angle: float) -> None:
    assert -math.pi < wrap_rad(angle) <= math.pi
    assert same_direction(wrap_rad(angle), angle)


@given(any_deg)
def test_wrap_deg_is_in_range_and_keeps_the_direction(angle: float) -> None:
    assert 0.0 <= wrap_deg(angle) < 360.0
    assert same_direction(math.radians(wrap_deg(angle)), math.radians(angle))


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(-1e-20, 0.0), (360.0, 0.0), (-90.0, 270.0), (720.5, 0.5), (359.999, 359.999)]
)
def test_wrap_deg_at_its_edges(angle: float, wrapped: float) -> None:
    assert wrap_deg(angle) == pytest.approx(wrapped)
    assert wrap_deg(angle) < 360.0


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(math.pi, math.pi), (-math.pi, math.pi), (3 * math.pi, math.pi), (0.0, 0.0)]
)
def test_wrap_rad_at_its_edges(angle: float, wrapped: float) -> None:
    assert wrap_rad(angle) == pytest.approx(wrapped)


@given(any_rad, any_rad)
def test_difference_rad_is_antisymmetric_and_leads_from_b_to_a(a: float, b: float) -> None:
    difference = difference_rad(a, b)
    assert -math.pi < difference <= math.pi
    assert same_direction(b + difference, a)
    if difference < math.pi:
        assert difference_rad(b, a) == -difference


@given(any_deg, any_deg)
def test_difference_deg_is_antisymmetric_and_leads_from_b_to_a(a: float, b: float) -> None:
    difference = difference_deg(a, b)
    assert -180.0 < difference <= 180.0
    assert same_direction(math.radians(b + difference), math.radians(a))
    if difference < 180.0:
        assert difference_deg(b, a) == -difference


def test_the_difference_goes_the_short_way_and_clockwise_is_positive() -> None:
    assert difference_deg(1.0, 359.0) == 2.0
    assert difference_deg(359.0, 1.0) == -2.0
    assert difference_deg(0.0, 180.0) == difference_deg(180.0, 0.0) == 180.0


@given(st.floats(0.0, 359.999))
def test_headings_convert_there_and_back(heading: float) -> None:
    assert abs(difference_deg(heading_deg(heading_rad(heading)), heading)) < 1e-9
