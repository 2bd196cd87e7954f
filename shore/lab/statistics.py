"""What may be said from many runs: means with intervals, paired ratios, and how odd one run is.

Samples are (runs,) or (runs, 3), one number for each run; seeds are shared, so samples of two methods are paired.
All intervals are 95 %, two-sided.
"""

import math
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from shore.navigation.numbers import Array, wrapped

COMPONENTS: Final = ("east_m2", "north_m2", "heading_deg2")
"""Names of the three columns, everywhere."""
TRANSIENT_STEPS: Final = 50
_STUDENT: Final = (12.706, 4.303, 3.182, 2.776)
"""Tabled for 1 to 4 degrees, where the expansion is too small."""


class Interval(NamedTuple):
    """Bounds of a 95 % interval."""

    low: float
    high: float


class IntervalEstimate(NamedTuple):
    """A number and its interval."""

    value: float
    interval: Interval


def student(degrees: int) -> float:
    """The 97.5 % point of Student's t: the normal one with three terms of its expansion (0.2 % off at 5)."""
    if degrees <= len(_STUDENT):
        return _STUDENT[degrees - 1]
    z = NormalDist().inv_cdf(0.975)
    terms = (
        (z**3 + z) / (4 * degrees),
        (5 * z**5 + 16 * z**3 + 3 * z) / (96 * degrees**2),
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / (384 * degrees**3),
    )
    return z + sum(terms)


def mean_of(samples: Array) -> IntervalEstimate:
    """Mean over runs (runs,) with its interval; at least two runs."""
    mean = float(samples.mean())
    return _around(mean, float(samples.std(ddof=1)) / math.sqrt(len(samples)), len(samples))


def ratio_of(upper: Array, lower: Array) -> IntervalEstimate:
    """Ratio of two means over the same runs, with the interval of paired samples (delta method)."""
    ratio = float(upper.mean() / lower.mean())
    apart = (upper - ratio * lower) / lower.mean()
    return _around(ratio, float(apart.std(ddof=1)) / math.sqrt(len(upper)), len(upper))


def oddness(published: float, samples: Array) -> float:
    """Z of one published run among ours, on the logarithm: (log published - mean log) / sd of log of single runs."""
    logs = np.log(samples)
    return float((math.log(published) - logs.mean()) / logs.std(ddof=1))


def squared_errors(x: Array, truth: Array) -> Array:
    """Squared errors (..., 3) in the units of `COMPONENTS` from states (..., n) and the truth (5,); heading wrapped."""
    errors = np.empty((*x.shape[:-1], 3))
    errors[..., :2] = x[..., :2] - truth[:2]
    errors[..., 2] = np.degrees(wrapped(x[..., 4] - truth[4]))
    return np.square(errors)


def spans(steps: int, change: int | None, silent: npt.NDArray[np.int_], *, biased: bool) -> dict[str, slice]:
    """The stretches of a run that are scored on their own; step 0 is the start and never scored.

    steps: rows of the truth. change: the first row with other noise. silent: rows without a fix. biased: a filter has
    biases to learn first.
    """
    parts = {"whole": slice(1, steps)}
    if change is not None:
        settled = min(change + TRANSIENT_STEPS, steps)
        parts |= {"before": slice(1, change), "transient": slice(change, settled)}
        if settled < steps:
            parts["after"] = slice(settled, steps)
    if len(silent):
        parts["outage"] = slice(int(silent[0]), int(silent[-1]) + 1)
    if biased:
        parts["second half"] = slice(steps // 2, steps)
    return parts


def running_rms(squares: Array) -> Array:
    """Root of the mean of everything so far: squares (k, ...) -> (k, ...), the thesis' RMS error over time."""
    counts = np.arange(1, len(squares) + 1).reshape(-1, *[1] * (squares.ndim - 1))
    so_far: Array = np.sqrt(np.cumsum(squares, axis=0) / counts)
    return so_far


def window_variance(noise: Array, window: int) -> Array:
    """Eqs 5.24, 5.25: the actual R at each step (k, ...) = mean square of the last `window` measurement errors."""
    sums = np.cumsum(np.square(noise), axis=0)
    earlier = np.concatenate((np.zeros((window, *sums.shape[1:])), sums[:-window]))[: len(sums)]
    counts = np.minimum(np.arange(1, len(sums) + 1), window).reshape(-1, *[1] * (sums.ndim - 1))
    means: Array = (sums - earlier) / counts
    return means


def _around(value: float, error: float, count: int) -> IntervalEstimate:
    half = student(count - 1) * error
    return IntervalEstimate(value, Interval(value - half, value + half))
