"""Window means of time series on one grid, and the factor between the changes of two (linear least squares)."""

from array import array
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.units import NS_PER_S

Array = NDArray[np.float64]

WINDOW_S: Final = 4.0
LEAST_WINDOWS: Final = 8
"""So many pairs of windows at least; with fewer nothing is said."""
MOST_WINDOWS: Final = 200_000
"""So many windows at most, nine days: a single row of 1970 would ask for years of them."""
LONGEST_TURN: Final = 10
"""So many windows at most are summed up for a person to see."""


@dataclass(slots=True)
class Series:
    """A quantity in time."""

    t_ns: "array[int]" = field(default_factory=lambda: array("q"))
    value: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, t_ns: int, value: float) -> None:
        """Add a value that is newer than all before; another one is passed over."""
        # A frame that came late says nothing new of a unit.
        if not self.t_ns or t_ns > self.t_ns[-1]:
            self.t_ns.append(t_ns)
            self.value.append(value)

    def arrays(self, start_ns: int) -> tuple[Array, Array]:
        """Times since `start_ns`, s, and values, (n,) both."""
        return (np.asarray(self.t_ns) - start_ns) / NS_PER_S, np.asarray(self.value)


class WindowMeans:
    """Window means of each quantity, (n,): NaN where it did not speak twice in a window."""

    def __init__(self, series: dict[str, Series], start_ns: int, end_ns: int) -> None:
        self.edges = np.arange(0.0, (end_ns - start_ns) / NS_PER_S + WINDOW_S, WINDOW_S)
        self.of: dict[str, Array] = {}
        for name, each in series.items():
            t_s, values = each.arrays(start_ns)
            if len(t_s) < 2:
                continue
            if name in ("heading", "cog"):
                values = np.degrees(np.unwrap(np.radians(values)))
            self.of[name] = self._means(t_s, values)
            if name in ("yaw_rate", "accel_fwd", "accel_stb"):
                self.of["sum of " + name] = self._means(t_s, _integral(t_s, values), t_s)
        if {"east", "north"} <= self.of.keys():
            self.v_east, self.v_north = (np.diff(self.of[name]) / WINDOW_S for name in ("east", "north"))

    def changes(self, name: str) -> Array | None:
        """Change of a quantity from each window to the next, (n - 1,)."""
        return np.diff(self.of[name]) if name in self.of else None

    def _means(self, t_s: Array, values: Array, counted_s: Array | None = None) -> Array:
        spoke = np.histogram(t_s if counted_s is None else counted_s, self.edges)[0] >= 2
        means = np.diff(np.interp(self.edges, t_s, _integral(t_s, values))) / WINDOW_S
        # Outside its own time the integral stands still.
        whole = (self.edges[:-1] >= t_s[0] - WINDOW_S / 8) & (self.edges[1:] <= t_s[-1] + WINDOW_S / 8)
        return np.where(spoke & whole, means, np.nan)


class Fit(NamedTuple):
    """How the changes of two quantities go together."""

    factor: float
    share: float
    """Share of the changes that the factor explains."""
    longest: tuple[float, float]
    """Both quantities over the stretch in which the right one changed most."""


def _integral(t_s: Array, values: Array) -> Array:
    return np.concatenate(([0.0], np.cumsum(np.diff(t_s) * (values[1:] + values[:-1]) / 2.0)))


def factor_between(right: Array | None, doubted: Array | None, least: float) -> Fit | None:
    """Factor from the doubted changes to the right ones (least squares); `None` = too little moved."""
    if right is None or doubted is None:
        return None
    both = np.isfinite(right) & np.isfinite(doubted)
    if both.sum() < LEAST_WINDOWS or float(np.std(right[both])) < least:
        return None
    y, x = right[both] - np.mean(right[both]), doubted[both] - np.mean(doubted[both])
    power = float(np.dot(x, x))
    if power == 0.0:
        return None
    factor = float(np.dot(x, y)) / power
    share = factor * float(np.dot(x, y)) / float(np.dot(y, y))
    return Fit(factor, share, _longest(right[both], doubted[both]))


def _longest(right: Array, doubted: Array) -> tuple[float, float]:
    """Both over the stretch of up to `LONGEST_TURN` windows in which the first changed most."""
    stretches = [
        (float(np.sum(right[place : place + count])), float(np.sum(doubted[place : place + count])))
        for count in range(1, min(LONGEST_TURN, len(right)) + 1)
        for place in (int(np.argmax(np.abs(np.convolve(right, np.ones(count), "valid")))),)
    ]
    return max(stretches, key=lambda both: abs(both[0]))
