"""Sea state: narrow-band random motions of a hull in waves (sum of sinusoids), and water and wind that change slowly.

A hull answers near its own periods, so roll, pitch, yaw and the drift to and fro are each a narrow band about a peak
of 0.1 to 0.5 Hz: long swell under a heavy hull, short chop under a small one (Fossen, Handbook of Marine Craft
Hydrodynamics, 2011, ch. 8, takes the same two-parameter spectrum about one peak). The studies' worlds
(real-boats.md section 3) roll by 4 and by 12 degrees.
"""

from dataclasses import dataclass

import numpy as np

from common.simulation.motion import Array
from common.simulation.sensor_errors import drift_path, gauss_markov

COMPONENTS = 16
"""Sinusoids of one motion: enough that its values are normal and its envelope does not repeat within an hour."""


def narrow_band(rng: np.random.Generator, t_s: Array, sigma: float, peak_hz: float, width: float = 0.12) -> Array:
    """A stationary motion of 1-sigma `sigma` at the times (n,); frequencies spread about the peak by `width` of it."""
    hz = peak_hz * np.clip(1.0 + width * rng.standard_normal(COMPONENTS), 0.5, 1.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, COMPONENTS)
    waves = np.sin(2.0 * np.pi * np.outer(hz, t_s) + phases[:, np.newaxis]).sum(axis=0)
    motion: Array = sigma * np.sqrt(2.0 / COMPONENTS) * waves
    return motion


@dataclass(frozen=True, slots=True, kw_only=True)
class Sea:
    """1-sigma of what waves do to a hull, for the middle boat of a scenario; each boat draws a factor of 0.6 to 1.5."""

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    drift_m_s: float
    """Velocity to and fro on each body axis, m/s."""
    peak_hz: tuple[float, float] = (0.15, 0.45)
    """Peak of the roll is drawn in here, Hz; pitch, yaw and drift lie within a quarter of it."""


@dataclass(frozen=True, slots=True)
class HullMotions:
    """What waves add: angles in rad, velocities along the body axes in m/s, each (n,)."""

    roll_rad: Array
    pitch_rad: Array
    yaw_rad: Array
    fwd_m_s: Array
    stb_m_s: Array


def in_waves(rng: np.random.Generator, t_s: Array, sea: Sea) -> HullMotions:
    """The motions of one boat, whose factor, peaks and phases are drawn."""
    factor = float(np.exp(rng.uniform(np.log(0.6), np.log(1.5))))
    peak_hz = rng.uniform(*sea.peak_hz)
    sigmas = (*np.radians((sea.roll_deg, sea.pitch_deg, sea.yaw_deg)), sea.drift_m_s, sea.drift_m_s)
    peaks = np.clip(peak_hz * np.array([1.0, *rng.uniform(0.8, 1.25, 4)]), 0.1, 0.5)
    return HullMotions(*(narrow_band(rng, t_s, factor * s, hz) for s, hz in zip(sigmas, peaks, strict=True)))


def wandering(rng: np.random.Generator, t_s: Array, mean: float, sigma: float, time_s: float) -> Array:
    """A vector (n, 2), east and north: drawn towards any side with length `mean`, plus a Gauss-Markov part each axis.

    The part has its nodes every tenth of `time_s` and is linear between.
    """
    towards = rng.uniform(0.0, 2.0 * np.pi)
    step_s = 0.1 * time_s
    nodes_s = np.arange(int(t_s[-1] / step_s) + 2, dtype=np.float64) * step_s
    path = drift_path(gauss_markov(sigma, time_s), nodes_s, rng.standard_normal((len(nodes_s), 2)))
    parts = [np.interp(t_s, nodes_s, path[:, axis]) for axis in range(2)]
    return np.stack(parts, axis=1) + mean * np.array([np.sin(towards), np.cos(towards)])
