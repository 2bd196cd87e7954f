"""The fuzzy rules: closed form against integration, windows, and what they do to R and to the estimate."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shore.navigation.noise.fuzzy import FUZZY, Memory
from shore.navigation.noise.fuzzy_thesis import FUZZY_THESIS, THESIS_SHAPE, fuzzy_alpha
from shore.navigation.noise.noise_rule import Channel, ChannelNoise, FixedNoise, NoiseRule
from shore.navigation.noise.outlier_guard import not_equal
from shore.navigation.numbers import Array
from tests.navigate.batches import GOOD, POOR, TABLE_5_3, Outcome, follow, noisy, ratios, told
from tests.navigate.voyages import Truth

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


def feed(
    rule: NoiseRule, channel: Channel, innovations: Iterable[float], priors: Iterable[float] | float = 0.0
) -> list[ChannelNoise]:
    innovations = list(innovations)
    priors = [priors] * len(innovations) if isinstance(priors, int | float) else list(priors)
    noise = ChannelNoise(channel.initial_variance)
    history = []
    for innovation, prior in zip(innovations, priors, strict=True):
        noise = rule.adapt(channel, noise, float(innovation), float(prior))
        history.append(noise)
    return history


def learned(noise: ChannelNoise) -> float:
    """R of the long window: without what a single sample does to its own update."""
    return float(noise.window[0])


def random_innovations(sigmas: Sequence[float], seed: int = 0) -> Array:
    return np.asarray(np.random.default_rng(seed).normal(size=len(sigmas)) * np.array(sigmas))


def test_the_thesis_rule_waits_for_a_full_window() -> None:
    history = feed(FUZZY_THESIS, Channel(1.0), [3.0] * 40)
    assert [noise.variance for noise in history[:29]] == [1.0] * 29
    assert history[28].dom_ratio is None
    assert history[29].dom_ratio == pytest.approx(9.0)
    assert history[29].variance == pytest.approx(5.0)


def test_degree_of_matching_uses_the_variance_of_before() -> None:
    history = feed(FUZZY_THESIS, Channel(1.0), [5.0] * 31, priors=1.0)
    assert history[30].dom_ratio == pytest.approx(25.0 / (1.0 + float(history[29].variance)))


@pytest.mark.parametrize("rate_hz", [0.1, 0.5, 1.0, 2.9, 3.0, 5.0, 10.0, 50.0])
def test_the_thesis_window_covers_twenty_seconds_at_any_rate(rate_hz: float) -> None:
    entry = FUZZY_THESIS.samples_per_entry(rate_hz)
    assert FUZZY_THESIS.window * entry / rate_hz >= 20.0


def test_fast_channels_of_the_thesis_rule_average_into_entries() -> None:
    """10 Hz: seven squares make one entry."""
    history = feed(FUZZY_THESIS, Channel(1.0, 10.0), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    assert [len(noise.window) for noise in history] == [0] * 6 + [1]
    assert history[6].window[-1] == pytest.approx(20.0)


def test_fixed_noise_stays() -> None:
    assert feed(FixedNoise(), Channel(4.0), [100.0])[-1] == ChannelNoise(4.0)


def test_table_5_3() -> None:
    assert (THESIS_SHAPE.ep1, THESIS_SHAPE.ep2, THESIS_SHAPE.largest) == (EP1, EP2, LARGEST)
    assert (THESIS_SHAPE.al_ep1, THESIS_SHAPE.al_ep2, THESIS_SHAPE.al_largest) == (AL1, AL2, AL_LARGEST)


def test_our_rule_moves_from_the_first_sample() -> None:
    """Three samples that say R0 = 2, faded once, and one of weight 2 / (2 + 1) that says 16 - 1."""
    first = feed(FUZZY, Channel(2.0), [4.0], priors=1.0)[0]
    assert first.variance == pytest.approx((2.95 * 2.0 + 2.0 / 3.0 * 15.0) / (2.95 + 2.0 / 3.0))
    assert first.dom_ratio == pytest.approx(16.0 / 3.0)


def test_a_healthy_sensor_hardly_ever_leaves_equal_and_its_variance_scatters_little() -> None:
    history = feed(FUZZY, Channel(9.0), random_innovations([3.0] * 20_000))[200:]
    dom_ratios = np.array([float(noise.dom_ratio or 0.0) for noise in history])
    assert np.mean(not_equal(dom_ratios, 2.0 * FUZZY.short - 1.0) > 0.0) < 0.02
    variances = np.array([learned(noise) for noise in history])
    assert variances.mean() == pytest.approx(9.0, rel=0.03)
    assert variances.std() / 9.0 < 0.16  # a plain mean of 120 squares: 0.13


@pytest.mark.parametrize("rate_hz", [0.1, 1.0, 10.0, 20.0])
@pytest.mark.parametrize("rule", [FUZZY, FUZZY_THESIS])
def test_adaptation_finds_the_real_variance(rule: NoiseRule, rate_hz: float) -> None:
    """A filter that knows its state well (prior variance 10 % of R): mean over the second half within 15 %."""
    count = round(4000 * max(1.0, rate_hz / 3.0))
    history = feed(rule, Channel(1.0, rate_hz), random_innovations([math.sqrt(27.5)] * count), priors=2.5)
    assert np.mean([noise.variance for noise in history[count // 2 :]]) == pytest.approx(25.0, rel=0.15)


def test_a_stale_long_window_gives_way_to_the_short_one() -> None:
    """Fifty samples say R = 1; the last six and the newest show 104 = prior variance 4 + R 100."""
    memory = Memory(1.0, 50.0, 50.0, 6.0, 6.0 * 104.0, 6.0 * 4.0)
    noise = FUZZY.adapt(Channel(1.0), ChannelNoise(1.0, memory), math.sqrt(104.0), 4.0)
    assert not_equal(float(noise.dom_ratio or 0.0), 6.0) == 1.0
    assert learned(noise) == pytest.approx(100.0)


def after_a_change(before: float, after: float) -> Array:
    """Median over 200 seeds of the R used, as a part of the true one, for 60 samples from the change on."""
    used = []
    for seed in range(200):
        innovations = random_innovations([before] * 100 + [after] * 60, seed)
        history = feed(FUZZY, Channel(0.64), innovations)
        used.append([float(noise.variance) for noise in history[100:]])
    return np.asarray(np.median(used, axis=0)) / after**2


def test_more_noise_is_seen_within_ten_samples() -> None:
    """0.8 -> 5 deg; 0.04 of the truth is what was known before."""
    found = after_a_change(0.8, 5.0)
    assert found[1] > 0.1
    assert found[8] > 0.4
    assert 0.7 < found[20] < 1.1


def test_less_noise_is_seen_within_forty_samples() -> None:
    """5 -> 0.8 deg: too much doubt for a while, no harm."""
    found = after_a_change(5.0, 0.8)
    assert found[20] < 10.0
    assert found[40] < 2.5


def test_a_single_jump_counts_only_for_itself() -> None:
    """500 m of a GPS with 8 m: not believed, and soon forgotten."""
    innovations = random_innovations([8.0] * 140)
    innovations[100] = 500.0
    history = feed(FUZZY, Channel(64.0), innovations)
    assert float(history[100].variance) > 0.9 * 500.0**2
    assert max(float(noise.variance) for noise in history[101:]) < 10.0 * 64.0
    assert learned(history[-1]) < 2.0 * 64.0


def test_what_comes_after_a_silence_says_nothing_about_the_noise() -> None:
    """Sigma of the state 1 km for three samples: their innovations are its error, not the sensor's."""
    priors = [5.0] * 100 + [1e6] * 3 + [5.0] * 20
    history = feed(FUZZY, Channel(64.0), random_innovations(np.sqrt(np.array(priors) + 64.0).tolist()), priors)
    after = np.array([learned(noise) for noise in history[100:]])
    assert np.all((after > 32.0) & (after < 128.0))


