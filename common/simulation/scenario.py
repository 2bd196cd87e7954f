"""A scenario: a mission, what moves the boat, what its sensors do, what its filter assumes; and variants of one."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, Final, Literal, Protocol

import numpy as np
import numpy.typing as npt

from common.boat_config import SensorTable
from common.geodesy import LocalPlane
from common.simulation.fields import STILL, VectorField
from common.simulation.filter_tuning import Assumed
from common.simulation.manoeuvres import Manoeuvres, follow
from common.simulation.motion import Array, Mission, Place, Truth, sail
from common.simulation.readings import SensorFacts, Timed
from common.simulation.sensor_errors import NO_FLAWS, Flaws
from common.simulation.sensor_models import Draws, Phase, imu_bias
from common.simulation.thesis_sensors import ThesisSensor, phases_of
from common.simulation.thesis_tables import REALISTIC, TABLE_5_4_BIAS, budget_m

SOLENT: Final = LocalPlane(50.76, -1.29)
"""Origin of the simulated plane, near Cowes: a schematic stand-in. The thesis prints its map without coordinates, so
the tracks cross land and sea as they like."""


class World(Protocol):
    """What a virtual boat can sail: a track for each seed, and the readings of any sensor on it."""

    @property
    def name(self) -> str:
        """Name on the command line."""
        ...

    @property
    def group(self) -> str:
        """Heading under which it is listed."""
        ...

    @property
    def text(self) -> str:
        """One sentence on what happens."""
        ...

    @property
    def plane(self) -> LocalPlane:
        """Local plane of the truth."""
        ...

    @property
    def facts(self) -> SensorFacts:
        """What the file of the three-port boat says of its sensors."""
        ...

    def truth(self, seed: int = 1, seconds: float | None = None) -> Truth:
        """What really happens for so many seconds (`None` = as long as it is); one seed, one track."""
        ...

    def draws(self, seed: int) -> Draws:
        """Random numbers of all sensors of the boat of a seed."""
        ...

    def readings(self, truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
        """What one sensor of the boat's file measures on the way, in order of time."""
        ...


@dataclass(frozen=True, slots=True)
class Outage:
    """A sensor gives nothing for from_s <= t < from_s + length_s."""

    sensor: str
    """Id of the sensor, as in the boat's file."""
    from_s: float
    length_s: float

    def covers(self, t_s: Any) -> Any:
        """Whether a time, or each of an array of times, lies in it."""
        return (t_s >= self.from_s) & (t_s < self.from_s + self.length_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Everything that makes a run but its seed."""

    name: str
    group: str
    """Heading under which the scenario is listed."""
    text: str
    mission: Mission | Manoeuvres
    phases: tuple[Phase, ...]
    assumed: Assumed
    """Tuning of the filter in the profile `stated`."""
    compat: Assumed | None = None
    """Tuning of the filter in the profile `compat`, which explains the published figures; `None` = nothing is
    published."""
    current: VectorField = STILL
    """All that moves the boat besides its own speed through the water; `Manoeuvres`, over ground, feel nothing."""
    flaws: Flaws = NO_FLAWS
    flaws_of: tuple[tuple[str, Flaws], ...] = ()
    """Flaws of single sensors by their id, in place of `flaws`."""
    outages: tuple[Outage, ...] = ()
    step_s: float = 1.0
    """Step T of the thesis, s: all sensors measure at once every so often in the laboratory."""
    plane: LocalPlane = SOLENT
    coast: tuple[Place, ...] = ()
    """A line to draw: our own schematic stand-in for the shore, which no calculation uses."""

    @property
    def bias(self) -> Literal["removed", "full"]:
        """Whether the IMU's bias is left in its samples."""
        drawn = any(self.flaws.turn_on)
        return "full" if drawn or any(any(imu_bias(phase.errors)) for phase in self.phases) else "removed"

    @property
    def facts(self) -> SensorFacts:
        """What a boat's file says of its sensors: an IMU is calibrated when its biases were removed and stay so."""
        flaws = self.flaws
        drifts = bool(flaws.accel_drift.density or flaws.gyro_drift_deg.density)
        return self.assumed.facts(is_calibrated=self.bias == "removed" and not drifts)

    def truth(self, seed: int = 1, seconds: float | None = None) -> Truth:
        """Sail it: the same for every seed, so its columns cannot be written to. A mission ends when it ends."""
        del seed
        return _sailed(self.mission, self.current).until(seconds)

    def draws(self, seed: int) -> Draws:
        """The same for every scenario: methods and scenarios are compared on the same noise."""
        return Draws(seed)

    def readings(self, truth: Truth, sensor: SensorTable, draws: Draws) -> Iterator[Timed]:
        """What one sensor measures: `gps1`, `compass1` and `imu1` have the errors of the phases.

        Another sensor has the noise that the boat's file states for it, which follows the phases in proportion.
        """
        flaws = dict(self.flaws_of).get(sensor.id, self.flaws)
        every = ThesisSensor(sensor, phases_of(sensor, self.phases), flaws, draws).readings(truth, self.plane)
        return filter(self._is_given, every) if self.outages else every

    def _is_given(self, timed: Timed) -> bool:
        return not any(outage.sensor == timed.sensor and outage.covers(timed.t_s) for outage in self.outages)

    def works(self, sensor: str, t_s: Array) -> npt.NDArray[np.bool_]:
        """Whether the sensor gives something at each time (bool): not within an outage."""
        given = np.ones(len(t_s), dtype=np.bool_)
        for outage in self.outages:
            if outage.sensor == sensor:
                given &= np.logical_not(outage.covers(t_s))
        return given


@lru_cache(maxsize=16)
def _sailed(mission: Mission | Manoeuvres, current: VectorField) -> Truth:
    """One voyage for all seeds of a scenario, and for its variants that differ in noise alone."""
    truth = follow(mission) if isinstance(mission, Manoeuvres) else sail(mission, current)
    for column in fields(Truth):
        if (values := getattr(truth, column.name)) is not None:
            values.flags.writeable = False
    return truth


def with_outage(scenario: Scenario, from_s: float, length_s: float, sensor: str = "gps1") -> Scenario:
    """The scenario with one more outage; all other readings keep their values."""
    return replace(scenario, outages=(*scenario.outages, Outage(sensor, from_s, length_s)))


def with_bias(scenario: Scenario) -> Scenario:
    """The scenario with the full IMU bias of Table 5.4 left in."""
    return with_noise(scenario, **TABLE_5_4_BIAS)


def with_drift(scenario: Scenario) -> Scenario:
    """The scenario with the in-run drift of `realistic` in its IMU, beside whatever bias it has."""
    accel, gyro = REALISTIC.accel_drift, REALISTIC.gyro_drift_deg
    return replace(scenario, flaws=replace(scenario.flaws, accel_drift=accel, gyro_drift_deg=gyro))


def with_noise(scenario: Scenario, **errors: Any) -> Scenario:
    """The scenario with fields of `SensorErrors` replaced in every phase."""
    phases = tuple(replace(phase, errors=replace(phase.errors, **errors)) for phase in scenario.phases)
    return replace(scenario, phases=phases)


def realistic(scenario: Scenario) -> Scenario:
    """The scenario with the flaws of the preset `realistic`; its white GPS noise is Table 3.3's fast part."""
    white_m = budget_m(is_slow=False)
    return replace(with_noise(scenario, gps_east_m=white_m, gps_north_m=white_m), flaws=REALISTIC)
