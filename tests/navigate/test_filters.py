"""The filters: agreement with filterpy and with each other, positive definiteness, north, snapshots, bad numbers."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from common.angles import difference_rad, wrap_rad
from common.errors import WayfixError
from common.sensors import BoatConfig, BoatTable, PortTable, SensorTable
from shore.navigation import filters, ukf
from shore.navigation.adaptation import Channel
from shore.navigation.filters import REGISTRY, Filter, FilterFacts, FilterState, build_filter, facts_of
from shore.navigation.kalman import update_scalar
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.models import FIVE, FREE_NOISE, Gaussian, ImuInput, ProcessNoise, move, process_noise
from shore.navigation.numbers import Array
from tests.navigate.voyages import Run, Truth, errors, run_filter, thesis_facts


def random_spd(seed: int, n: int = 5) -> Array:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) * rng.uniform(0.05, 3.0, size=n)
    return root @ root.T + 1e-6 * np.eye(n)


@given(st.integers(0, 10_000))
def test_sigma_points_reproduce_mean_and_covariance(seed: int) -> None:
    x, P = np.random.default_rng(seed).normal(size=5), random_spd(seed)
    points = ukf.sigma_points(x, ukf.factor(P)[0])
    mean = ukf.weights(5)[0] @ points
    apart = points - mean
    assert mean == pytest.approx(x, abs=1e-9)
    assert np.allclose((apart.T * ukf.weights(5)[1]) @ apart, P, rtol=1e-9, atol=1e-9)


def test_sigma_points_are_rows_along_the_columns_of_the_lower_factor() -> None:
    P = random_spd(3)
    L = np.linalg.cholesky(P)
    points = ukf.sigma_points(np.zeros(5), ukf.factor(P)[0])
    assert np.array_equal(points[1], math.sqrt(5.0) * L[:, 0])
    assert np.array_equal(points[6], -points[1])


def filterpy_ukf(x: Array, P: Array, noise: ProcessNoise) -> Any:
    """filterpy's filter with our angle arithmetic injected."""

    def residual(a: Array, b: Array) -> Array:
        apart = a - b
        apart[-1] = wrap_rad(apart[-1])
        return apart

    def mean(points: Array, weights: Array) -> Array:
        result = weights @ points
        result[-1] = math.atan2(weights @ np.sin(points[:, -1]), weights @ np.cos(points[:, -1]))
        return result

    points = MerweScaledSigmaPoints(5, alpha=1.0, beta=2.0, kappa=0.0)
    theirs = UnscentedKalmanFilter(
        5, 3, 1.0, hx=lambda s: s[[0, 1, 4]], fx=partial(move, FIVE), points=points,
        x_mean_fn=mean, z_mean_fn=mean, residual_x=residual, residual_z=residual,
    )  # fmt: skip
    theirs.x, theirs.P = x.copy(), P.copy()
    theirs.R = np.diag([36.0, 49.0, math.radians(0.5) ** 2])
    return theirs


def test_ukf_agrees_with_filterpy(mission: Truth, scenario_53: Callable[[int], Run]) -> None:
    """On a mission with turns, step by step; filterpy redraws sigma points before its update, which is linear here."""
    run, facts = scenario_53(1), thesis_facts()
    x, P = mission.states[0], np.diag([36.0, 49.0, 0.25, 0.25, 0.01])
    x[4] = wrap_rad(x[4])
    ours = build_filter("ukf", facts)
    ours.start(x, P)
    theirs = filterpy_ukf(x, P, facts.imu_noise)
    worst = 0.0
    for k in range(1, 300):
        imu = ImuInput(*run.inputs[k])
        middle = ours.estimate.x[4] + 0.5 * imu.yaw_rate_rad_s
        theirs.Q = process_noise(FIVE, middle, 1.0, facts.imu_noise)
        theirs.predict(imu=imu)
        theirs.sigmas_f = theirs.points_fn.sigma_points(theirs.x, theirs.P)
        theirs.update(np.array([*run.positions[k], wrap_rad(run.headings[k])]))
        ours.predict(1.0, imu)
        ours.update(Position(0, "gps1", *run.positions[k]))
        ours.update(TrueHeading(0, "compass1", run.headings[k]))
        apart = ours.estimate.x - theirs.x
        apart[4] = difference_rad(ours.estimate.x[4], theirs.x[4])
        worst = max(worst, np.abs(apart).max(), np.abs(ours.estimate.P - theirs.P).max())
    assert worst < 1e-9


