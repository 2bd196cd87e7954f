"""A small world of its own for the filter tests: the thesis' mission T1 in a current, its noise, filters on arrays."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from common.angles import difference_rad, wrap_deg
from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.geodesy import LocalPlane
from common.messages import Fix, Frame, Heading, ImuBlock
from common.units import NS_PER_S
from shore.navigation.filter_bank import Moment
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter, FilterState
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise, body_to_plane
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import FilterFacts

ACCEL_STD = 0.0039
"""What the filters assume, m/s^2 and deg/s at 1 Hz (Table 5.3)."""
GYRO_STD_DEG = 0.033
WAYPOINTS = ((650.0, 385.0), (320.0, 190.0), (30.0, 250.0))


@dataclass(frozen=True)
class Truth:
    """A mission in steps of dt_s: states (k, 5); body acceleration and yaw rate over the step ending there (k, 3)."""

    dt_s: float
    states: Array
    inputs: Array


@dataclass(frozen=True)
class Run:
    """One simulated run at 1 Hz: inputs (k, 3) in SI, positions (k, 2), headings (k,)."""

    inputs: Array
    positions: Array
    headings: Array


def sail(seconds: int, dt_s: float = 1.0) -> Truth:
    """T1: 1 m/s through the water, turns of 3 deg/s, waypoints within 20 m, 0.5 m/s current with a swinging set."""
    east, north, heading, leg = 765.0, 728.0, math.radians(199.0), 0
    count = round(seconds / dt_s)
    states, inputs = np.zeros((count, 5)), np.zeros((count, 3))
    velocity = None
    for k in range(count):
        if math.dist((east, north), WAYPOINTS[leg]) < 20.0:
            leg = min(leg + 1, len(WAYPOINTS) - 1)
        bearing = math.atan2(WAYPOINTS[leg][0] - east, WAYPOINTS[leg][1] - north)
        most = math.radians(3.0) * dt_s
        wanted = difference_rad(bearing, heading)
        turn = max(-most, min(most, wanted)) if abs(wanted) > most else 0.0
        set_rad = math.radians(235.0 + 45.0 * math.sin(2.0 * math.pi * east / 800.0))
        new = np.array(
            [math.sin(heading + turn) + 0.5 * math.sin(set_rad), math.cos(heading + turn) + 0.5 * math.cos(set_rad)]
        )
        velocity = new if velocity is None else velocity
        accel = (new - velocity) / dt_s
        # The rotation is its own inverse (test_models.py).
        fwd, stb = body_to_plane(accel[0], accel[1], heading + 0.5 * turn)
        east += dt_s * 0.5 * (new[0] + velocity[0])
        north += dt_s * 0.5 * (new[1] + velocity[1])
        heading += turn
        velocity = new
        states[k] = east, north, new[0], new[1], heading
        inputs[k] = fwd, stb, turn / dt_s
    return Truth(dt_s, states, inputs)


def measure(truth: Truth, seed: int, gps_m: Array, compass_deg: Array) -> Run:
    """Noisy sensors at the truth's rate; `gps_m` (k, 2) and `compass_deg` (k,) are the true sigmas at each step."""
    rng = np.random.default_rng(seed)
    count = len(truth.states)
    scale = [ACCEL_STD, ACCEL_STD, math.radians(GYRO_STD_DEG)]
    return Run(
        truth.inputs + rng.normal(size=(count, 3)) * scale,
        truth.states[:, :2] + rng.normal(size=(count, 2)) * gps_m,
        truth.states[:, 4] + np.radians(compass_deg) * rng.normal(size=count),
    )


def thesis_facts() -> FilterFacts:
    """Table 5.3."""
    channels = {
        "gps1.east": Channel(36.0),
        "gps1.north": Channel(49.0),
        "compass1.heading": Channel(math.radians(0.5) ** 2),
    }
    return FilterFacts(channels, imu_noise=ProcessNoise(ACCEL_STD, ACCEL_STD, math.radians(GYRO_STD_DEG)))


def run_filter(name: str, truth: Truth, run: Run, seed: int) -> tuple[Array, Array, Filter]:
    """Estimates (k, 5) and covariances (k, 5, 5) of a filter started about the truth with its own P."""
    each = build_filter(name, thesis_facts())
    P = np.diag([36.0, 49.0, 0.25, 0.25, math.radians(0.5) ** 2])
    noise = np.random.default_rng(10_000 + seed).normal(size=5)
    each.start(truth.states[0] + np.sqrt(P.diagonal()) * noise, P)
    states, spreads = np.zeros_like(truth.states), np.zeros((len(truth.states), 5, 5))
    states[0], spreads[0] = each.estimate.x, P
    for k in range(1, len(truth.states)):
        each.predict(truth.dt_s, ImuInput(*run.inputs[k]))
        t_ns = round(k * truth.dt_s * NS_PER_S)
        each.update(Position(t_ns, "gps1", *run.positions[k]))
        each.update(TrueHeading(t_ns, "compass1", run.headings[k]))
        states[k], spreads[k] = each.estimate.x, each.estimate.P
    return states, spreads, each


