"""Roll and pitch of a unit take gravity out of its accelerations."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.boat_config import SensorTable
from common.messages import Attitude, Frame, ImuBlock
from common.units import STANDARD_GRAVITY_M_S2
from shore.navigation.gravity import levelled
from shore.navigation.imu_track import blocks_of

MS = 1_000_000
FRAME = Frame(boat_id="b", boot_id="0" * 16, clock_id="c", start_no=1, seq=0, t0_ns=0, t1_ns=100 * MS)


def shown(roll_deg: float, pitch_deg: float, count: int = 1) -> ImuBlock:
    """What a unit at rest shows: the specific force is up, 1 g."""
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    return ImuBlock(
        sensor="imu1",
        t_ns=10 * MS,
        offset_us=tuple(1000 * i for i in range(count)),
        accel_fwd_m_s2=(STANDARD_GRAVITY_M_S2 * math.sin(pitch),) * count,
        accel_stb_m_s2=(-STANDARD_GRAVITY_M_S2 * math.sin(roll) * math.cos(pitch),) * count,
        yaw_rate_deg_s=(0.0,) * count,
    )


def attitude(t_ns: int, roll_deg: float | None, pitch_deg: float | None, sensor: str = "imu1") -> Attitude:
    return Attitude(sensor=sensor, t_ns=t_ns, roll_deg=roll_deg, pitch_deg=pitch_deg)


@given(roll=st.floats(-80.0, 80.0), pitch=st.floats(-80.0, 80.0), late_ms=st.integers(-240, 240))
def test_a_unit_at_rest_shows_nothing_at_any_attitude(roll: float, pitch: float, late_ms: int) -> None:
    block = levelled(shown(roll, pitch), [attitude((10 + late_ms) * MS, roll, pitch)])
    assert block.accel_fwd_m_s2 == pytest.approx((0.0,), abs=1e-12)
    assert block.accel_stb_m_s2 == pytest.approx((0.0,), abs=1e-12)


def test_each_sample_takes_the_attitude_that_is_nearest_in_time_in_any_order() -> None:
    block = shown(10.0, 0.0, count=2)
    near, far = attitude(10 * MS, 10.0, 0.0), attitude(300 * MS, 50.0, 0.0)
    for order in ([near, far], [far, near]):
        assert levelled(block, order).accel_stb_m_s2 == pytest.approx((0.0, 0.0), abs=1e-12)


def test_without_a_near_and_whole_attitude_the_samples_stay_as_they_are() -> None:
    block = shown(10.0, 5.0)
    useless = attitude(400 * MS, 10.0, 5.0), attitude(10 * MS, 10.0, None), attitude(10 * MS, None, 5.0)
    assert levelled(block, []) == levelled(block, useless) == block


@pytest.mark.parametrize("trust", [False, True])
def test_only_the_units_own_attitude_counts_and_only_where_the_boat_file_trusts_it(trust: bool) -> None:
    sensor = SensorTable(id="imu1", port="a", role="imu", model="arduimu", trust_tilt=trust)
    attitudes = attitude(10 * MS, 40.0, 5.0, "compass1"), attitude(10 * MS, 10.0, 5.0)
    (block,) = blocks_of(replace(FRAME, imu=(shown(10.0, 5.0),), attitudes=attitudes), sensor)
    assert (abs(block.accel_stb_m_s2[0]) < 1e-9) == trust
