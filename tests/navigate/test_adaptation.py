"""The fuzzy rule: closed form against integration, windows, and what it does to R and to the estimate."""

import math
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shore.navigation.adaptation import (
    FUZZY,
    FUZZY_THESIS,
    THESIS_SHAPE,
    Channel,
    ChannelNoise,
    FixedNoise,
    FuzzyNoise,
    NoiseRule,
    fuzzy_alpha,
)
from shore.navigation.numbers import Array
from tests.navigate.voyages import Run, Truth, errors, run_filter

Runs = tuple[Array, Array, Array]
Piece = tuple[Callable[[Array], Any], float, float]

EP1, EP2, LARGEST, AL1, AL2, AL_LARGEST = 0.25, 0.15, 7.0, 0.2, 0.08, 5.0


def small_in(d: float) -> float:
    return max(0.0, 1.0 - d / (1.0 - EP2))


def equal_in(d: float) -> float:
    return float(np.interp(d, [1 - EP1, 1 - EP2, 1 + EP2, 1 + EP1], [0.0, 1.0, 1.0, 0.0]))


def large_in(d: float) -> float:
    return float(np.interp(d, [1 + EP2, LARGEST], [0.0, 1.0]))


def small_out(a: Array) -> Array:
    return 1.0 - a / (1.0 - AL2)


def equal_out(a: Array) -> Array:
    return np.asarray(np.interp(a, [1 - AL1, 1 - AL2, 1 + AL2, 1 + AL1], [0.0, 1.0, 1.0, 0.0]))


def large_out(a: Array) -> Array:
    return np.asarray(np.interp(a, [1 + AL2, AL_LARGEST], [0.0, 1.0]))


def integrate(pieces: list[Piece]) -> float:
    """Centroid of pieces (function, from, to) by the midpoint rule."""
    area = moment = 0.0
    for shape, low, high in pieces:
        a = low + (high - low) * (np.arange(20_000) + 0.5) / 20_000
        heights = shape(a) * np.ones_like(a)
        area += heights.sum() * (high - low) / 20_000
        moment += (heights * a).sum() * (high - low) / 20_000
    return moment / area


def alpha_by_integration(d: float) -> float:
    """The five cases, straight from Eqs 5.19-5.23."""
    if d < 1 - EP1:
        return (small_in(d) - 1.0) * (AL2 - 1.0)
    if d < 1 - EP2:
        height = equal_in(d)
        at_equal, at_small = 1 - AL1 + (AL1 - AL2) * height, (1 - AL2) * (1 - small_in(d))
        return integrate(
            [(equal_out, 1 - AL1, at_equal), (lambda a: height, at_equal, at_small), (small_out, at_small, 1 - AL2)]
        )
    if d <= 1 + EP2:
        return 1.0
    at_large = 1 + AL2 + (AL_LARGEST - 1 - AL2) * large_in(d)
    if d > 1 + EP1:
        return at_large
    height = equal_in(d)
    at_equal = 1 + AL1 - (AL1 - AL2) * height
    return integrate(
        [(large_out, 1 + AL2, at_large), (lambda a: height, at_large, at_equal), (equal_out, at_equal, 1 + AL1)]
    )


