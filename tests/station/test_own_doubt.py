"""The doubt that a filter stated live, held against the smoothed track."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from common.geodesy import LocalPlane
from common.simulation.scenarios import scenario_voyage
from shore.navigation.estimate import Estimate
from shore.pipeline import Pipeline
from shore.report.own_doubt import LEAST_COUNT, OwnDoubt, verdict
from tests.offline import frames_of

PLANE = LocalPlane(50.0, -4.0)


@pytest.fixture(scope="module")
def estimate() -> Estimate:
    voyage = scenario_voyage("5.1", seed=3, seconds=30.0)
    pipeline = Pipeline(voyage.config, ["fuzzy"])
    return [each for frame in frames_of(voyage) for each in pipeline.push(frame).estimates][-1]


def track(estimate: Estimate, off: np.ndarray, turned_deg: np.ndarray, **changes: Any) -> OwnDoubt:
    """A boat that goes north at 2 m/s; off (n, 3): of what was live, east and north (m) and heading (deg).

    What was stated is 1 m, 1 m without correlation, and 1 deg.
    """
    doubt, n = OwnDoubt("fuzzy"), len(estimate.names)
    P = np.diag([1.0, 1.0, *[0.01] * (n - 2)])
    for k, (east, north, heading) in enumerate(off):
        t_ns, truth = k * 100_000_000, float(turned_deg[k]) % 360.0
        lat_deg, lon_deg = PLANE.to_lat_lon_deg(0.0, 0.2 * k)
        smoothed = replace(
            estimate, t_ns=t_ns, lat_deg=lat_deg, lon_deg=lon_deg, heading_true_deg=truth, state=(0.0, 0.0, 0.0, 2.0)
        )
        lat_deg, lon_deg = PLANE.to_lat_lon_deg(east, 0.2 * k + north)
        live = replace(
            smoothed,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            covariance=tuple(P[np.triu_indices(n)].tolist()),
            heading_true_deg=(truth + heading) % 360.0,
            sigma_heading_deg=1.0,
            aligned=True,
        )
        doubt.take(replace(live, **changes).as_record())
        doubt.take(replace(live, filter="ukf", lat_deg=0.0).as_record())
        doubt.compare(smoothed)
    return doubt


def test_errors_of_one_sigma_lie_inside_95_percent_and_the_verdict_says_so(estimate: Estimate) -> None:
    errors = np.random.default_rng(1).normal(size=(2000, 3))
    straight = track(estimate, errors, np.zeros(2000)).summary()
    assert set(straight) == {"straight ahead"}
    assert straight["straight ahead"]["place"] == pytest.approx(0.95, abs=0.02)
    assert straight["straight ahead"]["heading"] == pytest.approx(0.95, abs=0.02)
    assert "is right" in verdict(straight)


def test_a_doubt_that_is_too_small_in_turns_is_named_by_part_and_state(estimate: Estimate) -> None:
    errors = np.random.default_rng(1).normal(size=(400, 3)) * (1.0, 1.0, 5.0)
    turning = track(estimate, errors, 350.0 + np.arange(400.0)).summary()
    assert set(turning) == {"turning"}
    words = verdict(turning)
    assert "too small" in words
    assert "heading" in words
    assert "turning" in words
    assert "place" not in words


def test_without_fixes_is_a_state_of_its_own_and_few_estimates_say_nothing(estimate: Estimate) -> None:
    errors = np.zeros((LEAST_COUNT + 1, 3))
    assert set(track(estimate, errors, np.zeros(99), position_from="coasting").summary()) == {"without fixes"}
    assert track(estimate, errors[:20], np.zeros(20)).summary() == {}
    assert "too few" in verdict({})
    assert track(estimate, errors, np.zeros(99), aligned=False).summary() == {}
    assert track(estimate, errors, np.zeros(99), heading_true_deg=None).summary() == {}
