"""The timeline and the IMU track: a pure function of what was measured, whatever the order of arrival."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from common.boat_config import BoatConfig, SensorTable
from common.messages import Frame, ImuBlock
from shore.navigation.filter_bank import Bank, Batch, Moment
from shore.navigation.filter_registry import build_filter
from shore.navigation.fixed_steps import Synchronous
from shore.navigation.imu_track import ImuTrack
from shore.navigation.kalman import Predicted
from shore.navigation.measurements import Measurement, Position, TrueHeading
from shore.navigation.motion_model import ImuInput
from shore.navigation.sensor_facts import FilterFacts, facts_of
from shore.navigation.timeline import Timeline
from tests.navigate.voyages import BOAT, HOME, UNCALIBRATED, state_of

BankOf = Callable[..., Bank]

S = 1_000_000_000
IMU = SensorTable(id="imu1", port="p", role="imu", rate_hz=20.0)


def block(
    start_s: float, values: Sequence[float], sums: tuple[int, float, float] | None = None, period_s: float = 0.05
) -> ImuBlock:
    """A block whose first sample is at `start_s`; forward acceleration and yaw rate both `values`."""
    count, total, seconds = sums or (0, 0.0, 0.0)
    return ImuBlock(
        sensor="imu1", t_ns=round(start_s * S), offset_us=tuple(round(i * period_s * 1e6) for i in range(len(values))),
        accel_fwd_m_s2=tuple(values), accel_stb_m_s2=(0.0,) * len(values), yaw_rate_deg_s=tuple(values),
        sum_accel_fwd_m_s=total, sum_yaw_deg=total, sum_count=count, sum_time_s=seconds,
    )  # fmt: skip


def covered(track: ImuTrack, from_s: float, to_s: float) -> list[tuple[float, float | None]]:
    """[(seconds, forward acceleration or None)] with equal neighbours joined."""
    joined: list[tuple[float, float | None]] = []
    for step in track.steps(round(from_s * S), round(to_s * S)):
        value = None if step.imu is None else float(step.imu.accel_fwd_m_s2)
        before = joined.pop() if joined and joined[-1][1] == value else (0.0, value)
        joined.append((before[0] + step.dt_s, value))
    return [(round(seconds, 6), value) for seconds, value in joined]


def test_a_sample_covers_the_interval_that_ends_at_its_time() -> None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [1.0, 2.0, 3.0]), "b")
    assert covered(track, 0.95, 1.1) == [(0.05, 1.0), (0.05, 2.0), (0.05, 3.0)]
    assert covered(track, 1.01, 1.07) == [(0.04, 2.0), (0.02, 3.0)]


def test_after_the_newest_sample_it_is_held_then_nothing_is_known() -> None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [1.0, 2.0]), "b")
    assert covered(track, 1.0, 2.05) == [(0.3, 2.0), (0.75, None)]  # 0.05 s its own, 0.25 s held


def test_a_short_gap_belongs_to_the_next_sample_and_a_long_one_to_nobody() -> None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [1.0]), "b")
    track.insert(block(1.2, [2.0]), "b")
    track.insert(block(3.0, [3.0]), "b")
    assert covered(track, 1.0, 3.0) == [(0.45, 2.0), (1.5, None), (0.05, 3.0)]


def test_before_the_first_sample_nothing_is_known() -> None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [1.0]), "b")
    assert covered(track, 0.5, 1.0) == [(0.45, None), (0.05, 1.0)]


def test_missing_frames_are_bridged_by_the_running_sums_until_they_arrive() -> None:
    samples = [0.1 * k for k in range(12)]
    sums = [0.05 * sum(samples[1 : k + 1]) for k in range(12)]
    blocks = [
        block(1.0 + 0.2 * i, samples[4 * i : 4 * i + 4], (4 * i + 4, sums[4 * i + 3], 0.05 * (4 * i + 3)))
        for i in range(3)
    ]
    track = ImuTrack(IMU)
    track.insert(blocks[0], "b")
    assert track.insert(blocks[2], "b") == (round(1.15 * S), round(1.55 * S))
    coarse = covered(track, 1.15, 1.35)
    assert len(coarse) == 1
    assert coarse[0][1] == pytest.approx(sum(samples[4:8]) / 4)
    total = sum(dt_s * (value or 0.0) for dt_s, value in covered(track, 1.15, 1.55))
    assert total == pytest.approx(0.05 * sum(samples[4:12]))
    track.insert(blocks[1], "b")
    assert [value for _, value in covered(track, 1.15, 1.35)] == samples[4:8]


def test_the_newest_of_the_old_blocks_is_kept_to_be_held() -> None:
    track = ImuTrack(IMU)
    for start_s, value in ((1.0, 1.0), (1.1, 2.0), (1.2, 3.0)):
        track.insert(block(start_s, [value, value]), "b")
    track.forget_before(round(1.3 * S))
    assert covered(track, 1.3, 1.6) == [(0.2, 3.0), (0.1, None)]


def test_sums_of_another_start_are_not_used() -> None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [1.0], (1, 0.0, 0.0)), "b1")
    track.insert(block(3.0, [1.0], (40, 5.0, 2.0)), "b2")
    assert covered(track, 1.0, 2.9) == [(0.25, 1.0), (1.65, None)]


def test_biases_and_unused_axes() -> None:
    sensor = replace(IMU, use=("accel_fwd",), bias_accel_fwd_m_s2=0.5)
    track = ImuTrack(sensor)
    track.insert(block(1.0, [2.0]), "b")
    (step,) = track.steps(round(0.95 * S), S)
    assert step.imu == (1.5, 0.0, 0.0)


def test_samples_that_are_no_numbers_are_left_out() -> None:
    track = ImuTrack(IMU)
    assert track.insert(block(1.0, [math.nan]), "b") is None
    track.insert(block(2.0, [1.0, math.inf, 3.0]), "b")
    assert covered(track, 1.95, 2.1) == [(0.05, 1.0), (0.1, 3.0)]


@pytest.mark.parametrize("dt_s", [0.001, 0.5, 1.0, 600.0])
def test_long_stretches_are_split(dt_s: float) -> None:
    steps = list(ImuTrack(IMU).steps(S, S + round(dt_s * S)))
    assert sum(step.dt_s for step in steps) == pytest.approx(dt_s)
    assert len(steps) == (10 if dt_s > 10 else 1)


@pytest.fixture
def bank_of() -> BankOf:
    def make(*names: str, config: BoatConfig = BOAT) -> Bank:
        facts = facts_of(config)
        compass = bool(config.with_role("compass"))
        return Bank([build_filter(name, facts) for name in names], has_compass=compass)

    return make


def batch_of(frame: Frame) -> Batch:
    fixes = [
        Position(fix.t_ns, fix.sensor, *HOME.to_east_north_m(fix.lat_deg or 0.0, fix.lon_deg or 0.0), None, None)
        for fix in frame.fixes
    ]
    headings = [TrueHeading(h.t_ns, h.sensor, math.radians(h.heading_mag_deg or 0.0)) for h in frame.headings]
    return Batch(frame.t1_ns, frame.boot_id, (*fixes, *headings), frame.imu)


def apart(a: Moment, b: Moment) -> float:
    """Largest difference between two moments' states, covariances and R."""
    worst = 0.0
    for index in range(len(a.states)):
        one, other = state_of(a, index), state_of(b, index)
        worst = max(worst, np.abs(one.x - other.x).max(), np.abs(one.P - other.P).max())
        assert one.noise.keys() == other.noise.keys()
        worst = max([worst, *(abs(one.noise[c].variance - other.noise[c].variance) for c in one.noise)])
    return worst


