"""Consistency (NEES, NIS) on errors whose distribution is known."""

import numpy as np
import pytest

from shore.lab.consistency import ConsistencySums, nees


def test_nees_is_five_for_errors_of_the_claimed_covariance() -> None:
    rng = np.random.default_rng(5)
    half = rng.normal(size=(8, 8)) + 3.0 * np.eye(8)
    P = half @ half.T * 1e-3
    truth = np.array([1.0, 2.0, 3.0, 4.0, 3.1])
    x = np.zeros((20_000, 8))
    x[:, :5] = truth
    x += rng.multivariate_normal(np.zeros(8), P, size=len(x))
    x[:, 4] = np.angle(np.exp(1j * x[:, 4]))
    found = nees(x, np.tile(P, (len(x), 1, 1)), truth)
    assert found.mean() == pytest.approx(5.0, abs=0.1)
    assert found.var() == pytest.approx(10.0, abs=0.7)


def test_means_are_taken_over_the_steps_of_each_run() -> None:
    sums = ConsistencySums(2)
    truth = np.zeros(5)
    for east in (1.0, 3.0):
        sums.add_state(np.array([[east, 0.0, 0.0, 0.0, 0.0], np.zeros(5)]), np.tile(4.0 * np.eye(5), (2, 1, 1)), truth)
    assert sums.mean_nees == pytest.approx([(0.25 + 2.25) / 2.0, 0.0])


def test_nis_is_of_three_measured_numbers_whatever_was_measured() -> None:
    """Five scalars of a step and a half."""
    sums = ConsistencySums(2)
    assert np.all(np.isnan(sums.mean_nis))
    for nis in ((1.0, 0.0), (1.0, 0.0), (1.0, 0.0), (2.0, 5.0), (0.0, 0.0)):
        sums.add_innovation(np.array(nis))
    assert sums.mean_nis == pytest.approx([3.0, 3.0])
