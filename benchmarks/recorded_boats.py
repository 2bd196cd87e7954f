"""Recordings of real boats (NMEA 0183, CSV) as columns: RTK tracks, still receivers, inertial units, attitudes.

They lie beside the repository (`../shared/data`) and are only read. What each is stands in its README.
"""

import csv
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.boat_figures import Boat, Body, Track
from common.geodesy import LocalPlane
from common.units import M_S_PER_KN
from onboard.devices.nmea_sentence import Sentence, check_sentence

BLUEBOAT_RUNS = ("220", "224", "225", "232", "235")
"""Runs that turn and have way on."""
CATABOT_AFLOAT = 2000
"""Rows before are handling ashore, with the boat tipped."""


def recorded_boats(data: Path) -> dict[str, list[Boat]]:
    """All recordings by their kind."""
    moored = ("radar-ttm-nmea/RadarLogs_lines_20001-40000.txt", "signalk-boat-nmea/gofree-merrimac.log")
    return {
        "moored receivers": [Boat(nmea_track(data / name)) for name in moored],
        "ocean-rtk": [Boat(nmea_track(path)) for path in sorted((data / "ocean-rtk-usv").glob("*.txt"))],
        "sailing": [Boat(nmea_track(path)) for path in sorted((data / "sailing-nmea").glob("*.TXT"))],
        "BlueBoat": [_blueboat(data / "blueboat-usv" / f"fixed_00000{run}.csv") for run in BLUEBOAT_RUNS],
        "catabot": [_catabot(path) for path in sorted((data / "catabot-lake").glob("*.csv"))],
        "milliAmpere": [_milliampere(data / "milliampere-ferry")],
    }


def nmea_track(path: Path) -> Track:
    """The track of a file of sentences."""
    with path.open("rb") as lines:
        return track_of(lines)


def track_of(lines: Iterable[bytes]) -> Track:
    """Epochs by the time of day: GGA or else RMC for the place, RMC for the velocity, HDT or HDG for the heading."""
    places: dict[float, tuple[float, float]] = {}
    told: dict[float, tuple[float, float]] = {}
    headings: dict[float, float] = {}
    now_s = None
    for line in lines:
        sentence = check_sentence(line.strip())
        if not isinstance(sentence, Sentence):
            continue
        fields = sentence.text.split("*")[0].split(",")
        if sentence.formatter == "GGA" and fields[2]:
            now_s = _seconds(fields[1])
            places[now_s] = _degrees(fields[2], fields[3]), _degrees(fields[4], fields[5])
        elif sentence.formatter == "RMC" and fields[2] == "A" and fields[7]:
            now_s = _seconds(fields[1])
            places.setdefault(now_s, (_degrees(fields[3], fields[4]), _degrees(fields[5], fields[6])))
            course = np.radians(float(fields[8])) if fields[8] else np.nan
            speed = float(fields[7]) * M_S_PER_KN
            told[now_s] = speed * np.sin(course), speed * np.cos(course)
        elif sentence.formatter in {"HDT", "HDG"} and fields[1] and now_s is not None:
            headings.setdefault(now_s, np.radians(float(fields[1])))
    times = [t for t in sorted(places) if t in headings or not headings]
    plane = LocalPlane(*places[times[0]])
    return Track(
        np.array(times),
        np.array([plane.to_east_north_m(*places[t]) for t in times]),
        np.array([told.get(t, (np.nan, np.nan)) for t in times]),
        np.unwrap(np.array([headings.get(t, 0.0) for t in times])),
    )


def _blueboat(path: Path) -> Boat:
    names = ("surge", "sway", "yaw_rate", "surge_dot", "sway_dot")
    rows = [[row[name] for name in names] for row in _rows(path)]
    return Boat(body=Body(*np.array([[float(value) for value in row] for row in rows if all(row)]).T))


def _catabot(path: Path) -> Boat:
    """Attitude and place once a second; the clock has 12 hours and starts at noon."""
    rows = _rows(path)[CATABOT_AFLOAT:]
    fresh = [row for before, row in pairwise(rows) if row["Time"] != before["Time"]]
    tilt = [[float(row[f"mavlink_attitude_t.{axis}"]) for axis in ("roll", "pitch", "yaw")] for row in fresh]
    degrees = [[float(row[f"mavlink_global_position_int_t.{axis}"]) * 1e-7 for axis in ("lat", "lon")] for row in fresh]
    plane = LocalPlane(*degrees[0])
    columns = np.array(tilt)
    t_s = np.array(
        [60.0 * int(minute) + int(second) for _, minute, second in (row["Time"].split(":") for row in fresh)]
    )
    track = Track(
        t_s,
        np.array([plane.to_east_north_m(*place) for place in degrees]),
        np.full((len(t_s), 2), np.nan),
        np.unwrap(columns[:, 2]),
    )
    return Boat(track, tilt_rad=columns[:, :2], tilt_step_s=1.0)


def ferry_track(folder: Path) -> Track:
    """The track of the ferry's RTK receiver at 20 Hz."""
    return track_of(row["sentence"].encode() for row in _rows(folder / "maneuvering1_GPGGA.csv"))


def _milliampere(folder: Path) -> Boat:
    """The receiver at 20 Hz; roll and pitch of its inertial unit, consecutive samples of 100 Hz (see its README)."""
    track = ferry_track(folder)
    rows = _rows(folder / "maneuvering1_imu.csv")
    x, y, z, w = (np.array([float(row[f"orientation_{axis}"]) for row in rows]) for axis in "xyzw")
    roll = np.unwrap(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    tilt = np.stack((roll, np.arcsin(2.0 * (w * y - z * x))), axis=1)
    return replace(Boat(track), tilt_rad=tilt, tilt_step_s=0.01)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="ascii", newline="") as file:
        return list(csv.DictReader(file, skipinitialspace=True))


def _seconds(hhmmss: str) -> float:
    return int(hhmmss[:2]) * 3600.0 + int(hhmmss[2:4]) * 60.0 + float(hhmmss[4:])


def _degrees(ddmm: str, side: str) -> float:
    whole = ddmm.index(".") - 2
    value = float(ddmm[:whole] or 0.0) + float(ddmm[whole:]) / 60.0
    return -value if side in "SW" else value
