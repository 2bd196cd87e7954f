"""A rate gyro drives the heading of a boat that has no IMU."""

import math
from dataclasses import replace

import numpy as np
import pytest

from common.boat_config import BoatConfig, SensorTable
from common.messages import Frame, TurnRate
from shore.navigation.imu_track import blocks_of, driving_sensor
from shore.navigation.state_space import HEADING
from shore.pipeline import Pipeline
from tests.navigate.voyages import BOAT, frames_of, sail

GYRO = SensorTable(
    id="gyro1", port="p", role="gyro", rate_hz=20.0, gyro_density_deg=0.036, bias_yaw_rate_sigma_deg_s=0.0
)


def boat(*extra: SensorTable) -> BoatConfig:
    return replace(BOAT, sensor=(*(sensor for sensor in BOAT.sensor if sensor.role != "imu"), *extra))


def with_gyro(frame: Frame) -> Frame:
    """The IMU's yaw rates as those of a rate gyro."""
    (block,) = frame.imu
    rates = zip(block.sample_t_ns, block.yaw_rate_deg_s, strict=True)
    turns = tuple(TurnRate(sensor="gyro1", t_ns=t_ns, rate_deg_s=rate) for t_ns, rate in rates)
    return replace(frame, imu=(), turn_rates=turns)


def heading_rms_deg(config: BoatConfig, frames: list[Frame]) -> float:
    pipeline = Pipeline(config, ("ukf",))
    truth = np.degrees(sail(62, 0.05).states[:, 4])
    errors = [
        math.remainder(math.degrees(estimate.state[HEADING]) - float(truth[2 * estimate.seq + 2]), 360.0)
        for frame in frames
        for estimate in pipeline.push(frame).estimates
    ]
    return float(np.sqrt(np.mean(np.square(errors[100:]))))


def test_without_an_imu_a_rate_gyro_drives_the_heading() -> None:
    """A compass of 5 deg alone leaves some degrees; with the gyro its noise is averaged over the whole run."""
    noisy = replace(BOAT, sensor=tuple(replace(s, sigma_deg=5.0) for s in BOAT.sensor))
    frames = [with_gyro(frame) for frame in frames_of(sail(62, 0.05), 5, compass_deg=lambda t: 5.0)]
    without, with_one = (
        heading_rms_deg(replace(noisy, sensor=tuple(s for s in (*noisy.sensor, *extra) if s.role != "imu")), frames)
        for extra in ((), (GYRO,))
    )
    assert with_one < 0.5
    assert with_one < 0.3 * without


def test_the_order_of_who_drives() -> None:
    imu = BOAT.with_role("imu")[0]
    recorded_only = replace(imu, use=())
    assert driving_sensor(boat()) is None
    assert driving_sensor(boat(recorded_only)) is None
    assert driving_sensor(boat(GYRO, imu)) == imu
    for extra in ((GYRO,), (recorded_only, GYRO)):
        driver = driving_sensor(boat(*extra))
        assert driver is not None
        assert (driver.id, driver.use) == ("gyro1", ("yaw_rate",))


def test_turn_rates_of_the_gyro_alone_become_one_block_in_order_of_time() -> None:
    frame = with_gyro(frames_of(sail(2, 0.05), 1)[3])
    other = TurnRate(sensor="compass1", t_ns=frame.t0_ns, rate_deg_s=99.0)
    (block,) = blocks_of(replace(frame, turn_rates=(other, *reversed(frame.turn_rates))), GYRO)
    assert block.sample_t_ns == tuple(rate.t_ns for rate in frame.turn_rates)
    assert block.yaw_rate_deg_s == tuple(rate.rate_deg_s for rate in frame.turn_rates)
    assert blocks_of(replace(frame, turn_rates=(other,)), GYRO) == ()


@pytest.mark.parametrize("name", ["ukf", "fuzzy"])
def test_the_gyros_bias_is_estimated(name: str) -> None:
    biased = replace(GYRO, bias_yaw_rate_sigma_deg_s=1.0, gyro_density_deg=0.036)
    frames = [with_gyro(frame) for frame in frames_of(sail(62, 0.05), 6)]
    frames = [
        replace(f, turn_rates=tuple(replace(r, rate_deg_s=r.rate_deg_s + 0.7) for r in f.turn_rates)) for f in frames
    ]
    pipeline = Pipeline(boat(biased), (name,))
    estimate = [pipeline.push(frame) for frame in frames][-1].estimates[0]
    bias_deg_s = math.degrees(estimate.state[estimate.names.index("gyro_bias_rad_s")])
    assert bias_deg_s == pytest.approx(0.7, abs=0.1)


def test_a_rate_that_no_gyro_can_show_is_left_out_and_told() -> None:
    frames = [with_gyro(frame) for frame in frames_of(sail(22, 0.05), 7)]
    bad = replace(frames[100], turn_rates=tuple(replace(rate, rate_deg_s=3999.0) for rate in frames[100].turn_rates))
    good, hit = Pipeline(boat(GYRO), ("ukf",)), Pipeline(boat(GYRO), ("ukf",))
    told = []
    for frame in frames:
        (one,), output = good.push(frame).estimates, hit.push(bad if frame.seq == 100 else frame)
        told += [item for item in output.events if item.code == "imu-implausible"]
        apart_rad = one.state[HEADING] - output.estimates[0].state[HEADING]
        assert abs(math.degrees(math.remainder(apart_rad, math.tau))) < 0.2
    assert [(item.source, item.evidence["count"]) for item in told] == [("gyro1", 2)]
