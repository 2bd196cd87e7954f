"""Recurrences by doubling: equal to the loop, and a shorter series is the start of a longer one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.simulation.recurrences import held, lagged, recur
from common.simulation.sensor_errors import Drift, drift_path, gauss_markov


@given(st.integers(0, 70), st.integers(0, 2**32 - 1))
def test_recur_is_the_loop(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    keep, driven = rng.choice((0.0, 0.3, 0.999, 1.0), max(count - 1, 0)), rng.standard_normal((count, 2))
    looped = driven.copy()
    for k in range(count - 1):
        looped[k + 1] += keep[k] * looped[k]
    np.testing.assert_allclose(recur(keep, driven), looped, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("drift", [gauss_markov(2.0, 7.0), Drift(0.3)])
def test_a_shorter_drift_is_the_start_of_a_longer_one_to_the_bit(drift: Drift) -> None:
    t_s, normals = np.arange(1000.0) * 0.37, np.random.default_rng(1).standard_normal((1000, 2))
    np.testing.assert_array_equal(drift_path(drift, t_s[:333], normals[:333]), drift_path(drift, t_s, normals)[:333])


def test_a_lag_approaches_a_step_as_it_should() -> None:
    seen = lagged(np.concatenate(([0.0], np.ones(200))), 0.05, 2.0)
    np.testing.assert_allclose(seen, 1.0 - np.exp(-0.05 * np.arange(201) / 2.0), atol=1e-12)
    np.testing.assert_array_equal(lagged(np.arange(3.0), 0.05, 0.0), np.arange(3.0))


def test_what_is_not_fresh_stays_as_it_was() -> None:
    assert held(np.arange(6.0), np.array([False, True, False, False, True, False])).tolist() == [0, 1, 1, 1, 4, 4]
