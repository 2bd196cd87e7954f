"""Sensor error models: truth in, noisy columns (white noise, bias) out, for one boat or for many runs at once.

White Gaussian noise by phase plus a constant IMU bias are the thesis' models (Eqs 3.1-3.4, Table 5.4);
`sensor_errors.py` adds what real sensors do besides. Each sensor draws from its own generator; the draws of a time
come together, so a shorter run is the beginning of a longer one. Arrays have the runs first: (runs, n) or (runs, n,
axes).
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from common.boat_config import SensorTable
from common.simulation.motion import Array, Truth
from common.simulation.sensor_errors import NO_FLAWS, Flaws, drift_path

STREAMS: Final = ("gps1", "compass1", "imu1", "gps1 velocity", "start", "imu1 turn-on", "imu1 drift", "gps1 drift")
"""Streams of random numbers of the three-port boat. Append only: a stream's seed depends on its place, never on how
many follow. Every other stream is seeded by its name."""


def generators(seed: int | np.random.SeedSequence) -> dict[str, np.random.Generator]:
    """One independent generator for each of `STREAMS`."""
    root = np.random.SeedSequence(seed) if isinstance(seed, int) else seed
    children = root.spawn(len(STREAMS))
    return {name: np.random.default_rng(child) for name, child in zip(STREAMS, children, strict=True)}


def _named(root: np.random.SeedSequence, stream: str) -> np.random.Generator:
    """The generator of a stream that is not in `STREAMS`: it depends on nothing but root and name."""
    key = (*root.spawn_key, len(STREAMS), zlib.crc32(stream.encode()))
    return np.random.default_rng(np.random.SeedSequence(root.entropy, spawn_key=key))


class Draws:
    """Standard normals of several runs, each from its own seed: run j is the same however many there are."""

    def __init__(self, *roots: int | np.random.SeedSequence) -> None:
        self._roots = [np.random.SeedSequence(root) if isinstance(root, int) else root for root in roots]
        self._generators = [generators(root) for root in self._roots]

    def normals(self, stream: str, *shape: int) -> Array:
        """Next draws of a stream, (runs, *shape)."""
        return np.stack([each.standard_normal(shape) for each in self.of(stream)])

    def of(self, stream: str) -> list[np.random.Generator]:
        """The generators of a stream, one a run: of `STREAMS` or any other name; no stream moves another."""
        for root, each in zip(self._roots, self._generators, strict=True):
            if stream not in each:
                each[stream] = _named(root, stream)
        return [each[stream] for each in self._generators]

    def beginning(self, stream: str) -> np.random.Generator:
        """The first run's generator of a named stream as it is before any draw: what several sensors see alike."""
        return _named(self._roots[0], stream)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorErrors:
    """1-sigma of what the sensors really do."""

    gps_east_m: float
    gps_north_m: float
    compass_deg: float
    """1-sigma of each compass sample, deg."""
    accel_density: float
    """Noise density of the acceleration, m/s^2/sqrt(Hz): a sample at f Hz has 1-sigma density * sqrt(f). At 1 Hz it is
    the thesis' number."""
    gyro_density_deg: float
    """Noise density of the yaw rate, deg/s/sqrt(Hz)."""
    gps_velocity_m_s: float = 0.1
    """1-sigma of the GPS velocity on each axis, m/s; usual for Doppler velocity of a small receiver. The thesis does
    not use it."""
    bias_accel_fwd_m_s2: float = 0.0
    """Bias of the forward accelerometer, m/s^2. Biases default to 0: "removed" (Eq. 3.2, 3.3). `TABLE_5_4_BIAS` of
    `tables` has the thesis' values."""
    bias_accel_stb_m_s2: float = 0.0
    bias_yaw_rate_deg_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Phase:
    """`errors` hold for times later than `after_s`, until the next phase begins."""

    after_s: float
    errors: SensorErrors
    of_sensor: tuple[tuple[str, SensorErrors], ...] = ()
    """Errors of single sensors by their id, in place of `errors`."""


def by_phase(phases: Sequence[Phase], t_s: Array, pick: Callable[[SensorErrors], float | tuple[float, ...]]) -> Array:
    """One number of the errors at each time, shape of `t_s`; or several, (n, numbers)."""
    number = np.searchsorted([phase.after_s for phase in phases[1:]], t_s, side="left")
    values: Array = np.array([pick(phase.errors) for phase in phases], dtype=np.float64)[number]
    return values


def at_antenna(truth: Truth, sensor: SensorTable) -> Truth:
    """The truth as the receiver's antenna lives it: at the lever arm of the boat's file from the reference point."""
    fwd_m, stb_m = sensor.lever_fwd_m, sensor.lever_stb_m
    if not fwd_m and not stb_m:
        return truth
    sin, cos = np.sin(truth.heading_rad), np.cos(truth.heading_rad)
    east_m = truth.east_m + fwd_m * sin + stb_m * cos
    north_m = truth.north_m + fwd_m * cos - stb_m * sin
    return replace(truth, east_m=east_m, north_m=north_m)


