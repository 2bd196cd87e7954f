"""Magnetic compass error model: deviation A to E, heeling error, lasting error, latency, and tilt by apparent gravity.

What is drawn for each compass, and where its size comes from:

* Deviation: A 1.5 deg, B and C 3.5 deg, D 1 deg, E 0.5 deg (1-sigma), so that its largest value is 4 to 8 deg for most
  (judge.md, `real-*`; form: Bowditch, American Practical Navigator, ch. 6; the sums of sines are `Deviation`). What the
  boat's file states as `deviation_deg` comes on top, for the station takes it off.
* Heeling error: 0.2 to 0.8 deg for each degree of roll at headings north and south, either sign, falling to none at
  east and west (Bowditch, ch. 6; judge.md: 0.5). Waves and the heel of turns show in the heading.
* An error of 1 to 2.5 deg that lasts 40 to 90 s (judge.md and real-boats.md: 2 deg over 60 s), 0.3 to 1 deg of white
  noise, damping of 0.1 to 0.4 s, latency of 0 to 0.3 s.
* Pitch and roll are what a pendulum or a fluid feels (TCM2, HMR3000): the direction of apparent gravity, so a turn
  shows as heel. They lag by 0.3 s and are 0.5 deg askew.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from common.boat_config import SensorTable
from common.simulation.motion import Array, Truth, sample_times_s
from common.simulation.readings import HeadingReading, Timed
from common.simulation.recurrences import lagged
from common.simulation.sensor_errors import Deviation, drift_path, gauss_markov
from common.simulation.sensor_models import Draws
from common.simulation.specific_force import body_motion_3d

DEVIATION_DEG: Final = (1.5, 3.5, 3.5, 1.0, 0.5)
"""1-sigma of the coefficients A to E that a compass draws, deg."""
TILT_LAG_S: Final = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Compass:
    """What is drawn once for a compass."""

    deviation: Deviation
    heeling: float
    """Deviation for each degree of roll on a heading of north, deg/deg."""
    lasting_deg: float
    lasts_s: float
    white_deg: float
    damping_s: float
    late_s: float
    askew_deg: tuple[float, float]
    """Roll and pitch that it shows on a level boat, deg."""
    turn_rate_deg_s: float
    """Constant error of the rate of turn, deg/s."""


def drawn_compass(rng: np.random.Generator) -> Compass:
    """A compass of a small boat."""
    a, b, c, d, e = (np.array(DEVIATION_DEG) * rng.standard_normal(5)).tolist()
    return Compass(
        deviation=Deviation(A=a, B=b, C=c, D=d, E=e),
        heeling=rng.uniform(0.2, 0.8) * float(rng.choice((-1.0, 1.0))),
        lasting_deg=rng.uniform(1.0, 2.5),
        lasts_s=rng.uniform(40.0, 90.0),
        white_deg=rng.uniform(0.3, 1.0),
        damping_s=rng.uniform(0.1, 0.4),
        late_s=rng.uniform(0.0, 0.3),
        askew_deg=(0.5 * rng.standard_normal(), 0.5 * rng.standard_normal()),
        turn_rate_deg_s=0.1 * rng.standard_normal(),
    )


def compass_readings(truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
    """Heading, tilt and rate of turn of one compass; a model without tilt or rate prints none of it."""
    compass = drawn_compass(draws.of(f"{sensor.id} made")[0])
    t_s = sample_times_s(truth, sensor)
    heading, rate = seen_heading_deg(truth, t_s, compass)
    normals = draws.normals(sensor.id, len(t_s), 4)[0]
    lasting = drift_path(
        gauss_markov(compass.lasting_deg, compass.lasts_s), t_s, draws.normals(f"{sensor.id} drift", len(t_s), 1)[0]
    )[:, 0]
    heading = np.mod(heading - (sensor.deviation_deg or 0.0) + lasting + compass.white_deg * normals[:, 0], 360.0)
    heading[heading >= 360.0] = 0.0  # a tiny negative angle rounds up to 360
    rate += compass.turn_rate_deg_s + 0.3 * normals[:, 1]
    tilt = felt_tilt_deg(truth, t_s - compass.late_s) + compass.askew_deg + 0.1 * normals[:, 2:]
    for t, shown, (roll, pitch), turning in zip(
        t_s.tolist(), heading.tolist(), tilt.tolist(), rate.tolist(), strict=True
    ):
        yield Timed(t, sensor.id, HeadingReading(shown, pitch, roll, turning))


def seen_heading_deg(truth: Truth, t_s: Array, compass: Compass) -> tuple[Array, Array]:
    """Heading less the deviation, damped and late, and its rate, at the times; continuous, deg and deg/s."""
    step_s = float(truth.t_s[1] - truth.t_s[0])
    deviation = compass.deviation.at(truth.heading_rad)
    if truth.roll_rad is not None:
        deviation = deviation + compass.heeling * np.degrees(truth.roll_rad) * np.cos(truth.heading_rad)
    shown = lagged(np.degrees(truth.heading_rad) - deviation, step_s, compass.damping_s)
    turning = np.diff(shown, prepend=shown[0]) / step_s
    late = t_s - compass.late_s
    return np.interp(late, truth.t_s, shown), np.interp(late, truth.t_s, turning)


def felt_tilt_deg(truth: Truth, t_s: Array) -> Array:
    """Roll and pitch (n, 2) of apparent gravity: the turn and the speeding-up of the boat look like tilt."""
    motion = body_motion_3d(truth)
    fwd, stb, down = motion.force_m_s2.T
    felt = np.degrees(np.stack((np.arctan2(-stb, -down), np.arctan2(fwd, np.hypot(stb, down))), axis=1))
    slow = lagged(felt, float(truth.t_s[1] - truth.t_s[0]), TILT_LAG_S)
    return np.stack([np.interp(t_s, truth.t_s[1:], slow[:, axis]) for axis in range(2)], axis=1)
