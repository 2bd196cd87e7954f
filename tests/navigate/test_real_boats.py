"""Boats with the errors of real ones: the filter is right, its doubt holds the truth, and bad sensors are named.

A few seeds of what `python -m benchmarks.stress` measures over many; each limit is that of the row there, or wider for
so few boats where the comment says so.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.honesty import boat_of
from benchmarks.stress import Run, figures_of, one_boat
from benchmarks.stress_rows import rows_named
from common.messages import Frame
from common.simulation.scenarios import find_world
from common.simulation.voyage import boat_voyage
from common.simulation.without_ports import frames_of
from shore.pipeline import Pipeline

BOATS, SECONDS = 3, 400.0

pytestmark = pytest.mark.slow


def sailed(row: str, *, boats: int = BOATS, seconds: float = SECONDS) -> tuple[dict[str, float], Sequence[Run]]:
    """Figures of `fuzzy` over some boats of a row of the bench, and their runs."""
    (found,) = [each for each in rows_named([row]) if each.name == row]
    runs = [one_boat(found.world, seed, ["fuzzy"], seconds) for seed in range(1, boats + 1)]
    figures = figures_of(found, "fuzzy", runs, None)
    print({key: round(value, 2) for key, value in figures.items() if not math.isnan(value)})
    return figures, runs


def codes(runs: Sequence[Run]) -> list[set[str]]:
    return [{code for _, code in run.events} for run in runs]


def test_a_healthy_boat_is_found_and_nobody_is_blamed() -> None:
    figures, _ = sailed("white")
    assert figures["position_m"] <= 0.65
    assert figures["in95"] >= 0.92
    assert figures["heading_deg"] <= 1.0
    assert figures["blamed"] == 0


def test_a_hull_that_heels_in_its_turns_costs_nothing() -> None:
    figures, _ = sailed("heel-6")
    assert figures["position_m"] <= 0.7
    assert figures["blamed"] == 0


def test_errors_that_last_are_within_the_doubt_at_ten_fixes_a_second() -> None:
    figures, _ = sailed("lasting-120-10hz")
    assert figures["in95"] >= 0.85  # three boats, whose errors last as long as a third of the run
    assert figures["raw_ratio"] <= 1.0


@pytest.mark.parametrize("fault", ["imu-stuck-middle", "imu-sign", "imu-upside-down"])
def test_a_bad_imu_is_named_and_costs_no_position(fault: str) -> None:
    figures, runs = sailed(fault)
    assert figures["position_m"] <= 0.7
    assert figures["heading_deg"] <= 4.5  # the first turn, before the verdict, weighs much in so short a run
    assert all({"imu-repeats", "gyro-set-aside"} & each for each in codes(runs))
    assert figures["compass_blamed"] == 0


def test_a_magnetic_disturbance_is_named_and_the_gyro_is_not_blamed() -> None:
    figures, _ = sailed("magnetic")
    assert figures["compass_named_s"] <= 5.0
    assert figures["gyro_blamed"] == 0
    assert figures["heading_deg"] <= 3.0


def test_a_velocity_that_is_wrong_from_the_start_is_named() -> None:
    figures, _ = sailed("velocity-wrong")
    assert figures["velocity_named_s"] <= 20.0
    assert figures["in95"] >= 0.9


def test_each_quality_of_fix_has_its_own_doubt() -> None:
    figures, runs = sailed("rtk-single-float", boats=2, seconds=600.0)
    for part in ("rtk1", "single", "rtk2", "float", "rtk3"):
        assert figures[f"in95.{part}"] >= 0.9, part
    assert all("fix-quality-changed" in each for each in codes(runs))
    for part in ("rtk1", "rtk2", "rtk3"):
        assert figures[f"position_shown_m.{part}"] <= 0.1, part


def test_without_compass_in_a_current_the_heading_is_doubted_as_it_should_be() -> None:
    figures, _ = sailed("no-compass")
    assert figures["heading_e_s"] <= 1.0
    assert figures["given"] >= 0.99


def test_a_receiver_alone_at_rest_has_a_position() -> None:
    figures, _ = sailed("gps-only-rest", boats=2)
    assert figures["given"] >= 0.99
    assert figures["in95"] >= 0.9


def test_waves_blame_no_gyro_and_the_doubt_of_the_heading_holds() -> None:
    figures, _ = sailed("waves-12")
    assert figures["blamed"] == 0
    assert figures["heading_e_s"] <= 1.0


def test_the_path_does_not_move_when_every_stamp_is_a_microsecond_off() -> None:
    config = boat_of(1.0)
    frames = list(frames_of(boat_voyage(find_world("real-coast"), config, 3, 60.0)))

    def path(shift_ns: int) -> list[tuple[float, ...]]:
        pipeline = Pipeline(config, ["fuzzy"])
        return [item.state for frame in frames for item in pipeline.push(shifted(frame, shift_ns)).estimates]

    straight = np.array(path(0))
    for shift_ns in (-1000, 1000):
        apart = np.abs(np.array(path(shift_ns)) - straight)[:, :5]
        apart[:, 4] = np.minimum(apart[:, 4], math.tau - apart[:, 4])
        assert apart[:, :2].max() < 1e-3, shift_ns
        assert apart[:, 2:].max() < 1e-3, shift_ns


def shifted(frame: Frame, shift_ns: int) -> Frame:
    """The frame with other stamps in it."""

    def later(items: Any) -> Any:
        return tuple(replace(item, t_ns=item.t_ns + shift_ns) for item in items)

    return replace(
        frame,
        fixes=later(frame.fixes),
        imu=later(frame.imu),
        headings=later(frame.headings),
        attitudes=later(frame.attitudes),
    )