@pytest.mark.parametrize(("rate_hz", "seconds"), [(0.1, 600.0), (1.0, 60.0), (3.0, 20.0), (10.0, 20.0), (20.0, 20.0)])
def test_the_long_window_fades_over_sixty_samples_and_at_least_twenty_seconds(rate_hz: float, seconds: float) -> None:
    """The weight of a sample falls to 1 / e after `seconds`: two histories that differ in one sample only."""
    count = round(seconds * rate_hz)
    plain = feed(FUZZY, Channel(1.0, rate_hz), [1.0] * 40 * (count + 1))
    other = feed(FUZZY, Channel(1.0, rate_hz), [1.0] * 39 * (count + 1) + [1.2] + [1.0] * count)
    at_once = float(other[39 * (count + 1)].window[2]) - float(plain[39 * (count + 1)].window[2])
    later = float(other[-1].window[2]) - float(plain[-1].window[2])
    assert later / at_once == pytest.approx(math.exp(-1.0), rel=0.06)


@pytest.mark.parametrize(("rule", "floor"), [(FUZZY, 0.25), (FUZZY_THESIS, 1e-3)])
def test_limits(rule: NoiseRule, floor: float) -> None:
    assert feed(rule, Channel(4.0), [0.0] * 400)[-1].variance == pytest.approx(4.0 * floor)
    assert feed(rule, Channel(4.0), [1e9] * 200)[-1].variance == pytest.approx(4.0 * 1e4)


