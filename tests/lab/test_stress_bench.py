"""The stress bench: its worlds have the errors they name, and its figures are right where the answer is known."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.scoring import Sums, voyage_s
from benchmarks.stress import Run, Score, figures_of, one_boat, scored_parts
from benchmarks.stress_messages import IMU_FAULTS, Fixes, frames_of
from benchmarks.stress_rows import ROWS, Ask, Row, rows_named
from benchmarks.stress_world import Boat, Fault, Sky, Turn, World, sail
from common.errors import WayfixError
from common.messages import Fix

CALM = World(waves_deg=0.0)


def _fixes(world: World, seconds: float = 500.0, seed: int = 1) -> list[Fix]:
    return list(Fixes(sail(world, seed, seconds)).messages())


def _samples(world: World, seconds: float = 200.0) -> np.ndarray:
    boat = sail(world, 1, seconds)
    blocks = [block for frame in frames_of(boat, Fixes(boat)) for block in frame.imu]
    columns = [(each.accel_fwd_m_s2, each.accel_stb_m_s2, each.yaw_rate_deg_s) for each in blocks]
    return np.concatenate([np.array(each).T for each in columns])


def test_a_boat_without_a_sensor_has_the_fixes_of_the_boat_with_it() -> None:
    whole = _fixes(World(imu_fault=Fault(kind="sign")))
    assert _fixes(World().without_imu()) == whole
    bare = _fixes(World().without_velocity())
    assert [fix.lat_deg for fix in bare] == [fix.lat_deg for fix in whole]
    assert (bare[0].sog_kn is None, whole[0].sog_kn is None) == (True, False)


def test_gravity_adds_to_the_starboard_accelerometer_of_a_hull_that_heels_outward() -> None:
    turn_rate = math.radians(6.0)
    heeling = _samples(CALM) - _samples(replace(CALM, heel_s2_m=0.0))
    boat = sail(CALM, 1, 200.0)
    turn = boat.turns[0]
    middle = slice(int(10 * turn.begin_s) + 40, int(10 * turn.end_s) - 10)
    rate = np.radians(_samples(CALM)[middle, 2])
    way = np.hypot(boat.truth.v_east_m_s, boat.truth.v_north_m_s)[5 * 40 :].max()
    assert math.copysign(1.0, turn.angle_deg) == np.sign(heeling[middle, 1].mean()) == np.sign(rate.mean())
    assert abs(heeling[middle, 1]).max() < 9.81 * 0.15 * way * math.radians(12.5)
    assert abs(heeling[middle, 1]).min() > 0.4 * 9.81 * 0.15 * way * turn_rate / 2.0


@pytest.mark.parametrize("kind", IMU_FAULTS)
def test_a_fault_of_the_imu_begins_at_its_onset(kind: str) -> None:
    healthy, faulty = _samples(CALM, 60.0), _samples(replace(CALM, imu_fault=Fault(kind=kind, from_s=30.0)), 60.0)
    assert np.array_equal(healthy[:299], faulty[:299])
    assert not np.array_equal(healthy[299:], faulty[299:])


def test_a_wandering_error_has_its_size_and_its_time() -> None:
    world = World(sky=(Sky(0.0, 0.0, 1.5),), lasting_s=20.0)
    errors = [Fixes(sail(world, seed, 300.0)).error_m for seed in range(1, 41)]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.5, rel=0.08)
    kept = np.mean([each[20:] * each[:-20] for each in errors]) / np.mean(np.square(errors))
    assert kept == pytest.approx(math.exp(-1.0), abs=0.08)


def test_an_outage_is_scored_before_the_first_fix_after_it() -> None:
    boat = sail(World(outage_s=30.0), 3, 420.0)
    fixes = Fixes(boat)
    usable = [fix for fix in fixes.messages() if fix.usable]
    lost, back = max(pairwise(usable), key=lambda pair: pair[1].t_ns - pair[0].t_ns)
    assert 30.0 <= (back.t_ns - lost.t_ns) / 1e9 <= 32.0
    ((name, from_s, to_s),) = scored_parts(boat, fixes)
    assert name == ""
    assert voyage_s(back.t_ns) - 0.2 < from_s < voyage_s(back.t_ns) < to_s < voyage_s(back.t_ns) + 0.2


def test_the_first_turn_after_an_onset_is_the_one_that_still_passes_20_deg() -> None:
    boat = sail(World(), 2, 400.0)
    first, second = boat.turns[:2]
    at_first, at_second = boat.first_turn_from(0.0), boat.first_turn_from(first.end_s - 0.5)
    assert at_first is not None
    assert at_second is not None
    assert (at_first[0], at_second[0]) == (first.begin_s, second.begin_s)
    # 20 deg at 3 to 12 deg/s, and the lag of the hull.
    assert first.begin_s + 20.0 / 12.0 < at_first[1] < first.begin_s + 20.0 / 3.0 + 2.0
    assert Boat(boat.world, 2, boat.truth, (Turn(0.0, 1.0, 5.0),)).first_turn_from(0.0) is None


def _run(count: float, *events: tuple[float, str]) -> Run:
    sums = Sums(count=count, inside=count, position=4.0 * count, position_shown=count, raw=2.0, fixes=2.0)
    return Run({"fuzzy": Score({"": sums}, 1.0, 1.0, 5.0, np.ones(2), np.ones(2))}, events, (310.0, 315.0))


def test_naming_counts_from_the_turn_and_not_before_the_fault() -> None:
    row = Row("imu", World(imu_fault=Fault(kind="sign", from_s=300.0)))
    named = _run(3.0, (10.0, "gyro-set-aside"), (317.0, "gyro-set-aside"))
    figures = figures_of(row, "fuzzy", [named], [_run(1.0)])
    assert [figures[key] for key in ("gyro_named_s", "gyro_named20_s", "gyro_onset_s")] == [7.0, 2.0, 17.0]
    assert [figures[key] for key in ("beside_ratio", "raw_ratio")] == [1.0, 2.0]
    figures = figures_of(row, "fuzzy", [named, _run(3.0, (10.0, "gyro-set-aside"))], None)
    assert [figures[key] for key in ("gyro_named_s", "gyro_blamed", "blamed")] == [math.inf, 1.0, 2.0]


def test_without_any_estimate_figures_are_no_numbers_and_no_ask_holds() -> None:
    figures = figures_of(Row("white", World()), "fuzzy", [_run(0.0)], None)
    assert math.isnan(figures["position_m"] + figures["in95"])
    assert not Ask("position_m", most=1.0).holds(figures["position_m"])
    bare = World(track="rest", has_compass=False, has_velocity=False, any_estimate=True).without_imu()
    assert one_boat(bare, 1, ("fuzzy",), 70.0).scores["fuzzy"].parts[""].fixes == 11.0


def test_rows_are_found_by_name_beginning_and_pattern() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    assert [row.name for row in rows_named(["white"])] == ["white", "white-nov"]
    assert [row.name for row in rows_named(["heel-6-*"])] == ["heel-6-nov", "heel-6-roll-nov"]
    with pytest.raises(WayfixError, match="nonsense"):
        rows_named(["nonsense"])
