"""A car and a lake boat at the defaults: the filter stays with its fixes, and knows what it does not know.

Neither has a truth: the receiver's own fixes are compared with. The car's lag some tenths of a second behind its IMU,
undeclared, which is metres at 15 m/s.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from common.boat_config import BoatConfig
from common.simulation import without_ports
from common.simulation.readings import FixReading
from common.simulation.voyage import Voyage
from common.simulation.without_ports import START_NS
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.numbers import Array
from shore.pipeline import Pipeline
from tests.navigate.strangers import CAR, CAR_CONFIG, CATABOT, CATABOT_CONFIG, car, catabot
from tests.offline import frames_of, without_latency

pytestmark = pytest.mark.skipif(not (CAR.exists() and CATABOT.exists()), reason="no recordings in ../shared/data")


@dataclass(frozen=True)
class Followed:
    """Estimates beside the fixes (metres on one plane), from the filter's last start on."""

    t_s: Array
    distance_m: Array
    sigma_m: Array
    nis: float
    """Mean of both position channels; 1 expected, less for fixes that a receiver has smoothed."""


def followed(voyage: Voyage, config: BoatConfig, gaps: tuple[tuple[float, float], ...] = ()) -> Followed:
    """Through framer and pipeline; within `gaps` the filter gets no fix."""
    fixes = np.array(
        [
            (item.t_s, *voyage.plane.to_east_north_m(item.reading.lat_deg, item.reading.lon_deg))
            for item in voyage.readings
            if isinstance(item.reading, FixReading)
        ]
    )
    kept = tuple(
        item for item in voyage.readings if item.sensor != "gps1" or not any(a <= item.t_s < b for a, b in gaps)
    )
    pipeline = Pipeline(config, ["fuzzy"])
    estimates: list[Estimate] = []
    for frame in frames_of(without_latency(replace(voyage, readings=kept))):
        output = pipeline.push(frame)
        if any(each.code == "filter-started" for each in output.events):
            estimates.clear()
        estimates += output.estimates
    t_s = np.array([(each.t_ns - START_NS) / NS_PER_S for each in estimates])
    places = np.array([voyage.plane.to_east_north_m(each.lat_deg, each.lon_deg) for each in estimates])
    seen = np.stack([np.interp(t_s, fixes[:, 0], fixes[:, axis]) for axis in (1, 2)], axis=1)
    nis = [
        report.nis
        for each in estimates
        for name, report in each.channels.items()
        if name.startswith("gps1.") and not name.endswith(".course") and report.nis is not None
    ]
    sigma = np.array([math.hypot(each.sigma_east_m, each.sigma_north_m) for each in estimates])
    return Followed(t_s, np.hypot(*(places - seen).T), sigma, float(np.mean(nis)))


def in_gaps(voyage: Voyage, config: BoatConfig, gaps: tuple[tuple[float, float], ...]) -> float:
    """RMS distance at the ends of gaps over what the filter claims there."""
    found = followed(voyage, config, gaps)
    rows = [int(np.searchsorted(found.t_s, end - 0.05)) for _, end in gaps]
    print(found.distance_m[rows].round(1), found.sigma_m[rows].round(1))
    return float(np.sqrt(np.mean(found.distance_m[rows] ** 2) / np.mean(found.sigma_m[rows] ** 2)))


@pytest.fixture(autouse=True)
def no_latency(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(without_ports, "EPOCH_S", 0.0)


def later(voyage: Voyage, seconds: float) -> Voyage:
    """The same with fixes stamped earlier: the receiver's lag taken off."""
    readings = [replace(item, t_s=item.t_s - seconds) if item.sensor == "gps1" else item for item in voyage.readings]
    kept = sorted((item for item in readings if item.t_s >= 0.0), key=lambda item: item.t_s)
    return replace(voyage, readings=tuple(kept))


@pytest.mark.parametrize("lag_s", [0.0, 0.8])
def test_a_car_whose_imu_is_ten_degrees_off_level(lag_s: float) -> None:
    """The forward axis shows 1.7 m/s^2 at rest, eleven sigmas of the default. With the lag taken off, a leak bounded
    in c L instead of in L ran 68 m away from the fixes."""
    found = followed(later(car(), lag_s), CAR_CONFIG)
    print(
        f"rms {np.sqrt(np.mean(found.distance_m**2)):.2f} m, most {found.distance_m.max():.1f} m, NIS {found.nis:.2f}"
    )
    # fixes that wander are not followed: what is asked is that their distance is within the doubt
    assert np.sqrt(np.mean(found.distance_m**2)) <= 1.5 * np.sqrt(np.mean(found.sigma_m**2))
    assert found.distance_m.max() <= 15.0
    assert found.nis <= 1.4


@pytest.mark.slow
def test_a_car_without_gps() -> None:
    """The lag of the reference alone is up to 10 m: more than the sigma, so twice that is asked."""
    assert in_gaps(car(), CAR_CONFIG, ((30.0, 35.0), (45.0, 50.0), (60.0, 65.0), (75.0, 80.0))) <= 2.0


@pytest.mark.slow
def test_coarse_telemetry_of_a_lake_boat() -> None:
    found = followed(catabot(), CATABOT_CONFIG)
    print(
        f"rms {np.sqrt(np.mean(found.distance_m**2)):.2f} m, most {found.distance_m.max():.1f} m, NIS {found.nis:.2f}"
    )
    assert found.t_s[0] < 120.0
    assert np.sqrt(np.mean(found.distance_m**2)) <= 2.0
    assert found.distance_m.max() <= 10.0
    assert found.nis <= 1.4


@pytest.mark.slow
def test_a_lake_boat_without_gps_stays_within_its_doubt() -> None:
    gaps = tuple((start, start + 20.0) for start in np.arange(160.0, 1000.0, 80.0).tolist())
    assert in_gaps(catabot(), CATABOT_CONFIG, gaps) <= 1.25
