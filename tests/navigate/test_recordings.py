"""A real small boat whose forward accelerometer sees its own bow rise: with its IMU, without it, and trusting it.

All at the defaults of a boat's file (docs/filters.md); 1 Hz fixes with 1.5 m of noise per axis, no latency.
"""

import math
import statistics
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.boat_config import SensorTable
from common.simulation import without_ports
from common.simulation.column_recording import recording_voyages
from shore.navigation import own_ship
from shore.navigation.sensor_facts import facts_of
from tests.navigate.played import TRUSTING, Draws, Played, drawn, play
from tests.offline import errors_of, without_latency
from tests.recordings import BLUEBOAT, BLUEBOAT_MAP

SPIN = "228"
"""A spin on the spot: hardly any speed, so hardly any leak, and trust is right."""
RUNS = ("216", "218", "220", "224", "225", SPIN, "232", "235")
DEFAULTS = SensorTable(id="imu1", port="p", role="imu")

pytestmark = pytest.mark.skipif(not BLUEBOAT.exists(), reason="the recordings of ../shared/data are not here")


def file_of(run: str) -> Path:
    return BLUEBOAT / f"fixed_00000{run}.csv"


def of_run(run: str, draws: int) -> tuple[Played, Played, Played]:
    """With the IMU, without it, trusting it."""
    recording = drawn(file_of(run), BLUEBOAT_MAP, draws)
    with_imu, without = play(recording), play(recording, use=())
    trusting = play(recording, **TRUSTING)
    print(
        f"{run}: {with_imu.rms_m:.3f} m, without {without.rms_m:.3f} m, trusting {trusting.rms_m:.3f} m; "
        f"NIS {with_imu.nis.mean():.2f}, error / own sigma {with_imu.to_sigma:.2f}"
    )
    return with_imu, without, trusting


def check(run: str, draws: int) -> None:
    with_imu, without, trusting = of_run(run, draws)
    assert with_imu.rms_m <= 0.90 * without.rms_m
    assert with_imu.rms_m <= 1.6
    assert with_imu.rms_m <= (1.15 if run == SPIN else 1.0) * trusting.rms_m
    assert 0.7 <= with_imu.nis.mean() <= 1.4
    assert 0.8 <= with_imu.to_sigma <= 1.2


@pytest.mark.parametrize("run", ["216", SPIN])
def test_a_boat_gains_from_its_imu(run: str) -> None:
    check(run, 20)


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_a_boat_gains_from_its_imu_in_forty_draws(run: str) -> None:
    check(run, 40)


@cache
def two_runs() -> tuple[Draws, ...]:
    return tuple(drawn(file_of(run), BLUEBOAT_MAP, 10) for run in ("216", "225"))


@cache
def rms_m(**facts: Any) -> float:
    """Of both, summed."""
    return math.fsum(play(recording, **facts).rms_m for recording in two_runs())


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 1.5])
@pytest.mark.parametrize(
    "name",
    ["accel_density", "gyro_density_deg", "bias_accel_sigma_m_s2", "bias_accel_walk_m_s2", "tilt_leak_sigma_per_m"],
)
def test_no_default_is_tuned_to_these_runs(name: str, factor: float) -> None:
    """Half as much again or half of it: the mean of two runs grows by a tenth at most."""
    default, other = rms_m(), rms_m(**{name: factor * getattr(DEFAULTS, name)})
    print(f"{name} x {factor}: {other / default:.3f}")
    assert other <= 1.10 * default


@pytest.mark.slow
def test_framer_and_pipeline_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its estimates are for the end of a frame, 0.1 s after the row that is scored here."""
    monkeypatch.setattr(without_ports, "EPOCH_S", 0.0)
    monkeypatch.setattr(own_ship, "facts_of", lambda config: facts_of(config).plain)
    batch = np.sqrt(play(drawn(file_of(SPIN), BLUEBOAT_MAP, 4)).squares.mean(axis=0))
    voyages = recording_voyages(file_of(SPIN), BLUEBOAT_MAP, range(4))
    whole = [errors_of(without_latency(voyage), ["fuzzy"])["fuzzy"].rms_m() for voyage in voyages]
    assert whole == pytest.approx(batch, rel=0.05)


@pytest.mark.slow
def test_the_gain_outlives_the_latency_of_a_real_receiver() -> None:
    voyages = recording_voyages(file_of("232"), BLUEBOAT_MAP, range(6))
    with_imu, without = (
        statistics.median(errors_of(voyage, ["fuzzy"], **facts)["fuzzy"].rms_m() for voyage in voyages)
        for facts in ({}, {"use": ()})
    )
    print(f"{with_imu:.2f} m, without IMU {without:.2f} m")
    assert with_imu <= 0.8 * without
