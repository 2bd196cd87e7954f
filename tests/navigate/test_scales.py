"""The bank over scales of R: its mixture, its transitions, what it finds, and how near it comes to the oracle."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shore.navigation.kalman import update_scalar
from shore.navigation.noise.noise_rule import Channel, ChannelNoise
from shore.navigation.noise.scale_bank import SCALE_BANK, ScaleBank, _tables
from shore.navigation.numbers import Array
from shore.navigation.state_space import FIVE, NORTH, Gaussian
from tests.navigate.batches import GOOD, POOR, TABLE_5_3, follow, noisy, ratios, told
from tests.navigate.voyages import sail

CHANNEL = Channel(49.0)
COUNT = len(SCALE_BANK.scales())


def random_gaussian(seed: int) -> Gaussian:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 5)) * rng.uniform(0.5, 5.0, size=5)
    return Gaussian(FIVE, np.append(rng.normal(size=4), 0.1), root @ root.T + 0.1 * np.eye(5))


def mixture(before: Gaussian, innovation: float, prior: Array) -> tuple[Array, Array, Array]:
    """Weights, mean and covariance of one Kalman update a hypothesis, mixed by the book."""
    p = before.P[NORTH, NORTH]
    weights, means, spreads = [], [], []
    for weight, scale in zip(prior, SCALE_BANK.scales(), strict=True):
        R = scale * CHANNEL.initial_variance
        K = before.P[:, NORTH] / (p + R)
        weights.append(weight * math.exp(-0.5 * innovation**2 / (p + R)) / math.sqrt(2.0 * math.pi * (p + R)))
        means.append(before.x + K * innovation)
        spreads.append(before.P - np.outer(K, before.P[NORTH]))
    normalised = np.array(weights) / sum(weights)
    mean = normalised @ np.array(means)
    apart = np.array(means) - mean
    covariance = np.einsum("j,jab->ab", normalised, np.array(spreads) + apart[:, :, None] * apart[:, None, :])
    return normalised, mean, covariance


@pytest.mark.parametrize("innovation", [0.0, -3.0, 20.0, 60.0])
def test_the_update_is_that_of_the_mixture(innovation: float) -> None:
    before = random_gaussian(1)
    noise = ChannelNoise(49.0)
    for _ in range(2):
        prior = _tables(SCALE_BANK, 1.0)[1] @ np.array(noise.weights) if noise.weights else np.full(COUNT, 1.0 / COUNT)
        noise = SCALE_BANK.adapt(CHANNEL, noise, innovation, float(before.P[NORTH, NORTH]))
        weights, mean, covariance = mixture(before, innovation, prior)
        x, P = update_scalar(before, ((NORTH, 1.0),), innovation, noise.variance, noise.spread)
        assert np.allclose(np.asarray(noise.weights), weights, rtol=1e-9, atol=1e-15)
        assert np.allclose(x, mean, rtol=1e-9, atol=1e-9)
        assert np.allclose(P, covariance, rtol=1e-9, atol=1e-9)
        before = Gaussian(FIVE, x, P)


def test_scales() -> None:
    scales = SCALE_BANK.scales()
    assert (scales[0], scales[4], scales[-1]) == (0.25, 1.0, 256.0)
    assert np.allclose(scales[1:] / scales[:-1], math.sqrt(2.0))


@pytest.mark.parametrize("rate_hz", [1e-3, 0.2, 1.0, 10.0, 100.0])
def test_transitions_are_probabilities(rate_hz: float) -> None:
    transitions = _tables(SCALE_BANK, rate_hz)[1]
    assert np.all(transitions > 0.0)
    assert np.allclose(transitions.sum(axis=0), 1.0)
    assert np.all(transitions.diagonal() > 0.8)


def test_a_second_of_ten_transitions_is_about_one_transition_of_a_second() -> None:
    ten = np.linalg.matrix_power(_tables(SCALE_BANK, 10.0)[1], 10)
    assert np.allclose(ten, _tables(SCALE_BANK, 1.0)[1], atol=1e-4)


def test_two_scales_by_hand() -> None:
    """R0 or 2 R0, near 0.02 a second: the neighbour of an end is the other end, and half of it stays."""
    transitions = _tables(ScaleBank(0, 1, 1, 0.02, 0.0), 1.0)[1]
    assert np.allclose(transitions, [[0.99, 0.01], [0.01, 0.99]])


def feed(innovations: Array, prior: float = 5.0) -> list[ChannelNoise]:
    noise = ChannelNoise(49.0)
    history = []
    for innovation in innovations.tolist():
        noise = SCALE_BANK.adapt(CHANNEL, noise, innovation, prior)
        history.append(noise)
    return history


@pytest.mark.parametrize("scale", [0.5, 1.0, 8.0, 100.0])
def test_it_finds_a_constant_noise(scale: float) -> None:
    """Mean of log R over the last 200 of 400 samples, 20 seeds: within 15 %."""
    logs = []
    for seed in range(20):
        sigma = math.sqrt(49.0 * scale + 5.0)
        history = feed(np.random.default_rng(seed).normal(size=400) * sigma)
        logs.append(np.mean([math.log(float(noise.variance)) for noise in history[200:]]))
    assert math.exp(np.mean(logs)) == pytest.approx(49.0 * scale, rel=0.15)


def test_it_sees_a_hundredfold_noise_within_ten_samples() -> None:
    """Median of 20 seeds before the change, ten samples after it, ten samples after its end, and 60 after."""
    found = []
    for seed in range(20):
        sigmas = np.repeat([7.0, 70.0, 7.0], [200, 200, 100])
        history = feed(np.random.default_rng(seed).normal(size=500) * sigmas)
        found.append([float(history[k].variance) / 49.0 for k in (199, 210, 410, 460)])
    before, risen, falling, fallen = np.median(found, axis=0)
    assert before == pytest.approx(1.0, rel=0.3)
    assert risen == pytest.approx(100.0, rel=0.5)
    assert falling < 10.0
    assert fallen == pytest.approx(1.0, rel=0.3)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40), st.floats(0.0, 1e12))
def test_any_innovations(innovations: list[float], prior: float) -> None:
    for noise in feed(np.array(innovations), prior):
        assert isinstance(noise.variance, float)
        assert 0.25 * 49.0 * (1.0 - 1e-9) <= noise.variance <= 256.0 * 49.0 * (1.0 + 1e-9)
        assert isinstance(noise.spread, float)
        assert math.isfinite(noise.spread)
        assert noise.spread >= 0.0
        assert np.asarray(noise.weights).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("change", [0, 300, 711], ids=["5.2", "5.3", "5.1"])
def test_near_the_oracle_in_all_of_chapter_5(change: int) -> None:
    """One setting. Over 200 runs it is 1.01-1.02, 1.00-1.01, 1.02-1.05 with an ANEES of 5.2; here 60 runs."""
    sigmas = [GOOD if k < change else POOR for k in range(711)]
    batch = noisy(sail(711), 60, sigmas, np.ones(711))
    ours, oracle = follow("imm", batch, told(TABLE_5_3)), follow("ukf", batch, None)
    assert np.all(ratios(ours, oracle) <= 1.08)
    assert 4.5 < ours.nees.mean() < 6.0
