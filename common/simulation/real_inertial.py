"""Inertial error model of a consumer IMU and rate gyro: bias, scale, misalignment, random walk, noise, own attitude.

What is drawn for each unit, and where its size comes from:

* Turn-on bias 0.1 m/s^2 (10 mg) and 0.4 deg/s, walk 0.002 m/s^2 and 0.005 deg/s in a second: the defaults of
  `SensorTable`, which say why, and judge.md (0.4 deg/s). Biases that the boat's file knows are in it besides.
* Scale 0.5 % each accelerometer, 1 % each gyro (MPU-6000 data sheet: +-3 % before calibration; false alarms of
  honest-filter.md were judged at 1 %), mounted 1 deg askew about each axis (by eye).
* White noise: 0.004 m/s^2/sqrt(Hz) and 0.01 deg/s/sqrt(Hz) (data sheet of the MPU-6000: 400 ug and 0.005 deg/s), and
  what shakes the hull: 0.01 to 0.04 m/s^2/sqrt(Hz); a BlueBoat's athwart accelerometer keeps 0.05 to 0.11 m/s^2 at
  10 Hz after its motion is taken out (README of the recordings).
* The unit's own attitude is a complementary filter that levels itself by its accelerometers within 5 to 15 s and knows
  nothing of the acceleration in a turn: honest-filter.md section 3 levels within 10 s and finds it worth nothing.
"""

from collections.abc import Iterator

import numpy as np

from common.boat_config import SensorTable
from common.simulation.motion import Array, Truth, sample_times_s
from common.simulation.readings import ImuReading, Timed, TurnRateReading
from common.simulation.recurrences import recur
from common.simulation.sensor_errors import Drift, drift_path
from common.simulation.sensor_models import Draws
from common.simulation.specific_force import BodyMotion, body_motion_3d

ACCEL_BIAS_M_S2 = 0.1
ACCEL_WALK = Drift(0.002)
ACCEL_DENSITY = 0.004
SHAKING_DENSITY = (0.01, 0.04)
GYRO_BIAS_DEG_S = 0.4
GYRO_WALK_DEG = Drift(0.005)
GYRO_DENSITY_DEG = 0.01
SCALE = np.array([0.005, 0.005, 0.005, 0.01, 0.01, 0.01])
ASKEW_DEG = 1.0
LEVELS_WITHIN_S = (5.0, 15.0)


def imu_samples_3d(motion: BodyMotion, t_s: Array, rng: np.random.Generator, normals: Array, walks: Array) -> Array:
    """Six axes (m - 1, 6) over the intervals between the times (m,): m/s^2, then deg/s; forward, starboard, down each.

    `rng` draws what is constant for the unit, `normals` and `walks` (m - 1, 6) are standard normals.
    """
    askew = _rotation(np.radians(ASKEW_DEG) * rng.standard_normal(3))
    scale = 1.0 + SCALE * rng.standard_normal(6)
    bias = np.repeat((ACCEL_BIAS_M_S2, GYRO_BIAS_DEG_S), 3) * rng.standard_normal(6)
    density = np.repeat((np.hypot(ACCEL_DENSITY, rng.uniform(*SHAKING_DENSITY)), GYRO_DENSITY_DEG), 3)
    true = np.concatenate((motion.force_m_s2 @ askew.T, np.degrees(motion.rate_rad_s) @ askew.T), axis=1)
    values = motion.mean(true, t_s) * scale + bias + density / np.sqrt(np.diff(t_s))[:, np.newaxis] * normals
    values[:, :3] += drift_path(ACCEL_WALK, t_s[1:], walks[:, :3])
    values[:, 3:] += drift_path(GYRO_WALK_DEG, t_s[1:], walks[:, 3:])
    return values


def _rotation(turn_rad: Array) -> Array:
    """Rotation by a small vector (3,), to first order: rows are the axes of the unit."""
    x, y, z = turn_rad.tolist()
    return np.array([[1.0, z, -y], [-z, 1.0, x], [y, -x, 1.0]])


def own_attitude_deg(motion: BodyMotion, t_s: Array, samples: Array, levels_s: float) -> Array:
    """Roll and pitch (m - 1, 2) as the unit reckons them from its own samples (m - 1, 6): a complementary filter.

    Rates carry it, the direction of the specific force pulls it within `levels_s`. How rates of the body become rates
    of roll and pitch is taken from the truth: the error of that is of second order.
    """
    fwd, stb, down = samples[:, 0], samples[:, 1], samples[:, 2]
    apparent = np.degrees(np.stack((np.arctan2(-stb, -down), np.arctan2(fwd, np.hypot(stb, down))), axis=1))
    step_s = np.diff(t_s)
    gyro_error = samples[:, 3:5] - np.degrees(motion.mean(motion.rate_rad_s, t_s))[:, :2]
    turned = (np.degrees(motion.mean(motion.euler_rate_rad_s, t_s))[:, :2] + gyro_error) * step_s[:, np.newaxis]
    keep = np.exp(-step_s / levels_s)
    driven = keep[:, np.newaxis] * turned + (1.0 - keep)[:, np.newaxis] * apparent
    driven[0] = apparent[0]
    return recur(keep[1:], driven)


def imu_readings(truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
    """Six axes and an attitude of its own, as means over the intervals that end at each time."""
    motion, t_s = body_motion_3d(truth), sample_times_s(truth, sensor)
    if len(t_s) < 2:
        return
    made, rows = draws.of(f"{sensor.id} made")[0], len(t_s) - 1
    normals, walks = draws.normals(sensor.id, rows, 6)[0], draws.normals(f"{sensor.id} drift", rows, 6)[0]
    samples = imu_samples_3d(motion, t_s, made, normals, walks)
    known = (sensor.bias_accel_fwd_m_s2, sensor.bias_accel_stb_m_s2, 0.0, 0.0, 0.0, sensor.bias_yaw_rate_deg_s)
    samples += known
    attitude = own_attitude_deg(motion, t_s, samples, made.uniform(*LEVELS_WITHIN_S))
    for t, (fwd, stb, down, roll_rate, pitch_rate, yaw_rate), tilt in zip(
        t_s[1:].tolist(), samples.tolist(), attitude.tolist(), strict=True
    ):
        yield Timed(t, sensor.id, ImuReading(fwd, stb, yaw_rate, down, roll_rate, pitch_rate, *tilt))


def gyro_readings(truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
    """Yaw rate alone, about the hull's own axis."""
    motion, t_s = body_motion_3d(truth), sample_times_s(truth, sensor)
    if len(t_s) < 2:
        return
    made, rows = draws.of(f"{sensor.id} made")[0], len(t_s) - 1
    normals, walks = draws.normals(sensor.id, rows, 6)[0], draws.normals(f"{sensor.id} drift", rows, 6)[0]
    rates = imu_samples_3d(motion, t_s, made, normals, walks)[:, 5] + sensor.bias_yaw_rate_deg_s
    for t, rate in zip(t_s[1:].tolist(), rates.tolist(), strict=True):
        yield Timed(t, sensor.id, TurnRateReading(rate))
