"""A voyage: readings and the ground truth behind them, the same for a simulated world and a played recording."""

from dataclasses import dataclass, field
from itertools import chain
from operator import attrgetter

from common.boat_config import BoatConfig, BoatTable
from common.geodesy import LocalPlane
from common.simulation.motion import Truth
from common.simulation.readings import Timed
from common.simulation.scenario import World


@dataclass(frozen=True, slots=True, kw_only=True)
class Voyage:
    """Everything a virtual boat plays: readings in time order, the truth behind them, and what its file claims."""

    name: str
    config: BoatConfig
    """The boat's file: its ports and sensors. Where the ports are is not settled before they are made."""
    plane: LocalPlane
    truth: Truth
    readings: tuple[Timed, ...]
    skipped: dict[str, int] = field(default_factory=dict)
    """Rows of a recording that had an empty field, by what they were needed for."""

    @property
    def boat(self) -> BoatTable:
        """The vessel itself."""
        return self.config.boat

    @property
    def seconds(self) -> float:
        """Time of the last reading."""
        return self.readings[-1].t_s if self.readings else 0.0


def boat_voyage(world: World, config: BoatConfig, seed: int = 1, seconds: float | None = None) -> Voyage:
    """Sail a world with the sensors of a boat's file. Equal arguments give equal readings.

    What a sensor measures depends on world, seed and its own table, never on what other sensors there are. In one
    instant the sensors speak in the order of the file.
    """
    truth, draws = world.truth(seed, seconds), world.draws(seed)
    each = [world.readings(truth, sensor, draws) for sensor in config.sensor]
    readings = sorted(chain.from_iterable(each), key=attrgetter("t_s"))
    return Voyage(name=world.name, config=config, plane=world.plane, truth=truth, readings=tuple(readings))
