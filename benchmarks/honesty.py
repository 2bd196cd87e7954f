"""How wrong the filters are on real boats, and how wrong they say they are: many boats of `real-*`, without ports.

    python -m benchmarks.honesty [WORLD ...] [--boats 20] [--filters fuzzy,ukf] [--seconds 600] [--gps-hz 1] [--json]

Every boat is a seed: another track, other sensors. Scored is each aligned estimate after the first 60 s, at its own
time. in95 = share of time in which the 95 % ellipse (2-D, from the covariance shown) holds the truth; e/s = RMS error
/ RMS sigma shown; raw = the fixes themselves, without latency. Figures are over all boats and times.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from benchmarks.scoring import Sums, sums_of
from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.simulation.readings import FixReading
from common.simulation.scenarios import find_world
from common.simulation.scenarios_real import REAL_SCENARIOS
from common.simulation.voyage import Voyage, boat_voyage
from common.simulation.without_ports import frames_of
from shore.pipeline import Pipeline


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
