"""What a real boat's filter believes of its sensors: velocity guard, axes of the IMU, three witnesses of a turn."""

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from common.boat_config import SensorTable
from common.messages import ImuBlock
from common.units import NS_PER_S
from shore.navigation.imu_track import REPEATED, ImuTrack
from shore.navigation.measurements import Position
from shore.navigation.motion_model import ImuInput
from shore.navigation.trust.axes import Axes, Axis, judged
from shore.navigation.trust.marks import FixMark, HeadingBlock, RunningSums, Turned, append, before
from shore.navigation.trust.receiver import Receiver, guarded
from shore.navigation.trust.turns import Found, Turns, Witnesses, looked_at
from shore.navigation.trust.waves import Waves

BLOCK = HeadingBlock(np.zeros(1), np.eye(1))
START = FixMark(0, 0.0, 0.0, (2.0, 0.0), (0.0, 0.0), 0.0, RunningSums(), {}, BLOCK)
WITNESSES = Witnesses({"compass1": math.radians(1.0), "compass2": math.radians(1.0)}, 1e-4, None)


def guard(errors_m: Iterable[float], velocity_m_s: float = 2.0, white_m: float = 1.5) -> list[int]:
    """Seconds in which the velocity is set aside, of a boat that goes east at 2 m/s.

    errors_m: of its fixes. velocity_m_s: what the receiver says.
    """
    receiver, found = Receiver(), []
    for second, error_m in enumerate(errors_m):
        fix = Position(second * NS_PER_S, "gps1", 2.0 * second + error_m, 0.0, (velocity_m_s, 0.0))
        receiver = receiver.hears(fix)
        mark = START._replace(
            t_ns=fix.t_ns, east_m=float(fix.east_m), velocity_m_s=fix.velocity_m_s, way_m=receiver.way_to(fix)
        )
        receiver = guarded(receiver._replace(newest=mark), mark, white_m**2)
        receiver = receiver._replace(marks=append(receiver.marks, mark))
        if receiver.wrong_since_ns is not None:
            found.append(second)
    return found


def noise(seconds: int, sigma_m: float, seed: int = 1) -> list[float]:
    return list(map(float, sigma_m * np.random.default_rng(seed).normal(size=seconds)))


@pytest.mark.parametrize("seed", range(20))
def test_a_velocity_that_is_wrong_is_set_aside_and_a_right_one_is_not(seed: int) -> None:
    assert guard(noise(300, 1.5, seed)) == []
    assert 4 <= guard(noise(40, 1.5, seed), velocity_m_s=4.0)[0] <= 12
    assert 20 <= guard(noise(200, 1.5, seed), velocity_m_s=2.3)[0] <= 120


@pytest.mark.parametrize("velocity_m_s", [12.0, 20.0, 200.0, 450.0, -20.0])
def test_a_velocity_that_is_far_off_is_no_jump_of_the_position(velocity_m_s: float) -> None:
    assert 3 <= guard(noise(40, 1.5), velocity_m_s=velocity_m_s)[0] <= 12


@pytest.mark.parametrize("seed", range(5))
def test_a_jump_of_the_position_is_not_blamed_on_the_velocity(seed: int) -> None:
    quiet = noise(100, 1.5, seed)
    assert guard([each + 50.0 * (second >= 50) for second, each in enumerate(quiet)]) == []
    assert guard([each + 50.0 * (second == 50) for second, each in enumerate(quiet)]) == []


def test_a_velocity_that_agrees_again_is_taken_back() -> None:
    errors, velocity = noise(120, 1.0), [4.0 if second < 40 else 2.0 for second in range(120)]
    receiver, wrong = Receiver(), []
    for second, (error_m, v) in enumerate(zip(errors, velocity, strict=True)):
        fix = Position(second * NS_PER_S, "gps1", 2.0 * second + error_m, 0.0, (v + 1e-3 * second, 0.0))
        receiver = receiver.hears(fix)
        mark = START._replace(
            t_ns=fix.t_ns, east_m=float(fix.east_m), velocity_m_s=fix.velocity_m_s, way_m=receiver.way_to(fix)
        )
        receiver = guarded(receiver._replace(newest=mark), mark, 1.0)
        receiver = receiver._replace(marks=append(receiver.marks, mark))
        wrong.append(receiver.wrong_since_ns is not None)
    assert wrong[39]
    assert not wrong[-1]
    assert sum(wrong) < 100


