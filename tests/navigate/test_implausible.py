"""Samples that no IMU can show: left out, told, and no sum that holds one is believed."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest

from common.messages import Frame, ImuBlock
from shore.navigation.imu_track import ImuTrack
from shore.navigation.state_space import HEADING
from shore.pipeline import Pipeline
from tests.navigate.test_pipeline import play
from tests.navigate.test_timeline import IMU, S, block, covered
from tests.navigate.voyages import BOAT


@pytest.mark.parametrize("value", [2001.0, -1e6])
def test_samples_that_no_sensor_can_show_are_left_out_and_counted_once(value: float) -> None:
    track = ImuTrack(IMU)
    broken = block(1.0, [value, value])
    assert track.insert(broken, "b") is None
    assert track.insert(broken, "b") is None
    track.insert(block(2.0, [159.0, value, -159.0]), "b")
    assert covered(track, 1.95, 2.1) == [(0.05, 159.0), (0.1, -159.0)]
    assert track.left_out == 3


def test_an_axis_that_is_not_used_may_show_anything() -> None:
    track = ImuTrack(replace(IMU, use=("yaw_rate",)))
    track.insert(block(1.0, [1999.0]), "b")
    assert track.left_out == 0
    assert covered(track, 0.95, 1.0) == [(0.05, 0.0)]


def with_sums(values: Sequence[float]) -> list[ImuBlock]:
    """Blocks of four samples from 1 s on, with their running sums."""
    sums = [0.05 * sum(values[1 : k + 1]) for k in range(len(values))]
    return [
        block(1.0 + 0.05 * i, values[i : i + 4], (i + 4, sums[i + 3], 0.05 * (i + 3))) for i in range(0, len(values), 4)
    ]


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (0, 2, 3, 1), (0, 3, 1, 2)])
def test_sums_that_hold_a_sample_left_out_bridge_nothing(order: Sequence[int]) -> None:
    """A mean over samples left out (here 100) may look plausible; the sums behind them are good again."""
    samples = [1.0] * 4 + [397.0, 1.0, 1.0, 1.0] + [2.0] * 4 + [3.0] * 4
    blocks = with_sums(samples)
    blocks[1] = replace(blocks[1], accel_fwd_m_s2=(397.0,) * 4)
    track = ImuTrack(IMU)
    for index in order:
        track.insert(blocks[index], "b")
    assert covered(track, 1.15, 1.75) == [(0.4, 2.0), (0.2, 3.0)]
    assert track.left_out == 4


def test_the_sums_behind_a_block_left_out_bridge_what_is_missing_after_it() -> None:
    blocks = with_sums([1.0] * 4 + [1000.0] * 4 + [2.0] * 4 + [3.0] * 4)
    track = ImuTrack(IMU)
    for each in (blocks[0], blocks[1], blocks[3]):
        track.insert(each, "b")
    bridged = covered(track, 1.35, 1.75)
    assert [seconds for seconds, _ in bridged] == pytest.approx([0.2, 0.2])
    assert [value for _, value in bridged] == pytest.approx([2.0, 3.0])


@pytest.mark.parametrize("value", [1e6, math.nan])
def test_a_mean_that_no_sensor_can_show_bridges_nothing(value: float) -> None:
    blocks = with_sums([1.0] * 4 + [value] * 4 + [3.0] * 4)
    track = ImuTrack(IMU)
    track.insert(blocks[0], "b")
    track.insert(blocks[2], "b")
    assert covered(track, 1.15, 1.55) == [(0.4, 3.0)]


def test_a_block_left_out_that_comes_late_takes_the_bridge_away() -> None:
    blocks = with_sums([1.0] * 4 + [161.0] + [1.0] * 3 + [3.0] * 4)
    blocks[1] = replace(blocks[1], accel_fwd_m_s2=(161.0,) * 4)
    track = ImuTrack(IMU)
    track.insert(blocks[0], "b")
    track.insert(blocks[2], "b")
    ((_, bridged),) = covered(track, 1.15, 1.35)
    assert bridged == pytest.approx(41.0)
    assert track.insert(blocks[1], "b") == (round(1.15 * S), round(1.35 * S))
    assert covered(track, 1.15, 1.55) == [(0.4, 3.0)]


def broken(frame: Frame, accel_m_s2: float, yaw_rate_deg_s: float) -> Frame:
    """All samples of its IMU, and the sums from there on, as a broken line leaves them."""
    (block,) = frame.imu
    count = len(block.offset_us)
    block = replace(block, accel_fwd_m_s2=(accel_m_s2,) * count, yaw_rate_deg_s=(yaw_rate_deg_s,) * count)
    return replace(frame, imu=(block,))


def shifted(frame: Frame, by: float) -> Frame:
    """Its running sums hold `by` more."""
    (block,) = frame.imu
    fwd, yaw = block.sum_accel_fwd_m_s + by, block.sum_yaw_deg + by
    return replace(frame, imu=(replace(block, sum_accel_fwd_m_s=fwd, sum_yaw_deg=yaw),))


@pytest.mark.parametrize("values", [(1e6, 0.0), (0.0, 1e6), (-161.0, 0.0), (0.0, -2001.0)])
@pytest.mark.parametrize("step_s", [None, 0.2])
def test_a_frame_of_values_no_imu_can_show_moves_nothing(
    short_voyage: list[Frame], values: tuple[float, float], step_s: float | None
) -> None:
    frames = short_voyage[:150]
    bad = [*frames[:100], broken(frames[100], *values), *frames[101:]]
    bad[100:] = [shifted(frame, 0.1 * sum(values)) for frame in bad[100:]]
    whole, _ = play(Pipeline(BOAT, ("ukf",), step_s), frames)
    hit, events = play(Pipeline(BOAT, ("ukf",), step_s), bad)
    assert len(hit) == len(whole)
    for one, other in zip(whole, hit, strict=True):
        assert one.state[:4] == pytest.approx(other.state[:4], abs=0.05)
        assert abs(math.degrees(one.state[HEADING] - other.state[HEADING])) < 0.2
    told = [item for item in events if item.code == "imu-implausible"]
    assert [(item.source, item.evidence["count"]) for item in told] == [("imu1", 2)]


def test_values_no_imu_can_show_are_told_in_sums_and_a_rewind_tells_nothing_again(short_voyage: list[Frame]) -> None:
    frames = [broken(frame, 1e6, 1e6) if frame.seq in {100, 103, 250} else frame for frame in short_voyage[:310]]
    late = [*frames[:90], *frames[91:130], frames[90], *frames[130:]]
    first, again = (play(Pipeline(BOAT, ("fuzzy",)), late) for _ in range(2))
    assert [item.as_record() for item in first[0]] == [item.as_record() for item in again[0]]
    assert first[1] == again[1]
    told = [item for item in first[1] if item.code == "imu-implausible"]
    assert [item.evidence["count"] for item in told] == [2, 2, 2]
    assert told[0].t_ns == frames[100].t1_ns
