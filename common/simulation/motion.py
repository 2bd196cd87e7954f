"""Ground truth: a boat that follows waypoints through moving water (guidance, kinematics), on a fine time grid.

The thesis sails in steps of T = 1 s. Here the helm decides every T and the boat moves in steps of 0.05 s between, so
that any sensor rate can be served. Within a step the ground velocity changes linearly (constant acceleration):
integrating the mean acceleration of each interval gives back velocity and position exactly.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from common.angles import difference_rad
from common.boat_config import ROLES, SensorTable
from common.simulation.fields import VectorField

Array = npt.NDArray[np.float64]
Place = tuple[float, float]
"""A place on the local plane: (east_m, north_m)."""


@dataclass(frozen=True, slots=True)
class Truth:
    """What really happened: columns of equal length, local plane; `heading_rad` is continuous (never wraps)."""

    t_s: Array
    east_m: Array
    north_m: Array
    v_east_m_s: Array
    """Velocity over ground to the east, m/s, current included."""
    v_north_m_s: Array
    heading_rad: Array
    """Heading clockwise from true north, rad."""
    roll_rad: Array | None = None
    """Roll of the hull, starboard down +, rad; `None` = it floats level, as in the thesis."""
    pitch_rad: Array | None = None
    """Pitch of the hull, bow up +, rad."""

    def at(self, t_s: Array) -> "Truth":
        """Truth at other times, linear between its own (exact for velocity and heading, 20 um for position)."""
        return self._with(t_s, lambda values: np.interp(t_s, self.t_s, values))

    def until(self, seconds: float | None) -> "Truth":
        """The part up to and including `seconds` (`None` = all)."""
        keep = slice(None) if seconds is None else slice(int(np.searchsorted(self.t_s, seconds, side="right")))
        return self._with(self.t_s[keep], lambda values: values[keep])

    def _with(self, t_s: Array, column: Callable[[Array], Array]) -> "Truth":
        """Every column changed in the same way."""
        return Truth(
            t_s,
            column(self.east_m),
            column(self.north_m),
            column(self.v_east_m_s),
            column(self.v_north_m_s),
            column(self.heading_rad),
            None if self.roll_rad is None else column(self.roll_rad),
            None if self.pitch_rad is None else column(self.pitch_rad),
        )


def grid(duration_s: float, rate_hz: float, first: int = 0) -> Array:
    """Times k / rate_hz from k = first to the last one within `duration_s`."""
    return np.arange(first, math.floor(duration_s * rate_hz + 1e-6) + 1, dtype=np.float64) / rate_hz


def sample_times_s(truth: Truth, sensor: SensorTable) -> Array:
    """Times at which a sensor measures, from 0 to the end of the truth: `rate_hz` of its file, else usual."""
    return grid(float(truth.t_s[-1]), sensor.rate_hz or ROLES[sensor.role].nominal_rate_hz)


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Waypoints and the boat that follows them."""

    start: Place
    waypoints: tuple[Place, ...]
    """Waypoints in order; the last one is the end point: the mission is over within its clearance."""
    heading_deg: float
    """Heading at the start, deg from true north."""
    speed_m_s: float = 1.0
    """Speed through the water along the heading, m/s."""
    turn_rate_deg_s: float = 3.0
    clearance_m: float = 20.0
    """Waypoint clearance d of Eq. 4.54, m. Below the turn radius (19 m at 1 m/s and 3 deg/s) a boat may circle a
    waypoint for ever."""
    helm_s: float = 1.0
    """Period T of the turn rule, s: time between two decisions of the helm."""
    longest_s: float = 3600.0
    """Longest duration of the mission, s: it is cut here if it has not ended."""


def turn_direction(heading_rad: float, bearing_rad: float, band_rad: float) -> int:
    """Turn rule of section 4.3.3: +1 = clockwise, -1 = anticlockwise, 0 = hold.

    Read with a dead band of w T on both sides and a wrapped difference: as printed, a boat on course would always turn
    clockwise first and chatter by w T.
    """
    off_course = difference_rad(heading_rad, bearing_rad)
    if abs(off_course) <= band_rad:
        return 0
    return -1 if off_course > 0.0 else 1


def cleared(place: Place, waypoint: Place, clearance_m: float) -> bool:
    """Waypoint clearance, Eq. 4.54: |p_usv - p_wp| < d."""
    return math.dist(place, waypoint) < clearance_m


def sail(mission: Mission, current: VectorField, step_s: float = 0.05) -> Truth:
    """Follow the waypoints; the track starts at t = 0 and its velocity includes the current from the start."""
    rate_rad_s = math.radians(mission.turn_rate_deg_s)
    steps = round(mission.helm_s / step_s)
    heading = math.radians(mission.heading_deg)
    place = mission.start
    velocity = _over_ground(mission, current, place, heading, 0.0)
    rows = [(*place, *velocity, heading)]
    ahead = list(mission.waypoints)
    for _ in range(round(mission.longest_s / mission.helm_s)):
        while ahead and cleared(place, ahead[0], mission.clearance_m):
            ahead.pop(0)
        if not ahead:
            break
        bearing = math.atan2(ahead[0][0] - place[0], ahead[0][1] - place[1])
        turn = turn_direction(heading, bearing, rate_rad_s * mission.helm_s)
        for _ in range(steps):
            heading += turn * rate_rad_s * step_s
            before = velocity
            t_s = len(rows) * step_s
            velocity = _over_ground(mission, current, _moved(place, before, before, step_s), heading, t_s)
            place = _moved(place, before, velocity, step_s)
            rows.append((*place, *velocity, heading))
    columns = np.array(rows, dtype=np.float64).T
    return Truth(np.round(np.arange(len(rows)) * step_s, 9), *columns)


def _moved(place: Place, before: Place, after: Place, step_s: float) -> Place:
    """Place to which a constant acceleration from one velocity to the other leads."""
    return place[0] + 0.5 * step_s * (before[0] + after[0]), place[1] + 0.5 * step_s * (before[1] + after[1])


def _over_ground(mission: Mission, current: VectorField, place: Place, heading: float, t_s: float) -> Place:
    """Velocity through water along the heading, plus the water's own."""
    east, north = current(*place, t_s)
    return float(east) + mission.speed_m_s * math.sin(heading), float(north) + mission.speed_m_s * math.cos(heading)
