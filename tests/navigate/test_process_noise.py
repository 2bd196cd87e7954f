"""The fuzzy rule on Q and R: what raises the drive, what does not, and what it is worth."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from shore.navigation.noise.noise_rule import Channel, ChannelNoise
from shore.navigation.noise.process_noise import FUZZY_QR
from shore.navigation.numbers import Array
from tests.navigate.batches import GOOD, TABLE_5_3, Batch, Outcome, follow, noisy, ratios, told
from tests.navigate.voyages import sail

RIGHT = (8.0, 7.0, 0.8)
RUNS = 60


@pytest.mark.parametrize(
    ("deviations", "drive", "step"),
    [
        (-9.0, 1.0, 0.0),
        (2.0, 1.0, 0.0),
        (3.5, 1.0, 0.05 * 0.5 * FUZZY_QR.rise),
        (5.0, 1.0, 0.05 * FUZZY_QR.rise),
        (50.0, 4.0, 0.05 * FUZZY_QR.rise),
        (0.0, 4.0, -0.05 * FUZZY_QR.fall * math.log(4.0)),
    ],
)
def test_the_two_rules(deviations: float, drive: float, step: float) -> None:
    assert FUZZY_QR.step(deviations, 0.05, drive) == pytest.approx(step)


def test_one_step_is_limited() -> None:
    assert FUZZY_QR.step(9.0, 0.9, 1.0) == FUZZY_QR.largest_step


def drives_of(innovations: Array, prior: float) -> Array:
    """Drive (k, runs) of innovations (k, runs) under a constant prior variance, R0 = 1."""
    noise = ChannelNoise(np.ones(innovations.shape[1]))
    history = []
    for each in innovations:
        noise = FUZZY_QR.adapt(Channel(1.0), noise, each, np.full(innovations.shape[1], prior))
        history.append(noise.drive)
    return np.array(history)


@pytest.mark.parametrize("factor", [0.7, 1.0, 5.0])
def test_white_innovations_raise_it_little_whatever_their_size(factor: float) -> None:
    """Geometric mean over 1000 samples of 200 channels; in a filter less, where a drive makes innovations alternate."""
    white = np.random.default_rng(0).normal(size=(1000, 200)) * math.sqrt(1.05) * factor
    assert np.exp(np.log(drives_of(white, 0.05)).mean()) < 1.45


def test_innovations_that_keep_their_sign_raise_it() -> None:
    """A mean square as expected, but a third of it stays for 30 samples."""
    rng = np.random.default_rng(0)
    slow = np.zeros((400, 200))
    for k in range(1, 400):
        slow[k] = slow[k - 1] * math.exp(-1 / 30) + rng.normal(size=200) * math.sqrt(0.35 * (1.0 - math.exp(-2 / 30)))
    drives = drives_of(slow + rng.normal(size=(400, 200)) * math.sqrt(0.7), 0.05)
    assert np.median(drives[-1]) > 3.0


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.floats(0.0, 1e6))
def test_any_innovations(innovations: list[float], prior: float) -> None:
    noise = ChannelNoise(4.0)
    for each in innovations:
        noise = FUZZY_QR.adapt(Channel(4.0), noise, each, prior)
        assert isinstance(noise.drive, float)
        assert 1.0 <= noise.drive <= FUZZY_QR.most
        assert math.isfinite(noise.variance)
        assert noise.variance > 0.0


@pytest.fixture(scope="module")
def loud() -> Batch:
    """R right; the IMU five times as noisy from step 250 to 450."""
    steps = np.arange(711)
    return noisy(sail(711), RUNS, [RIGHT] * 711, np.where((steps >= 250) & (steps < 450), 5.0, 1.0))


@pytest.fixture(scope="module")
def outcome(loud: Batch) -> Callable[[str], Outcome]:
    """Filter -> the runs of `loud`."""
    return cache(lambda name: follow("ukf", loud, None) if name == "oracle" else follow(name, loud, told(RIGHT)))


def test_the_drive_rises_with_the_noise_of_the_imu_and_falls_back(outcome: Callable[[str], Outcome]) -> None:
    """The filter takes the larger of the two that see the accelerometers."""
    drive = outcome("fuzzy-qr").drive
    both = np.column_stack((drive[:, :2].max(axis=1), drive[:, 2]))
    assert np.all(both[200:250].mean(axis=0) < 1.3)
    assert np.all(both[370:450].mean(axis=0) > 2.0)
    assert np.all(both[-20:].mean(axis=0) < 1.7)


def test_it_is_worth_it_while_the_imu_is_noisy(outcome: Callable[[str], Outcome]) -> None:
    """The ratios to an oracle that knows the noise of the IMU, paired, from the change on to the end of the noise."""
    span = slice(250, 450)
    fixed, ours, oracle = (outcome(name).squares[:, span].mean(axis=(0, 1)) for name in ("ukf", "fuzzy-qr", "oracle"))
    assert np.all(fixed / oracle >= 1.8)
    assert np.all(ours / oracle <= 1.7)


def test_it_costs_little_where_only_r_is_uncertain() -> None:
    batch = noisy(sail(711), RUNS, [GOOD] * 711, np.ones(711))
    assert np.all(ratios(follow("fuzzy-qr", batch, told(TABLE_5_3)), follow("fuzzy", batch, told(TABLE_5_3))) <= 1.10)
