"""Simulated boats beside real ones: the same figures (statistics of errors) of scenarios `real-*` and of recordings.

    python -m benchmarks.real_boats [--boats 20] [--data ../shared/data] [--out FILE]

Prints the table of docs/simulation.md: for each figure the value of each recording that has it, and of the simulated
boats the median and the middle 80 %. Without the recordings it says so, and their column stays empty.
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import boat_figures as figures
from benchmarks.boat_figures import Boat, Body, Track
from benchmarks.recorded_boats import recorded_boats
from common.boat_config import SensorTable
from common.simulation.motion import Array, Truth
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from common.simulation.real_gps import RTK
from common.simulation.scenarios_real import REAL_SCENARIOS, RealScenario
from common.simulation.sensor_models import Draws

DATA = Path(__file__).parents[2] / "shared" / "data"
GPS = SensorTable(id="gps1", port="gps", role="gps", rate_hz=5.0)
COMPASS = SensorTable(id="compass1", port="compass", role="compass", rate_hz=5.0)
IMU = SensorTable(id="imu1", port="imu", role="imu", rate_hz=10.0)


@dataclass(frozen=True)
class Row:
    """One figure, the recordings that have it, and the worlds that it is compared with."""

    text: str
    figure: Callable[[Boat], float]
    recordings: tuple[str, ...]
    worlds: tuple[str, ...]
    digits: int = 2


LAGS_S = (1, 10, 30, 60, 300)
MOORED = ("moored receivers",)
BLUEBOAT = ("BlueBoat",)
TILTED = ("catabot", "milliAmpere")
ALL_SEAS = ("lake", "harbour", "coast")


def _correlations(
    text: str, figure: Callable[..., float], recordings: tuple[str, ...], worlds: tuple[str, ...]
) -> list[Row]:
    return [Row(f"{text}, {lag_s} s", partial(figure, lag_s=lag_s), recordings, worlds) for lag_s in LAGS_S]


ROWS = (
    Row("GPS, 1-sigma on an axis about the mean of 570 s, m", figures.wander_m, MOORED, ("lake", "harbour")),
    *_correlations("its autocorrelation", figures.wander_correlation, MOORED, ("lake", "harbour")),
    *_correlations("the same about the truth", figures.error_correlation, (), ("lake", "10ms")),
    Row("SOG, COG - differentiated RTK, m/s an axis", figures.told_velocity, ("ocean-rtk", "milliAmpere"), ("rtk",), 3),
    Row("SOG, COG - truth, m/s an axis", figures.true_velocity, (), ("lake", "coast", "6ms", "10ms"), 3),
    Row("velocity about its mean of 5 s, m/s an axis", figures.seaway_m_s, ("ocean-rtk",), ("rtk", "lake"), 3),
    Row("heading about its mean of 5 s, deg", figures.seaway_deg, ("ocean-rtk",), ("rtk", "lake")),
    Row(
        "course over ground about the heading on legs, deg",
        figures.drift_angle_deg,
        ("ocean-rtk", "sailing", "catabot"),
        ("lake", "coast", "rtk"),
        1,
    ),
    Row("compass, RMS error, deg", figures.compass_error_deg, (), ("lake", "coast", "6ms"), 1),
    Row(
        "gravity in turns: starboard accelerometer on u r", figures.gravity_in_turns, BLUEBOAT, ("lake", "6ms", "10ms")
    ),
    Row("gravity of trim: forward on u abs(u), 1/m", figures.gravity_of_trim, BLUEBOAT, ("lake", "rtk", "6ms")),
    Row("starboard accelerometer less motion, m/s^2", figures.unexplained_m_s2, BLUEBOAT, ("lake", "6ms", "coast")),
    Row("outward slide v = -k u r: k, s", figures.outward_slide_s, BLUEBOAT, ("lake", "6ms", "10ms")),
    Row("roll about its mean of 10 s, deg", partial(figures.tilt_deg, axis=0), TILTED, ALL_SEAS),
    Row("pitch about its mean of 10 s, deg", partial(figures.tilt_deg, axis=1), TILTED, ALL_SEAS),
    Row("roll, peak of the spectrum, Hz", partial(figures.tilt_hz, axis=0), ("milliAmpere",), ("lake", "coast")),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; exit code 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--boats", type=int, default=20)
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args(arguments)
    recordings = {}
    if options.data.is_dir():
        recordings = recorded_boats(options.data)
    else:
        sys.stderr.write(f"{options.data} is not there: the column of the recordings stays empty\n")
    table = "\n".join(lines(recordings, options.boats)) + "\n"
    sys.stdout.write(table)
    if options.out is not None:
        options.out.write_text(table, encoding="utf-8")
    return 0


def lines(recordings: dict[str, list[Boat]], count: int) -> Iterator[str]:
    """The table in Markdown."""
    worlds = {scenario.name.removeprefix("real-"): scenario for scenario in REAL_SCENARIOS}
    simulated = {name: [simulated_boat(world, seed) for seed in range(1, count + 1)] for name, world in worlds.items()}
    yield "| figure | recorded | simulated: median [middle 80 %] |"
    yield "|---|---|---|"
    for row in ROWS:
        left = [
            f"{name} {', '.join(_number(row.figure(boat), row.digits) for boat in recordings.get(name, ()))}"
            for name in row.recordings
        ]
        right = [f"{name} {_spread(map(row.figure, simulated[name]), row.digits)}" for name in row.worlds]
        yield f"| {row.text} | {'; '.join(left)} | {'; '.join(right)} |"


def _spread(values: Iterable[float], digits: int) -> str:
    low, middle, high = (_number(value, digits) for value in np.nanpercentile(list(values), (10, 50, 90)))
    return f"{middle} [{low}, {high}]"


def _number(value: float, digits: int) -> str:
    return "-" if np.isnan(value) else f"{value:.{digits}f}"


def simulated_boat(world: RealScenario, seed: int) -> Boat:
    """All columns of one simulated boat: fixes and headings at 5 Hz, inertial samples at 10 Hz."""
    truth, draws = world.truth(seed), world.draws(seed)
    rows = [(timed.t_s, timed.reading) for timed in world.readings(truth, GPS, draws)]
    fixes = [(t_s, fix) for t_s, fix in rows if isinstance(fix, FixReading) and fix.v_east_m_s is not None]
    seen = truth.at(np.array([t_s for t_s, _ in fixes]))
    place_m = np.array([world.plane.to_east_north_m(fix.lat_deg, fix.lon_deg) for _, fix in fixes])
    velocity = np.array([(fix.v_east_m_s, fix.v_north_m_s) for _, fix in fixes], dtype=np.float64)
    # The recordings of RTK boats are fixed throughout.
    usual = np.array([fix.quality == 4 or world.reception is not RTK for _, fix in fixes])
    assert truth.roll_rad is not None
    assert truth.pitch_rad is not None
    shown_m = np.where(usual[:, np.newaxis], place_m, np.nan)
    return Boat(
        Track(seen.t_s, shown_m, velocity, seen.heading_rad),
        place_m - np.stack((seen.east_m, seen.north_m), axis=1),
        velocity - np.stack((seen.v_east_m_s, seen.v_north_m_s), axis=1),
        _compass_error(world, truth, draws),
        _body(world, truth, draws),
        np.stack((truth.roll_rad, truth.pitch_rad), axis=1),
    )


def _compass_error(world: RealScenario, truth: Truth, draws: Draws) -> Array:
    rows = list(world.readings(truth, COMPASS, draws))
    seen = truth.at(np.array([timed.t_s for timed in rows]))
    shown = [timed.reading.heading_true_deg for timed in rows if isinstance(timed.reading, HeadingReading)]
    error: Array = np.angle(np.exp(1j * (np.radians(shown) - seen.heading_rad)))
    return error


def _body(world: RealScenario, truth: Truth, draws: Draws) -> Body:
    """True velocities, measured rate and accelerations."""
    rows = list(world.readings(truth, IMU, draws))
    seen = truth.at(np.array([timed.t_s for timed in rows]))
    samples = [timed.reading for timed in rows if isinstance(timed.reading, ImuReading)]
    sin, cos = np.sin(seen.heading_rad), np.cos(seen.heading_rad)
    return Body(
        sin * seen.v_east_m_s + cos * seen.v_north_m_s,
        cos * seen.v_east_m_s - sin * seen.v_north_m_s,
        np.radians([sample.yaw_rate_deg_s for sample in samples]),
        np.array([sample.accel_fwd_m_s2 for sample in samples]),
        np.array([sample.accel_stb_m_s2 for sample in samples]),
    )


if __name__ == "__main__":
    sys.exit(main())
