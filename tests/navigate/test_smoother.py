"""The smoother: exact where the world is linear; links, north, limits, batches; what it gains in the scenarios."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from common.simulation.monte_carlo_runs import Runs, draw_runs
from common.simulation.scenario import Scenario, with_outage
from common.simulation.scenarios import find_scenario
from common.units import NS_PER_S
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise, jacobian, process_noise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array, wrapped
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.smoother import Smoother
from shore.navigation.state_space import FIVE, Extra, Gaussian, StateSpace

BIASES = (Extra("gyro_bias_rad_s", 0.005), Extra("accel_bias_fwd_m_s2", 0.04), Extra("accel_bias_stb_m_s2", 0.04))
EIGHT = StateSpace(BIASES)
NINE = StateSpace((*BIASES, Extra("tilt_leak_per_m", 0.2, limit=0.4)))
QUIET = ProcessNoise(0.004, 0.004, math.radians(0.036))
CHANNELS = {"g.east": Channel(4.0), "g.north": Channel(9.0), "c.heading": Channel(math.radians(1.0) ** 2)}

Operation = float | str | Position | TrueHeading
"""A step in s, "keep", or a measurement."""


def some_way(seed: int) -> list[Operation]:
    """A minute: steps of many lengths, several between two measurements, some measurements at one time, 8 kept."""
    rng = np.random.default_rng(seed)
    way: list[Operation] = []
    for k in range(8):
        way += rng.uniform(0.01, 3.0, rng.integers(1, 5)).tolist()
        way += [Position(0, "g", *(rng.normal(size=2) * 3.0))] * (k % 3)
        way += ["keep"]
        way += [TrueHeading(0, "c", math.pi + 0.02 * rng.normal())] * (k % 2)
    return way


def carry(each: Smoother, way: Sequence[Operation], imu: ImuInput | None = None) -> None:
    for item in way:
        if isinstance(item, float):
            each.filter.predict(item, imu)
        elif isinstance(item, str):
            each.keep()
        else:
            each.filter.update(item)


def least_squares(x: Array, P: Array, way: Sequence[Operation], facts: FilterFacts) -> list[tuple[Array, Array]]:
    """Mean and covariance of the kept states without IMU, from the joint Gaussian of all states: no recursion."""
    transitions, kept, rows, values, variances = [np.eye(5)], [], [], [], []
    covariance = P.copy()
    spreads = [P]
    for item in way:
        if isinstance(item, float):
            F = jacobian(FIVE, x, item, None)
            transitions.append(F)
            spreads.append(process_noise(FIVE, 0.0, item, facts.free_noise))
        elif isinstance(item, str):
            kept.append(len(transitions) - 1)
        elif isinstance(item, Position):
            at = len(transitions) - 1
            rows += [(at, 0), (at, 1)]
            values += [float(item.east_m), float(item.north_m)]
            variances += [4.0, 9.0]
        else:
            rows.append((len(transitions) - 1, 4))
            values.append(float(item.heading_rad))
            variances.append(math.radians(1.0) ** 2)
    count = len(transitions)
    joint, mean = np.zeros((5 * count, 5 * count)), np.zeros(5 * count)
    mean[:5], joint[:5, :5] = x, covariance
    for k in range(1, count):
        old, new, F = slice(0, 5 * k), slice(5 * k, 5 * k + 5), transitions[k]
        mean[new] = F @ mean[5 * k - 5 : 5 * k]
        joint[new, old] = F @ joint[5 * k - 5 : 5 * k, old]
        joint[old, new] = joint[new, old].T
        joint[new, new] = F @ joint[5 * k - 5 : 5 * k, 5 * k - 5 : 5 * k] @ F.T + spreads[k]
    H = np.zeros((len(rows), 5 * count))
    for row, (at, place) in enumerate(rows):
        H[row, 5 * at + place] = 1.0
    gain = joint @ H.T @ np.linalg.inv(H @ joint @ H.T + np.diag(variances))
    mean, joint = mean + gain @ (np.array(values) - H @ mean), joint - gain @ H @ joint
    return [(mean[5 * at : 5 * at + 5], joint[5 * at : 5 * at + 5, 5 * at : 5 * at + 5]) for at in kept]


@pytest.mark.parametrize("name", ["kf", "ekf", "ukf"])
@pytest.mark.parametrize("known", [(), (2,), (0, 3)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_is_the_exact_answer_of_a_linear_world(name: str, known: tuple[int, ...], seed: int) -> None:
    """Across north, also where some states are known at the start (P is singular then)."""
    way = some_way(seed)
    x, P = np.array([0.0, 0.0, 0.3, -0.2, math.pi - 0.01]), np.diag([25.0, 25.0, 1.0, 1.0, 0.05])
    P[known, known] = 1e-14 if name == "ukf" else 0.0
    each = Smoother(name, FilterFacts(CHANNELS))
    each.filter.start(x, P)
    carry(each, way)
    expected = least_squares(x, P, way, each.filter.facts)
    found = each.smoothed()
    assert len(found) == 8
    for (mean, covariance), state in zip(expected, found, strict=True):
        apart = state.x - mean
        apart[4] = wrapped(float(apart[4]))
        assert apart == pytest.approx(np.zeros(5), abs=1e-9)
        assert np.allclose(state.P, covariance, rtol=0.0, atol=1e-9)


SHAKEN = ImuInput(0.2, -0.1, 0.15)


def started(name: str, space: StateSpace, runs: int | None = None) -> Smoother:
    each = Smoother(name, FilterFacts(CHANNELS, space, QUIET))
    x = np.array([0.0, 0.0, 0.3, -0.2, math.pi - 0.01, *[0.0] * len(space.extras)])
    P = np.diag([25.0, 25.0, 1.0, 1.0, 0.05, *(extra.sigma**2 for extra in space.extras)])
    each.filter.start(*((x, P) if runs is None else (np.tile(x, (runs, 1)), np.tile(P, (runs, 1, 1)))))
    return each


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_links_make_one_link_of_many(name: str) -> None:
    """Kept at every operation or at 8 of them: the same at these 8, whatever was measured in between."""
    way = some_way(4)
    few, all_of_them = started(name, NINE), started(name, NINE)
    carry(few, way, SHAKEN)
    places = []
    for item in way:
        if item == "keep":
            places.append(len(all_of_them.smoothed()))
        else:
            carry(all_of_them, [item], SHAKEN)
        all_of_them.keep()
    everything = all_of_them.smoothed()
    for place, state in zip(places, few.smoothed(), strict=True):
        same = everything[place]
        assert state.x == pytest.approx(same.x, abs=1e-9)
        assert np.allclose(state.P, same.P, rtol=1e-7, atol=1e-12)


def test_a_batch_is_its_runs_side_by_side() -> None:
    way = some_way(5)
    together = started("fuzzy", NINE, runs=3)
    shift = np.array([0.0, 0.1, -0.2])
    carry(together, [_shifted(item, shift) for item in way], SHAKEN)
    for run in range(3):
        alone = started("fuzzy", NINE)
        carry(alone, [_shifted(item, float(shift[run])) for item in way], SHAKEN)
        for one, all_runs in zip(alone.smoothed(), together.smoothed(), strict=True):
            assert one.x == pytest.approx(all_runs.x[run], abs=1e-9)
            assert np.allclose(one.P, all_runs.P[run], rtol=1e-7, atol=1e-12)


def _shifted(item: Operation, shift: Array | float) -> Operation:
    if isinstance(item, Position):
        return item._replace(east_m=item.east_m + shift)
    return item


def test_the_filter_itself_does_not_notice() -> None:
    way = some_way(6)
    recorded, plain = started("fuzzy", NINE), build_filter("fuzzy", FilterFacts(CHANNELS, NINE, QUIET))
    plain.start(recorded.filter.estimate.x, recorded.filter.estimate.P)
    carry(recorded, way, SHAKEN)
    for item in way:
        if isinstance(item, float):
            plain.predict(item, SHAKEN)
        elif not isinstance(item, str):
            plain.update(item)
    assert np.array_equal(recorded.filter.estimate.x, plain.estimate.x)
    assert np.array_equal(recorded.filter.estimate.P, plain.estimate.P)


def test_it_ends_where_the_filter_does_and_never_knows_less() -> None:
    way: list[Operation] = [*some_way(7), "keep"]
    each = started("ukf", NINE)
    believed = []
    for item in way:
        carry(each, [item], SHAKEN)
        if item == "keep":
            believed.append(each.filter.estimate)
    found = each.smoothed()
    assert np.array_equal(found[-1].x, each.filter.estimate.x)
    for before, after in zip(believed, found, strict=True):
        assert (after.P.diagonal() <= before.P.diagonal() * (1.0 + 1e-9)).all()
        assert np.linalg.eigvalsh(after.P).min() > -1e-12


def test_a_limited_state_stays_within_its_limit() -> None:
    """One that wanders: a constant one is smoothed to its last value, which the filter has limited."""
    leak = Extra("tilt_leak_per_m", 0.2, walk=0.1, limit=0.1)
    each = started("ukf", StateSpace((leak,)))
    for k in range(40):
        each.keep()
        each.filter.predict(1.0, ImuInput(0.2 if k < 20 else -0.2, 0.0, 0.0))
        each.filter.update(Position(0, "g", 0.0, -2.0 * k))
        each.filter.update(TrueHeading(0, "c", math.pi))
    assert max(abs(float(state.x[5])) for state in each.smoothed()) == pytest.approx(0.1, abs=1e-12)


def test_what_has_no_variance_is_known() -> None:
    way = some_way(8)
    known, without = started("ekf", EIGHT), started("ekf", FIVE)
    P = known.filter.estimate.P.copy()
    P[5:] = P[:, 5:] = 0.0
    known.filter.start(known.filter.estimate.x, P)
    carry(known, way, SHAKEN)
    carry(without, way, SHAKEN)
    for state, expected in zip(known.smoothed(), without.smoothed(), strict=True):
        assert state.x == pytest.approx([*expected.x, 0.0, 0.0, 0.0], abs=1e-9)
        assert np.allclose(state.P[:5, :5], expected.P, rtol=1e-7, atol=1e-12)


def test_two_states_that_are_one() -> None:
    """Fully correlated constants: P is singular for ever."""
    way = some_way(8)
    each = started("ekf", EIGHT)
    P = each.filter.estimate.P.copy()
    P[6, 7] = P[7, 6] = P[6, 6]
    each.filter.start(each.filter.estimate.x, P)
    carry(each, way, SHAKEN)
    for state in each.smoothed():
        assert state.x[6] == pytest.approx(state.x[7], abs=1e-9)
        assert abs(state.x[6]) < 0.2
        assert state.P[6, 6] == pytest.approx(state.P[6, 7], rel=1e-6)
        assert state.P[6, 6] <= 0.04**2


def test_an_opening_that_is_filtered_again_is_smoothed_with_what_it_learned() -> None:
    """At the fourth sample `fuzzy` begins anew with the R of the four: as a filter that knew it from the start."""
    rng = np.random.default_rng(9)
    way: list[Operation] = []
    for k in range(4):
        heading = math.pi + 0.1 * (-1.0) ** k
        t_ns = k * NS_PER_S
        way += [0.7, 0.3, "keep", Position(t_ns, "g", *(rng.normal(size=2) * 9.0)), TrueHeading(t_ns, "c", heading)]
    learning = started("fuzzy", FIVE)
    carry(learning, way)
    learned = {name: Channel(float(noise.variance)) for name, noise in learning.filter.estimate.noise.items()}
    assert learned["c.heading"].initial_variance > 1.5 * CHANNELS["c.heading"].initial_variance
    knowing = Smoother("ukf", FilterFacts(learned, FIVE, QUIET))
    knowing.filter.start(started("ukf", FIVE).filter.estimate.x, started("ukf", FIVE).filter.estimate.P)
    carry(knowing, way)
    for state, expected in zip(learning.smoothed(), knowing.smoothed(), strict=True):
        assert state.x == pytest.approx(expected.x, abs=1e-9)
        assert np.allclose(state.P, expected.P, rtol=1e-7, atol=1e-12)


def test_what_came_before_a_number_that_is_not_finite_is_still_smoothed() -> None:
    each = started("ukf", FIVE)
    with np.errstate(invalid="ignore"):
        for k in range(20):
            each.keep()
            each.filter.predict(1.0, ImuInput(math.nan if k == 19 else 0.0, 0.0, 0.0))
            each.filter.update(Position(0, "g", float(k), 0.0))
    assert not each.filter.estimate.healthy
    found = each.smoothed()
    assert len(found) == 20
    assert all(np.isfinite(state.x).all() for state in found)
    assert found[0].P[0, 0] < 0.5 * 25.0


def test_a_filter_that_is_smoothed_cannot_go_back() -> None:
    each = started("ukf", FIVE)
    before = each.filter.snapshot()
    each.filter.predict(1.0, None)
    with pytest.raises(ValueError, match="cannot go back"):
        each.filter.restore(before)


def test_another_start_forgets_what_was_kept() -> None:
    way = some_way(10)
    again, once = started("ukf", NINE), started("ukf", NINE)
    x, P = again.filter.estimate.x, again.filter.estimate.P
    carry(again, [*way, 0.5], SHAKEN)
    again.filter.start(x, P)
    carry(again, way, SHAKEN)
    carry(once, way, SHAKEN)
    for state, expected in zip(again.smoothed(), once.smoothed(), strict=True):
        assert np.array_equal(state.x, expected.x)
        assert np.array_equal(state.P, expected.P)


def squares(states: Sequence[Gaussian], truth: Array) -> Array:
    """Squared errors (steps, runs, 3): east, north in m^2, heading in deg^2."""
    apart = np.stack([state.x[..., [0, 1, 4]] for state in states]) - truth[:, np.newaxis, [0, 1, 4]]
    apart[..., 2] = np.degrees(wrapped(apart[..., 2]))
    return np.square(apart)


def sail(
    scenario: Scenario, runs: Runs, space: StateSpace, name: str = "ukf", *, told: bool = True
) -> tuple[Array, Array]:
    """Squared errors of filter and smoother, (steps, runs, 3) each; `told`: R is the true one, else the scenario's."""
    assumed = scenario.assumed
    fix_m = runs.gps_m[1] if told else np.array([assumed.gps_east_m, assumed.gps_north_m])
    turn_rad = runs.compass_sigma_rad[1] if told else math.radians(assumed.compass_deg)
    channels = {
        "gps1.east": Channel(float(fix_m[0]) ** 2),
        "gps1.north": Channel(float(fix_m[1]) ** 2),
        "compass1.heading": Channel(float(turn_rad) ** 2),
    }
    accel, gyro = float(runs.accel_std[1, 0]), float(runs.gyro_std_rad[1])
    each = Smoother(name, FilterFacts(channels, space, ProcessNoise(accel, accel, gyro)))
    sigmas = np.array([*assumed.start_sigmas, *(extra.sigma for extra in space.extras)])
    x = np.zeros((len(runs.imu), space.size))
    x[:, :5] = runs.truth[0] + sigmas[:5] * runs.start_noise[:, :5]
    each.filter.start(x, np.tile(np.diag(sigmas**2), (len(x), 1, 1)))
    believed = [each.filter.estimate.gaussian]
    each.keep()
    for step in range(1, len(runs.truth)):
        each.filter.predict(1.0, ImuInput(*np.ascontiguousarray(runs.imu[:, step].T)))
        if runs.has_gps[step]:
            each.filter.update(Position(step, "gps1", *np.ascontiguousarray(runs.gps[:, step].T)))
        each.filter.update(TrueHeading(step, "compass1", runs.compass_rad[:, step]))
        each.keep()
        believed.append(each.filter.estimate.gaussian)
    return squares(believed, runs.truth), squares(each.smoothed(), runs.truth)