any_size = st.floats(-300.0, 300.0).map(lambda power: 10.0**power) | st.sampled_from([0.0, math.inf])


@given(st.lists(st.tuples(any_size, any_size.filter(math.isfinite)), max_size=30), st.sampled_from([0.1, 1.0, 20.0]))
def test_whatever_is_measured_the_variance_stays_within_its_limits(
    samples: list[tuple[float, float]], rate_hz: float
) -> None:
    channel = Channel(4.0, rate_hz)
    for noise in feed(FUZZY, channel, [a for a, _ in samples], [b for _, b in samples]):
        assert 0.25 * 4.0 <= float(noise.variance) <= 1e4 * 4.0
        assert 0.25 * 4.0 <= learned(noise) <= 1e4 * 4.0


@pytest.mark.parametrize("rule", [FUZZY, FUZZY_THESIS])
@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
def test_floats_and_arrays_give_the_same(rule: NoiseRule, rate_hz: float) -> None:
    """Runs with jumps of the noise, wild samples and silences, 3,000 samples."""
    rng = np.random.default_rng(3)
    sigmas = np.repeat(rng.choice([0.3, 1.0, 7.0], size=(30, 4)), 100, axis=0)
    wild = np.where(rng.random((3000, 4)) < 0.01, 100.0, 1.0)
    innovations = rng.normal(size=(3000, 4)) * sigmas * wild
    priors = np.where(rng.random((3000, 4)) < 0.01, 1e4, 0.1)
    channel = Channel(1.0, rate_hz)
    noise = ChannelNoise(1.0)
    together = []
    for innovation, prior in zip(innovations, priors, strict=True):
        noise = rule.adapt(channel, noise, innovation, prior)
        together.append(np.broadcast_to(noise.variance, 4))
    for run in range(4):
        alone = np.array([noise.variance for noise in feed(rule, channel, innovations[:, run], priors[:, run])])
        np.testing.assert_allclose(np.array(together)[:, run], alone, rtol=1e-9)


SCENARIOS = {"5.1": [GOOD] * 600, "5.2": [POOR] * 600, "5.3": [GOOD] * 301 + [POOR] * 299}


@pytest.fixture(scope="module")
def paired(mission: Truth) -> Callable[[str, str], Outcome]:
    """Scenario and filter (or "oracle") -> 100 runs, the same for all filters."""

    @cache
    def outcome(scenario: str, name: str) -> Outcome:
        batch = noisy(mission, 100, SCENARIOS[scenario], np.ones(600))
        return follow("ukf", batch, None) if name == "oracle" else follow(name, batch, told(TABLE_5_3))

    return outcome


@pytest.mark.parametrize(
    ("name", "scenario", "most"),
    [
        ("fuzzy", "5.1", (1.05, 1.05, 1.05)),
        ("fuzzy", "5.2", (1.06, 1.06, 1.08)),
        ("fuzzy", "5.3", (1.08, 1.08, 1.08)),
        pytest.param("fuzzy-thesis", "5.1", (1.08, 1.08, 1.08), marks=pytest.mark.slow),
        pytest.param("fuzzy-thesis", "5.2", (1.6, 1.6, 2.8), marks=pytest.mark.slow),
        pytest.param("fuzzy-thesis", "5.3", (1.15, 1.15, 1.15), marks=pytest.mark.slow),
    ],
)
def test_squared_error_against_the_filter_that_knows_the_noise(
    paired: Callable[[str, str], Outcome], name: str, scenario: str, most: tuple[float, float, float]
) -> None:
    """East, north, heading; attained by `fuzzy`: at most 1.04 each."""
    assert np.all(ratios(paired(scenario, name), paired(scenario, "oracle")) <= most)


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_our_rule_does_not_claim_more_than_it_knows(paired: Callable[[str, str], Outcome], scenario: str) -> None:
    assert 4.5 < paired(scenario, "fuzzy").nees.mean() < 6.0


@pytest.mark.parametrize("scenario", ["5.2", pytest.param("5.3", marks=pytest.mark.slow)])
def test_the_fixed_filter_is_three_times_worse_in_heading(paired: Callable[[str, str], Outcome], scenario: str) -> None:
    """Above 4.4 in a voyage of 600 s."""
    assert ratios(paired(scenario, "ukf"), paired(scenario, "fuzzy"))[2] >= 3.5
    assert paired(scenario, "ukf").nees.mean() > 20.0
