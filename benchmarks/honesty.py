"""How wrong the filters are on real boats, and how wrong they say they are: many boats of `real-*`, without ports.

    python -m benchmarks.honesty [WORLD ...] [--boats 20] [--filters fuzzy,ukf] [--seconds 600] [--gps-hz 1] [--json]

Every boat is a seed: another track, other sensors. Scored is each aligned estimate after the first 60 s, at its own
time. in95 = share of time in which the 95 % ellipse (2-D, from the covariance shown) holds the truth; e/s = RMS error
/ RMS sigma shown; raw = the fixes themselves, without latency. Figures are over all boats and times.
"""

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.geodesy import LocalPlane
from common.simulation.motion import Truth
from common.simulation.readings import FixReading
from common.simulation.scenarios import find_world
from common.simulation.scenarios_real import REAL_SCENARIOS
from common.simulation.voyage import Voyage, boat_voyage
from common.simulation.without_ports import START_NS, frames_of
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.navigation.motion_model import EAST, HEADING, NORTH, V_EAST, V_NORTH
from shore.pipeline import Pipeline

Array = npt.NDArray[np.float64]
CHI2_95_2D: Final = 5.991
"""95 % of a chi-squared variable with two degrees of freedom."""
SETTLED_S: Final = 60.0


def boat_of(gps_hz: float, *, has_imu: bool = True) -> BoatConfig:
    """Receiver, one compass of 5 Hz, and an inertial unit of 10 Hz; nothing stated of them."""
    imu = (SensorTable(id="imu1", port="a", role="imu", model="arduimu", rate_hz=10.0),) if has_imu else ()
    sensors = (
        SensorTable(id="gps1", port="a", role="gps", rate_hz=gps_hz, latency_ms=300.0),
        SensorTable(id="compass1", port="a", role="compass", rate_hz=5.0),
        *imu,
    )
    return BoatConfig(
        boat=BoatTable(id="bench", variation_deg=0.0), port=(PortTable(name="a", path="a"),), sensor=sensors
    )


@dataclass(frozen=True, slots=True)
class Sums:
    """Sums over the scored estimates of one filter on one boat; they add up over boats."""

    count: float = 0.0
    inside: float = 0.0
    """Number of estimates whose ellipse holds the truth."""
    position: float = 0.0
    """Squared horizontal error, m^2."""
    position_shown: float = 0.0
    velocity: float = 0.0
    velocity_shown: float = 0.0
    heading: float = 0.0
    """Squared error, deg^2."""
    heading_shown: float = 0.0
    raw: float = 0.0
    """Squared horizontal error of the fixes, m^2."""
    fixes: float = 0.0

    def __add__(self, other: "Sums") -> "Sums":
        return Sums(*(getattr(self, item.name) + getattr(other, item.name) for item in fields(Sums)))

    def figures(self) -> dict[str, float]:
        """RMS, share inside the ellipse, and error over own sigma."""
        count = max(self.count, 1.0)

        def to_sigma(square: float, shown: float) -> float:
            return math.sqrt(square / shown) if shown else math.nan

        return {
            "raw_m": math.sqrt(self.raw / max(self.fixes, 1.0)),
            "position_m": math.sqrt(self.position / count),
            "in95": self.inside / count,
            "position_e_s": to_sigma(self.position, self.position_shown),
            "velocity_m_s": math.sqrt(self.velocity / count),
            "velocity_e_s": to_sigma(self.velocity, self.velocity_shown),
            "heading_deg": math.sqrt(self.heading / count),
            "heading_e_s": to_sigma(self.heading, self.heading_shown),
        }