def test_the_third_equal_pair_of_speed_and_course_is_held() -> None:
    receiver = Receiver()
    for second in range(4):
        fix = Position(second * NS_PER_S, "gps1", 0.0, 0.0, (1.0, 0.5))
        receiver = receiver.hears(fix)
        receiver = receiver._replace(newest=START._replace(t_ns=fix.t_ns, velocity_m_s=fix.velocity_m_s))
        assert receiver.is_held == (second >= 2)


def test_a_receiver_that_gives_a_fix_each_five_seconds_has_no_gaps() -> None:
    receiver = Receiver(newest=START, interval_ns=5 * NS_PER_S)
    fix = Position(5 * NS_PER_S, "gps1", 10.0, 0.0, (2.0, 0.0))
    assert not receiver.is_broken_by(fix)
    assert receiver.is_broken_by(fix._replace(t_ns=20 * NS_PER_S))
    assert receiver._replace(interval_ns=NS_PER_S).is_broken_by(fix)


def axes_after(seconds: int, explained: float, *, gravity: float = 0.0) -> Axes:
    """A boat that changes its speed ahead, and whose forward axis shows that share of it; heading 0 is north.

    gravity: what the axis shows beside that, m/s^2, to and fro.
    """
    axes: Axes = (Axis(), Axis())
    marks: tuple[FixMark, ...] = ()
    rng = np.random.default_rng(2)
    for second in range(seconds):
        speed = 2.0 + math.sin(0.5 * second)
        shown = explained * speed + gravity * math.sin(1.3 * second)
        now = START._replace(
            t_ns=second * NS_PER_S,
            velocity_m_s=(0.05 * rng.normal(), speed + 0.05 * rng.normal()),
            tally=RunningSums(gained_north_m_s=shown),
        )
        axes = judged(axes, marks, now, sigma_m_s=0.05, white_m2=1.0)
        marks = append(marks, now)
    return axes


def test_an_axis_that_explains_the_motion_stays_and_one_that_contradicts_it_goes() -> None:
    right, wrong, waves = axes_after(60, 1.0), axes_after(60, -1.0), axes_after(60, 1.0, gravity=2.0)
    assert not right[0].is_off
    assert right[0].density2 < 0.1**2
    assert wrong[0].is_off
    assert waves[0].is_off
    assert not wrong[1].is_off


def turned(compass: float, gyro: float, course: float | None = None, other: float | None = None) -> Found:
    """After a turn within 10 s, by so many degrees as each of them says; `None` = there is no such witness."""
    marks: tuple[FixMark, ...] = ()
    turns = Turns()
    for second in range(20):
        share = min(1.0, max(0.0, (second - 8) / 10.0))
        seen = {"compass1": compass} | ({"compass2": other} if other is not None else {})
        now = START._replace(
            t_ns=second * NS_PER_S,
            course_rad=None if course is None else math.radians(course) * share,
            turns={
                name: Turned(
                    math.radians(deg) * share,
                    math.radians(gyro) * share,
                    float(second),
                    second * NS_PER_S,
                    math.radians(deg - gyro) * share,
                )
                for name, deg in seen.items()
            },
        )
        sigma = None if course is None else math.radians(4.0)
        found = looked_at(turns, marks, now, WITNESSES._replace(course_rad=sigma))
        if found.gyro_wrong or found.compass_wrong:
            return found
        turns, marks = found.turns, append(marks, now)
    return found


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_two_of_three_witnesses_say_which_is_wrong(side: float) -> None:
    assert turned(60.0 * side, -60.0 * side, course=60.0 * side).gyro_wrong
    assert turned(60.0 * side, 1.0 * side, course=58.0 * side).gyro_wrong
    disturbed = turned(45.0 * side, 0.0, course=2.0 * side).compass_wrong
    assert disturbed
    assert disturbed[0] == "compass1"
    other = turned(45.0 * side, 0.0, other=1.0 * side).compass_wrong
    assert other
    assert other[0] == "compass1"


def test_without_witness_only_a_large_turn_speaks_against_the_gyro_and_less_is_doubt() -> None:
    assert turned(90.0, 2.0).gyro_wrong
    found = turned(40.0, 0.0)
    assert not found.gyro_wrong
    assert not found.compass_wrong
    assert found.doubts["compass1"] > 0.0


@pytest.mark.parametrize("gyro", [30.0, 60.0, 120.0])
def test_a_deviation_of_twenty_degrees_and_a_scale_error_blame_nobody(gyro: float) -> None:
    for compass, course in ((1.35 * gyro, gyro), (0.65 * gyro, gyro), (1.02 * gyro, 0.97 * gyro)):
        found = turned(compass, gyro, course=course)
        assert not found.gyro_wrong
        assert not found.compass_wrong