def gps_position(
    truth: Truth, phases: Sequence[Phase], draws: Draws, flaws: Flaws = NO_FLAWS, sensor: str = "gps1"
) -> Array:
    """Measured east and north at the times of `truth` (m), (runs, n, 2), Eq. 4.30."""
    white = draws.normals(sensor, len(truth.t_s), 2)
    sigma = by_phase(phases, truth.t_s, lambda errors: (errors.gps_east_m, errors.gps_north_m))
    seen = _seen(truth, flaws.gps_latency_s)
    measured = np.stack((seen.east_m, seen.north_m), axis=1) + white * sigma
    if flaws.gps_drift_m.density:
        measured += drift_path(flaws.gps_drift_m, truth.t_s, draws.normals(f"{sensor} drift", len(truth.t_s), 2))
    return measured


def gps_velocity(truth: Truth, phases: Sequence[Phase], draws: Draws, sensor: str = "gps1") -> Array:
    """Measured velocity over ground, east and north (m/s), (runs, n, 2)."""
    white = draws.normals(f"{sensor} velocity", len(truth.t_s), 2)
    sigma = by_phase(phases, truth.t_s, lambda errors: errors.gps_velocity_m_s)
    return np.stack((truth.v_east_m_s, truth.v_north_m_s), axis=1) + white * sigma[:, np.newaxis]


def compass_heading_deg(
    truth: Truth, phases: Sequence[Phase], draws: Draws, flaws: Flaws = NO_FLAWS, sensor: str = "compass1"
) -> Array:
    """Measured heading from true north (deg, [0, 360)), (runs, n), Eq. 4.31."""
    white = draws.normals(sensor, len(truth.t_s))
    sigma = by_phase(phases, truth.t_s, lambda errors: errors.compass_deg)
    heading_rad = _seen(truth, flaws.compass_latency_s).heading_rad
    # true = compass + deviation: what the compass shows is less by its deviation
    return np.mod(np.degrees(heading_rad) - flaws.deviation.at(heading_rad) + white * sigma, 360.0)


def _seen(truth: Truth, latency_s: float) -> Truth:
    """What a sensor still believes that is `latency_s` behind without saying so; at first the boat's first state."""
    return truth.at(truth.t_s - latency_s) if latency_s else truth


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


@dataclass(frozen=True, slots=True)
class ImuSamples:
    """What IMUs measured over the n - 1 intervals between the times of a truth."""

    values: Array
    """Measured values, (runs, n - 1, 3): accel_fwd m/s^2, accel_stb m/s^2, yaw rate deg/s; row k covers what ends at
    t_s[k + 1]."""
    turn_on: Array
    """Part of the bias that was drawn for the run, (runs, 3), in the same units."""


def imu_samples(
    truth: Truth, phases: Sequence[Phase], draws: Draws, flaws: Flaws = NO_FLAWS, sensor: str = "imu1"
) -> ImuSamples:
    """Measured accelerations and yaw rate: (1 + scale) truth + white + bias + drift (Eqs 3.2, 3.3 and `flaws`)."""
    accel_fwd, accel_stb, yaw_rate_rad_s = body_motion(truth)
    motion = np.stack((accel_fwd, accel_stb, np.degrees(yaw_rate_rad_s)), axis=1)
    t_s = truth.t_s[1:]
    root_rate = 1.0 / np.sqrt(np.diff(truth.t_s))
    white = draws.normals(sensor, len(t_s), 3) * root_rate[:, np.newaxis]
    sigma = by_phase(phases, t_s, lambda errors: (errors.accel_density, errors.accel_density, errors.gyro_density_deg))
    turn_on = draws.normals(f"{sensor} turn-on", 6) * (*flaws.turn_on, *flaws.scale)
    scaled = motion * (1.0 + turn_on[:, np.newaxis, 3:])
    values = scaled + white * sigma + (by_phase(phases, t_s, imu_bias) + turn_on[:, np.newaxis, :3])
    if flaws.accel_drift.density or flaws.gyro_drift_deg.density:
        shared = draws.normals(f"{sensor} drift", len(t_s), 3)
        values[..., :2] += drift_path(flaws.accel_drift, t_s, shared[..., :2])
        values[..., 2:] += drift_path(flaws.gyro_drift_deg, t_s, shared[..., 2:])
    return ImuSamples(values, turn_on[:, :3])


def imu_bias(errors: SensorErrors) -> tuple[float, float, float]:
    """Constant bias: forward, starboard (m/s^2), yaw rate (deg/s)."""
    return errors.bias_accel_fwd_m_s2, errors.bias_accel_stb_m_s2, errors.bias_yaw_rate_deg_s
