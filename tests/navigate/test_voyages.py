"""Whole voyages in this process: scenario 5.3 over paired seeds, and a real recording with and without its IMU."""

from pathlib import Path

import numpy as np
import pytest

from common.simulation.recording import recording_voyage
from common.simulation.scenarios import scenario_voyage
from tests.offline import errors_of

BLUEBOAT = Path(__file__).parents[3] / "shared" / "data" / "blueboat-usv" / "fixed_00000235.csv"
BLUEBOAT_MAP = Path(__file__).parents[2] / "deploy" / "examples" / "blueboat-map.toml"

pytestmark = pytest.mark.slow


def upper_95(ratio_of: np.ndarray, count: int = 2000) -> float:
    """Upper end of the bootstrap 95 % interval of sqrt(sum a / sum b) over pairs (a, b)."""
    rng = np.random.default_rng(1)
    picks = rng.integers(0, len(ratio_of), (count, len(ratio_of)))
    sums = ratio_of[picks].sum(axis=1)
    return float(np.quantile(np.sqrt(sums[:, 0] / sums[:, 1]), 0.975))


def test_scenario_53_over_fifty_paired_seeds() -> None:
    position, heading = [], []
    for seed in range(50):
        errors = errors_of(scenario_voyage("5.3", seed=seed), ["fuzzy", "ukf"])
        fuzzy, ukf = errors["fuzzy"], errors["ukf"]
        position.append((fuzzy.rms_m() ** 2, ukf.rms_m() ** 2))
        heading.append((fuzzy.rms_deg(0.75) ** 2, ukf.rms_deg(0.75) ** 2))
    assert upper_95(np.array(heading)) <= 0.5
    assert upper_95(np.array(position)) <= 1.0


def test_a_real_boat_gains_from_gyro_and_sideways_accelerometer() -> None:
    if not BLUEBOAT.exists():
        pytest.skip("the recordings of ../shared/data are not here")
    ratios = []
    for seed in range(20):
        voyage = recording_voyage(BLUEBOAT, BLUEBOAT_MAP, seed=seed)
        with_imu = errors_of(voyage, ["fuzzy"])["fuzzy"].rms_m()
        without = errors_of(voyage, ["fuzzy"], use=())["fuzzy"].rms_m()
        ratios.append(with_imu / without)
    assert float(np.median(ratios)) <= 1.0, sorted(ratios)