def test_kf_and_ukf_are_the_same_on_the_thesis_mission(mission: Truth, scenario_53: Callable[[int], Run]) -> None:
    run = scenario_53(2)
    linear, _, _ = run_filter("kf", mission, run, 2)
    unscented, _, _ = run_filter("ukf", mission, run, 2)
    kf_rms, ukf_rms = (np.sqrt(np.mean(errors(x, mission) ** 2, axis=0)) for x in (linear, unscented))
    assert kf_rms == pytest.approx(ukf_rms, rel=0.02)


inputs = st.tuples(
    st.sampled_from(["predict", "coast", "position", "heading"]),
    st.floats(1e-3, 600.0),
    st.floats(-20.0, 20.0),
    st.floats(-3.0, 3.0),
)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(REGISTRY)), st.lists(inputs, max_size=30))
def test_covariance_stays_symmetric_and_positive_definite(
    name: str, sequence: list[tuple[str, float, float, float]]
) -> None:
    facts = FilterFacts(
        {"g.east": Channel(9.0), "g.north": Channel(9.0), "c.heading": Channel(1e-4)},
        imu_noise=ProcessNoise(0.05, 0.02, 0.002),
    )
    each = build_filter(name, facts)
    each.start(np.zeros(5), np.diag([9.0, 9.0, 1.0, 1.0, 0.1]))
    for kind, dt, metres, rad in sequence:
        if kind == "predict":
            each.predict(min(dt, 2.0), ImuInput(0.1 * metres, -0.1 * metres, rad))
        elif kind == "coast":
            each.predict(dt, None)
        elif kind == "position":
            each.update(Position(0, "g", metres, 100.0 * rad))
        else:
            each.update(TrueHeading(0, "c", rad))
        P = each.estimate.P
        assert np.array_equal(P, P.T)
        scale = 1.0 / np.sqrt(P.diagonal())
        assert np.linalg.eigvalsh(P * scale[:, None] * scale).min() > 0.0
        assert -math.pi < each.estimate.x[4] <= math.pi
        assert each.estimate.healthy


def test_joseph_survives_a_tiny_variance_where_the_short_form_does_not() -> None:
    P = np.diag([1e8, 1e8, 1.0, 1.0, 1.0])
    P[0, 2] = P[2, 0] = 9e3
    short = P - np.outer(P[0], P[0]) / (P[0, 0] + 1e-9)
    assert short[0, 0] != pytest.approx(1e-9, rel=0.5)
    _, after = update_scalar(Gaussian(FIVE, np.zeros(5), P), ((0, 1.0),), 1.0, 1e-9)
    assert after[0, 0] == pytest.approx(1e-9, rel=1e-3)
    assert np.linalg.eigvalsh(after).min() > 0.0


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_heading_across_north(name: str) -> None:
    """A slow turn through north, compass on both sides of 0/360: no error beyond noise, no jump."""
    facts = FilterFacts(
        {"c.heading": Channel(math.radians(1.0) ** 2)}, imu_noise=ProcessNoise(0.01, 0.01, math.radians(0.1))
    )
    each = build_filter(name, facts)
    each.start(np.array([0, 0, 0, 0, math.radians(-20.0)]), np.diag([1.0, 1, 1, 1, 0.01]))
    rng = np.random.default_rng(4)
    worst = 0.0
    for k in range(1, 41):
        truth = math.radians(-20.0 + k)
        each.predict(1.0, ImuInput(0, 0, math.radians(1.0)))
        each.update(TrueHeading(0, "c", (truth + math.radians(rng.normal())) % math.tau))
        worst = max(worst, abs(difference_rad(each.estimate.x[4], truth)))
    assert math.degrees(worst) < 3.0