def sums_of(
    estimates: Sequence[Estimate],
    truth: Truth,
    plane: LocalPlane,
    raw: tuple[float, float],
    *,
    settled_s: float = SETTLED_S,
    start_ns: int = START_NS,
) -> Sums:
    """Score valid estimates of one filter on one boat; start_ns: boat time at the start of the truth's clock."""
    latest_s = float(truth.t_s[-1])
    kept = [item for item in estimates if settled_s <= (item.t_ns - start_ns) / NS_PER_S <= latest_s]
    if not kept:
        return Sums(raw=raw[0], fixes=raw[1])
    seen = truth.at(np.array([(item.t_ns - start_ns) / NS_PER_S for item in kept]))
    places = np.array([plane.to_east_north_m(item.lat_deg, item.lon_deg) for item in kept])
    offset = places - np.stack((seen.east_m, seen.north_m), axis=1)
    P = np.array([_covariance(item) for item in kept])
    states = np.array([item.state[:5] for item in kept])
    of_place = P[:, EAST : NORTH + 1, EAST : NORTH + 1]
    distance = np.einsum("ki,kij,kj->k", offset, np.linalg.inv(of_place), offset)
    d_velocity = states[:, V_EAST : V_NORTH + 1] - np.stack((seen.v_east_m_s, seen.v_north_m_s), axis=1)
    d_heading = np.degrees(np.remainder(states[:, HEADING] - seen.heading_rad + np.pi, 2.0 * np.pi) - np.pi)
    return Sums(
        count=float(len(kept)),
        inside=float(np.sum(distance <= CHI2_95_2D)),
        position=float(np.sum(offset**2)),
        position_shown=float(np.sum(P[:, EAST, EAST] + P[:, NORTH, NORTH])),
        velocity=float(np.sum(d_velocity**2)),
        velocity_shown=float(np.sum(P[:, V_EAST, V_EAST] + P[:, V_NORTH, V_NORTH])),
        heading=float(np.sum(d_heading**2)),
        heading_shown=float(np.sum(np.degrees(np.sqrt(P[:, HEADING, HEADING])) ** 2)),
        raw=raw[0],
        fixes=raw[1],
    )


def _covariance(item: Estimate) -> Array:
    """The part of P of the five states, (5, 5)."""
    n = len(item.names)
    whole = np.zeros((n, n))
    whole[np.triu_indices(n)] = item.covariance
    return (whole + whole.T - np.diag(whole.diagonal()))[:5, :5]


def _raw(voyage: Voyage) -> tuple[float, float]:
    """Sum of the squared errors of the fixes at their own time, m^2, and their number."""
    fixes = [(t.t_s, t.reading) for t in voyage.readings if isinstance(t.reading, FixReading) and t.reading.quality]
    if not fixes:
        return 0.0, 0.0
    seen = voyage.truth.at(np.array([t_s for t_s, _ in fixes]))
    places = np.array([voyage.plane.to_east_north_m(fix.lat_deg, fix.lon_deg) for _, fix in fixes])
    return float(np.sum((places - np.stack((seen.east_m, seen.north_m), axis=1)) ** 2)), float(len(fixes))


def one_boat(world: str, seed: int, filters: Sequence[str], gps_hz: float, seconds: float | None) -> dict[str, Sums]:
    """All filters on the boat of a seed."""
    config = boat_of(gps_hz)
    voyage = boat_voyage(find_world(world), config, seed, seconds)
    pipeline = Pipeline(config, list(filters))
    estimates = [item for frame in frames_of(voyage) for item in pipeline.push(frame).estimates]
    raw = _raw(voyage)
    return {
        name: sums_of(
            [item for item in estimates if item.filter == name and item.aligned], voyage.truth, voyage.plane, raw
        )
        for name in filters
    }


def _rows(arguments: argparse.Namespace) -> Iterator[tuple[str, str, dict[str, float]]]:
    filters = arguments.filters.split(",")
    seeds = range(arguments.first, arguments.first + arguments.boats)
    with ProcessPoolExecutor(arguments.workers) as pool:
        for world in arguments.worlds or [world.name for world in REAL_SCENARIOS]:
            jobs = [pool.submit(one_boat, world, seed, filters, arguments.gps_hz, arguments.seconds) for seed in seeds]
            found = [job.result() for job in jobs]
            for name in filters:
                total = Sums()
                for each in found:
                    total += each[name]
                yield world, name, total.figures()


def main() -> None:
    """Print a row for each world and filter."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("worlds", nargs="*", metavar="WORLD")
    parser.add_argument("--boats", type=int, default=20)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--filters", default="fuzzy")
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--gps-hz", type=float, default=1.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    rows: list[dict[str, Any]] = []
    arguments = parser.parse_args()
    for world, name, figures in _rows(arguments):
        rows.append({"world": world, "filter": name, **figures})
        if not arguments.json:
            if len(rows) == 1:
                print(f"{'world':<14}{'filter':<14}" + "".join(f"{key:>14}" for key in figures))
            print(f"{world:<14}{name:<14}" + "".join(f"{value:>14.3f}" for value in figures.values()), flush=True)
    if arguments.json:
        print(json.dumps(rows))


if __name__ == "__main__":
    main()
