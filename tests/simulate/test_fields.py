"""Fields: what they say at a place and time, for one boat as for many, and their sums."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.simulation.fields import (
    SEMI_DIURNAL_S,
    SOUTHAMPTON_WATER,
    STILL,
    Leeway,
    Sum,
    Tide,
    TidePeaks,
    Uniform,
    VectorField,
    WavyCurrent,
)

TIDE = Tide(flood_towards_deg=315.0, slack_s=1000.0, peaks=SOUTHAMPTON_WATER, mouth=(900.0, 0.0))
FIELDS: tuple[VectorField, ...] = (
    STILL,
    Uniform(0.5, 140.0),
    WavyCurrent(0.5, 235.0, 45.0),
    TIDE,
    Leeway(Uniform(8.0, 90.0), 0.03),
    Sum((TIDE, Leeway(Uniform(8.0, 90.0), 0.03))),
)
metres = st.floats(-5e3, 5e3)
seconds = st.floats(-1e5, 1e5)


def speed_along(field: VectorField, towards_deg: float, east_m: float, north_m: float, t_s: float) -> float:
    """Component of the flow in a direction."""
    east, north = field(east_m, north_m, t_s)
    return float(east * math.sin(math.radians(towards_deg)) + north * math.cos(math.radians(towards_deg)))


def test_directions_are_where_the_water_goes() -> None:
    assert Uniform(2.0, 90.0)(0.0, 0.0, 0.0) == pytest.approx((2.0, 0.0))
    assert Uniform(2.0, 180.0)(0.0, 0.0, 0.0) == pytest.approx((0.0, -2.0))


@pytest.mark.parametrize("field", FIELDS)
@given(points=st.lists(st.tuples(metres, metres, seconds), min_size=1, max_size=5))
def test_many_boats_at_once_see_what_each_sees_alone(
    field: VectorField, points: list[tuple[float, float, float]]
) -> None:
    east, north = field(*np.array(points).T)
    assert np.shape(east) == np.shape(north) == (len(points),)
    alone = [field(*point) for point in points]
    assert np.transpose([east, north]) == pytest.approx(np.array(alone), abs=1e-12)
    # A filter knows one time and many places.
    easts, norths, _ = np.array(points).T
    east, north = field(easts, norths, points[0][2])
    assert (float(np.ravel(east)[0]), float(np.ravel(north)[0])) == pytest.approx(alone[0], abs=1e-12)


@pytest.mark.parametrize(
    ("up_m", "flood", "ebb"), [(0.0, 0.7, 1.0), (250.0, 0.6, 0.75), (500.0, 0.5, 0.5), (1000.0, 0.25, 0.25)]
)
def test_tide_has_the_peaks_of_the_thesis_at_the_mouth_and_up_the_estuary(
    up_m: float, flood: float, ebb: float
) -> None:
    place = (900.0 - up_m * math.sqrt(0.5), up_m * math.sqrt(0.5))
    quarter = SEMI_DIURNAL_S / 4
    speeds = [speed_along(TIDE, 315.0, *place, 1000.0 + quarters * quarter) for quarters in range(5)]
    assert speeds == pytest.approx([0.0, flood, 0.0, -ebb, 0.0], abs=1e-9)


@given(metres, metres, seconds)
def test_tide_flows_along_its_axis_comes_back_and_keeps_below_its_peaks(east: float, north: float, t_s: float) -> None:
    assert speed_along(TIDE, 45.0, east, north, t_s) == pytest.approx(0.0, abs=1e-12)
    assert -1.0 <= speed_along(TIDE, 315.0, east, north, t_s) <= 0.7
    assert TIDE(east, north, t_s) == pytest.approx(TIDE(east, north, t_s + SEMI_DIURNAL_S), abs=1e-9)


def test_one_pair_of_peaks_is_a_tide_that_is_equal_everywhere() -> None:
    tide = Tide(flood_towards_deg=0.0, slack_s=0.0, peaks=(TidePeaks(0.0, 0.7, 1.0),))
    assert tide(-3e3, 5e3, 1e4) == tide(0.0, 0.0, 1e4)


def test_leeway_is_a_share_of_the_wind_and_sums_add() -> None:
    leeway = Leeway(Uniform(10.0, 90.0), 0.03)
    assert leeway(1.0, 2.0, 3.0) == pytest.approx((0.3, 0.0))
    assert Sum((leeway, Uniform(0.5, 0.0), STILL))(1.0, 2.0, 3.0) == pytest.approx((0.3, 0.5))
    assert Sum(())(1.0, 2.0, 3.0) == (0.0, 0.0)
