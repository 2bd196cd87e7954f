"""The stages of a start: what is awaited is said, and no estimate is valid before the last of them."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from common.messages import Frame
from shore.pipeline import Output, Pipeline
from tests.navigate.voyages import BOAT, UNCALIBRATED, Truth, frames_of


def steady(speed_m_s: float, seconds: float) -> Truth:
    """Due east, 20 Hz."""
    count = round(20 * seconds)
    states = np.zeros((count, 5))
    states[:, 0] = speed_m_s * 0.05 * np.arange(count)
    states[:, 2], states[:, 4] = speed_m_s, math.pi / 2
    return Truth(0.05, states, np.zeros((count, 3)))


def stages(outputs: Iterable[Output]) -> list[tuple[str, ...]]:
    """What was awaited, one after the other."""
    found = [output.waiting for output in outputs if output.waiting is not None]
    return [waiting for index, waiting in enumerate(found) if index == 0 or waiting != found[index - 1]]


def test_a_start_goes_through_its_stages_and_no_estimate_is_valid_before_the_last(short_voyage: list[Frame]) -> None:
    frames = [
        replace(f, fixes=f.fixes if f.seq >= 20 else (), headings=f.headings if f.seq >= 45 else ())
        for f in short_voyage
    ]
    pipeline = Pipeline(UNCALIBRATED, ("fuzzy", "ukf"))
    outputs = [pipeline.push(frame) for frame in frames]
    noise = "noise of the sensors"
    assert stages(outputs) == [("position", "heading"), ("heading",), (noise, "IMU biases"), ("IMU biases",), ()]
    for output in outputs:
        assert output.waiting is not None
        assert bool(output.estimates) == ("position" not in output.waiting and output.waiting != ("heading",))
        for estimate in output.estimates:
            assert estimate.aligned == (estimate.waiting == ())
    valid = [output.estimates[0].aligned for output in outputs if output.estimates]
    assert valid == sorted(valid)
    assert valid[-1]
    (aligned,) = (told for output in outputs for told in output.events if told.code == "filter-aligned")
    assert aligned.t_ns == next(output.estimates[0].t_ns for output in outputs if output.waiting == ())
    early = [f.seq for f in frames if f.t1_ns < aligned.t_ns]
    # Fixes are heard for ten seconds before the filter begins for good; then those of 8 m take forty.
    assert 100 < len(early) < 550


def test_a_steady_boat_settles_though_bias_and_tilt_leak_cannot_be_told_apart() -> None:
    """Straight on at 2 m/s: each of the two stays in doubt, their sum does not."""
    pipeline = Pipeline(UNCALIBRATED, ("ukf",))
    straight = frames_of(steady(2.0, 60.0), 3)
    outputs = [pipeline.push(frame) for frame in straight]
    assert outputs[-1].waiting == ()
    names = outputs[-1].estimates[0].names
    covariance = np.zeros((len(names), len(names)))
    covariance[np.triu_indices(len(names))] = outputs[-1].estimates[0].covariance
    bias = names.index("accel_bias_fwd_m_s2")
    assert math.sqrt(covariance[bias, bias]) > 0.1


def test_a_heading_that_is_lost_makes_the_estimate_invalid_again(short_voyage: list[Frame]) -> None:
    config = replace(BOAT, sensor=tuple(s for s in BOAT.sensor if s.role != "imu"))
    frames = [replace(f, headings=() if 150 <= f.seq < 350 else f.headings) for f in short_voyage[:370]]
    pipeline = Pipeline(config, ("ukf",))
    outputs = [pipeline.push(frame) for frame in frames]
    assert stages(outputs) == [("noise of the sensors",), (), ("heading",), ()]
    assert [told.code for output in outputs for told in output.events].count("filter-aligned") == 1


def test_a_boat_without_compass_has_a_position_and_waits_for_its_heading(short_voyage: list[Frame]) -> None:
    config = replace(BOAT, sensor=tuple(s for s in BOAT.sensor if s.role != "compass"))
    output = Pipeline(config, ("ukf",)).push(short_voyage[0])
    assert output.waiting == ("noise of the sensors", "heading")
    assert output.estimates
