"""A scenario of the thesis or a column recording as the virtual boat's source. Needs numpy."""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig
from common.simulation.voyage import Voyage
from common.units import NS_PER_S
from onboard.devices.encoder import Surroundings
from onboard.virtual.baud_pacing import SerialLine
from onboard.virtual.boat import LEAD_NS, PORTS, lines_of
from onboard.virtual.encoders import BoatEncoders
from onboard.virtual.voyage_files import TruthFile, boat_config

_HEAD: Final = """\
for the voyage {name!r}; matches what its pseudo-terminals send.
sigma_m is one number for both axes; a scenario's own noise may differ by axis and change under way.
"""


class VoyageSource:
    """Readings of a voyage, encoded as its devices would send them."""

    def __init__(self, voyage: Voyage) -> None:
        self.bauds: Mapping[str, int] = {plan.name: plan.baud for plan in PORTS}
        self.counted = ("sensor", tuple(plan.sensor for plan in PORTS))
        self._voyage = voyage
        self._truth = TruthFile(voyage)

    def head(self) -> str:
        """Which voyage."""
        return _HEAD.format(name=self._voyage.name)

    def config(self, ports: Mapping[str, str], bind: str) -> BoatConfig:
        """The boat of the scenario or recording."""
        return boat_config(self._voyage, dict(ports), bind)

    def ready(self, directory: Path) -> dict[str, Any]:
        """Where the truth will be, how long it takes, which rows were left out."""
        voyage = self._voyage
        return {"truth": str(directory / "truth.csv"), "seconds": voyage.seconds, "skipped": voyage.skipped}

    def lines(self, start_ns: int, clock_rate: float) -> Mapping[str, Iterator[SerialLine]]:
        """All readings, encoded as they come up."""
        # Receivers solve on whole seconds of UTC, so t = 0 is called a whole second: wrong by half a second at most.
        utc_ns = round((time.time_ns() + LEAD_NS / clock_rate) / NS_PER_S) * NS_PER_S
        voyage = self._voyage
        encoders = BoatEncoders(Surroundings(utc_ns, voyage.boat.variation_deg or 0.0))
        return {plan.name: lines_of(plan, voyage.readings, start_ns, encoders) for plan in PORTS}

    def started(self, directory: Path, start_ns: int) -> None:
        """Write the truth, whose times are boat times."""
        self._truth.write(directory / "truth.csv", start_ns)

    def done(self, counts: Mapping[str, int]) -> dict[str, Any]:
        """Nothing more."""
        del counts
        return {}
