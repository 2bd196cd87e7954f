"""A small world of its own for the filter tests: the thesis' mission T1 in a current, its noise, filters on arrays."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from common.angles import difference_rad
from shore.navigation.adaptation import Channel
from shore.navigation.filters import Filter, FilterFacts, build_filter
from shore.navigation.models import Array, ImuInput, ProcessNoise, plane_to_body, wrap_rad_array

ACCEL_STD = 0.0039
"""What the filters assume, m/s^2 and deg/s at 1 Hz (Table 5.3)."""
GYRO_STD_DEG = 0.033
WAYPOINTS = ((650.0, 385.0), (320.0, 190.0), (30.0, 250.0))


@dataclass(frozen=True)
class Truth:
    """A mission in steps of dt_s: states (k, 5); body acceleration and yaw rate over the step that ends there (k, 3)."""

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
        fwd, stb = plane_to_body(accel[0], accel[1], heading + 0.5 * turn)
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
    return FilterFacts(channels, ProcessNoise(ACCEL_STD, ACCEL_STD, math.radians(GYRO_STD_DEG)))


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
        each.update_position("gps1", *run.positions[k])
        each.update_heading("compass1", run.headings[k])
        states[k], spreads[k] = each.estimate.x, each.estimate.P
    return states, spreads, each


def errors(states: Array, truth: Truth) -> Array:
    """Estimate - truth, (k, 5), heading wrapped."""
    error = states - truth.states
    error[:, 4] = wrap_rad_array(error[:, 4])
    return error


@pytest.fixture(scope="session")
def mission() -> Truth:
    """T1 at 1 Hz for 600 s, with two turns."""
    return sail(600)


@pytest.fixture(scope="session")
def scenario_53(mission: Truth) -> Callable[[int], Run]:
    """Seed -> run with the thesis' change: from step 300 on GPS 20 m and compass 5 deg instead of 8/7 m and 0.8 deg."""
    count = len(mission.states)
    late = np.arange(count) >= 300
    gps = np.where(late[:, None], 20.0, np.array([8.0, 7.0]))
    compass = np.where(late, 5.0, 0.8)
    return lambda seed: measure(mission, seed, gps, compass)
