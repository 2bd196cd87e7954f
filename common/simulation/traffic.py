"""Ships around the simulated boat, as its AIS receiver and its radar's target tracker (ARPA) see them.

The ships are drawn from the seed and keep course and speed; they are the same for every sensor. Reporting intervals of
AIS are those of ITU-R M.1371-5, Annex 1, Tables 1 and 2.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.angles import wrap_deg
from common.boat_config import SensorTable
from common.geodesy import LocalPlane
from common.simulation.ais_sentences import Report, position_a, position_b, static_a
from common.simulation.motion import Truth
from common.simulation.readings import AisReading, RadarReading, Timed
from common.simulation.sensor_models import Draws

SHIPS: Final = 5
"""Number of ships about the boat; the last of them is small and sends class B."""
OWN_MMSI: Final = 235_000_001
STATIC_EVERY_S: Final = 360.0
SWEEP_S: Final = 2.5
"""Time of a turn of the antenna, s: 24 turns a minute, usual for a small marine radar."""
RADAR_RANGE_M: Final = 11_112.0
"""Range of the picture, 6 nautical miles."""
RANGE_SIGMA_M: Final = 15.0
BEARING_SIGMA_DEG: Final = 0.5
"""1-sigma of one plot in bearing: IMO MSC.192(79) asks for 1 deg (95 %) of a ship's radar."""


@dataclass(frozen=True, slots=True)
class Ship:
    """One ship on a straight course."""

    mmsi: int
    is_class_b: bool
    east_m: float
    north_m: float
    speed_m_s: float
    course_deg: float
    first_report_s: float

    def at(self, t_s: float) -> tuple[float, float]:
        """Place on the local plane: east, north (m)."""
        way_m, course = self.speed_m_s * t_s, math.radians(self.course_deg)
        return self.east_m + way_m * math.sin(course), self.north_m + way_m * math.cos(course)

    @property
    def period_s(self) -> float:
        """Time between two position reports, s."""
        if self.is_class_b:
            return 30.0 if self.speed_m_s > 1.0 else 180.0
        return 10.0 if self.speed_m_s < 7.2 else 6.0


def ships_around(truth: Truth, draws: Draws) -> tuple[Ship, ...]:
    """The ships of a seed: half a mile to two miles from where the boat starts, bound past that place."""
    draw = draws.beginning("traffic")
    middle = float(truth.east_m[0]), float(truth.north_m[0])
    found = []
    for number in range(SHIPS):
        bearing, distance_m = draw.uniform(0.0, 2.0 * math.pi), draw.uniform(900.0, 3700.0)
        east, north = middle[0] + distance_m * math.sin(bearing), middle[1] + distance_m * math.cos(bearing)
        aim = math.atan2(middle[0] - east, middle[1] - north) + draw.uniform(-0.6, 0.6)
        is_class_b = number == SHIPS - 1
        speed = draw.uniform(1.5, 4.0) if is_class_b else draw.uniform(3.0, 9.0)
        course_deg = wrap_deg(math.degrees(aim))
        found.append(Ship(235_100_000 + number, is_class_b, east, north, speed, course_deg, draw.uniform(0.0, 6.0)))
    return tuple(found)


def traffic_readings(truth: Truth, sensor: SensorTable, draws: Draws, plane: LocalPlane) -> Iterator[Timed]:
    """What an AIS receiver or a radar of the boat gives, in order of time."""
    ships = ships_around(truth, draws)
    if sensor.role == "radar":
        return _plots(truth, sensor, ships, draws)
    return iter(sorted(_sentences(truth, sensor, ships, plane), key=lambda timed: timed.t_s))


def _sentences(truth: Truth, sensor: SensorTable, ships: tuple[Ship, ...], plane: LocalPlane) -> Iterator[Timed]:
    end_s = float(truth.t_s[-1])
    for number, ship in enumerate(ships):
        for t_s in np.arange(ship.first_report_s, end_s, ship.period_s).tolist():
            lat_deg, lon_deg = plane.to_lat_lon_deg(*ship.at(t_s))
            report = Report(
                mmsi=ship.mmsi,
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                sog_m_s=ship.speed_m_s,
                cog_true_deg=ship.course_deg,
                heading_true_deg=None if ship.is_class_b else ship.course_deg,
            )
            yield from _spoken(t_s, sensor, position_b(report) if ship.is_class_b else position_a(report))
        if not ship.is_class_b:
            for t_s in np.arange(ship.first_report_s + 1.0, end_s, STATIC_EVERY_S).tolist():
                yield from _spoken(t_s, sensor, static_a(ship.mmsi, f"VIRTUAL {number + 1}", number))
    for t_s, own in _own_ship(truth, plane, end_s):
        yield from _spoken(t_s, sensor, position_a(own, talker="AIVDO", channel=""))


def _spoken(t_s: float, sensor: SensorTable, sentences: tuple[str, ...]) -> Iterator[Timed]:
    return (Timed(t_s, sensor.id, AisReading(sentence)) for sentence in sentences)


def _own_ship(truth: Truth, plane: LocalPlane, end_s: float) -> Iterator[tuple[float, Report]]:
    """The transponder's own report, each 10 s."""
    seen = truth.at(np.arange(3.0, end_s, 10.0))
    for k, t_s in enumerate(seen.t_s.tolist()):
        lat_deg, lon_deg = plane.to_lat_lon_deg(float(seen.east_m[k]), float(seen.north_m[k]))
        v_east, v_north = float(seen.v_east_m_s[k]), float(seen.v_north_m_s[k])
        yield (
            t_s,
            Report(
                mmsi=OWN_MMSI,
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                sog_m_s=math.hypot(v_east, v_north),
                cog_true_deg=wrap_deg(math.degrees(math.atan2(v_east, v_north))),
                heading_true_deg=wrap_deg(math.degrees(float(seen.heading_rad[k]))),
            ),
        )


def _plots(truth: Truth, sensor: SensorTable, ships: tuple[Ship, ...], draws: Draws) -> Iterator[Timed]:
    """Every target once a turn of the antenna, when the beam passes it; in order of time."""
    own = truth.at(np.arange(0.0, float(truth.t_s[-1]), SWEEP_S))
    noise = draws.normals(sensor.id, len(own.t_s), len(ships), 2)[0]
    for k, t_s in enumerate(own.t_s.tolist()):
        seen = []
        for number, ship in enumerate(ships):
            east, north = ship.at(t_s)
            east, north = east - float(own.east_m[k]), north - float(own.north_m[k])
            range_m = math.hypot(east, north) + RANGE_SIGMA_M * float(noise[k, number, 0])
            bearing_deg = math.degrees(math.atan2(east, north)) + BEARING_SIGMA_DEG * float(noise[k, number, 1])
            if not 0.0 < range_m < RADAR_RANGE_M:
                continue
            ahead_deg = wrap_deg(bearing_deg - math.degrees(float(own.heading_rad[k])))
            target = RadarReading(
                number=number + 1,
                range_m=range_m,
                bearing_true_deg=wrap_deg(bearing_deg),
                sog_m_s=ship.speed_m_s,
                course_true_deg=ship.course_deg,
                status="acquiring" if k < 10 else "tracking",
            )
            seen.append(Timed(round(t_s + SWEEP_S * ahead_deg / 360.0, 6), sensor.id, target))
        yield from sorted((timed for timed in seen if timed.t_s <= truth.t_s[-1]), key=lambda timed: timed.t_s)
