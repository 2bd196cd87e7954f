"""Monte Carlo runs of one scenario: all sensors at the scenario's step, each run from its own seed."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from common.simulation.motion import Array, grid
from common.simulation.scenario import Scenario
from common.simulation.sensor_models import (
    Draws,
    body_motion,
    by_phase,
    compass_heading_deg,
    gps_position,
    imu_bias,
    imu_samples,
)

START_NOISES: Final = 16
"""Standard normals for the random start: more than the filters have states."""


@dataclass(frozen=True, slots=True)
class Runs:
    """Independent runs of one scenario. `k` rows are steps, row 0 is the start; SI, radians, local plane.

    The truth is the same in all runs. Readings of row 0 exist too; without a reading (outage) a row still holds what
    would have been measured: ask `has_gps` and `has_compass`.
    """

    step_s: float
    truth: Array
    """True state, (k, 5): east, north (m), v_east, v_north over ground (m/s), heading (rad, continuous, clockwise from
    north)."""
    inputs: Array
    """True input, (k, 3): means over the interval that ends at the row, resolved at the mid heading: acceleration
    forward and to starboard (m/s^2), yaw rate (rad/s). Row 0 is 0."""
    imu: Array
    """Measured input, (runs, k, 3), in the same units, with noise and bias."""
    gps: Array
    """Measured position, (runs, k, 2): east, north (m)."""
    compass_rad: Array
    """Measured heading, (runs, k), rad, within [-pi, pi)."""
    has_gps: npt.NDArray[np.bool_]
    """True at each step that has a fix, (k,)."""
    has_compass: npt.NDArray[np.bool_]
    """True at each step that has a heading, (k,)."""
    gps_m: Array
    """True 1-sigma of a fix's error at each step, (k, 2), m, a slow part included."""
    compass_sigma_rad: Array
    """True 1-sigma of the compass' noise at each step, (k,), rad; deviation is none."""
    accel_std: Array
    """True 1-sigma of the white noise of an acceleration sample at each step, (k, 2), m/s^2."""
    gyro_std_rad: Array
    """True 1-sigma of the white noise of a yaw-rate sample at each step, (k,), rad/s."""
    biases: Array
    """True IMU bias that is constant over a run, (runs, 3): forward, starboard (m/s^2), yaw rate (rad/s)."""
    start_noise: Array
    """Standard normals for the filters' start, (runs, 16)."""

    @property
    def t_s(self) -> Array:
        """Time of each row, (k,)."""
        t_s: Array = np.arange(len(self.truth), dtype=np.float64) * self.step_s
        return t_s


def draw_runs(scenario: Scenario, count: int, seed: int, first: int = 0) -> Runs:
    """Measure a scenario: runs `first` to `first + count`; run j is the same whatever these are."""
    fine = scenario.truth()
    truth = fine.at(grid(float(fine.t_s[-1]), 1.0 / scenario.step_s))
    draws = Draws(*(np.random.SeedSequence(seed, spawn_key=(run,)) for run in range(first, first + count)))
    phases, flaws, t_s = scenario.phases, scenario.flaws, truth.t_s
    samples = imu_samples(truth, phases, draws, flaws)
    compass = np.radians(compass_heading_deg(truth, phases, draws, flaws))
    white_m = by_phase(phases, t_s, lambda errors: (errors.gps_east_m, errors.gps_north_m))
    accel = by_phase(phases, t_s, lambda errors: (errors.accel_density, errors.accel_density))
    gyro_deg = by_phase(phases, t_s, lambda errors: errors.gyro_density_deg)
    root_rate = 1.0 / np.sqrt(scenario.step_s)
    return Runs(
        step_s=scenario.step_s,
        truth=np.stack((truth.east_m, truth.north_m, truth.v_east_m_s, truth.v_north_m_s, truth.heading_rad), axis=1),
        inputs=_from_row_1(np.stack(body_motion(truth), axis=1)),
        imu=_from_row_1(samples.values * _TO_SI),
        gps=gps_position(truth, phases, draws, flaws),
        compass_rad=np.mod(compass + np.pi, 2.0 * np.pi) - np.pi,
        has_gps=scenario.works("gps1", t_s),
        has_compass=scenario.works("compass1", t_s),
        gps_m=np.hypot(white_m, flaws.gps_drift_m.sigma),
        compass_sigma_rad=np.radians(by_phase(phases, t_s, lambda errors: errors.compass_deg)),
        accel_std=accel * root_rate,
        gyro_std_rad=np.radians(gyro_deg) * root_rate,
        biases=(samples.turn_on + imu_bias(phases[0].errors)) * _TO_SI,
        start_noise=draws.normals("start", START_NOISES),
    )


_TO_SI: Final = np.array([1.0, 1.0, np.pi / 180.0])
"""Factors to SI for the columns of an IMU: the gyro is in degrees in `sensors`."""


def _from_row_1(columns: Array) -> Array:
    """(..., k - 1, 3) -> (..., k, 3): a row of zeros before the first, for nothing is measured before the start."""
    before = np.zeros_like(columns[..., :1, :])
    return np.concatenate((before, columns), axis=-2)
