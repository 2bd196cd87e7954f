"""The filters: agreement with filterpy and with each other, positive definiteness, north, snapshots, bad numbers."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.angles import difference_rad, heading_rad
from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.errors import WayfixError
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.simulation.scenarios import scenario_voyage
from common.units import NS_PER_S
from shore.navigation import sensor_facts, ukf
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.filters import Filter, FilterState
from shore.navigation.imu_track import split
from shore.navigation.initial_state import first_of
from shore.navigation.kalman import update_scalar
from shore.navigation.measurements import Course, Position, TrueHeading
from shore.navigation.motion_model import FREE_NOISE, ImuInput, ProcessNoise, process_noise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.numbers import Array, wrapped
from shore.navigation.sensor_facts import FilterFacts, facts_of
from shore.navigation.state_space import EXTRA_NAMES, FIVE, Extra, Gaussian, StateSpace
from tests.navigate.filterpys import filterpy_ukf
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


TOLD = np.diag([36.0, 49.0, math.radians(0.5) ** 2])


class Twins:
    """Our UKF and filterpy's side by side; filterpy redraws its sigma points before an update, which is linear here."""

    def __init__(self, facts: FilterFacts, x: Array, P: Array) -> None:
        self.ours = build_filter("ukf", facts)
        self.ours.start(x, P)
        self.theirs = filterpy_ukf(x, P, TOLD)
        self._wraps = self.theirs.residual_z, self.theirs.z_mean
        self.worst = 0.0

    def predict(self, dt_s: float, imu: ImuInput) -> None:
        middle = self.ours.estimate.x[4] + 0.5 * dt_s * imu.yaw_rate_rad_s
        self.theirs.Q = process_noise(FIVE, middle, dt_s, self.ours.facts.imu_noise)
        self.theirs.predict(dt=dt_s, imu=imu)
        self.ours.predict(dt_s, imu)

    def update(self, *measured: Position | TrueHeading) -> None:
        """All at once there, one after the other here."""
        values, places, variances = [], [], []
        for each in measured:
            self.ours.update(each)
            is_fix = isinstance(each, Position)
            values += [each.east_m, each.north_m] if isinstance(each, Position) else [wrapped(each.heading_rad)]
            places += [0, 1] if is_fix else [4]
            channels = ("east", "north") if is_fix else ("heading",)
            variances += [self.ours.facts.channels[f"{each.sensor}.{name}"].initial_variance for name in channels]
        has_angle = 4 in places
        self.theirs.residual_z, self.theirs.z_mean = self._wraps if has_angle else (np.subtract, None)
        self.theirs.sigmas_f = self.theirs.points_fn.sigma_points(self.theirs.x, self.theirs.P)
        self.theirs.update(np.array(values), R=np.diag(variances), hx=lambda state: state[places])
        apart = self.ours.estimate.x - self.theirs.x
        apart[4] = wrapped(float(apart[4]))
        self.worst = max(self.worst, np.abs(apart).max(), np.abs(self.ours.estimate.P - self.theirs.P).max())


def test_ukf_agrees_with_filterpy(mission: Truth, scenario_53: Callable[[int], Run]) -> None:
    """On a mission with turns, step by step, GPS and compass in one update there."""
    run, x = scenario_53(1), mission.states[0].copy()
    x[4] = wrapped(float(x[4]))
    twins = Twins(thesis_facts(), x, np.diag([36.0, 49.0, 0.25, 0.25, 0.01]))
    for k in range(1, len(mission.states)):
        twins.predict(1.0, ImuInput(*run.inputs[k]))
        twins.update(Position(0, "gps1", *run.positions[k]), TrueHeading(0, "compass1", run.headings[k]))
    assert twins.worst < 1e-9


def test_ukf_agrees_with_filterpy_on_what_a_boat_sends() -> None:
    """Two minutes of scenario 5.2 as they come: IMU 20 Hz, compass 10 Hz, GPS 1 Hz, each at its own time."""
    voyage = scenario_voyage("5.2", seed=1, seconds=120.0)
    truth = voyage.truth
    x = np.array([truth.east_m[0], truth.north_m[0], 0.0, 0.0, wrapped(float(truth.heading_rad[0]))])
    twins = Twins(thesis_facts(), x, np.diag([36.0, 49.0, 1.0, 1.0, 0.01]))
    now_s = 0.0
    for each in voyage.readings:
        reading = each.reading
        if isinstance(reading, FixReading):
            place = voyage.plane.to_east_north_m(reading.lat_deg, reading.lon_deg)
            twins.update(Position(0, "gps1", *place))
        elif isinstance(reading, HeadingReading):
            twins.update(TrueHeading(0, "compass1", heading_rad(reading.heading_true_deg)))
        elif isinstance(reading, ImuReading):
            rate = math.radians(reading.yaw_rate_deg_s)
            twins.predict(each.t_s - now_s, ImuInput(reading.accel_fwd_m_s2, reading.accel_stb_m_s2, rate))
            now_s = each.t_s
    assert now_s == pytest.approx(120.0)
    assert twins.worst < 1e-9