@pytest.mark.slow
def test_what_a_smoother_gains_in_scenario_51() -> None:
    """The bound of the study: 0.26 / 0.27 / 0.50 of the filter's MSE."""
    scenario = find_scenario("5.1")
    filtered, smooth = sail(scenario, draw_runs(scenario, 200, 1), FIVE)
    ratio = smooth.mean(axis=(0, 1)) / filtered.mean(axis=(0, 1))
    print("RTS / filter, 5.1:", ratio.round(3))
    assert (ratio <= [0.32, 0.32, 0.58]).all(), ratio


@pytest.mark.slow
def test_what_is_left_of_an_outage_without_calibration() -> None:
    """Horizontal RMS inside an outage from 400 s on, biases constant and unknown."""
    for seconds, most_m in ((10, 1.2), (30, 1.4), (60, 1.6), (120, 2.0)):
        scenario = with_outage(find_scenario("uncalibrated"), 400.0, float(seconds))
        runs = draw_runs(scenario, 200, 1)
        filtered, smooth = sail(scenario, runs, EIGHT)
        inside = ~runs.has_gps
        end_m, inside_m = (
            math.sqrt(float(each[rows][..., :2].sum(axis=-1).mean()))
            for each, rows in ((filtered, np.flatnonzero(inside)[-1:]), (smooth, inside))
        )
        print(f"outage {seconds} s: filter at its end {end_m:.2f} m, smoother inside {inside_m:.2f} m")
        assert inside_m <= most_m


@pytest.mark.slow
def test_a_wrong_start_is_smoothed_with_what_was_learned() -> None:
    """5.2: the opening is filtered again with the R it found, and the smoother goes by that."""
    scenario = find_scenario("5.2")
    runs = draw_runs(scenario, 100, 2)
    _, knowing = sail(scenario, runs, FIVE)
    _, learning = sail(scenario, runs, FIVE, "fuzzy", told=False)
    ratio = learning.mean(axis=(0, 1)) / knowing.mean(axis=(0, 1))
    start = learning[:30].mean(axis=(0, 1)) / knowing[:30].mean(axis=(0, 1))
    print("smoothed fuzzy / smoothed oracle, 5.2:", ratio.round(3), "first 30 s:", start.round(3))
    assert (ratio <= 1.15).all()
