"""Gridded fields: bilinear between the points, units in the header, and faults told with their line."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.simulation.field_file import GriddedField, read_field
from common.simulation.motion import Mission, sail

SI = "t_s,east_m,north_m,v_east_m_s,v_north_m_s"
EASTS, NORTHS, TIMES = (0.0, 100.0, 400.0), (-50.0, 50.0), (0.0, 3600.0)


def bilinear(east: float, north: float, t_s: float) -> tuple[float, float]:
    """A field that a grid holds exactly: linear in each axis, with all their products."""
    u, v, w = east / 400.0, north / 50.0, t_s / 3600.0
    return 0.5 + 0.2 * u - 0.1 * v * w + 0.3 * u * v * w, -0.2 + 0.1 * v + 0.4 * u * w


def grid_text() -> str:
    points = [(t, east, north) for t, east, north in product(TIMES, EASTS, NORTHS)]
    rows = [",".join(map(repr, (t, e, n, *bilinear(e, n, t)))) for t, e, n in points]
    return "\n".join((SI, *rows)) + "\n"


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> GriddedField:
    file = tmp_path_factory.mktemp("field") / "field.csv"
    file.write_text(grid_text(), encoding="utf-8")
    return read_field(file)


def read(tmp_path: Path, text: str) -> GriddedField:
    file = tmp_path / "field.csv"
    file.write_text(text, encoding="utf-8")
    return read_field(file)


points = st.lists(
    st.tuples(st.floats(EASTS[0], EASTS[-1]), st.floats(*NORTHS), st.floats(*TIMES)), min_size=1, max_size=4
)


@given(points)
def test_between_the_points_it_is_linear_along_each_axis(
    field: GriddedField, points: list[tuple[float, float, float]]
) -> None:
    expected = np.array([bilinear(*point) for point in points])
    assert np.array([field(*point) for point in points]) == pytest.approx(expected, abs=1e-12)
    assert np.stack(field(*np.array(points).T), axis=-1) == pytest.approx(expected, abs=1e-12)
    east, north, t_s = np.array(points).T
    same_time = np.stack(field(east, north, float(t_s[0])), axis=-1)
    assert same_time[0] == pytest.approx(expected[0], abs=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_beyond_the_edges_it_is_that_of_the_edge(field: GriddedField, east: float, north: float, t_s: float) -> None:
    held = (min(max(east, 0.0), 400.0), min(max(north, -50.0), 50.0), min(max(t_s, 0.0), 3600.0))
    assert field(east, north, t_s) == pytest.approx(field(*held), abs=1e-12)


@pytest.mark.parametrize(
    ("header", "scales"),
    [
        ("t_min,east_km,north_m,v_east_cm_s,v_north_m_s", (60, 1000, 1, 0.01, 1)),
        ("t_h,east_m,north_km,v_east_kn,v_north_kn", (3600, 1, 1000, 1852 / 3600, 1852 / 3600)),
    ],
)
def test_units_of_the_header_change_nothing_but_the_numbers(
    field: GriddedField, tmp_path: Path, header: str, scales: tuple[float, ...]
) -> None:
    rows = [[float(text) for text in line.split(",")] for line in grid_text().splitlines()[1:]]
    lines = [",".join(repr(value / scale) for value, scale in zip(row, scales, strict=True)) for row in rows]
    other = read(tmp_path, "\n".join((header, *reversed(lines))))
    assert other.velocity_m_s == pytest.approx(field.velocity_m_s)
    assert other(123.0, 12.0, 1234.0) == pytest.approx(field(123.0, 12.0, 1234.0))


def test_without_times_and_with_one_line_it_is_the_same_all_along(tmp_path: Path) -> None:
    field = read(tmp_path, "v_east_kn, v_north_kn, east_m, north_m\n1,0,0,7\n3,0,10,7\n\n")
    assert field(5.0, -1e3, 9e9) == pytest.approx((2 * 1852 / 3600, 0.0))


def test_a_boat_sails_through_a_gridded_field(field: GriddedField) -> None:
    track = sail(Mission(start=(0.0, 0.0), waypoints=((300.0, 0.0),), heading_deg=90.0), field)
    assert track.v_east_m_s[0] == pytest.approx(1.0 + bilinear(0.0, 0.0, 0.0)[0])
    middle = len(track.t_s) // 2
    expected = bilinear(float(track.east_m[middle]), float(track.north_m[middle]), float(track.t_s[middle]))
    heading = track.heading_rad[middle]
    assert track.v_east_m_s[middle] == pytest.approx(np.sin(heading) + expected[0], abs=1e-6)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", r"has no column for east.*east_m"),
        (f"{SI}\n", "has no rows"),
        ("east_m,north_m,v_east_m_s\n0,0,1\n", "has no column for v_north"),
        ("east_m,north_m,v_east_m_s,v_north\n0,0,1,1\n", r"'v_north' is no quantity with a unit.*v_north_kn"),
        ("east_m,east_km,north_m,v_east_kn,v_north_kn\n0,0,0,1,1\n", "more than one column for east"),
        (f"{SI}\n0,0,0,1,x\n", "line 2: v_north_m_s: 'x' is not a number"),
        (f"{SI}\n0,0,0,1,1\n0,1,0,1,nan\n", "line 3: v_north_m_s: 'nan' is not a number"),
        (f"{SI}\n0,0,0,1,\n", r"line 2: v_north_m_s: '' is not a number; write 0"),
        (f"{SI}\n0,0,0,1\n", "line 2: has 4 fields, the header 5"),
        (f"{SI}\n0,0,0,1,1\n0,0,0,1,1\n", "line 3: gives a point of the grid for the second time"),
        (f"{SI}\n0,0,0,1,1\n0,1,1,1,1\n", "has no row for east 0 m, north 1 m, t 0 s"),
        (f'{SI}\n0,0,0,1,"1\n', "cannot be read"),
    ],
)
def test_a_fault_of_the_file_is_one_sentence(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(WayfixError, match=f"field.csv: .*{told}"):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match="cannot be read"):
        read_field(tmp_path / "none.csv")
