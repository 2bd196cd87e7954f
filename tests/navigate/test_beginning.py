"""The first state: all the IMU shows may be bias, the antenna has a lever."""

import math

import numpy as np
import pytest

from common.boat_config import BoatConfig, BoatTable, SensorTable
from common.messages import Fix, Frame, Heading, ImuBlock
from shore.navigation.estimate import Estimate
from shore.navigation.filter_registry import build_filter
from shore.navigation.initial_state import first_state
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise, body_to_plane
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import FIVE, Extra, StateSpace
from shore.pipeline import Pipeline

LEAKY = StateSpace(
    (Extra("accel_bias_fwd_m_s2", 0.15), Extra("accel_bias_stb_m_s2", 0.15), Extra("tilt_leak_per_m", 0.2, limit=0.4))
)
CHANNELS = {"g.east": Channel(4.0), "g.north": Channel(4.0), "c.heading": Channel(1e-4)}
FIX, HEADING = Position(0, "g", 0.0, 0.0), TrueHeading(0, "c", 1.0)


def test_the_doubt_of_a_bias_holds_what_the_imu_shows() -> None:
    x, P, _ = first_state(0, FIX, HEADING, FilterFacts(CHANNELS, LEAKY), ImuInput(-1.7, 0.3, 0.0))
    assert x[5:] == pytest.approx([0.0, 0.0, 0.0])
    assert np.sqrt(P.diagonal()[5:]) == pytest.approx([math.hypot(1.7, 0.15), math.hypot(0.3, 0.15), 0.2])


def test_without_bias_states_or_without_imu_nothing_is_widened() -> None:
    for facts, shown in ((FilterFacts(CHANNELS, FIVE), ImuInput(-1.7, 0.3, 0.0)), (FilterFacts(CHANNELS, LEAKY), None)):
        _, P, _ = first_state(0, FIX, HEADING, facts, shown)
        sigmas = [extra.sigma for extra in facts.space.extras]
        assert np.sqrt(P.diagonal()[5:]) == pytest.approx(sigmas)


AFT = (-8.0, 1.0)
"""Forward and starboard of the reference point, m."""


@pytest.mark.parametrize("space", [LEAKY, StateSpace((Extra("c_bias_rad", 0.02),))])
def test_the_first_place_is_that_of_the_reference_point(space: StateSpace) -> None:
    """Fix and heading are drawn about the truth: the first state is exact without noise, and as good as it claims."""
    rng = np.random.default_rng(4)
    truth = np.array([3.0, -5.0, 1.0])
    antenna = truth[:2] + np.array(body_to_plane(*AFT, truth[2]))
    facts = FilterFacts({**CHANNELS, "g.east": Channel(0.01), "g.north": Channel(0.01)}, space, levers={"g": AFT})
    exact, _, _ = first_state(0, Position(0, "g", *antenna), HEADING._replace(heading_rad=1.0), facts)
    assert exact[[0, 1, 4]].tolist() == pytest.approx(truth.tolist())

    squares = []
    for _ in range(2000):
        fix = Position(0, "g", *(antenna + 0.1 * rng.normal(size=2)))
        bias = space.index("c_bias_rad")
        off = 0.01 * rng.normal() + (0.0 if bias is None else 0.02 * rng.normal())
        x, P, read_from = first_state(0, fix, HEADING._replace(heading_rad=1.0 + off), facts)
        error = x[:2] - truth[:2]
        squares.append(error @ np.linalg.solve(P[:2, :2], error))
    assert np.mean(squares) == pytest.approx(2.0, abs=0.15)
    assert read_from == {0: "g.east", 1: "g.north", 4: "c.heading"}


@pytest.mark.parametrize("told_sigma_deg", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("name", ["kf", "ekf", "ukf", "fuzzy"])
def test_a_long_lever_and_a_fine_gps_start_well_whatever_is_told_of_the_compass(
    name: str, told_sigma_deg: float
) -> None:
    """8 m and 5 cm: a P that is not positive after R was learned would end in no number."""
    rng = np.random.default_rng(5)
    fine = {"g.east": Channel(0.0025, 5.0), "g.north": Channel(0.0025, 5.0)}
    channels = {**fine, "c.heading": Channel(math.radians(told_sigma_deg) ** 2, 10.0)}
    each = build_filter(name, FilterFacts(channels, FIVE, ProcessNoise(0.02, 0.02, 0.002), levers={"g": AFT}))
    antenna = np.array(body_to_plane(*AFT, 1.0))
    for k in range(200):
        fix = Position(0, "g", *(antenna + 0.05 * rng.normal(size=2)))
        heading = TrueHeading(0, "c", 1.0 + math.radians(1.0) * rng.normal())
        if k == 0:
            each.start(*first_state(0, fix, heading, each.facts))
        else:
            each.predict(0.1, ImuInput(*(rng.normal(size=3) * [0.06, 0.06, 0.006])))
            each.update(heading)
            if k % 2 == 0:
                each.update(fix)
        x, P = each.estimate.x, each.estimate.P
        assert np.linalg.eigvalsh(P).min() > 0.0
        assert x[:2] @ np.linalg.solve(P[:2, :2], x[:2]) < 25.0
    assert each.estimate.repairs == 0


@pytest.mark.parametrize("step_s", [None, 0.2])
def test_the_station_takes_the_second_before_the_start(step_s: float | None) -> None:
    """3 m/s^2 until a second before the first fix, 1 after: the doubt is that of 1."""
    config = BoatConfig(
        boat=BoatTable(id="b", variation_deg=0.0),
        sensor=(
            SensorTable(id="gps1", port="p", role="gps"),
            SensorTable(id="compass1", port="p", role="compass"),
            SensorTable(id="imu1", port="p", role="imu", rate_hz=10.0, bias_accel_sigma_m_s2=0.1),
        ),
    )
    pipeline = Pipeline(config, ["ukf"]) if step_s is None else Pipeline(config, ["ukf"], step_s=step_s)
    estimates: list[Estimate] = []
    for number in range(20):
        t0_ns = 10**12 + number * 10**8
        shown = 3.0 if number < 8 else 1.0
        block = ImuBlock(
            sensor="imu1", t_ns=t0_ns + 10**8, offset_us=(0,), accel_fwd_m_s2=(shown,), accel_stb_m_s2=(0.0,),
            yaw_rate_deg_s=(0.0,),
        )  # fmt: skip
        late = number >= 18
        fixes = (Fix(sensor="gps1", t_ns=t0_ns + 10**8, lat_deg=50.0, lon_deg=-4.0, fix_quality=1),) if late else ()
        headings = (Heading(sensor="compass1", t_ns=t0_ns + 10**8, heading_true_deg=0.0),) if late else ()
        start = {"boat_id": "b", "clock_id": "c", "boot_id": "0", "start_no": 1}
        moment = {"seq": number, "t0_ns": t0_ns, "t1_ns": t0_ns + 10**8}
        frame = Frame(**start, **moment, imu=(block,), fixes=fixes, headings=headings)  # type: ignore[arg-type]
        estimates += pipeline.push(frame).estimates
    first = estimates[0]
    size = len(first.names)
    P = np.zeros((size, size))
    P[np.triu_indices(size)] = first.covariance
    place = first.names.index("accel_bias_fwd_m_s2")
    assert math.sqrt(P[place, place]) == pytest.approx(math.hypot(1.0, 0.1), rel=0.02)
