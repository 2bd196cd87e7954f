"""The thesis' simulation scenarios by name: a table; one row is one scenario."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.sensors import BoatTable
from common.simulation.fields import CurrentField, WavyCurrent
from common.simulation.motion import Mission, Truth, grid, sail
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Rates, SensorFacts, Timed
from common.simulation.sensors import (
    Phase,
    SensorErrors,
    compass_heading_deg,
    generators,
    gps_position,
    gps_velocity,
    imu_samples,
)
from common.simulation.voyage import Voyage

SOLENT: Final = LocalPlane(50.76, -1.29)
"""Origin of the simulated plane, near Cowes: a schematic stand-in. The thesis prints its map without coordinates, so
the track crosses land and sea as it likes."""

TRACK_1: Final = Mission(
    start=(765.0, 728.0), waypoints=((650.0, 385.0), (320.0, 190.0), (30.0, 250.0)), heading_deg=210.0
)
"""T1 of Table 4.6 and Eq. 4.57; turn rate and clearance are not printed (docs/thesis-map.md)."""

SOLENT_TIDE: Final = WavyCurrent(drift_m_s=0.5, towards_deg=235.0, swing_deg=45.0, wavelength_m=800.0)
"""The varied current of Scenario 4.4, which the thesis shows only as a picture."""

TABLE_5_4: Final = SensorErrors(
    gps_east_m=8.0, gps_north_m=7.0, compass_deg=0.8, accel_density=0.004, gyro_density_deg=0.036
)
POOR: Final = replace(TABLE_5_4, gps_east_m=20.0, gps_north_m=20.0, compass_deg=5.0)
"""Scenario 5.2."""
TABLE_5_4_BIAS: Final = {"bias_accel_fwd_m_s2": 0.03, "bias_accel_stb_m_s2": 0.02, "bias_yaw_rate_deg_s": 0.28}
"""For `replace(errors, **TABLE_5_4_BIAS)`; removed before the filter in the thesis' own runs."""

TABLE_5_3: Final = SensorFacts(sigma_m=6.5, sigma_deg=0.5, accel_density=0.0039, gyro_density_deg=0.033)
"""What the filter is told. Table 5.3 has 6 m east and 7 m north; a receiver's entry holds one number, so 6.5."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """A mission, the water it goes through, and what the sensors do along the way."""

    text: str
    mission: Mission
    current: CurrentField
    phases: tuple[Phase, ...]
    facts: SensorFacts


SCENARIOS: Final[dict[str, Scenario]] = {
    "5.3": Scenario(
        text="two turns in a varying current; after 300 s the GPS noise rises to 20 m and the compass noise to 5 deg",
        mission=TRACK_1,
        current=SOLENT_TIDE,
        phases=(Phase(0.0, TABLE_5_4), Phase(300.0, POOR)),
        facts=TABLE_5_3,
    ),
}


def find_scenario(name: str) -> Scenario:
    """The scenario called `name`; raises WayfixError with the names there are."""
    if name not in SCENARIOS:
        raise WayfixError(f"there is no scenario {name!r}", "--scenario", f"choose one of: {', '.join(SCENARIOS)}")
    return SCENARIOS[name]


def scenario_voyage(name: str, seed: int = 1, seconds: float | None = None, rates: Rates | None = None) -> Voyage:
    """Sail a scenario and measure it. Equal arguments give equal readings; a shorter run is the start of a longer."""
    scenario, rates = find_scenario(name), rates or Rates()
    truth = sail(scenario.mission, scenario.current).until(seconds)
    readings = sorted(_measure(truth, scenario, seed, rates), key=lambda timed: timed.t_s)
    return Voyage(
        name=name,
        boat=BoatTable(id=f"virtual-{name}", variation_deg=-0.5),
        plane=SOLENT,
        truth=truth,
        readings=tuple(readings),
        facts=scenario.facts,
        rates=rates,
    )


def _measure(truth: Truth, scenario: Scenario, seed: int, rates: Rates) -> Iterator[Timed]:
    draw = generators(seed)
    duration_s = float(truth.t_s[-1])

    seen = truth.at(grid(duration_s, rates.gps_hz))
    east, north = gps_position(seen, scenario.phases, draw["gps1"])
    v_east, v_north = gps_velocity(seen, scenario.phases, draw["gps1 velocity"])
    for row, t_s in enumerate(seen.t_s.tolist()):
        place = SOLENT.to_lat_lon_deg(float(east[row]), float(north[row]))
        yield Timed(t_s, "gps1", FixReading(*place, float(v_east[row]), float(v_north[row])))

    seen = truth.at(grid(duration_s, rates.compass_hz))
    headings = compass_heading_deg(seen, scenario.phases, draw["compass1"])
    for t_s, heading in zip(seen.t_s.tolist(), headings.tolist(), strict=True):
        yield Timed(t_s, "compass1", HeadingReading(heading))

    seen = truth.at(grid(duration_s, rates.imu_hz))
    samples = imu_samples(seen, scenario.phases, draw["imu1"])
    for t_s, sample in zip(seen.t_s[1:].tolist(), samples.tolist(), strict=True):
        yield Timed(t_s, "imu1", ImuReading(*sample))