def test_unknown_heading_is_not_folded_into_false_certainty() -> None:
    """Ten minutes without anything: the heading's sigma must grow monotonically past half a turn."""
    each = build_filter("ukf", FilterFacts({}))
    each.start(np.zeros(5), np.diag([1.0, 1, 1, 1, 0.01]))
    sigmas = []
    for _ in range(10):
        each.predict(60.0, None)
        sigmas.append(math.degrees(math.sqrt(each.estimate.P[4, 4])))
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] == pytest.approx(5.0 * math.sqrt(600.0), rel=0.01)


def test_repairs_of_an_indefinite_covariance_are_counted() -> None:
    each = build_filter("ukf", FilterFacts({}))
    P = np.eye(5)
    P[0, 1] = P[1, 0] = 1.0 + 1e-13
    each.start(np.zeros(5), P)
    each.predict(0.1, None)
    assert each.estimate.repairs == 1
    assert each.estimate.healthy


@pytest.mark.parametrize("name", sorted(REGISTRY))
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_bad_numbers_are_visible_and_raise_nothing(name: str, bad: float) -> None:
    each = build_filter(name, FilterFacts({"g.east": Channel(9.0), "g.north": Channel(9.0)}))
    each.start(np.zeros(5), np.eye(5))
    with np.errstate(all="ignore"):
        each.predict(0.1, ImuInput(bad, 0.0, 0.0))
        each.update(Position(0, "g", 1.0, 1.0))
        each.predict(0.1, None)
    assert not each.estimate.healthy


@pytest.mark.parametrize("name", sorted(REGISTRY))
def test_restore_continues_bit_for_bit(name: str, mission: Truth, scenario_53: Callable[[int], Run]) -> None:
    run = scenario_53(7)

    def carry_on(each: Filter, start: int, stop: int) -> FilterState:
        for k in range(start, stop):
            each.predict(1.0, ImuInput(*run.inputs[k]))
            each.update(Position(0, "gps1", *run.positions[k]))
            each.update(TrueHeading(0, "compass1", run.headings[k]))
        return each.snapshot()

    each = build_filter(name, thesis_facts())
    each.start(mission.states[0], np.diag([36.0, 49.0, 0.25, 0.25, 0.01]))
    middle = carry_on(each, 1, 80)
    first = carry_on(each, 80, 160)
    each.restore(middle)
    second = carry_on(each, 80, 160)
    assert np.array_equal(first.x, second.x)
    assert np.array_equal(first.P, second.P)
    assert dict(first.noise) == dict(second.noise)


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(WayfixError, match="kf, ekf, ukf, fuzzy-thesis, fuzzy"):
        build_filter("pf", FilterFacts({}))


def test_facts_come_from_the_boats_file() -> None:
    port = PortTable(name="p", path="/dev/null")
    config = BoatConfig(
        boat=BoatTable(id="b"),
        port=(port,),
        sensor=(
            SensorTable(id="gps1", port="p", role="gps", sigma_m=4.0, rate_hz=5.0),
            SensorTable(id="compass1", port="p", role="compass", sigma_deg=2.0),
            SensorTable(id="imu1", port="p", role="imu", use=("yaw_rate",), gyro_density_deg=0.2),
        ),
    )
    facts = facts_of(config)
    assert facts.channels["gps1.north"] == Channel(16.0, 5.0)
    assert facts.channels["compass1.heading"] == Channel(math.radians(2.0) ** 2, 10.0)
    assert facts.channels["gps1.course"].initial_variance == pytest.approx(math.radians(filters.COURSE_SIGMA_DEG) ** 2)
    assert facts.imu_noise == ProcessNoise(FREE_NOISE.accel_fwd, FREE_NOISE.accel_stb, math.radians(0.2))
    assert facts.free_noise == FREE_NOISE
