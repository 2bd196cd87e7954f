"""All simulated worlds by name, and the voyage that the three-port boat makes in one."""

from typing import Final

from common.boat_config import BoatTable
from common.errors import WayfixError
from common.simulation.readings import Rates
from common.simulation.scenario import Scenario, World
from common.simulation.scenarios_own import OWN
from common.simulation.scenarios_real import REAL_SCENARIOS
from common.simulation.scenarios_thesis import THESIS
from common.simulation.three_port_boat import three_port_boat
from common.simulation.voyage import Voyage, boat_voyage
from common.words import did_you_mean

SCENARIOS: Final[dict[str, Scenario]] = {scenario.name: scenario for scenario in (*THESIS, *OWN)}
"""Scenarios of the laboratory: one track each, many runs."""
WORLDS: Final[dict[str, World]] = {**SCENARIOS, **{world.name: world for world in REAL_SCENARIOS}}
"""Everything that a virtual boat can sail: these, and the worlds that draw another boat and track from each seed."""
VARIATION_DEG: Final = -0.5
"""Variation that the three-port boat's file states, about that of the Solent in 2015."""


def find_scenario(name: str, where: str = "--scenario") -> Scenario:
    """The laboratory's scenario called `name`; raises WayfixError with the names there are, `where` it was given."""
    if name in WORLDS and name not in SCENARIOS:
        cure = "use wayfix demo --scenario or wayfix-onboard virtual --scenario"
        raise WayfixError(f"{name} has another track for each seed, and runs here share one", where, cure)
    if name not in SCENARIOS:
        what = f"there is no scenario {name!r}{did_you_mean(name, SCENARIOS)}"
        raise WayfixError(what, where, f"choose one of: {', '.join(SCENARIOS)}")
    return SCENARIOS[name]


def find_world(name: str, where: str = "--scenario") -> World:
    """The world called `name`; raises WayfixError with the names there are."""
    if name not in WORLDS:
        what = f"there is no scenario {name!r}{did_you_mean(name, WORLDS)}"
        raise WayfixError(what, where, f"choose one of: {', '.join(WORLDS)}")
    return WORLDS[name]


def scenario_voyage(name: str, seed: int = 1, seconds: float | None = None, rates: Rates | None = None) -> Voyage:
    """The three-port boat in a world. Equal arguments give equal readings; a shorter run is the start of a longer."""
    world = find_world(name)
    boat = BoatTable(id=f"virtual-{name}", variation_deg=VARIATION_DEG)
    return boat_voyage(world, three_port_boat(boat, world.facts, rates), seed, seconds)
