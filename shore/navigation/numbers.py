"""Arithmetic that is the same for one boat (floats) and for a batch of runs (arrays): branches, limits, angles.

A `Number` is a float, or one value for each member of a batch. Floats stay floats: numpy's
scalars are ten times slower.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from common.angles import wrap_rad

Array = npt.NDArray[np.float64]
Number = float | Array
Components = Sequence[Number] | Array
"""The components of a state, or of many states, each a `Number`."""


def choose(condition: Any, yes: Number, no: Number) -> Number:
    """`yes` where the condition holds, else `no`; for arrays both are calculated, so neither may raise."""
    if isinstance(condition, np.ndarray):
        chosen: Array = np.where(condition, yes, no)
        return chosen
    return yes if condition else no


def clip(value: Number, low: Number, high: Number) -> Number:
    """The value within [low, high]; NaN stays NaN."""
    return smaller(larger(value, low), high)


def smaller(a: Number, b: Number) -> Number:
    """The smaller of two; NaN of `a` stays."""
    return choose(b < a, b, a)


def larger(a: Number, b: Number) -> Number:
    """The larger of two; NaN of `a` stays."""
    return choose(b > a, b, a)


def magnitude(value: Number) -> Number:
    """The value without its sign."""
    return np.abs(value) if isinstance(value, np.ndarray) else abs(value)


def sqrt(value: Number) -> Number:
    """Square root of what is not negative."""
    return np.sqrt(value) if isinstance(value, np.ndarray) else math.sqrt(value)


def exp(value: Number) -> Number:
    """E to the power of `value`."""
    return np.exp(value) if isinstance(value, np.ndarray) else math.exp(value)


def log(value: Number) -> Number:
    """Natural logarithm of what is positive."""
    return np.log(value) if isinstance(value, np.ndarray) else math.log(value)


def sin_cos(angle_rad: Number) -> tuple[Number, Number]:
    """Sine and cosine; numpy's, so that one boat has the same bits as in a batch."""
    sin, cos = np.sin(angle_rad), np.cos(angle_rad)
    return (sin, cos) if isinstance(angle_rad, np.ndarray) else (float(sin), float(cos))


def tanh(value: Number) -> Number:
    """Hyperbolic tangent; numpy's, as above."""
    return np.tanh(value) if isinstance(value, np.ndarray) else float(np.tanh(value))


def hypot(a: Number, b: Number) -> Number:
    """Square root of a^2 + b^2; numpy's, as above."""
    is_batch = isinstance(a, np.ndarray) or isinstance(b, np.ndarray)
    return np.hypot(a, b) if is_batch else float(np.hypot(a, b))


def wrapped(angle_rad: Number) -> Number:
    """The same direction in (-pi, pi]; NaN for infinity, so that a filter's guard reports it without an exception."""
    if isinstance(angle_rad, np.ndarray):
        around: Array = math.pi - np.mod(math.pi - angle_rad, math.tau)
        return around
    return wrap_rad(angle_rad) if math.isfinite(angle_rad) else math.nan


def part(x: Array, index: int) -> Number:
    """One component of a state (n,) as a float, or of states (..., n) as an array."""
    return float(x[index]) if x.ndim == 1 else x[..., index]


def components(x: Array) -> Components:
    """All components, each as `part` gives it."""
    return x.tolist() if x.ndim == 1 else [x[..., index] for index in range(x.shape[-1])]


def product(left: Array, right: Array) -> Array:
    """`left @ right`; of two small matrices, not stacks of them, `dot` is the same and twice as quick."""
    both: Array = left.dot(right) if right.ndim <= 2 and left.ndim <= 2 else left @ right
    return both


def column(value: Number) -> Number:
    """A number that multiplies vectors (..., n)."""
    return value[..., np.newaxis] if isinstance(value, np.ndarray) else value


def square(value: Number) -> Number:
    """A number that multiplies matrices (..., n, n)."""
    return value[..., np.newaxis, np.newaxis] if isinstance(value, np.ndarray) else value
