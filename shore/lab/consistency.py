"""Filter consistency: normalised estimation error squared (NEES) and normalised innovation squared (NIS) of many runs.

A filter that is right about its own covariance has a mean NEES of 5 (the states) and a mean NIS of 3 (the measured
numbers of a step); more = it believes itself too much. The means over runs are called ANEES and ANIS (`scores.py`).
"""

import math
from typing import Final

import numpy as np

from shore.navigation.numbers import Array, Number, wrapped

STATES: Final = 5
"""NEES is taken of the five states that every filter has."""
CHANNELS: Final = 3
"""NIS is scaled to three measured numbers a step."""


def nees(x: Array, P: Array, truth: Array) -> Array:
    """Normalised estimation error squared (...) of the five states; mean 5 when P is right."""
    error = x[..., :STATES] - truth
    error[..., 4] = wrapped(error[..., 4])
    solved = np.linalg.solve(P[..., :STATES, :STATES], error[..., np.newaxis])[..., 0]
    normalised: Array = np.einsum("...i,...i->...", error, solved)
    return normalised


class ConsistencySums:
    """NEES and NIS, summed over the steps of all runs at once."""

    def __init__(self, runs: int) -> None:
        self._nees = np.zeros(runs)
        self._steps = 0
        self._nis = np.zeros(runs)
        self._innovations = 0

    def add_state(self, x: Array, P: Array, truth: Array) -> None:
        """One step: states (runs, n), their covariances (runs, n, n), the truth (5,)."""
        self._nees += nees(x, P, truth)
        self._steps += 1

    def add_innovation(self, nis: Number) -> None:
        """One measured scalar: innovation squared / its variance, (runs,); mean 1 when consistent."""
        self._nis += nis
        self._innovations += 1

    @property
    def mean_nees(self) -> Array:
        """Mean over the steps of each run, (runs,)."""
        return self._nees / self._steps

    @property
    def mean_nis(self) -> Array:
        """Mean over the steps of each run, (runs,), of three measured numbers; NaN without innovations."""
        if not self._innovations:
            return np.full(len(self._nis), math.nan)
        return self._nis * CHANNELS / self._innovations