@given(st.floats(0.0, 12.0))
def test_closed_form_is_the_integral(dom_ratio: float) -> None:
    assert fuzzy_alpha(dom_ratio) == pytest.approx(alpha_by_integration(dom_ratio), rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("dom_ratio", [0.7501, 0.77, 0.8, 0.83, 0.8499, 1.1501, 1.17, 1.2, 1.22, 1.24, 1.2499])
def test_closed_form_in_the_narrow_cases_two_and_four(dom_ratio: float) -> None:
    assert fuzzy_alpha(dom_ratio) == pytest.approx(alpha_by_integration(dom_ratio), rel=1e-6)


@pytest.mark.parametrize(
    ("dom_ratio", "alpha"),
    [(0.0, 0.0), (0.5, 0.541), (0.85, 1.0), (1.0, 1.0), (1.15, 1.0), (7.0, 5.0), (1e9, 5.0)],
)
def test_the_plain_cases(dom_ratio: float, alpha: float) -> None:
    assert fuzzy_alpha(dom_ratio) == pytest.approx(alpha, abs=5e-4)


@pytest.mark.parametrize(
    ("at", "below", "above"), [(0.75, 0.812, 0.848), (0.85, 0.88, 1.0), (1.15, 1.0, 1.12), (1.25, 1.125, 1.147)]
)
def test_the_known_steps_of_the_literal_rule(at: float, below: float, above: float) -> None:
    """Study section 2: the thesis' case limits make alpha jump."""
    assert fuzzy_alpha(at - 1e-9) == pytest.approx(below, abs=5e-4)
    assert fuzzy_alpha(at + 1e-9) == pytest.approx(above, abs=5e-4)


def test_alpha_falls_just_below_1_25() -> None:
    values = [fuzzy_alpha(d) for d in np.linspace(1.1501, 1.249999, 1000)]
    assert max(values) == pytest.approx(1.164, abs=5e-4)
    assert values[-1] == pytest.approx(1.125, abs=5e-4)


def feed(rule: NoiseRule, channel: Channel, innovations: Iterable[float], prior: float = 0.0) -> list[ChannelNoise]:
    noise = ChannelNoise(channel.initial_variance)
    history = []
    for innovation in innovations:
        noise = rule.adapt(channel, noise, float(innovation), prior)
        history.append(noise)
    return history


def test_the_thesis_rule_waits_for_a_full_window() -> None:
    history = feed(FUZZY_THESIS, Channel(1.0), [3.0] * 40)
    assert [noise.variance for noise in history[:29]] == [1.0] * 29
    assert history[28].dom_ratio is None
    assert history[29].dom_ratio == pytest.approx(9.0)
    assert history[29].variance == pytest.approx(5.0)


def test_our_rule_moves_from_the_first_step() -> None:
    """Three entries of C_T = 1 and one 25: DoM 7."""
    history = feed(FUZZY, Channel(1.0), [5.0])
    assert history[0].dom_ratio == pytest.approx(7.0)
    assert history[0].variance == pytest.approx(5.0)


def test_degree_of_matching_uses_the_variance_of_before() -> None:
    history = feed(FUZZY, Channel(1.0), [5.0, 5.0], prior=1.0)
    window = history[1].window
    assert history[1].dom_ratio == pytest.approx(sum(window) / len(window) / (1.0 + history[0].variance))


@pytest.mark.parametrize(("rule", "floor"), [(FUZZY, 0.5), (FUZZY_THESIS, 1e-3)])
def test_limits(rule: FuzzyNoise, floor: float) -> None:
    assert feed(rule, Channel(4.0), [0.0] * 200)[-1].variance == pytest.approx(4.0 * floor)
    assert feed(rule, Channel(4.0), [1e9] * 200)[-1].variance == pytest.approx(4.0 * 1e4)


def test_fixed_noise_stays() -> None:
    assert feed(FixedNoise(), Channel(4.0), [100.0])[-1] == ChannelNoise(4.0)


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 2.9, 3.0, 5.0, 10.0, 50.0])
@pytest.mark.parametrize("rule", [FUZZY, FUZZY_THESIS])
def test_windows_cover_twenty_seconds_at_any_rate(rule: FuzzyNoise, rate_hz: float) -> None:
    entry = rule.samples_per_entry(rate_hz)
    assert rule.window * entry / rate_hz >= 20.0
    if rule is FUZZY and rate_hz <= 3.0:
        assert entry == 1