@pytest.mark.parametrize(
    ("config", "size", "longest_delay_s", "seed"),
    [
        (BOAT, 7, 2.0, 0),
        (UNCALIBRATED, 11, 0.3, 1),
        (UNCALIBRATED, 11, 2.0, 2),
        (UNCALIBRATED, 11, 2.0, 3),
        (UNCALIBRATED, 11, 4.5, 4),
    ],
)
def test_order_of_arrival_does_not_matter(
    short_voyage: list[Frame], bank_of: BankOf, config: BoatConfig, size: int, longest_delay_s: float, seed: int
) -> None:
    """Fixes, headings and IMU blocks, each delayed on its own; the frames stay where they are."""
    batches = [batch_of(frame) for frame in short_voyage[:200]]
    straight = Timeline(bank_of("ukf", "fuzzy", config=config), ImuTrack(IMU))
    for batch in batches:
        straight.push(batch)

    rng = np.random.default_rng(seed)
    delayed = [Batch(batch.t1_ns, batch.boot_id, (), ()) for batch in batches]
    delayed += [Batch(delayed[-1].t1_ns + 1 + k, "b1", (), ()) for k in range(50)]
    for index, batch in enumerate(batches):
        for measured in batch.measurements:
            to = index + int(rng.integers(0, round(10 * longest_delay_s) + 1))
            delayed[to] = delayed[to]._replace(measurements=(*delayed[to].measurements, measured))
        for each in batch.blocks:
            to = index + int(rng.integers(0, round(10 * longest_delay_s) + 1))
            delayed[to] = delayed[to]._replace(blocks=(*delayed[to].blocks, each))
    shuffled = Timeline(bank_of("ukf", "fuzzy", config=config), ImuTrack(IMU))
    for batch in delayed:
        shuffled.push(batch)

    assert not shuffled.late
    end_ns = batches[-1].t1_ns
    assert len(state_of(straight.at(end_ns)).x) == size
    assert apart(straight.at(end_ns), shuffled.at(end_ns)) < 1e-9


