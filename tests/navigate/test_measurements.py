"""Kinds of measurement: one more kind is one class, and filter, bank, timeline and thesis' steps take it as it is."""

import math
from itertools import permutations
from typing import NamedTuple

import numpy as np
import pytest

from shore.navigation.filter_bank import Bank, Batch
from shore.navigation.filter_registry import build_filter
from shore.navigation.fixed_steps import Synchronous
from shore.navigation.measurements import (
    Course,
    Lever,
    Measurement,
    Part,
    Position,
    Scalar,
    Seeds,
    TrueHeading,
    is_angle,
    with_courses,
)
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array, hypot, part
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import EAST, NORTH, StateSpace
from shore.navigation.timeline import Timeline
from tests.navigate.voyages import state_of

S = 1_000_000_000
FACTS = FilterFacts(
    {"g.east": Channel(4.0), "g.north": Channel(4.0), "c.heading": Channel(0.01), "beacon.range": Channel(0.25)}
)


class Range(NamedTuple):
    """The distance to a beacon on the local plane: a kind that the engine has never heard of."""

    t_ns: int
    sensor: str
    range_m: float
    east_m: float
    north_m: float

    @property
    def rank(self) -> int:
        return 3

    @property
    def parts(self) -> tuple[Part, ...]:
        return (self._range,)

    def seed(self, seeds: Seeds) -> Seeds:
        return seeds

    def _range(self, _space: StateSpace, x: Array, _lever: Lever | None) -> Scalar:
        east, north = part(x, EAST) - self.east_m, part(x, NORTH) - self.north_m
        expected = hypot(east, north)
        row = ((EAST, east / expected), (NORTH, north / expected))
        return Scalar(row, self.range_m - expected, f"{self.sensor}.range", self.range_m)


def bank() -> Bank:
    return Bank([build_filter("ukf", FACTS)], has_compass=True)


FIX, HEADING, RANGE = Position(S, "g", 3.0, 4.0), TrueHeading(S, "c", 0.5), Range(2 * S, "beacon", 5.6, 0.0, 0.0)


def test_another_kind_is_fused_as_its_class_says() -> None:
    each = build_filter("ukf", FACTS)
    P = np.diag([4.0, 9.0, 1.0, 1.0, 0.1])
    each.start(np.array([3.0, 4.0, 0.0, 0.0, 0.0]), P)
    each.update(RANGE)
    h = np.array([0.6, 0.8, 0.0, 0.0, 0.0])
    K = P @ h / (h @ P @ h + 0.25)
    assert each.estimate.x == pytest.approx(np.array([3.0, 4.0, 0.0, 0.0, 0.0]) + K * 0.6)
    assert np.allclose(each.estimate.P, (np.eye(5) - np.outer(K, h)) @ P)
    assert each.estimate.noise["beacon.range"].variance == 0.25


def test_another_kind_starts_no_filter_and_keeps_its_place_in_the_order() -> None:
    """In whatever order the three of one time arrive: fix and heading start the filter, then the range is fused."""
    kinds: list[Measurement] = [FIX, HEADING, RANGE._replace(t_ns=S)]
    found = []
    for arrival in permutations(kinds):
        timeline = Timeline(bank(), None)
        for measured in arrival:
            timeline.push(Batch(S, "b", (measured,), ()))
        found.append(state_of(timeline.at(S)))
    assert found[0].P[0, 0] < 4.0 * 0.8
    assert all(np.array_equal(state.x, found[0].x) for state in found)
    assert Timeline(bank(), None).push(Batch(2 * S, "b", (RANGE, FIX), ()))[0].states == (None,)


def test_a_synchronous_step_takes_the_newest_of_another_kind_and_no_older_one_after_it() -> None:
    stepped = Synchronous(bank(), None, 1.0)
    stepped.push(Batch(S, "b", (FIX, HEADING), ()))
    older = RANGE._replace(t_ns=2 * S - 1, range_m=50.0)
    (measured,) = stepped.push(Batch(2 * S, "b", (RANGE, older), ()))
    (later,) = stepped.push(Batch(3 * S, "b", (older,), ()))
    assert state_of(measured).noise["beacon.range"].nis == pytest.approx(0.0, abs=1.0)
    assert state_of(later).noise == state_of(measured).noise


def test_only_a_fix_with_a_course_gives_one() -> None:
    moving = FIX._replace(course_rad=1.0)
    given: list[Measurement] = [FIX, HEADING, moving, RANGE]
    more: list[Measurement] = [FIX, HEADING, moving, Course(S, "g", 1.0), RANGE]
    assert list(with_courses(given)) == more


def test_fix_before_heading_at_the_same_time() -> None:
    course = Course(S, "g", math.pi)
    assert FIX.rank < HEADING.rank == course.rank < RANGE.rank
    assert [is_angle(channel) for channel in (HEADING.channel, course.channel, "g.east", "g.north")] == [
        True, True, False, False,
    ]  # fmt: skip
