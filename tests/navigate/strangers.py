"""Two recordings that are no small boat at sea: a car (IMU and GPS, no compass) and a lake boat's coarse telemetry.

Read as a newcomer would: axes and signs put right, everything else at the defaults of a boat's file.
"""

import csv
from collections.abc import Iterator
from itertools import groupby

import numpy as np

from common.boat_config import BoatConfig, BoatTable, SensorTable
from common.geodesy import LocalPlane
from common.simulation.motion import Truth
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Rates, Timed
from common.simulation.three_port_boat import three_port_boat
from common.simulation.voyage import Voyage
from tests.recordings import SHARED_DATA

CAR = SHARED_DATA / "car-imu-gps" / "2014-03-26-000-Data_first4500.csv"
CATABOT = SHARED_DATA / "catabot-lake" / "20201006_Lake_China_tlog_GPS_first5000.csv"

CAR_CONFIG = BoatConfig(
    boat=BoatTable(id="car", variation_deg=0.0),
    sensor=(
        SensorTable(id="gps1", port="gps", role="gps", rate_hz=10.0),
        SensorTable(id="imu1", port="imu", role="imu", rate_hz=50.0),
    ),
)
CATABOT_CONFIG = BoatConfig(
    boat=BoatTable(id="catabot", variation_deg=0.0),
    sensor=(
        SensorTable(id="gps1", port="gps", role="gps"),
        SensorTable(id="compass1", port="compass", role="compass", rate_hz=1.0, sigma_deg=3.0),
        SensorTable(id="imu1", port="imu", role="imu", rate_hz=2.0, use=("yaw_rate",)),
    ),
)


def car() -> Voyage:
    """IMU: x forward, y to port, z up, all three with the sign of gravity instead of that of the reaction to it."""
    with CAR.open(newline="") as stream:
        rows = [{name: float(text) for name, text in row.items()} for row in csv.DictReader(stream)]
    return _voyage("car", list(_car(rows)), 10.0, 50.0)


def _car(rows: list[dict[str, float]]) -> Iterator[Timed]:
    before: tuple[float, float] | None = None
    for row in rows:
        t_s = (row["millis"] - rows[0]["millis"]) / 1e3
        yield Timed(t_s, "imu1", ImuReading(-row["ax"], row["ay"], -row["yawrate"]))
        place = row["latitude"], row["longitude"]
        if place != before:
            before, speed, course = place, row["speed"] / 3.6, np.radians(row["course"])
            yield Timed(t_s, "gps1", FixReading(*place, speed * float(np.sin(course)), speed * float(np.cos(course))))


def catabot() -> Voyage:
    """Rows of one second spread over it; a value counts when it changes. The first fixes are of another lake."""
    with CATABOT.open(newline="") as stream:
        rows = [[text.strip() for text in row] for row in list(csv.reader(stream))[1:]]
    return _voyage("catabot", list(_catabot(rows)), 1.0, 2.0)


def _catabot(rows: list[list[str]]) -> Iterator[Timed]:
    known: dict[str, tuple[str, ...]] = {}
    first_s = _seconds(rows[0][1])
    for second, group in groupby(rows, key=lambda row: row[1]):
        together = list(group)
        for number, row in enumerate(together):
            t_s = (_seconds(second) - first_s) % 43_200.0 + number / len(together)
            for sensor, fields in (("imu1", (row[7],)), ("compass1", (row[9],)), ("gps1", (row[-2], row[-1]))):
                if known.get(sensor) == fields:
                    continue
                known[sensor] = fields
                values = [float(text) for text in fields]
                if sensor == "imu1":
                    yield Timed(t_s, sensor, ImuReading(0.0, 0.0, float(np.degrees(values[0]))))
                elif sensor == "compass1":
                    yield Timed(t_s, sensor, HeadingReading(values[0] % 360.0))
                else:
                    yield Timed(t_s, sensor, FixReading(values[0] * 1e-7, values[1] * 1e-7))


def _seconds(text: str) -> float:
    """Hh:mm:ss, 12-hour."""
    hours, minutes, seconds = map(int, text.split(":"))
    return 3600.0 * (hours % 12) + 60.0 * minutes + seconds


def _voyage(name: str, readings: list[Timed], gps_hz: float, imu_hz: float) -> Voyage:
    """No truth is known."""
    none = np.zeros(2)
    last = next(timed.reading for timed in reversed(readings) if isinstance(timed.reading, FixReading))
    return Voyage(
        name=name,
        config=three_port_boat(BoatTable(id=name, variation_deg=0.0), rates=Rates(gps_hz=gps_hz, imu_hz=imu_hz)),
        plane=LocalPlane(last.lat_deg, last.lon_deg),
        truth=Truth(none, none, none, none, none, none),
        readings=tuple(readings),
    )
