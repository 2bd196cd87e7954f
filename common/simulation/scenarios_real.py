"""Scenarios with the errors of real boats (realistic sensor simulation): a new track and new sensors from each seed.

Which waters are sailed follows the `real-*` boats of the study of a judge (judge.md) and the stress of real-boats.md
section 3: a lake, a coast, a harbour, an anchorage, 6 and 10 m/s, an RTK receiver.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from common.boat_config import SensorTable
from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.simulation.drawn_tracks import Habits, programme
from common.simulation.hull import STEP_S, Weather, afloat, at_anchor, drawn_hull, steered
from common.simulation.motion import Truth
from common.simulation.readings import SensorFacts, Timed
from common.simulation.real_compass import compass_readings
from common.simulation.real_gps import BETWEEN_WALLS, OPEN_SKY, RTK, Reception, fixes
from common.simulation.real_inertial import gyro_readings, imu_readings
from common.simulation.sensor_models import Draws
from common.simulation.traffic import traffic_readings
from common.simulation.waves import Sea

REAL: Final = "real boats"
LONGEST_S: Final = 6.0 * 3600.0
"""Longest voyage, s: all of its readings are made before the first is sent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RealScenario:
    """A stretch of water and what boats do on it: every seed is another boat with other sensors on another track."""

    name: str
    text: str
    plane: LocalPlane
    habits: Habits | None
    """How the boat is driven; `None` = it lies at anchor."""
    weather: Weather
    reception: Reception = OPEN_SKY
    seconds: float = 600.0
    facts: SensorFacts = field(default_factory=SensorFacts)
    """The file states nothing of its own: nobody has measured these sensors."""
    group: str = REAL

    def truth(self, seed: int = 1, seconds: float | None = None) -> Truth:
        """What happens to the boat of a seed for `seconds` (`None` = as long as the scenario); a longer one goes on."""
        if seconds is not None and seconds > LONGEST_S:
            cure = "ask for less"
            raise WayfixError(
                f"{self.name} is simulated for at most {LONGEST_S / 3600.0:g} h at once", "--seconds", cure
            )
        root = np.random.SeedSequence(self._entropy(seed))
        helm, boat, water = (np.random.default_rng(child) for child in root.spawn(3))
        # One step is the least: velocities are differences.
        count = max(1, round((self.seconds if seconds is None else seconds) / STEP_S)) + 1
        t_s = np.round(np.arange(count) * STEP_S, 9)
        hull = drawn_hull(boat)
        if self.habits is None:
            course = at_anchor(boat, t_s)
        else:
            course = steered(boat, t_s, programme(helm, self.habits, count), hull)
        return afloat(water, t_s, course, hull, self.weather)

    def draws(self, seed: int) -> Draws:
        """Sensors of their own for each seed of each world, so that figures over several worlds are independent."""
        return Draws(np.random.SeedSequence((*self._entropy(seed), 1)))

    def _entropy(self, seed: int) -> tuple[int, int]:
        return seed, zlib.crc32(self.name.encode())

    def readings(self, truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
        """What one sensor measures on the way."""
        match sensor.role:
            case "gps":
                return fixes(truth, sensor, draws, self.reception, self.plane)
            case "compass":
                return compass_readings(truth, sensor, draws)
            case "imu":
                return imu_readings(truth, sensor, draws)
            case "gyro":
                return gyro_readings(truth, sensor, draws)
            case _:
                return traffic_readings(truth, sensor, draws, self.plane)


LAKE: Final = Sea(roll_deg=0.7, pitch_deg=0.5, yaw_deg=0.2, drift_m_s=0.03)
BAY: Final = Sea(roll_deg=2.0, pitch_deg=1.0, yaw_deg=0.4, drift_m_s=0.03)
COAST: Final = Sea(roll_deg=7.0, pitch_deg=3.0, yaw_deg=1.5, drift_m_s=0.25, peak_hz=(0.1, 0.35))

REAL_SCENARIOS: Final = (
    RealScenario(
        name="real-lake",
        text="a small boat surveys a lake at 1 to 2 m/s: legs, turns to both sides, circles, slaloms, a few stops",
        plane=LocalPlane(63.4013, 10.3150),
        habits=Habits(
            speed_m_s=(1.0, 2.0),
            turn_deg_s=(3.0, 20.0),
            weights={"turn": 7.0, "circle": 1.0, "slalom": 1.0, "stop": 1.0},
        ),
        weather=Weather(sea=LAKE, current_m_s=0.1, wind_m_s=6.0),
        seconds=900.0,
    ),
    RealScenario(
        name="real-coast",
        text="open coast at 1.5 to 3 m/s in waves: roll of 7 degrees (1-sigma), current up to 0.6 m/s, drifting",
        plane=LocalPlane(22.5800, 114.5300),
        habits=Habits(
            speed_m_s=(1.5, 3.0),
            turn_deg_s=(2.0, 12.0),
            weights={"turn": 7.0, "circle": 1.0, "slalom": 1.0, "drift": 1.0},
        ),
        weather=Weather(sea=COAST, current_m_s=0.6, wind_m_s=12.0),
        seconds=900.0,
    ),
    RealScenario(
        name="real-harbour",
        text="in and out of berths below 1.2 m/s: stops, astern, tight turns, walls that hide satellites",
        plane=LocalPlane(63.4389, 10.3991),
        habits=Habits(
            speed_m_s=(0.3, 1.2),
            turn_deg_s=(4.0, 25.0),
            leg_s=(8.0, 40.0),
            weights={"turn": 4.0, "circle": 0.5, "stop": 2.0, "astern": 2.0, "drift": 0.5},
        ),
        weather=Weather(sea=LAKE, current_m_s=0.3, wind_m_s=6.0),
        reception=BETWEEN_WALLS,
        seconds=900.0,
    ),
    RealScenario(
        name="real-anchor",
        text="at anchor: the boat sheers about a rode of 15 to 40 m while the wind goes round",
        plane=LocalPlane(58.2124, 11.5475),
        habits=None,
        weather=Weather(sea=BAY, current_m_s=0.5, wind_m_s=8.0),
        seconds=900.0,
    ),
    RealScenario(
        name="real-6ms",
        text="a fast boat at 4.5 to 6.5 m/s that heels outward in its turns",
        plane=LocalPlane(50.76, -1.29),
        habits=Habits(speed_m_s=(4.5, 6.5), turn_deg_s=(2.0, 8.0)),
        weather=Weather(sea=BAY, current_m_s=0.5, wind_m_s=8.0),
    ),
    RealScenario(
        name="real-10ms",
        text="a planing boat at 8 to 11 m/s, turns up to 12 deg/s",
        plane=LocalPlane(50.76, -1.29),
        habits=Habits(speed_m_s=(8.0, 11.0), turn_deg_s=(2.0, 12.0)),
        weather=Weather(sea=BAY, current_m_s=0.5, wind_m_s=8.0),
    ),
    RealScenario(
        name="real-rtk",
        text="a survey at 1 to 3 m/s with an RTK receiver: fixed, float, single, none and back",
        plane=LocalPlane(22.6500, 114.8000),
        habits=Habits(
            speed_m_s=(1.0, 3.0),
            turn_deg_s=(3.0, 15.0),
            weights={"turn": 7.0, "circle": 1.0, "slalom": 1.0, "stop": 1.0},
        ),
        weather=Weather(sea=BAY, current_m_s=0.4, wind_m_s=8.0),
        reception=RTK,
        seconds=900.0,
    ),
)
