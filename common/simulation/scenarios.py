"""All simulation scenarios by name, and the voyage a virtual boat makes of one."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from common.boat_config import BoatTable
from common.errors import WayfixError
from common.simulation.motion import Array, Truth, grid
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Rates, Timed
from common.simulation.scenario import Scenario, Sensor
from common.simulation.scenarios_own import OWN
from common.simulation.scenarios_thesis import THESIS
from common.simulation.sensor_models import Draws, compass_heading_deg, gps_position, gps_velocity, imu_samples
from common.simulation.voyage import Voyage

SCENARIOS: Final[dict[str, Scenario]] = {scenario.name: scenario for scenario in (*THESIS, *OWN)}


def find_scenario(name: str, where: str = "--scenario") -> Scenario:
    """The scenario called `name`; raises WayfixError with the names there are, `where` the wrong one was given."""
    if name not in SCENARIOS:
        raise WayfixError(f"there is no scenario {name!r}", where, f"choose one of: {', '.join(SCENARIOS)}")
    return SCENARIOS[name]


def scenario_voyage(name: str, seed: int = 1, seconds: float | None = None, rates: Rates | None = None) -> Voyage:
    """Sail a scenario and measure it. Equal arguments give equal readings; a shorter run is the start of a longer."""
    scenario, rates = find_scenario(name), rates or Rates()
    truth = scenario.truth().until(seconds)
    readings = sorted(_measure(truth, scenario, seed, rates), key=lambda timed: timed.t_s)
    return Voyage(
        name=name,
        boat=BoatTable(id=f"virtual-{name}", variation_deg=-0.5),
        plane=scenario.plane,
        truth=truth,
        readings=tuple(readings),
        facts=scenario.facts,
        rates=rates,
    )


def _measure(truth: Truth, scenario: Scenario, seed: int, rates: Rates) -> Iterator[Timed]:
    draws = Draws(seed)
    duration_s = float(truth.t_s[-1])

    seen = truth.at(grid(duration_s, rates.gps_hz))
    places = gps_position(seen, scenario.phases, draws, scenario.flaws)[0]
    velocities = gps_velocity(seen, scenario.phases, draws)[0]
    for row in _given(scenario, "gps1", seen.t_s):
        lat_lon = scenario.plane.to_lat_lon_deg(*places[row].tolist())
        yield Timed(float(seen.t_s[row]), "gps1", FixReading(*lat_lon, *velocities[row].tolist()))

    seen = truth.at(grid(duration_s, rates.compass_hz))
    headings = compass_heading_deg(seen, scenario.phases, draws, scenario.flaws)[0]
    for row in _given(scenario, "compass1", seen.t_s):
        yield Timed(float(seen.t_s[row]), "compass1", HeadingReading(float(headings[row])))

    seen = truth.at(grid(duration_s, rates.imu_hz))
    samples = imu_samples(seen, scenario.phases, draws, scenario.flaws).values[0]
    for t_s, sample in zip(seen.t_s[1:].tolist(), samples.tolist(), strict=True):
        yield Timed(t_s, "imu1", ImuReading(*sample))


def _given(scenario: Scenario, sensor: Sensor, t_s: Array) -> list[int]:
    """Rows in which the sensor gives something."""
    rows: list[int] = np.flatnonzero(scenario.works(sensor, t_s)).tolist()
    return rows
