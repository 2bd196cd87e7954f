"""A sensor's own scatter from third differences, and the bound that it sets on what adaptive filters learn."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.units import NS_PER_S
from shore.navigation.filter_bank import Bank, Batch
from shore.navigation.filter_registry import REGISTRY, build_filter
from shore.navigation.filters import Filter, FilterState
from shore.navigation.initial_state import first_of
from shore.navigation.measurements import Measurement, Position, TrueHeading
from shore.navigation.motion_model import ImuInput, ProcessNoise
from shore.navigation.noise.noise_rule import Channel
from shore.navigation.noise.own_scatter import IN_FORCE_FROM, Scatter, bound, difference
from shore.navigation.noise.rules import NOISE_RULES
from shore.navigation.numbers import Array, wrapped
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.timeline import Timeline

BOUNDED = sorted(name for name, (_, rule) in REGISTRY.items() if NOISE_RULES[rule].is_bounded)
R0 = 4.0
FACTS = FilterFacts(
    {"g.east": Channel(R0), "g.north": Channel(R0), "c.heading": Channel(math.radians(1.0) ** 2)},
    imu_noise=ProcessNoise(0.004, 0.004, math.radians(0.036)),
)
START = first_of(FACTS, (0.0, 0.0, 0.0, 0.0, 3.1), (R0, R0, 0.25, 0.25, 1e-3))

times_s = st.lists(st.floats(1.0, 50.0), min_size=4, max_size=4).map(lambda steps: np.cumsum(steps).tolist())
coefficients = st.tuples(st.floats(-1e3, 1e3), st.floats(-20.0, 20.0), st.floats(-0.5, 0.5))


def after(t_s: list[float], values: list[float]) -> tuple[float, float]:
    """Squares of the difference of four readings, and of what the last one alone is off."""
    first, second, third, newest = [(round(t * NS_PER_S), value) for t, value in zip(t_s, values, strict=True)]
    square, share = difference(first, second, third, newest)
    return float(square), float(square) / share


def fed(values: Array, *, step_s: float = 1.0, prior: float = R0, is_angle: bool = False) -> Scatter:
    """The memory after readings `values` (k,) or (k, runs)."""
    scatter = Scatter.first(prior, is_angle=is_angle)
    for k, value in enumerate(values.tolist() if values.ndim == 1 else values):
        scatter = scatter.then((round(k * step_s * NS_PER_S), value))
    return scatter


@given(times_s, coefficients)
def test_a_parabola_cancels_at_whatever_times(t_s: list[float], way: tuple[float, float, float]) -> None:
    square, _ = after(t_s, [way[0] + way[1] * t + way[2] * t * t for t in t_s])
    assert square < 1e-12


@given(times_s, st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4), st.floats(-math.pi, math.pi))
def test_headings_wrap(t_s: list[float], values: list[float], north: float) -> None:
    """About any direction the same, less than half a turn apart."""
    turned = Scatter.first(1.0, is_angle=True)
    plain = turned._replace(is_angle=False)
    for t, value in zip(t_s, values, strict=True):
        plain = plain.then((round(t * NS_PER_S), value))
        turned = turned.then((round(t * NS_PER_S), float(wrapped(value + north))))
    assert turned.squares == pytest.approx(plain.squares, abs=1e-9)
    assert turned.jump == pytest.approx(plain.jump, abs=1e-9)


@pytest.mark.parametrize("turn_deg_s", [-100.0, 100.0])
def test_a_spin_of_many_turns_is_a_parabola(turn_deg_s: float) -> None:
    way = wrapped(np.radians(turn_deg_s * np.arange(100.0) + 0.05 * np.arange(100.0) ** 2))
    assert fed(np.asarray(way), prior=1e-9, is_angle=True).variance < 1e-9


@given(times_s, st.floats(-100.0, 100.0))
def test_what_the_newest_reading_alone_is_off(t_s: list[float], off: float) -> None:
    _, square = after(t_s, [3.0, 3.0, 3.0, 3.0 + off])
    assert square == pytest.approx(off * off, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_differences_have_the_variance_of_one_reading(jitter: float) -> None:
    """4000 fours of readings at regular and irregular times: within 3.3 standard errors."""
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(4000):
        t_s = (2.0 * np.arange(4.0) + rng.uniform(-jitter, jitter, 4) + 1.0).tolist()
        squares.append(after(t_s, (2.0 * rng.normal(size=4)).tolist())[0])
    assert np.mean(squares) == pytest.approx(4.0, abs=3.3 * 4.0 * math.sqrt(2.0 / 4000))


@pytest.mark.parametrize("factor", [0.1, 1.0, 7.0])
def test_the_scatter_is_found_whatever_was_told(factor: float) -> None:
    """400 readings of 400 receivers that are better and worse than told: the mean within 3 %, each within 60 %."""
    rng = np.random.default_rng(2)
    found = fed(factor * rng.normal(size=(400, 400)), prior=1.0).variance / factor**2
    assert np.mean(found) == pytest.approx(1.0, abs=0.03)
    assert 0.4 < np.min(found) < np.max(found) < 2.0


def test_the_bound_is_in_force_after_fifteen_readings_and_above_what_a_worse_sensor_has() -> None:
    rng = np.random.default_rng(3)
    worse = 7.0 * rng.normal(size=(15, 2000))
    assert bound(1.0, fed(worse[:14], prior=1.0)) == math.inf
    most = bound(1.0, fed(worse, prior=1.0))
    assert np.mean(most < 49.0) < 0.025
    assert fed(worse, prior=1.0).weight >= IN_FORCE_FROM


def test_errors_that_last_do_not_scatter() -> None:
    rng = np.random.default_rng(4)
    walk = np.cumsum(0.1 * rng.normal(size=(400, 50)), axis=0)
    assert np.std(walk) > 0.8
    assert np.mean(fed(walk).variance) < 0.01


def test_a_jump_counts_for_little() -> None:
    rng = np.random.default_rng(5)
    values = 2.0 * rng.normal(size=(200, 100))
    before = fed(values).variance
    values[190:] += 1000.0
    assert np.all(fed(values).variance < 3.2 * before)


@pytest.mark.parametrize("is_angle", [False, True])
def test_readings_that_are_nearer_than_their_spacing_are_left_out(is_angle: bool) -> None:
    """A sensor of 10 Hz gives a difference each 0.9 s, as one of 1.1 Hz does."""
    quick, slow = (fed(np.zeros(count), step_s=step_s, is_angle=is_angle) for count, step_s in ((100, 0.1), (12, 0.9)))
    assert quick.weight == slow.weight
    assert quick.readings == slow.readings


def test_readings_before_a_long_silence_are_forgotten() -> None:
    scatter = fed(np.zeros(10))
    later = scatter.then((7 * 3600 * NS_PER_S, 5000.0))
    assert later.readings == ((7 * 3600 * NS_PER_S, 5000.0),)
    assert later.squares == scatter.squares


def test_a_jump_raises_the_bound_for_a_while() -> None:
    """To its square at once, of a reading near to the last one too; after three minutes it is forgotten."""
    rng = np.random.default_rng(5)
    quiet = fed(2.0 * rng.normal(size=100))
    jumped = quiet.then((99_200_000_000, 500.0))
    assert jumped.readings == quiet.readings
    assert bound(R0, jumped) == pytest.approx(500.0**2, rel=0.1)
    for second in range(100, 280):
        jumped = jumped.then((second * NS_PER_S, 2.0 * rng.normal()))
    assert bound(R0, jumped) < 20.0 * R0
    assert np.max(jumped.jump) < R0


def test_what_does_not_scatter_is_believed_no_more_than_told() -> None:
    """Held fixes, a compass of whole degrees at rest: 1000 readings alike."""
    held = fed(np.full(1000, 12.5))
    assert held.variance < 1e-3 * R0
    assert bound(R0, held) == R0


def blamed(name: str, runs: int | None = None, seconds: int = 120) -> tuple[Filter, list[FilterState]]:
    """Fixes and headings as told, of a boat at rest whose IMU says from 40 s on that it speeds up and turns."""
    rng = np.random.default_rng(6)
    tail = () if runs is None else (runs,)
    fixes, headings = 2.0 * rng.normal(size=(seconds, 2, *tail)), math.radians(1.0) * rng.normal(size=(seconds, *tail))
    each = build_filter(name, FACTS)
    x, P = START
    each.start(*((x, P) if runs is None else (np.tile(x, (runs, 1)), np.tile(P, (runs, 1, 1)))))
    states = []
    for k in range(seconds):
        each.predict(1.0, ImuInput(0.2, 0.1, 0.02) if k > 40 else ImuInput(0.0, 0.0, 0.0))
        each.update(Position(k * NS_PER_S, "g", *(fixes[k] if runs else fixes[k].tolist())))
        each.update(TrueHeading(k * NS_PER_S, "c", wrapped(3.1 + (headings[k] if runs else float(headings[k])))))
        states.append(each.estimate)
    return each, states


def worst(states: list[FilterState]) -> float:
    """Largest R of a position, m^2, in the last minute."""
    return max(float(state.noise[name].variance) for state in states[-60:] for name in ("g.east", "g.north"))


@pytest.mark.parametrize("name", BOUNDED)
def test_a_wrong_imu_is_not_blamed_on_good_sensors(name: str) -> None:
    """No R is beyond its bound; the literal rule of the thesis goes on."""
    each, states = blamed(name)
    for state in states:
        for channel, noise in state.noise.items():
            assert noise.scatter is not None
            assert noise.variance <= bound(FACTS.channels[channel].initial_variance, noise.scatter)
            assert noise.scatter.jump == 0.0
    scatter = each.estimate.noise["g.east"].scatter
    assert scatter is not None
    assert 0.5 * R0 < float(scatter.variance) < 2.0 * R0
    _, literal = blamed("fuzzy-thesis")
    assert worst(literal) > 20.0 * 9.0 * R0
    assert abs(float(states[-1].x[0])) < 0.5 * abs(float(literal[-1].x[0]))


@pytest.mark.parametrize("name", ["ukf", "fuzzy-thesis"])
def test_a_rule_that_is_not_bounded_remembers_no_scatter(name: str) -> None:
    _, states = blamed(name, seconds=3)
    assert all(noise.scatter is None for noise in states[-1].noise.values())


@pytest.mark.parametrize("name", BOUNDED)
def test_a_batch_has_the_bounds_of_its_runs(name: str) -> None:
    """Three runs at once, and each of them alone with the same readings."""
    rng, runs, seconds = np.random.default_rng(7), 3, 40
    fixes = 2.0 * rng.normal(size=(seconds, 2, runs))
    x, P = START

    def carry(of: slice | int, start: tuple[Array, Array]) -> FilterState:
        each = build_filter(name, FACTS)
        each.start(*start)
        for k in range(seconds):
            each.predict(1.0, ImuInput(0.3, 0.0, 0.0))
            each.update(Position(k * NS_PER_S, "g", *fixes[k, :, of]))
        return each.estimate

    together = carry(slice(None), (np.stack([x] * runs), np.stack([P] * runs))).noise
    for run in range(runs):
        for channel, noise in carry(run, (x, P)).noise.items():
            many, alone = together[channel].scatter, noise.scatter
            assert many is not None
            assert alone is not None
            assert float(np.asarray(many.squares)[run]) == float(alone.squares)
            assert float(np.asarray(together[channel].variance)[run]) == pytest.approx(float(noise.variance), rel=1e-9)


@pytest.mark.parametrize("name", ["fuzzy", "imm"])
def test_the_memory_is_that_of_the_readings_though_the_opening_was_filtered_again(name: str) -> None:
    rng = np.random.default_rng(8)
    fixes = 9.0 * rng.normal(size=(60, 2))
    each = build_filter(name, FACTS)
    each.start(*START)
    for k, (east_m, north_m) in enumerate(fixes.tolist()):
        each.predict(1.0, None)
        each.update(Position(k * NS_PER_S, "g", east_m, north_m))
    for channel, column in (("g.east", 0), ("g.north", 1)):
        scatter, expected = each.estimate.noise[channel].scatter, fed(fixes[:, column])
        assert scatter is not None
        assert (scatter.squares, scatter.weight) == (expected.squares, expected.weight)
        assert scatter.readings == expected.readings


def test_a_rewind_gives_the_same_memory() -> None:
    """A fix and a heading that come 3 s late, against all in order: everything remembered is equal, bit for bit."""
    rng = np.random.default_rng(9)
    way: list[Measurement] = []
    for k in range(60):
        way.append(Position(k * NS_PER_S, "g", *(2.0 * rng.normal(size=2)).tolist()))
        way.append(TrueHeading(k * NS_PER_S, "c", 0.02 * rng.normal()))

    def last(order: list[Measurement]) -> FilterState:
        timeline = Timeline(Bank([build_filter("fuzzy", FACTS)], has_compass=True), None)
        for measured in order:
            timeline.push(Batch(max(measured.t_ns, NS_PER_S), "b", (measured,), ()))
        (state,) = timeline.at(way[-1].t_ns).states
        assert state is not None
        return state

    late = [*way[:100], *way[102:108], *way[100:102], *way[108:]]
    assert late != way
    assert last(late).noise == last(way).noise
    each = build_filter("fuzzy", FACTS)
    each.restore(last(way))
    kept = each.snapshot()
    each.predict(1.0, None)
    each.update(Position(61 * NS_PER_S, "g", 30.0, 0.0))
    once = each.snapshot()
    each.restore(kept)
    each.predict(1.0, None)
    each.update(Position(61 * NS_PER_S, "g", 30.0, 0.0))
    assert each.snapshot().noise == once.noise
    assert once.noise != kept.noise
