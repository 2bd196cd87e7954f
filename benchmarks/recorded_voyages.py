"""Recordings as voyages for a Monte Carlo bench: ocean RTK, BlueBoat and ferry, with declared noise and IMU faults.

A voyage holds readings and the truth behind them. Each recording has its own noise for a seed, and its worlds (without
velocity, without IMU, with a fault) share it. The place and velocity of the truth of an RTK track are those of a
parabola fitted to its neighbours: 5 epochs at 5 Hz (+-0.4 s), 21 at 20 Hz (+-0.5 s).
"""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.boat_figures import Array, Track
from benchmarks.recorded_boats import ferry_track, nmea_track
from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.geodesy import LocalPlane
from common.simulation.column_recording import recording_voyages
from common.simulation.faults import with_faults
from common.simulation.motion import Truth
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Timed
from common.simulation.voyage import Voyage

OCEAN_SIGMA_M: Final = 3.0
FERRY_SIGMA_M: Final = 0.01
BLUEBOAT_VELOCITY_M_S: Final = 0.15
"""1-sigma on an axis of the velocity that is put beside the fixes of a BlueBoat."""
BLUEBOAT_MAP: Final = Path(__file__).parents[1] / "deploy" / "examples" / "blueboat-map.toml"
PLANE: Final = LocalPlane(22.5, 114.5)
"""Plane on which RTK tracks are laid: a `Track` keeps metres only."""
STUCK_FROM: Final = 0.4
"""Share of the voyage after which a stuck unit repeats itself."""


def ocean_voyage(path: Path, seed: int, hdop: float | None, *, with_velocity: bool) -> Voyage:
    """Fixes at 1 Hz with 3 m of white noise on an axis; the receiver's own SOG and COG, and its own heading at 5 Hz."""
    track = _loaded(path)
    noise = np.random.default_rng([seed, int(path.stem)]).standard_normal((len(track.t_s), 2)) * OCEAN_SIGMA_M
    fix = FixReading(0.0, 0.0, hdop=hdop, minute_decimals=7)
    return _rtk_voyage(path.stem, track, noise, OCEAN_SIGMA_M, fix, half=2, with_velocity=with_velocity)


def ferry_voyage(folder: Path, seed: int, noise_m: float) -> Voyage:
    """Fixes at 1 Hz of an RTK receiver (quality 4) with white noise added; its own SOG and heading, no IMU."""
    track = _loaded(folder)
    noise = np.random.default_rng([seed, 2]).standard_normal((len(track.t_s), 2)) * noise_m
    fix = FixReading(0.0, 0.0, quality=4, hdop=0.8, satellites=14, minute_decimals=7)
    return _rtk_voyage(folder.name, track, noise, SensorTable(id="g", port="a", role="gps").sigma_m, fix, half=10)


def blueboat_voyage(file: Path, seed: int, hdop: float | None) -> Voyage:
    """Fixes at 1 Hz with 1.5 m and velocity with 0.15 m/s of white noise on an axis; its own IMU and compass."""
    own_seed = 1000 * int(file.stem.removeprefix("fixed_")) + seed
    (voyage,) = recording_voyages(file, BLUEBOAT_MAP, (own_seed,))
    draw = np.random.default_rng([own_seed, 3])

    def with_velocity(timed: Timed) -> Timed:
        if not isinstance(timed.reading, FixReading):
            return timed
        seen = voyage.truth.at(np.array([timed.t_s]))
        east, north = draw.standard_normal(2) * BLUEBOAT_VELOCITY_M_S
        v_east, v_north = float(seen.v_east_m_s[0] + east), float(seen.v_north_m_s[0] + north)
        return replace(timed, reading=replace(timed.reading, v_east_m_s=v_east, v_north_m_s=v_north, hdop=hdop))

    sensors = tuple(replace(sensor, latency_ms=0.0) for sensor in voyage.config.sensor)
    config = replace(voyage.config, sensor=sensors)
    return replace(voyage, config=config, readings=tuple(map(with_velocity, voyage.readings)))


def without_imu(voyage: Voyage) -> Voyage:
    """The same boat, on which no inertial unit was ever mounted."""
    sensors = tuple(sensor for sensor in voyage.config.sensor if sensor.role != "imu")
    readings = tuple(timed for timed in voyage.readings if not isinstance(timed.reading, ImuReading))
    return replace(voyage, config=replace(voyage.config, sensor=sensors), readings=readings)


