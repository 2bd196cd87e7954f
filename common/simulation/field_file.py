"""Gridded current or wind: a vector field from a CSV file, velocities on a rectangular grid, units in the header.

The header names each column and its unit, in any order; every row gives the velocity at one point of the grid:

    t_h,east_m,north_m,v_east_kn,v_north_kn
    0,0,0,0.4,-0.1

| column | units |
|---|---|
| `east_`, `north_` | `m`, `km` in the local plane |
| `v_east_`, `v_north_` | `m_s`, `cm_s`, `kn`; the direction of the flow |
| `t_` (may be left out) | `s`, `min`, `h` after the start of the voyage |

Rows come in any order, but each point of the grid must be there once: where there is land, write 0. The spacing may
vary. Between the points the velocity is bilinear in the place and linear in time; beyond the edges it is that of the
edge. A grid of one easting, northing or time is the same all along it.
"""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from common.errors import WayfixError
from common.simulation.fields import Number
from common.simulation.motion import Array
from common.units import M_S_PER_KN

_LENGTHS: Final = {"m": 1.0, "km": 1000.0}
_SPEEDS: Final = {"m_s": 1.0, "cm_s": 0.01, "kn": M_S_PER_KN}
_TIMES: Final = {"s": 1.0, "min": 60.0, "h": 3600.0}
_UNITS: Final = {"t": _TIMES, "east": _LENGTHS, "north": _LENGTHS, "v_east": _SPEEDS, "v_north": _SPEEDS}
"""Factors to SI, by quantity and unit."""


@dataclass(frozen=True, eq=False)
class GriddedField:
    """Velocities on a rectangular grid of times and places; see the module for what is between and beyond."""

    t_s: Array
    """Times of the grid, (times,), s, growing."""
    east_m: Array
    """Eastings of the grid, (easts,), m, growing."""
    north_m: Array
    """Northings of the grid, (norths,), m, growing."""
    velocity_m_s: Array
    """Velocity at each point of the grid, (times, easts, norths, 2): east, north, m/s."""

    def __call__(self, east_m: Number, north_m: Number, t_s: Number) -> tuple[Number, Number]:
        """Velocity at a place and time."""
        places = [
            _between(axis, value) for axis, value in ((self.t_s, t_s), (self.east_m, east_m), (self.north_m, north_m))
        ]
        total: Array = np.zeros((*np.broadcast(east_m, north_m, t_s).shape, 2))
        for corner in range(8):
            weight: Number = 1.0
            index = []
            for place, (below, share) in enumerate(places):
                is_above = corner >> place & 1
                index.append(below + is_above)
                weight = weight * (share if is_above else 1.0 - share)
            total = total + np.asarray(weight)[..., np.newaxis] * self.velocity_m_s[tuple(index)]
        return (total[..., 0], total[..., 1]) if total.ndim > 1 else (float(total[0]), float(total[1]))


def _between(axis: Array, value: Number) -> tuple[npt.NDArray[np.intp], Array]:
    """(index of the grid line below, share of the way to the next one) of values, held within the axis."""
    inside: Array = np.clip(np.asarray(value, dtype=np.float64), axis[0], axis[-1])
    below = np.clip(np.searchsorted(axis, inside, side="right") - 1, 0, len(axis) - 2)
    return below, (inside - axis[below]) / (axis[below + 1] - axis[below])


def read_field(file: str | Path) -> GriddedField:
    """Read a gridded field; raises WayfixError that names line and column."""
    path = Path(file)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            return _field(csv.reader(stream, strict=True), str(path))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise WayfixError(f"cannot be read ({error})", str(path), "give a readable CSV file") from error


def _field(rows: Iterable[list[str]], file: str) -> GriddedField:
    numbered = ((number, row) for number, row in enumerate(rows, start=1) if row)
    _, header = next(numbered, (1, []))
    columns = [_column(name.strip(), file) for name in header]
    names = [quantity for quantity, _ in columns]
    cure = "name the columns east_m, north_m, v_east_m_s, v_north_m_s and, if it changes in time, t_s"
    for quantity in _UNITS:
        if names.count(quantity) > 1:
            raise WayfixError(f"has more than one column for {quantity}", file, cure)
        if quantity not in names and quantity != "t":
            raise WayfixError(f"has no column for {quantity}", file, cure)
    points: dict[tuple[float, float, float], tuple[float, float]] = {}
    for number, row in numbered:
        where = f"{file}: line {number}"
        if len(row) != len(columns):
            raise WayfixError(f"has {len(row)} fields, the header {len(columns)}", where, "correct the line")
        values = {
            quantity: scale * _number(text, name, where)
            for (quantity, scale), text, name in zip(columns, row, header, strict=True)
        }
        point = (values.get("t", 0.0), values["east"], values["north"])
        if point in points:
            raise WayfixError("gives a point of the grid for the second time", where, "leave one of them out")
        points[point] = (values["v_east"], values["v_north"])
    return _gridded(points, file)


def _column(name: str, file: str) -> tuple[str, float]:
    """(quantity, its unit in SI) of a column's name."""
    for quantity, units in _UNITS.items():
        for unit, scale in units.items():
            if name == f"{quantity}_{unit}":
                return quantity, scale
    known = "; ".join(", ".join(f"{quantity}_{unit}" for unit in units) for quantity, units in _UNITS.items())
    raise WayfixError(f"column {name!r} is no quantity with a unit", file, f"choose from: {known}")


def _number(text: str, column: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise WayfixError(f"{column.strip()}: {text!r} is not a number", where, "write 0 where there is no flow")
    return value


def _gridded(points: dict[tuple[float, float, float], tuple[float, float]], file: str) -> GriddedField:
    """The points as a whole grid; an axis of one line becomes two with the same values."""
    if not points:
        raise WayfixError("has no rows below the header", file, "give one row for each point of the grid")
    axes = [sorted(set(values)) for values in zip(*points, strict=True)]
    grid = [[[points.get((t, east, north)) for north in axes[2]] for east in axes[1]] for t in axes[0]]
    for t, plane in zip(axes[0], grid, strict=True):
        for east, line in zip(axes[1], plane, strict=True):
            for north, velocity in zip(axes[2], line, strict=True):
                if velocity is None:
                    what = f"has no row for east {east:g} m, north {north:g} m, t {t:g} s"
                    raise WayfixError(what, file, "give every point of a rectangular grid, 0 where there is land")
    velocity_m_s = np.array(grid, dtype=np.float64)
    for number, axis in enumerate(axes):
        if len(axis) == 1:
            axis.append(axis[0] + 1.0)
            velocity_m_s = np.repeat(velocity_m_s, 2, axis=number)
    t_s, east_m, north_m = (np.array(axis) for axis in axes)
    return GriddedField(t_s, east_m, north_m, velocity_m_s)
