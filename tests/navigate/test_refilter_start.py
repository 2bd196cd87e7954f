"""The opening of a run: filtered again when R is known, and a part of the snapshot like everything else."""

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest

from shore.navigation import refilter_start as opening
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter, FilterState
from shore.navigation.numbers import Array
from shore.navigation.state_space import EAST, HEADING, NORTH, StateSpace
from tests.navigate.batches import CHANNELS, POOR, START_SIGMAS, TABLE_5_3, Batch, begin, facts, noisy, step, told
from tests.navigate.voyages import Truth

FIRST_STEPS = 2 * opening.LAST_DUE


@pytest.fixture(scope="module")
def poor(mission: Truth) -> Batch:
    """Scenario 5.2: GPS 20 m, compass 5 deg."""
    return noisy(mission, 200, [POOR] * len(mission.states), np.ones(len(mission.states)))


def go(each: Filter, batch: Batch, member: int, steps: Sequence[int]) -> list[FilterState]:
    """One run; the states after each of the steps."""
    states = []
    for k in steps:
        step(each, k, batch.inputs[member, k], batch.measured[member, k])
        states.append(each.estimate)
    return states


def assert_same(ours: FilterState, theirs: FilterState) -> None:
    assert np.array_equal(ours.x, theirs.x)
    assert np.array_equal(ours.P, theirs.P)
    assert ours.noise == theirs.noise


def variances(state: FilterState) -> Array:
    return np.array([float(state.noise[channel].variance) for channel in CHANNELS])


@pytest.mark.parametrize("due", [2, 4, 8, 16, 32])
def test_it_leaves_the_filter_that_knew_the_noise(poor: Batch, due: int) -> None:
    """Step by step the same as a fixed filter that was told the R learned."""
    each = begin("fuzzy", poor, told(TABLE_5_3), 0)
    state = go(each, poor, 0, range(1, due + 1))[-1]
    knew = begin("ukf", poor, facts(np.sqrt(variances(state))), 0)
    known = go(knew, poor, 0, range(1, due + 1))[-1]
    np.testing.assert_allclose(state.x, known.x, rtol=1e-12)
    np.testing.assert_allclose(state.P, known.P, rtol=1e-9, atol=1e-15)


def test_it_ends_and_is_forgotten(poor: Batch) -> None:
    states = go(begin("fuzzy", poor, told(TABLE_5_3), 0), poor, 0, range(1, FIRST_STEPS))
    kept = [0 if state.opening is None else len(state.opening.operations) for state in states]
    assert kept[: opening.LAST_DUE - 1] == [3 * k for k in range(1, opening.LAST_DUE)]
    assert not any(kept[opening.LAST_DUE - 1 :])


def test_it_ends_though_one_sensor_went_silent(poor: Batch, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opening, "MOST_OPERATIONS", 20)
    states = go(begin("fuzzy", poor, told(TABLE_5_3), 0), poor, 0, range(1, 10))
    assert states[4].opening is not None
    assert states[6].opening is None


@pytest.mark.parametrize("name", ["ukf", "fuzzy-thesis"])
def test_filters_that_do_not_need_it_keep_nothing(poor: Batch, name: str) -> None:
    assert go(begin(name, poor, told(TABLE_5_3), 0), poor, 0, [1])[-1].opening is None


@pytest.mark.parametrize("at", [1, 7, 20, 31, 33])
def test_a_snapshot_within_it_continues_bit_for_bit(poor: Batch, at: int) -> None:
    """The filter has gone on to the end of the opening and beyond before it is taken back."""
    each = begin("fuzzy", poor, told(TABLE_5_3), 0)
    go(each, poor, 0, range(1, at + 1))
    memory = each.snapshot()
    first = go(each, poor, 0, range(at + 1, FIRST_STEPS))
    each.restore(memory)
    second = go(each, poor, 0, range(at + 1, FIRST_STEPS))
    for ours, theirs in zip(first, second, strict=True):
        assert_same(ours, theirs)


def test_one_boat_and_a_batch_of_runs_are_the_same(poor: Batch) -> None:
    """Over the opening and a minute more, five runs, in the units of the first sigmas."""
    runs, known = range(5), told(TABLE_5_3)
    few = Batch(poor.truth, poor.inputs[:5], poor.measured[:5], poor.start[:5], poor.sigmas, poor.imu_factor)
    together = begin("fuzzy", few, known)
    for k in range(1, 100):
        step(together, k, few.inputs[:, k].T.copy(), few.measured[:, k].T.copy())
    alone = [go(begin("fuzzy", few, known, run), few, run, range(1, 100))[-1] for run in runs]
    apart_x = together.estimate.x - np.array([state.x for state in alone])
    apart_P = together.estimate.P - np.array([state.P for state in alone])
    assert np.abs(apart_x / START_SIGMAS).max() < 1e-9
    assert np.abs(apart_P / np.outer(START_SIGMAS, START_SIGMAS)).max() < 1e-9
    ours = np.array([together.estimate.noise[channel].variance for channel in CHANNELS])
    np.testing.assert_allclose(ours.T, np.array([variances(state) for state in alone]), rtol=1e-9)


def heading_errors(poor: Batch, read_from: dict[int, str]) -> float:
    """Mean squared error, deg^2, when each filter starts where its first samples say it is."""
    each = build_filter("fuzzy", told(TABLE_5_3))
    x = np.tile(poor.truth.states[0], (len(poor.inputs), 1))
    x[:, [EAST, NORTH, HEADING]] = poor.measured[:, 0]
    P = np.diag([*np.square(TABLE_5_3[:2]), 1.0, 1.0, math.radians(TABLE_5_3[2]) ** 2])
    each.start(x, np.tile(P, (len(x), 1, 1)), read_from)
    squares = []
    for k in range(1, 300):
        step(each, k, poor.inputs[:, k].T.copy(), poor.measured[:, k].T.copy())
        error = np.degrees(each.estimate.x[:, HEADING] - poor.truth.states[k, HEADING])
        squares.append(np.mean((np.mod(error + 180.0, 360.0) - 180.0) ** 2))
    return float(np.mean(squares))


def test_a_first_state_read_from_sensors_is_doubted_as_they_are(poor: Batch) -> None:
    """A first heading of a compass with 5 deg, told 0.5 deg: without the correction it is believed for minutes."""
    read_from = dict(zip((EAST, NORTH, HEADING), CHANNELS, strict=True))
    assert heading_errors(poor, read_from) < 0.1 * heading_errors(poor, {})


def test_another_start_forgets_it(poor: Batch) -> None:
    each = begin("fuzzy", poor, told(TABLE_5_3), 0)
    go(each, poor, 0, range(1, 7))
    x, P = each.estimate.x, each.estimate.P
    each.start(x, P)
    state, fresh = each.estimate, opening.Opening(x, P)
    begun = state.opening
    assert begun is not None
    # Array by array: from Python 3.13 on, `==` of dataclasses compares each field even of one and the same object.
    for found, expected in ((state.x, x), (state.P, P), (begun.x, x), (begun.P, P)):
        np.testing.assert_array_equal(found, expected)
    assert (state.space, state.noise, state.repairs) == (StateSpace(), {}, 0)
    others = [field.name for field in fields(fresh) if field.name not in ("x", "P")]
    assert [getattr(begun, name) for name in others] == [getattr(fresh, name) for name in others]