def test_fast_channels_average_into_entries() -> None:
    """10 Hz: four squares make one entry, and R moves once for them."""
    history = feed(FUZZY, Channel(1.0, 10.0), [1.0, 2.0, 3.0, 4.0])
    assert [len(noise.window) for noise in history] == [0, 0, 0, 4]
    assert history[3].window[-1] == pytest.approx(7.5)


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_adaptation_finds_the_real_variance(rate_hz: float) -> None:
    """A filter that knows its state well (prior variance 10 % of R): mean over 20 seeds within 20 % of the truth."""
    found = {}
    for name, rule in (("fuzzy", FUZZY), ("fuzzy-thesis", FUZZY_THESIS)):
        finals = []
        for seed in range(20):
            rng = np.random.default_rng(seed)
            innovations = rng.normal(size=round(300 * rate_hz)) * math.sqrt(25.0 + 2.5)
            history = feed(rule, Channel(1.0, rate_hz), innovations, prior=2.5)
            finals.append(np.mean([noise.variance for noise in history[len(history) // 2 :]]))
        found[name] = np.mean(finals)
    assert found["fuzzy"] == pytest.approx(25.0, rel=0.2)
    assert found["fuzzy-thesis"] == pytest.approx(25.0, rel=0.2)


def test_table_5_3() -> None:
    assert (THESIS_SHAPE.ep1, THESIS_SHAPE.ep2, THESIS_SHAPE.largest) == (EP1, EP2, LARGEST)
    assert (THESIS_SHAPE.al_ep1, THESIS_SHAPE.al_ep2, THESIS_SHAPE.al_largest) == (AL1, AL2, AL_LARGEST)


@pytest.fixture(scope="module")
def paired(mission: Truth, scenario_53: Callable[[int], Run]) -> Callable[[str], Runs]:
    """Filter -> errors (50 seeds, k, 5), NEES (50, k), final sigmas (50, 3) in scenario 5.3; same data for all."""

    @cache
    def runs_of(name: str) -> Runs:
        all_errors, scores, sigmas = [], [], []
        for seed in range(50):
            states, spreads, each = run_filter(name, mission, scenario_53(seed), seed)
            error = errors(states, mission)
            all_errors.append(error)
            scores.append(np.einsum("ki,kij,kj->k", error, np.linalg.inv(spreads), error))
            sigmas.append([math.sqrt(noise.variance) for noise in each.estimate.noise.values()])
        return np.array(all_errors), np.array(scores), np.array(sigmas)

    return runs_of


def bootstrap_upper(ours: Array, fixed: Array, quantile: float = 0.975) -> float:
    """Of mean(ours) / mean(fixed), pairs drawn together."""
    rows = np.random.default_rng(0).integers(0, len(ours), (2000, len(ours)))
    return float(np.quantile(ours[rows].mean(axis=1) / fixed[rows].mean(axis=1), quantile))


def heading_rms(runs: Runs) -> Array:
    """Of each seed, over the last quarter."""
    return np.asarray(np.sqrt(np.mean(runs[0][:, 450:, 4] ** 2, axis=1)))


@pytest.mark.parametrize("name", ["fuzzy", pytest.param("fuzzy-thesis", marks=pytest.mark.slow)])
def test_scenario_5_3_heading_is_twice_as_good_as_the_fixed_filter(paired: Callable[[str], Runs], name: str) -> None:
    """Ratio of the mean RMS over 50 paired seeds (0.44): the upper end of its 95 % bootstrap interval."""
    ours, fixed = heading_rms(paired(name)), heading_rms(paired("ukf"))
    assert bootstrap_upper(ours, fixed) <= 0.5


def test_scenario_5_3_finds_the_new_noise(paired: Callable[[str], Runs]) -> None:
    sigmas = np.median(paired("fuzzy")[2], axis=0)
    assert sigmas[:2] == pytest.approx([20.0, 20.0], rel=0.15)
    assert math.degrees(sigmas[2]) == pytest.approx(5.0, rel=0.15)


def test_scenario_5_3_consistency(paired: Callable[[str], Runs]) -> None:
    """ANEES (5 expected): the fixed filter is far too sure of itself, ours is near (study section 6: 5.6)."""
    assert paired("ukf")[1].mean() > 20.0
    assert 4.5 < paired("fuzzy")[1].mean() < 6.5


@pytest.mark.slow
def test_scenario_5_3_consistency_of_the_literal_rule(paired: Callable[[str], Runs]) -> None:
    assert 4.5 < paired("fuzzy-thesis")[1].mean() < 7.0
