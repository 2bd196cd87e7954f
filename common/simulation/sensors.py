"""Error models of simulated sensors: truth in, erroneous columns out.

Errors are white and Gaussian plus a constant IMU bias (thesis section 4.3, Table 5.4). Each sensor draws from its own
generator; the draws of a time come together, so a shorter run is the beginning of a longer one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.simulation.motion import Array, Truth

STREAMS: Final = ("gps1", "compass1", "imu1", "gps1 velocity")
"""Who draws random numbers. Append only: a stream's seed depends on its place, never on how many follow."""


def generators(seed: int) -> dict[str, np.random.Generator]:
    """One independent generator for each of `STREAMS`."""
    children = np.random.SeedSequence(seed).spawn(len(STREAMS))
    return {name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorErrors:
    """1-sigma of what the sensors really do."""

    gps_east_m: float
    gps_north_m: float
    compass_deg: float
    """Of each sample."""
    accel_density: float
    """m/s^2/sqrt(Hz): a sample at f Hz has 1-sigma density * sqrt(f). At 1 Hz it is the thesis' number."""
    gyro_density_deg: float
    """deg/s/sqrt(Hz)."""
    gps_velocity_m_s: float = 0.1
    """Each axis; usual for Doppler velocity of a small receiver. The thesis does not use it."""
    bias_accel_fwd_m_s2: float = 0.0
    """Biases default to 0: "removed" (Eq. 3.2, 3.3). `TABLE_5_4_BIAS` of `scenarios` has the thesis' values."""
    bias_accel_stb_m_s2: float = 0.0
    bias_yaw_rate_deg_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Phase:
    """`errors` hold for times later than `after_s`, until the next phase begins."""

    after_s: float
    errors: SensorErrors


def by_phase(phases: Sequence[Phase], t_s: Array, pick: Callable[[SensorErrors], float]) -> Array:
    """One number of the errors at each time, shape of `t_s`."""
    number = np.searchsorted([phase.after_s for phase in phases[1:]], t_s, side="left")
    values: Array = np.array([pick(phase.errors) for phase in phases], dtype=np.float64)[number]
    return values


def gps_position(truth: Truth, phases: Sequence[Phase], draw: np.random.Generator) -> tuple[Array, Array]:
    """Measured (east_m, north_m) at the times of `truth`, Eq. 4.31."""
    noise = draw.standard_normal((len(truth.t_s), 2))
    east = truth.east_m + noise[:, 0] * by_phase(phases, truth.t_s, lambda errors: errors.gps_east_m)
    north = truth.north_m + noise[:, 1] * by_phase(phases, truth.t_s, lambda errors: errors.gps_north_m)
    return east, north


def gps_velocity(truth: Truth, phases: Sequence[Phase], draw: np.random.Generator) -> tuple[Array, Array]:
    """Measured velocity over ground (east_m_s, north_m_s)."""
    noise = draw.standard_normal((len(truth.t_s), 2))
    sigma = by_phase(phases, truth.t_s, lambda errors: errors.gps_velocity_m_s)
    return truth.v_east_m_s + noise[:, 0] * sigma, truth.v_north_m_s + noise[:, 1] * sigma


def compass_heading_deg(truth: Truth, phases: Sequence[Phase], draw: np.random.Generator) -> Array:
    """Measured heading from true north (deg, [0, 360))."""
    noise = draw.standard_normal(len(truth.t_s))
    sigma = by_phase(phases, truth.t_s, lambda errors: errors.compass_deg)
    return np.mod(np.degrees(truth.heading_rad) + noise * sigma, 360.0)


def body_motion(truth: Truth) -> tuple[Array, Array, Array]:
    """Means over the n - 1 intervals between the times of `truth`: accel_fwd and accel_stb (m/s^2), yaw rate (rad/s).

    The mid heading resolves the acceleration into forward and starboard (transpose of the filters' rotation, clockwise
    heading): a_fwd = sin(psi) a_east + cos(psi) a_north, a_stb = cos(psi) a_east - sin(psi) a_north.
    """
    step_s = np.diff(truth.t_s)
    a_east = np.diff(truth.v_east_m_s) / step_s
    a_north = np.diff(truth.v_north_m_s) / step_s
    middle = 0.5 * (truth.heading_rad[1:] + truth.heading_rad[:-1])
    sin, cos = np.sin(middle), np.cos(middle)
    return sin * a_east + cos * a_north, cos * a_east - sin * a_north, np.diff(truth.heading_rad) / step_s


def imu_samples(truth: Truth, phases: Sequence[Phase], draw: np.random.Generator) -> Array:
    """Shape (n - 1, 3): accel_fwd m/s^2, accel_stb m/s^2, yaw rate deg/s; row k covers what ends at t_s[k + 1]."""
    accel_fwd, accel_stb, yaw_rate_rad_s = body_motion(truth)
    t_s = truth.t_s[1:]
    root_rate = 1.0 / np.sqrt(np.diff(truth.t_s))
    noise = draw.standard_normal((len(t_s), 3)) * root_rate[:, np.newaxis]
    accel = by_phase(phases, t_s, lambda errors: errors.accel_density)
    gyro = by_phase(phases, t_s, lambda errors: errors.gyro_density_deg)
    return np.stack(
        (
            accel_fwd + noise[:, 0] * accel + by_phase(phases, t_s, lambda errors: errors.bias_accel_fwd_m_s2),
            accel_stb + noise[:, 1] * accel + by_phase(phases, t_s, lambda errors: errors.bias_accel_stb_m_s2),
            np.degrees(yaw_rate_rad_s)
            + noise[:, 2] * gyro
            + by_phase(phases, t_s, lambda errors: errors.bias_yaw_rate_deg_s),
        ),
        axis=1,
    )