def test_a_block_in_its_place_is_predicted_once(
    short_voyage: list[Frame], bank_of: BankOf, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames of two samples, nothing late: the two and the rest of the frame, nothing of the frames before."""
    bank = bank_of("ukf")
    predict = bank.filters[0].predict
    steps: list[float] = []

    def counted(dt_s: float, imu: ImuInput | None) -> Predicted:
        steps.append(dt_s)
        return predict(dt_s, imu)

    monkeypatch.setattr(bank.filters[0], "predict", counted)
    timeline = Timeline(bank, ImuTrack(IMU))
    for batch in map(batch_of, short_voyage[:40]):
        timeline.push(batch)
    for batch in map(batch_of, short_voyage[40:60]):
        steps.clear()
        timeline.push(batch._replace(measurements=()))
        assert steps == pytest.approx([0.05] * 3)


def test_a_late_fix_counts_at_its_own_time(bank_of: BankOf) -> None:
    """A boat at 2 m/s: a fix that is 1 s late must not pull it back by 2 m."""
    timeline = Timeline(bank_of("ukf"), None)
    for k in range(101):
        t_ns = round(0.1 * k * S)
        measured: list[Measurement] = [TrueHeading(t_ns, "compass1", 0.0)]
        if k % 10 == 0 and k >= 10:
            measured.append(Position(t_ns - S, "gps1", 0.0, 2.0 * (k / 10 - 1), (0.0, 2.0), None))
        moments = timeline.push(Batch(t_ns, "b", tuple(measured), ()))
    assert state_of(moments[0]).x[1] == pytest.approx(20.0, abs=0.05)


def test_later_than_the_horizon_is_counted_and_not_fused(bank_of: BankOf) -> None:
    timeline = Timeline(bank_of("ukf"), None)
    start = (Position(S, "gps1", 0.0, 0.0, None, None), TrueHeading(S, "compass1", 0.0))
    timeline.push(Batch(S, "b", start, ()))
    (before,) = timeline.push(Batch(10 * S, "b", (), ()))
    late = (Position(round(4.9 * S), "gps1", 99.0, 99.0, None, None), TrueHeading(round(5.1 * S), "compass1", 0.0))
    assert timeline.push(Batch(10 * S - 1, "b", late, ())) == []
    assert timeline.late == {"gps1": 1}
    after = timeline.at(10 * S)
    assert np.abs(state_of(after).x - state_of(before).x).max() < 1e-9


def test_stamps_ahead_of_their_frame_are_counted_and_not_fused(bank_of: BankOf) -> None:
    timeline = Timeline(bank_of("ukf"), None)
    timeline.push(Batch(S, "b", (TrueHeading(60 * S, "compass1", 0.0),), ()))
    assert timeline.ahead == {"compass1": 1}


def test_repeated_measurements_count_once(bank_of: BankOf) -> None:
    def run(times: int) -> Moment:
        timeline = Timeline(bank_of("ukf"), ImuTrack(IMU))
        start = (Position(S, "gps1", 0.0, 0.0, None, None), TrueHeading(S, "compass1", 0.0))
        for k in range(times):
            timeline.push(Batch(2 * S + k, "b", (*start, TrueHeading(2 * S, "compass1", 0.1)), (block(2.0, [1.0]),)))
        return timeline.at(3 * S)

    assert apart(run(1), run(3)) == 0.0


@pytest.mark.parametrize("silence_s", [0.001, 1.0, 60.0, 600.0])
def test_any_silence_is_safe(bank_of: BankOf, silence_s: float) -> None:
    timeline = Timeline(bank_of("kf", "ukf", "fuzzy"), ImuTrack(IMU))
    start = (Position(S, "gps1", 0.0, 0.0, None, None), TrueHeading(S, "compass1", 3.1))
    timeline.push(Batch(S, "b", start, (block(1.0, [0.1]),)))
    t_ns = S + round(silence_s * S)
    (before,) = timeline.push(Batch(t_ns, "b", (), ()))
    again = (Position(t_ns, "gps1", 5.0, 5.0, None, None), TrueHeading(t_ns, "compass1", -3.1))
    (after,) = timeline.push(Batch(t_ns + 1, "b", again, ()))
    for index in range(3):
        prior, posterior = state_of(before, index), state_of(after, index)
        assert prior.healthy
        assert posterior.healthy
        assert np.all(posterior.P.diagonal()[[0, 1, 4]] < prior.P.diagonal()[[0, 1, 4]])
        assert posterior.repairs == 0


def test_a_state_that_is_no_number_is_reset_and_reported(bank_of: BankOf) -> None:
    bank = bank_of("ukf")
    timeline = Timeline(bank, ImuTrack(IMU))
    start = (Position(S, "gps1", 0.0, 0.0, None, None), TrueHeading(S, "compass1", 0.0))
    timeline.push(Batch(S, "b", start, ()))
    timeline.push(Batch(2 * S, "b", (TrueHeading(2 * S, "compass1", math.nan),), ()))
    assert bank.resets
    (moment,) = timeline.push(Batch(3 * S, "b", (TrueHeading(3 * S, "compass1", 0.0),), ()))
    assert state_of(moment).healthy


def test_without_compass_the_course_gives_the_heading(bank_of: BankOf) -> None:
    water = replace(BOAT.boat, leeway_m_s=0.1)
    config = replace(BOAT, boat=water, sensor=tuple(s for s in BOAT.sensor if s.role == "gps"))
    timeline = Timeline(bank_of("ukf", config=config), None)
    (slow,) = timeline.push(Batch(S, "b", (Position(S, "gps1", 0.0, 0.0, None, None),), ()))
    assert math.degrees(math.sqrt(state_of(slow).P[4, 4])) > 100.0
    for second in range(2, 15):
        fast = Position(second * S, "gps1", 2.0 * second, 0.0, (2.0, 0.0), math.pi / 2)
        (moment,) = timeline.push(Batch(second * S, "b", (fast,), ()))
    assert state_of(moment).x[4] == pytest.approx(math.pi / 2, abs=1e-3)
    assert math.degrees(math.sqrt(state_of(moment).P[4, 4])) < 20.0
    assert not [channel for channel in state_of(moment).noise if channel.endswith(".course")]


def test_the_start_uses_the_newest_of_both_and_knows_their_age(bank_of: BankOf) -> None:
    timeline = Timeline(bank_of("ukf"), None)
    timeline.push(Batch(S, "b", (Position(S, "gps1", 10.0, 0.0, (1.0, 0.0), None),), ()))
    (moment,) = timeline.push(Batch(5 * S, "b", (TrueHeading(5 * S, "compass1", 1.0),), ()))
    state = state_of(moment)
    assert state.x[:5].tolist() == pytest.approx([14.0, 0.0, 1.0, 0.0, 1.0])
    claimed = 2.0 * 6.5**2  # what a receiver claims may be white, or last
    assert state.P[0, 0] == pytest.approx(claimed + (0.5 * 4.0) ** 2)


def test_synchronous_steps_take_the_mean_imu_and_each_fix_once(bank_of: BankOf) -> None:
    bank = bank_of("ukf")
    stepped = Synchronous(bank, ImuTrack(IMU), 1.0)
    start = (Position(S - 1, "gps1", 0.0, 0.0, None, None), TrueHeading(S - 1, "compass1", 0.0))
    (first,) = stepped.push(Batch(S, "b", start, ()))
    assert first.states[0] is not None
    assert stepped.push(Batch(S + S // 2, "b", (), (block(1.05, [0.0] * 10),))) == []
    (second,) = stepped.push(Batch(2 * S, "b", (TrueHeading(2 * S - 1, "compass1", 0.0),), (block(1.55, [2.0] * 9),)))
    expected = build_filter("ukf", facts_of_boat(bank))
    expected.restore(state_of(first))
    mean = stepped_mean([0.0] * 10 + [2.0] * 9)
    expected.predict(1.0, mean)
    expected.update(TrueHeading(0, "compass1", 0.0))
    assert np.allclose(state_of(second).x, expected.estimate.x, atol=1e-12)
    assert "gps1.east" not in state_of(second).noise
    several = stepped.push(Batch(5 * S, "b", (), ()))
    assert [moment.t_ns for moment in several] == [3 * S, 4 * S, 5 * S]


def facts_of_boat(bank: Bank) -> FilterFacts:
    return bank.filters[0].facts


def stepped_mean(values: Sequence[float]) -> ImuInput | None:
    track = ImuTrack(IMU)
    track.insert(block(1.0, [sum(values) / len(values)]), "b")
    return track.mean(0, 2 * S)


def test_late_lines_in_a_burst_are_not_a_gap() -> None:
    """A board that was busy for half a second delivers what waited with one stamp: nothing is unknown in between."""
    track = ImuTrack(IMU)
    track.insert(block(0.0, [1.0, 1.0, 1.0]), "boot")
    burst = replace(block(0.6, [2.0, 4.0, 5.0]), offset_us=(0, 0, 10_000))
    track.insert(burst, "boot")
    seconds, inputs = zip(*covered(track, 0.1, 0.61), strict=True)
    assert inputs == (3.0, 5.0)
    assert seconds == pytest.approx((0.5, 0.01))


def test_a_longer_silence_is_a_gap_and_the_next_sample_covers_its_own_period() -> None:
    track = ImuTrack(IMU)
    track.insert(block(0.0, [1.0, 1.0, 1.0]), "boot")
    track.insert(block(2.0, [2.0]), "boot")
    seconds, inputs = zip(*covered(track, 0.1, 2.0), strict=True)
    assert inputs == (1.0, None, 2.0)
    assert seconds == pytest.approx((0.25, 1.6, 0.05))


def test_missing_frames_are_bridged_rightly_when_lines_share_a_stamp() -> None:
    """The board integrates the mean of lines with one stamp; the bridge must take the same off the later block."""
    track = ImuTrack(IMU)
    track.insert(block(0.0, [1.0] * 2, sums=(2, 0.05, 0.05)), "boot")
    # 0.1 ... 1.0 s were lost: 19 samples of 2.0. Then three lines with one stamp, mean 4.0, and one more.
    later = replace(block(1.05, [2.0, 4.0, 6.0, 4.0]), offset_us=(0, 0, 0, 50_000))
    total = 0.05 * 1.0 + 0.95 * 2.0 + 0.05 * 4.0 + 0.05 * 4.0
    later = replace(later, sum_accel_fwd_m_s=total, sum_yaw_deg=total, sum_count=2 + 19 + 4, sum_time_s=1.1)
    track.insert(later, "boot")
    bridged = [value for _, value in covered(track, 0.05, 1.0)]
    assert bridged[0] == pytest.approx(2.0, rel=0.03)
