"""The first state knows that all the IMU shows may be bias; the trim is as restless as the bow is high."""

import math

import numpy as np
import pytest

from common.messages import Fix, Frame, Heading, ImuBlock
from common.sensors import BoatConfig, BoatTable, SensorTable
from shore.navigation.adaptation import Channel
from shore.navigation.beginning import first_state
from shore.navigation.estimate import Estimate
from shore.navigation.filters import FilterFacts
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.models import (
    FIVE,
    LARGEST_LIFT_M2_S2,
    TRIM_UNREST,
    Extra,
    Gaussian,
    ImuInput,
    ProcessNoise,
    StateSpace,
    with_trim,
)
from shore.navigation.numbers import Array
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


def at_speed(speed_m_s: float | Array) -> Gaussian:
    speed = np.asarray(speed_m_s)
    x = np.zeros((*speed.shape, LEAKY.size))
    x[..., 3] = speed
    return Gaussian(LEAKY, x, np.zeros((*speed.shape, LEAKY.size, LEAKY.size)))


def test_the_forward_axis_is_noisier_the_higher_the_bow() -> None:
    quiet = ProcessNoise(0.1, 0.1, 0.01)
    assert with_trim(at_speed(0.0), quiet).accel_fwd == pytest.approx(0.1)
    assert with_trim(at_speed(1.0), quiet).accel_fwd == pytest.approx(math.hypot(0.1, TRIM_UNREST * 0.2), rel=0.01)
    most = math.hypot(0.1, TRIM_UNREST * 0.2 * LARGEST_LIFT_M2_S2)
    assert with_trim(at_speed(-30.0), quiet).accel_fwd == pytest.approx(most)
    assert with_trim(at_speed(1.0), quiet)[1:] == quiet[1:]
    assert with_trim(Gaussian(FIVE, np.ones(5), np.eye(5)), quiet) == quiet


def test_a_batch_has_the_trim_of_each_run() -> None:
    noise = with_trim(at_speed(np.array([0.0, 1.0, 2.0])), ProcessNoise(0.1, 0.1, 0.01))
    alone = [float(with_trim(at_speed(speed), ProcessNoise(0.1, 0.1, 0.01)).accel_fwd) for speed in (0.0, 1.0, 2.0)]
    assert noise.accel_fwd == pytest.approx(alone)