_SENTENCES: Final = {
    "sign": "imu1 sign at 0 s",
    "stuck": "imu1 stuck at {stuck_s:g} s",
    "zeros": "imu1 zero at 0 s",
    "upside-down": "imu1 upside-down at 0 s",
    "turned-90": "imu1 turned 90 deg at 0 s",
    "rad-per-s": "imu1 unit at 0 s",
}
FAULTS: Final = tuple(_SENTENCES)
"""Faults of an inertial unit, from the start but for `stuck`."""


def with_fault(voyage: Voyage, fault: str) -> Voyage:
    """The voyage with a fault of `FAULTS` in its inertial unit."""
    return with_faults(voyage, [_SENTENCES[fault].format(stuck_s=STUCK_FROM * voyage.seconds)])


def first_turn_s(truth: Truth, turn_deg: float = 20.0, within_s: float = 30.0) -> float | None:
    """When the boat had first turned so far within that time, s; `None` = never."""
    for place, t_s in enumerate(truth.t_s):
        window = truth.heading_rad[np.searchsorted(truth.t_s, t_s - within_s) : place + 1]
        if np.degrees(np.ptp(window)) >= turn_deg:
            return float(t_s)
    return None


@cache
def _loaded(path: Path) -> Track:
    """The track of a file of sentences, or of the folder of the ferry, its time counted from the first epoch."""
    track = nmea_track(path) if path.is_file() else ferry_track(path)
    return replace(track, t_s=np.round(track.t_s - track.t_s[0], 6))


def _rtk_voyage(
    name: str,
    track: Track,
    noise_m: Array,
    sigma_m: float,
    fix: FixReading,
    *,
    half: int,
    with_velocity: bool = True,
) -> Voyage:
    """One fix and five headings a second; `fix` says what the receiver tells beside place and velocity."""

    def as_fix(index: int) -> FixReading:
        lat_deg, lon_deg = PLANE.to_lat_lon_deg(*(track.place_m[index] + noise_m[index]).tolist())
        v_east, v_north = track.velocity_m_s[index].tolist()
        placed = replace(fix, lat_deg=lat_deg, lon_deg=lon_deg)
        told = with_velocity and np.isfinite(v_east + v_north)
        return replace(placed, v_east_m_s=v_east, v_north_m_s=v_north) if told else placed

    fixes = [Timed(float(track.t_s[at]), "gps1", as_fix(at)) for at in _first_of(track.t_s, 1.0)]
    headings = [Timed(float(track.t_s[at]), "compass1", _heading(track, at)) for at in _first_of(track.t_s, 5.0)]
    sensors = (
        SensorTable(id="gps1", port="a", role="gps", rate_hz=1.0, sigma_m=sigma_m),
        SensorTable(id="compass1", port="a", role="compass", rate_hz=5.0),
    )
    boat = BoatConfig(
        boat=BoatTable(id="rtk", variation_deg=0.0), port=(PortTable(name="a", path="a"),), sensor=sensors
    )
    readings = tuple(sorted((*fixes, *headings), key=lambda timed: timed.t_s))
    return Voyage(name=name, config=boat, plane=PLANE, truth=_truth(track, half), readings=readings)


def _heading(track: Track, index: int) -> HeadingReading:
    return HeadingReading(float(np.degrees(track.heading_rad[index]) % 360.0), decimals=3)


def _first_of(t_s: Array, rate_hz: float) -> list[int]:
    """The first epoch of each period."""
    periods = np.floor(t_s * rate_hz + 1e-6).astype(int)
    return [0, *(k + 1 for k, (a, b) in enumerate(pairwise(periods.tolist())) if b > a)]


def _truth(track: Track, half: int) -> Truth:
    """Parabolas through `half` epochs on either side; the ends have none and are left out."""
    inner = range(half, len(track.t_s) - half)
    fits = []
    for k in inner:
        near = slice(k - half, k + half + 1)
        fits.append(np.polyfit(track.t_s[near] - track.t_s[k], track.place_m[near], 2)[1:])
    velocity, place = np.array(fits).transpose(1, 2, 0)
    kept = slice(inner.start, inner.stop)
    return Truth(track.t_s[kept], place[0], place[1], velocity[0], velocity[1], track.heading_rad[kept])