def test_kf_and_ukf_are_the_same_on_the_thesis_mission(mission: Truth, scenario_53: Callable[[int], Run]) -> None:
    run = scenario_53(2)
    linear, _, _ = run_filter("kf", mission, run, 2)
    unscented, _, _ = run_filter("ukf", mission, run, 2)
    kf_rms, ukf_rms = (np.sqrt(np.mean(errors(x, mission) ** 2, axis=0)) for x in (linear, unscented))
    assert kf_rms == pytest.approx(ukf_rms, rel=0.02)


SIGMAS = (0.02, 0.1, 0.1, 0.2, 0.3, 0.3, 0.05, 0.5)
ALL = StateSpace(
    tuple(
        Extra(name, sigma, walk=0.01 * sigma * (place % 2), limit=0.4 if name == "tilt_leak_per_m" else math.inf)
        for place, (name, sigma) in enumerate(zip(EXTRA_NAMES, SIGMAS, strict=True))
    )
)
NINE = StateSpace(ALL.extras[:4])

inputs = st.tuples(
    st.sampled_from(["predict", "coast", "position", "heading", "course"]),
    st.floats(1e-3, 600.0),
    st.floats(-20.0, 20.0),
    st.floats(-3.0, 3.0),
)


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(sorted(REGISTRY)), st.sampled_from([FIVE, NINE, ALL]), st.lists(inputs, min_size=1, max_size=30))
def test_covariance_stays_symmetric_and_positive_definite(
    name: str, space: StateSpace, sequence: list[tuple[str, float, float, float]]
) -> None:
    """Any order of measurements and of stretches of 1 ms to 10 min, split as the timeline splits them.

    The heading stays wrapped and the tilt leak within its limit.
    """
    channels = {"g.east": Channel(9.0), "g.north": Channel(9.0), "g.course": Channel(0.1), "c.heading": Channel(1e-4)}
    facts = FilterFacts(channels, space, ProcessNoise(0.05, 0.02, 0.002), levers={"g": (2.0, -1.0)})
    each = build_filter(name, facts)
    each.start(*first_of(facts, (0.0,) * 5, (9.0, 9.0, 1.0, 1.0, 0.1)))
    for kind, dt, metres, rad in sequence:
        if kind in ("predict", "coast"):
            accel = metres * min(0.1, 0.5 / dt)  # a boat does not gain more than 10 m/s
            imu = ImuInput(accel, -accel, rad) if kind == "predict" else None
            for step in split(0, round(dt * NS_PER_S), imu):
                each.predict(*step)
        elif kind == "position":
            each.update(Position(0, "g", metres, 100.0 * rad))
        elif kind == "heading":
            each.update(TrueHeading(0, "c", rad))
        else:
            each.update(Course(0, "g", rad))
        x, P = each.estimate.x, each.estimate.P
        assert np.array_equal(P, P.T)
        scale = 1.0 / np.sqrt(P.diagonal())
        assert np.linalg.eigvalsh(P * scale[:, None] * scale).min() > 0.0
        assert -math.pi < x[4] <= math.pi
        assert space is FIVE or abs(x[8]) <= 0.4 + 1e-9  # a mean of sigma points rounds
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


@pytest.mark.parametrize("least", [1e-9, 0.0, -1e-9])
def test_every_variance_of_every_member_is_positive_or_the_filter_is_not_healthy(least: float) -> None:
    P = np.diag([1.0, 1.0, least, 1.0, 1.0])
    for each in (P, np.stack([np.eye(5), P])):
        assert FilterState(FIVE, np.zeros(each.shape[:-1]), each, {}).healthy == (least > 0.0)


@pytest.mark.parametrize("name", sorted(REGISTRY))
@pytest.mark.parametrize("space", [FIVE, NINE, ALL])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("where", ["accel", "turn", "fix", "heading"])
def test_bad_numbers_are_visible_and_raise_nothing(name: str, space: StateSpace, bad: float, where: str) -> None:
    channels = {"g.east": Channel(9.0), "g.north": Channel(9.0), "c.heading": Channel(1e-4)}
    each = build_filter(name, FilterFacts(channels, space))
    each.start(*first_of(each.facts, (0.0,) * 5, (1.0,) * 5))
    good = {"accel": 0.0, "turn": 0.0, "fix": 1.0, "heading": 0.1}
    told = {**good, where: bad}
    with np.errstate(all="ignore"):
        each.predict(0.1, ImuInput(told["accel"], 0.0, told["turn"]))
        each.update(Position(0, "g", told["fix"], 1.0))
        each.update(TrueHeading(0, "c", told["heading"]))
        each.predict(0.1, None)
    assert not each.estimate.healthy


@pytest.mark.parametrize("dt_s", [0.0, -1.0, math.nan, math.inf])
def test_a_step_that_is_none_is_refused_with_a_reason(dt_s: float) -> None:
    each = build_filter("ukf", thesis_facts())
    each.start(np.zeros(5), np.eye(5))
    before = each.estimate
    with pytest.raises(ValueError, match=rf"ukf cannot move on by {dt_s} s: give a finite step above 0"):
        each.predict(dt_s, None)
    assert each.estimate is before


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
    course_rad = math.radians(sensor_facts.COURSE_SIGMA_DEG)
    assert facts.channels["gps1.course"].initial_variance == pytest.approx(course_rad**2)
    assert facts.imu_noise == ProcessNoise(FREE_NOISE.accel_fwd, FREE_NOISE.accel_stb, math.radians(0.2))
    assert facts.free_noise == FREE_NOISE
