"""First-order recurrences without a loop (parallel prefix scan, Kogge and Stone 1973): autoregression, low-pass lag.

y[k + 1] = keep[k] y[k] + driven[k + 1] is linear, so two steps make one of the same kind. Doubling the stride log2(n)
times gives all y at once. Row k needs nothing after row k: a shorter series is the start of a longer one, to the bit.
"""

import numpy as np
import numpy.typing as npt

from common.simulation.motion import Array


def recur(keep: Array, driven: Array) -> Array:
    """The series y with y[0] = driven[0] and y[k + 1] = keep[k] y[k] + driven[k + 1], exact but for rounding.

    Time is the first axis: `keep` (n - 1,) in [0, 1], `driven` and y (n, ...).
    """
    y = np.array(driven, dtype=np.float64)
    if not len(y):
        return y
    factor = np.concatenate(([0.0], keep)).reshape(-1, *(1,) * (y.ndim - 1))
    stride = 1
    while stride < len(y):
        y[stride:] += factor[stride:] * y[:-stride]
        factor[stride:] = factor[stride:] * factor[:-stride]
        stride *= 2
    return y


def lagged(values: Array, step_s: float, time_s: float) -> Array:
    """First-order lag (time constant `time_s`) of `values` (n, ...) at a constant step; it begins settled on the first.

    y' = (x - y) / time_s, x held over each step. A time constant of 0 gives the values themselves.
    """
    if time_s <= 0.0:
        return np.array(values, dtype=np.float64)
    keep = np.exp(-step_s / time_s)
    driven = (1.0 - keep) * values
    driven[0] = values[0]
    return recur(np.full(len(values) - 1, keep), driven)


def held(values: Array, is_fresh: npt.NDArray[np.bool_]) -> Array:
    """Each row of `values` (n, ...) where `is_fresh` (n,) holds, else the last row that was fresh (row 0 always is)."""
    rows = np.where(is_fresh, np.arange(len(values)), 0)
    fresh: Array = values[np.maximum.accumulate(rows)]
    return fresh
