"""A real recording through a filter, with many draws of the noise of its fixes side by side.

The same readings and facts as through framer and pipeline, but no frames and no latency: what is scored is the state
after each row of the recording.
"""

import math
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from common.boat_config import IMU_AXES, BoatConfig
from common.simulation.column_recording import recording_voyages
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.simulation.voyage import Voyage
from common.units import NS_PER_S
from shore.navigation.filter_registry import build_filter
from shore.navigation.filters import Filter
from shore.navigation.imu_track import driving_sensor
from shore.navigation.initial_state import first_state
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.motion_model import ImuInput
from shore.navigation.numbers import Array
from shore.navigation.sensor_facts import facts_of

TRUSTING: dict[str, Any] = {
    "bias_accel_sigma_m_s2": 0.0,
    "bias_yaw_rate_sigma_deg_s": 0.0,
    "tilt_leak_sigma_per_m": 0.0,
}
"""Facts of an IMU that is taken at its word: the five states of the thesis."""


@dataclass(frozen=True)
class Draws:
    """One recording with its fixes drawn several times."""

    voyage: Voyage
    fixes: Array
    """(fixes, 2, draws): east, north, m."""


@dataclass(frozen=True)
class Played:
    """What a filter made of it; the first axis is the row of the recording."""

    t_s: Array
    squares: Array
    """Squared horizontal error (rows, draws), m^2."""
    claimed: Array
    """Its variance as the filter has it."""
    nis: Array
    """(fixes, draws): mean of both axes of a fix; 1 expected."""

    @property
    def rms_m(self) -> float:
        """Median over the draws of the RMS error."""
        return float(np.median(np.sqrt(self.squares.mean(axis=0))))

    @property
    def to_sigma(self) -> float:
        """RMS error over its own sigma."""
        return math.sqrt(self.squares.mean() / self.claimed.mean())


def drawn(file: Path, map_file: Path, draws: int) -> Draws:
    voyages = recording_voyages(file, map_file, range(draws))
    plane = voyages[0].plane
    fixes = [
        [
            plane.to_east_north_m(r.reading.lat_deg, r.reading.lon_deg)
            for r in v.readings
            if isinstance(r.reading, FixReading)
        ]
        for v in voyages
    ]
    return Draws(voyages[0], np.moveaxis(np.array(fixes), 0, -1))


def with_imu(config: BoatConfig, **facts: Any) -> BoatConfig:
    sensors = tuple(replace(item, **facts) if item.role == "imu" else item for item in config.sensor)
    return replace(config, sensor=sensors)


def play(draws: Draws, name: str = "fuzzy", **imu: Any) -> Played:
    """Run a filter over all draws at once; `imu` replaces facts of the IMU (`use=()` = it goes without)."""
    config = with_imu(draws.voyage.config, **imu)
    each = build_filter(
        name, facts_of(config).plain
    )  # a batch: what a real boat's filter does beside it is for one boat
    driver = driving_sensor(config)
    count = draws.fixes.shape[-1]
    fixes = iter(draws.fixes)
    truth = draws.voyage.truth
    heading: TrueHeading | None = None
    shown: ImuInput | None = None
    t_last_s: float | None = None
    t_s, squares, claimed, nis = [], [], [], []
    for now_s, group in groupby(draws.voyage.readings, key=lambda timed: timed.t_s):
        readings = sorted((timed.reading for timed in group), key=lambda reading: not isinstance(reading, ImuReading))
        t_ns = round(now_s * NS_PER_S)
        for reading in readings:
            if isinstance(reading, ImuReading):
                shown = _input(reading, driver.use) if driver else None
                if t_last_s is not None and now_s > t_last_s:
                    each.predict(now_s - t_last_s, shown)
                    t_last_s = now_s
            elif isinstance(reading, HeadingReading):
                heading = TrueHeading(t_ns, "compass1", np.full(count, math.radians(reading.heading_true_deg)))
                if t_last_s is not None:
                    each.update(heading)
            else:
                position = Position(t_ns, "gps1", *next(fixes))
                if t_last_s is not None:
                    each.update(position)
                    nis.append(_nis(each))
                elif heading is not None:
                    _start(each, position, heading, shown)
                    t_last_s = now_s
        if t_last_s is not None:
            place = [np.interp(now_s, truth.t_s, column) for column in (truth.east_m, truth.north_m)]
            t_s.append(now_s)
            squares.append(((each.estimate.x[:, :2] - place) ** 2).sum(axis=1))
            claimed.append(each.estimate.P[:, 0, 0] + each.estimate.P[:, 1, 1])
    return Played(np.array(t_s), np.array(squares), np.array(claimed), np.array(nis))


def _input(reading: ImuReading, used: tuple[str, ...]) -> ImuInput:
    values = (reading.accel_fwd_m_s2, reading.accel_stb_m_s2, math.radians(reading.yaw_rate_deg_s))
    return ImuInput(*(value if axis in used else 0.0 for axis, value in zip(IMU_AXES, values, strict=True)))


def _start(each: Filter, position: Position, heading: TrueHeading, shown: ImuInput | None) -> None:
    columns = np.broadcast_arrays(position.east_m, position.north_m, heading.heading_rad)
    starts = [
        first_state(0, Position(0, "gps1", east_m, north_m), TrueHeading(0, "compass1", angle), each.facts, shown)
        for east_m, north_m, angle in np.stack(columns, axis=1).tolist()
    ]
    each.start(np.stack([x for x, _, _ in starts]), np.stack([P for _, P, _ in starts]), starts[0][2])


def _nis(each: Filter) -> Array:
    noise = each.estimate.noise
    east, north = noise["gps1.east"].nis, noise["gps1.north"].nis
    assert east is not None
    assert north is not None
    return np.asarray(0.5 * (east + north))
