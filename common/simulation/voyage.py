"""A voyage: readings and the ground truth behind them, the same for a simulated scenario and a played recording."""

from dataclasses import dataclass, field

from common.boat_config import BoatTable
from common.geodesy import LocalPlane
from common.simulation.motion import Truth
from common.simulation.readings import Rates, SensorFacts, Timed


@dataclass(frozen=True, slots=True, kw_only=True)
class Voyage:
    """Everything a virtual boat plays: readings in time order, the truth behind them, and what its file claims."""

    name: str
    boat: BoatTable
    plane: LocalPlane
    truth: Truth
    readings: tuple[Timed, ...]
    facts: SensorFacts
    rates: Rates
    skipped: dict[str, int] = field(default_factory=dict)
    """Rows of a recording that had an empty field, by what they were needed for."""

    @property
    def seconds(self) -> float:
        """Time of the last reading."""
        return self.readings[-1].t_s if self.readings else 0.0