def test_windows_are_those_asked_for() -> None:
    marks: tuple[FixMark, ...] = ()
    for second in (0, 1, 2, 3, 3.5, 4, 5, 6, 14, 15):
        marks = append(marks, START._replace(t_ns=round(second * NS_PER_S)))
    assert len(marks) == 9
    found = before(marks, 6 * NS_PER_S, 5.0)
    assert found
    assert found.t_ns == NS_PER_S
    assert before(marks, 15 * NS_PER_S, 4.0) is None


IMU = SensorTable(id="imu1", port="p", role="imu", rate_hz=10.0)


def blocks_of(values: Iterable[float], per_block: int = 2) -> list[ImuBlock]:
    """Samples of 10 Hz that have these values on all axes."""
    numbers = list(values)
    return [
        ImuBlock(
            sensor="imu1",
            t_ns=(at + 10) * NS_PER_S // 10,
            offset_us=tuple(k * 100_000 for k in range(len(numbers[at : at + per_block]))),
            accel_fwd_m_s2=tuple(numbers[at : at + per_block]),
            accel_stb_m_s2=tuple(numbers[at : at + per_block]),
            yaw_rate_deg_s=tuple(numbers[at : at + per_block]),
        )
        for at in range(0, len(numbers), per_block)
    ]


def used(blocks: Iterable[ImuBlock], sensor: SensorTable = IMU) -> tuple[list[bool], bool]:
    """Whether each sample drives the filters, and whether the unit repeats itself at the end."""
    track = ImuTrack(sensor)
    for block in blocks:
        track.insert(block, "b")
    return [step.imu is not None for step in track.steps(9 * NS_PER_S // 10, 3 * NS_PER_S)], track.repeats


def test_the_fifth_equal_sample_is_not_used_and_the_next_other_one_is() -> None:
    values = [0.1, 0.2, *[0.3] * 8, 0.4, 0.5]
    drives, repeats = used(blocks_of(values))
    assert drives[:12] == [True] * (2 + REPEATED - 1) + [False] * 4 + [True] * 2
    assert not repeats
    assert used(blocks_of([0.0] * 6))[1]


@pytest.mark.parametrize("seed", range(10))
def test_repeats_are_the_same_in_any_order_of_arrival(seed: int) -> None:
    values = [0.1, *[0.2] * 7, 0.3, *[0.0] * 9, 0.4]
    blocks = blocks_of(values)
    shuffled = [blocks[place] for place in np.random.default_rng(seed).permutation(len(blocks))]
    assert used(shuffled) == used(blocks)


def test_a_rate_gyro_at_rest_may_repeat_itself() -> None:
    gyro = replace(IMU, role="gyro", use=("yaw_rate",))
    drives, repeats = used(blocks_of([0.0] * 12), gyro)
    assert all(drives[:12])
    assert not repeats


def in_waves(roll_deg: float, pitch_deg: float, vibration_m_s2: float = 0.0) -> tuple[float, float]:
    """Doubt of a gyro after two minutes of waves of 0.3 Hz, and how fast it really runs away, deg/s.

    Pitch and roll are a quarter of a wave apart: pitch rate x roll has a mean that lasts. The angles are amplitudes.
    """
    rng, waves, off = np.random.default_rng(1), Waves(), []
    for step in range(1200):
        phase = math.tau * 0.3 * 0.1 * step
        roll, pitch = math.radians(roll_deg) * math.cos(phase), math.radians(pitch_deg) * math.sin(phase)
        pitch_rate = math.tau * 0.3 * math.radians(pitch_deg) * math.cos(phase)
        vibration = vibration_m_s2 * rng.normal(size=2)
        force = 9.81 * math.sin(pitch) + vibration[0], 9.81 * math.sin(roll) + vibration[1]
        waves = waves.then(0.1, ImuInput(*force, 0.0))
        off.append(pitch_rate * math.sin(roll))
    return math.degrees(waves.gyro_rad_s), math.degrees(float(np.mean(off)))


def test_waves_excuse_a_gyro_by_about_what_they_make_of_it() -> None:
    for roll_deg, pitch_deg in ((12.0, 5.0), (4.0, 1.7), (20.0, 8.0)):
        doubt, off = in_waves(roll_deg, pitch_deg)
        assert 0.8 * off < doubt < 2.0 * off, (roll_deg, doubt, off)


def test_vibration_and_roll_alone_are_no_waves() -> None:
    assert in_waves(0.0, 0.0, vibration_m_s2=1.0)[0] < 0.3
    assert in_waves(15.0, 0.0)[0] < 0.01