def errors(states: Array, truth: Truth) -> Array:
    """Estimate - truth, (k, 5), heading wrapped."""
    error = states - truth.states
    error[:, 4] = np.angle(np.exp(1j * error[:, 4]))
    return error


# Its IMU is calibrated: the filters have the thesis' five states.
BOAT = BoatConfig(
    boat=BoatTable(id="springer", variation_deg=0.0, current_sigma_m_s=0.0, leeway_m_s=0.0),
    port=(PortTable(name="p", path="/dev/null"),),
    sensor=(
        SensorTable(id="gps1", port="p", role="gps", rate_hz=1.0, sigma_m=6.5),
        SensorTable(
            id="compass1", port="p", role="compass", rate_hz=10.0, sigma_deg=0.5, compass_bias_sigma_deg=0.0,
            compass_deviation_sigma_deg=0.0,
        ),
        SensorTable(
            id="imu1", port="p", role="imu", rate_hz=20.0, accel_density=0.004, gyro_density_deg=0.036,
            bias_accel_sigma_m_s2=0.0, bias_yaw_rate_sigma_deg_s=0.0, tilt_leak_sigma_per_m=0.0,
            heel_leak_sigma=0.0,
        ),
    ),
)  # fmt: skip
UNCALIBRATED = replace(
    BOAT,
    sensor=tuple(
        replace(s, bias_accel_sigma_m_s2=0.3, bias_yaw_rate_sigma_deg_s=1.0, tilt_leak_sigma_per_m=0.2)
        for s in BOAT.sensor
    ),
)
"""A consumer IMU mounted by eye."""
HOME = LocalPlane(50.4, -4.2)
FRAME_NS = 100_000_000


def frames_of(
    truth: Truth,
    seed: int,
    gps_m: Callable[[float], tuple[float, float]] = lambda t: (8.0, 7.0),
    compass_deg: Callable[[float], float] = lambda t: 0.8,
) -> list[Frame]:
    """10 frames/s from a 20 Hz truth: IMU 20 Hz, compass 10 Hz, GPS 1 Hz; the end of a frame belongs to the next one.

    `gps_m` and `compass_deg` give the true sigmas at a time in s.
    """
    rng = np.random.default_rng(seed)
    step_ns = round(truth.dt_s * 1e9)
    spread = np.array([0.004, 0.004, 0.036]) / math.sqrt(truth.dt_s)
    readings = truth.inputs * [1.0, 1.0, math.degrees(1.0)] + rng.normal(size=truth.inputs.shape) * spread
    sums = np.zeros(3)
    frames = []
    for seq in range((len(truth.states) - 1) * step_ns // FRAME_NS):
        t0_ns = 10**9 + seq * FRAME_NS
        k = seq * FRAME_NS // step_ns
        rows = readings[k : k + FRAME_NS // step_ns]
        sums = sums + (rows.sum(axis=0) if k else rows[1:].sum(axis=0)) * truth.dt_s
        block = ImuBlock(
            sensor="imu1", t_ns=t0_ns, offset_us=tuple(step_ns // 1000 * i for i in range(len(rows))),
            accel_fwd_m_s2=tuple(rows[:, 0].tolist()), accel_stb_m_s2=tuple(rows[:, 1].tolist()),
            yaw_rate_deg_s=tuple(rows[:, 2].tolist()), sum_accel_fwd_m_s=float(sums[0]),
            sum_accel_stb_m_s=float(sums[1]), sum_yaw_deg=float(sums[2]),
            sum_count=k + len(rows), sum_time_s=(k + len(rows) - 1) * truth.dt_s,
        )  # fmt: skip
        t = seq * FRAME_NS / 1e9
        mag = math.degrees(truth.states[k, 4]) + compass_deg(t) * rng.normal()
        fixes: tuple[Fix, ...] = ()
        if seq % 10 == 0:
            lat, lon = HOME.to_lat_lon_deg(*(truth.states[k, :2] + rng.normal(size=2) * gps_m(t)))
            fixes = (Fix(sensor="gps1", t_ns=t0_ns, lat_deg=lat, lon_deg=lon, fix_quality=1, fix_mode=3),)
        frames.append(
            Frame(
                boat_id="springer",
                boot_id="b1",
                seq=seq,
                clock_id="c1",
                start_no=1,
                t0_ns=t0_ns,
                t1_ns=t0_ns + FRAME_NS,
                imu=(block,),
                fixes=fixes,
                headings=(Heading(sensor="compass1", t_ns=t0_ns, heading_mag_deg=wrap_deg(mag)),),
            )
        )
    return frames


def state_of(moment: Moment, index: int = 0) -> FilterState:
    """The state of one filter that must have started."""
    state = moment.states[index]
    assert state is not None
    return state
