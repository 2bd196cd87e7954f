import math
import struct

from hypothesis import given
from hypothesis import strategies as st

from common.events import event
from common.framer import Framer, Identity, ImuSample, Utc, merge
from common.messages import Heading
from common.units import NS_PER_MS, NS_PER_S

IDENTITY = Identity("boat", "0123456789abcdef", "clock", 1)
NO_UTC = Utc(None, None, "none")


def framer() -> Framer:
    return Framer(IDENTITY, ["imu1"], 0)


def sample(t_ns: int, fwd: float = 1.0, yaw: float = 2.0) -> ImuSample:
    return ImuSample("imu1", t_ns, fwd, 0.0, yaw)


def test_each_measurement_is_in_exactly_one_frame_by_its_stamp() -> None:
    gathered = framer()
    for k in range(10):
        gathered.add(Heading(sensor="compass1", t_ns=k * 30 * NS_PER_MS, heading_true_deg=1.0))
    # The tick came late: three stamps are already past its end and wait for the next frame.
    first = gathered.tick(200 * NS_PER_MS, NO_UTC, 0, ())
    second = gathered.tick(400 * NS_PER_MS, NO_UTC, 0, ())
    assert [reading.t_ns for reading in first.headings] == [k * 30 * NS_PER_MS for k in range(7)]
    assert [reading.t_ns for reading in second.headings] == [k * 30 * NS_PER_MS for k in range(7, 10)]
    assert (first.seq, first.t1_ns, second.seq, second.t0_ns) == (0, second.t0_ns, 1, first.t1_ns)


def test_sums_are_integrals_over_the_interval_that_ends_at_each_sample() -> None:
    gathered = framer()
    for k in range(21):
        gathered.add(sample(k * 50 * NS_PER_MS, fwd=0.5, yaw=3.0))
    block = gathered.tick(2 * NS_PER_S, NO_UTC, 0, ()).imu[0]
    assert math.isclose(block.sum_accel_fwd_m_s, 0.5)
    assert math.isclose(block.sum_yaw_deg, 3.0)
    assert math.isclose(block.sum_time_s, 1.0)
    assert block.sum_count == 21


def test_a_gap_is_not_integrated_and_not_counted_as_covered() -> None:
    gathered = framer()
    for t_ms in (0, 50, 5000, 5050):
        gathered.add(sample(t_ms * NS_PER_MS))
    block = gathered.tick(10 * NS_PER_S, NO_UTC, 0, ()).imu[0]
    assert math.isclose(block.sum_time_s, 0.1)
    assert math.isclose(block.sum_accel_fwd_m_s, 0.1)


def test_samples_that_share_a_stamp_count_with_their_mean() -> None:
    gathered = framer()
    for t_ms, fwd in ((0, 0.0), (100, 1.0), (100, 3.0), (150, 1.0)):
        gathered.add(sample(t_ms * NS_PER_MS, fwd=fwd))
    block = gathered.tick(NS_PER_S, NO_UTC, 0, ()).imu[0]
    assert math.isclose(block.sum_accel_fwd_m_s, 0.1 * 2.0 + 0.05 * 1.0)
    assert block.sum_count == 4


def test_sums_do_not_contain_samples_that_wait_for_the_next_frame() -> None:
    gathered = framer()
    for k in range(5):
        gathered.add(sample(k * 50 * NS_PER_MS))
    block = gathered.tick(100 * NS_PER_MS, NO_UTC, 0, ()).imu[0]
    assert (len(block.offset_us), block.sum_count) == (2, 2)


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=30))
def test_columns_are_f32_already_and_the_mean_is_theirs(values: list[float]) -> None:
    gathered = framer()
    for k, value in enumerate(values):
        gathered.add(sample(k * 50 * NS_PER_MS, fwd=value))
    block = gathered.tick(100 * NS_PER_S, NO_UTC, 0, ()).imu[0]
    assert block.accel_fwd_m_s2 == struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values))
    assert block.mean_accel_fwd_m_s2 is not None
    assert math.isclose(block.mean_accel_fwd_m_s2, sum(block.accel_fwd_m_s2) / len(values), abs_tol=1e-9)


def test_ten_merged_frames_are_one_second_with_everything_in_it() -> None:
    gathered = framer()
    frames = []
    for k in range(10):
        for j in range(2):
            gathered.add(sample((100 * k + 50 * j) * NS_PER_MS, fwd=float(k)))
        gathered.add(Heading(sensor="compass1", t_ns=100 * k * NS_PER_MS, heading_true_deg=float(k)))
        gathered.add(event("port-calm", 100 * k * NS_PER_MS, "gps", port="gps", budget=1))
        frames.append(gathered.tick((k + 1) * 100 * NS_PER_MS, NO_UTC, 0, ()))
    merged = merge(frames)
    assert (merged.first_seq, merged.seq, merged.t0_ns, merged.t1_ns) == (0, 9, 0, NS_PER_S)
    assert [reading.heading_true_deg for reading in merged.headings] == [float(k) for k in range(10)]
    assert len(merged.events) == 10
    assert (merged.utc_ns, merged.utc_src) == (None, "none")
    block = merged.imu[0]
    assert block.sample_t_ns == tuple(50 * k * NS_PER_MS for k in range(20))
    assert block.mean_accel_fwd_m_s2 == 4.5
    assert block.sum_count == frames[-1].imu[0].sum_count == 20
