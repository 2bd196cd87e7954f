"""Whole voyages in this process: scenario 5.3 over paired seeds (real recordings: `test_recordings.py`)."""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from common.simulation.scenarios import scenario_voyage
from tests.offline import errors_of

pytestmark = pytest.mark.slow


def last_quarter(seed: int) -> tuple[float, float, float]:
    """Mean squares in the last quarter: fuzzy heading, heading of a UKF that knows the late noise, the fixed UKF's."""
    voyage = scenario_voyage("5.3", seed=seed)
    errors = errors_of(voyage, ["fuzzy", "ukf"])
    knowing = replace(voyage, facts=replace(voyage.facts, sigma_m=20.0, sigma_deg=5.0))
    oracle = errors_of(knowing, ["ukf"])["ukf"]
    return tuple(item.rms_deg(0.75) ** 2 for item in (errors["fuzzy"], oracle, errors["ukf"]))  # type: ignore[return-value]


def interval(pairs: np.ndarray, count: int = 2000) -> tuple[float, float]:
    """Bootstrap 95 % interval of sqrt(sum a / sum b) over paired rows (a, b)."""
    rng = np.random.default_rng(1)
    picks = rng.integers(0, len(pairs), (count, len(pairs)))
    sums = pairs[picks].sum(axis=1)
    low, high = np.quantile(np.sqrt(sums[:, 0] / sums[:, 1]), (0.025, 0.975))
    return float(low), float(high)


def test_in_scenario_53_fuzzy_ends_as_good_as_a_filter_that_knows_the_noise() -> None:
    with ProcessPoolExecutor(2) as pool:
        squares = np.array(list(pool.map(last_quarter, range(50))))
    to_oracle, to_fixed = interval(squares[:, [0, 1]]), interval(squares[:, [0, 2]])
    print(f"fuzzy / oracle {to_oracle}, fuzzy / fixed {to_fixed}")
    assert to_oracle[1] <= 1.10, to_oracle
    # The optimum is 0.445 (docs/decisions.md): on a draw of fifty seeds even that has an interval beyond 0.5.
    assert to_fixed[1] <= 0.6, to_fixed
