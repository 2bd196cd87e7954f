"""Systematic sensor errors: turn-on bias, Gauss-Markov drift, scale factor, deviation, latency.

Thesis section 3.2.2 names them (turn-on and in-run errors as a random walk or a Gauss-Markov process, hard and soft
iron) and simulates none but the constant bias.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.simulation.motion import Array
from common.simulation.recurrences import recur

Axes = tuple[float, float, float]
"""Forward and starboard accelerometer (m/s^2), gyro (deg/s); or three numbers without unit."""


@dataclass(frozen=True, slots=True)
class Drift:
    """An error that wanders: first-order Gauss-Markov, or with `time_s` = inf a random walk from 0.

    d b = -b / time_s dt + density dW. A Gauss-Markov process starts in its steady state, where its 1-sigma is
    density sqrt(time_s / 2).
    """

    density: float = 0.0
    """Density of the random walk, unit of the error / sqrt(s)."""
    time_s: float = math.inf
    """Correlation time of the error, s."""

    @property
    def sigma(self) -> float:
        """1-sigma of the steady state; a random walk has none."""
        return self.density * math.sqrt(0.5 * self.time_s) if self.density else 0.0


def gauss_markov(sigma: float, time_s: float) -> Drift:
    """First-order Gauss-Markov process of a given 1-sigma and correlation time."""
    return Drift(sigma * math.sqrt(2.0 / time_s), time_s)


def drift_path(drift: Drift, t_s: Array, normals: Array) -> Array:
    """The error at times `t_s` (n,) from standard normals (..., n, axes): exact at any spacing; shape of `normals`."""
    if not drift.density:
        return np.zeros_like(normals)
    walks = math.isinf(drift.time_s)
    step_s = np.diff(t_s)
    keep = np.ones_like(step_s) if walks else np.exp(-step_s / drift.time_s)
    fresh = drift.density * np.sqrt(step_s) if walks else drift.sigma * np.sqrt(1.0 - keep**2)
    scale = np.concatenate(([0.0 if walks else drift.sigma], fresh))
    return np.moveaxis(recur(keep, np.moveaxis(normals * scale[:, np.newaxis], -2, 0)), 0, -2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """A compass' own error by heading psi, east +: A + B sin psi + C cos psi + D sin 2 psi + E cos 2 psi (deg).

    A is how it is mounted, B and C are hard iron (permanent magnets along and across the boat), D and E soft iron.
    """

    A: float = 0.0
    B: float = 0.0
    C: float = 0.0
    D: float = 0.0
    E: float = 0.0

    def at(self, heading_rad: Array) -> Array:
        """Deviation (deg) at true headings; that the compass itself turns by it is neglected."""
        hard = self.B * np.sin(heading_rad) + self.C * np.cos(heading_rad)
        soft = self.D * np.sin(2.0 * heading_rad) + self.E * np.cos(2.0 * heading_rad)
        return self.A + hard + soft


@dataclass(frozen=True, slots=True, kw_only=True)
class Flaws:
    """Errors of the sensors beyond noise by phase; everything 0 = none. They last the whole run."""

    turn_on: Axes = (0.0, 0.0, 0.0)
    """1-sigma of an IMU bias drawn once a run, constant in it."""
    scale: Axes = (0.0, 0.0, 0.0)
    """1-sigma of the relative error of the IMU's scale factor, drawn once a run."""
    accel_drift: Drift = Drift()
    """In-run drift of the bias of each accelerometer, m/s^2."""
    gyro_drift_deg: Drift = Drift()
    """In-run drift of the gyro's bias, deg/s."""
    gps_drift_m: Drift = Drift()
    """Slow error of each GPS axis, beside the white noise of the phase."""
    deviation: Deviation = Deviation()
    gps_latency_s: float = 0.0
    """Undeclared latency of a fix, s: one that is stamped t holds the place of t - latency."""
    compass_latency_s: float = 0.0


NO_FLAWS: Final = Flaws()
