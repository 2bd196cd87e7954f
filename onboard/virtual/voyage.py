"""A scenario of the thesis or a column recording as the virtual boat's source. Needs numpy."""

import heapq
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig, SensorTable
from common.simulation.measured import Measured
from common.simulation.voyage import Voyage
from common.units import NS_PER_MS, NS_PER_S, NS_PER_US
from onboard.devices import Surroundings, make_encoder
from onboard.recorded.line_times import BITS_PER_BYTE
from onboard.virtual.baud_pacing import SerialLine
from onboard.virtual.boat import LEAD_NS
from onboard.virtual.voyage_files import TruthFile, placed

_HEAD: Final = """\
for the voyage {name!r}; matches what its pseudo-terminals send.
sigma_m is one number for both axes; a scenario's own noise may differ by axis and change under way.
"""


LOOK_NS: Final = 20 * NS_PER_S
"""Part of a voyage over which the load of a port is judged, ns; all of a shorter one, but at least `LEAST_LOOK_NS`."""
LEAST_LOOK_NS: Final = 5 * NS_PER_S


class VoyageSource:
    """Readings of a voyage, encoded as its devices would send them."""

    def __init__(self, voyage: Voyage) -> None:
        self.bauds: Mapping[str, int] = {port.name: port.baud for port in voyage.config.port}
        self.counted = ("sensor", tuple(sensor.id for sensor in voyage.config.sensor))
        self._voyage = voyage
        self._truth = TruthFile(voyage)

    def head(self) -> str:
        """Which voyage."""
        return _HEAD.format(name=self._voyage.name)

    def config(self, ports: Mapping[str, str], bind: str) -> BoatConfig:
        """The boat of the scenario or recording."""
        return placed(self._voyage.config, ports, bind)

    def ready(self, directory: Path) -> dict[str, Any]:
        """Where the truth will be, how long it takes, which rows were left out."""
        voyage = self._voyage
        return {"truth": str(directory / "truth.csv"), "seconds": voyage.seconds, "skipped": voyage.skipped}

    def lines(self, start_ns: int, clock_rate: float) -> Mapping[str, Iterator[SerialLine]]:
        """All readings, encoded as they come up."""
        # Receivers solve on whole seconds of UTC, so t = 0 is called a whole second: wrong by half a second at most.
        utc_ns = round((time.time_ns() + LEAD_NS / clock_rate) / NS_PER_S) * NS_PER_S
        return {port.name: self._lines(port.name, start_ns, utc_ns) for port in self._voyage.config.port}

    def _lines(self, port: str, start_ns: int, utc_ns: int) -> Iterator[SerialLine]:
        """The lines of one port, encoded as they come up; t = 0 of the readings is boat time `start_ns`."""
        sensors = (sensor for sensor in self._voyage.config.sensor if sensor.port == port)
        each = [self._lines_of(sensor, start_ns, utc_ns) for sensor in sensors]
        return heapq.merge(*each, key=lambda line: line.ready_ns)

    def _lines_of(self, sensor: SensorTable, start_ns: int, utc_ns: int) -> Iterator[SerialLine]:
        variation_deg = self._voyage.boat.variation_deg or 0.0
        encoder = make_encoder(sensor, Surroundings(utc_ns, variation_deg))
        measured = Measured(sensor, variation_deg, utc_ns)
        latency_ns = round(sensor.latency_ms * NS_PER_MS)
        for timed in self._voyage.readings:
            if timed.sensor != sensor.id:
                continue
            t_ns = start_ns + round(timed.t_s * 1e6) * NS_PER_US
            first = next(measured.measurements(timed.t_s, t_ns, timed.reading))
            values = {name: value for name, value in asdict(first).items() if value is not None}
            record = {"kind": type(first).__name__, **values}
            yield SerialLine(t_ns + latency_ns, encoder.encode(timed.t_s, timed.reading), record)

    def overloads(self) -> Iterator[str]:
        """A sentence for each port that cannot carry its lines: they queue, and come later and later."""
        look_ns = min(LOOK_NS, max(LEAST_LOOK_NS, round(self._voyage.seconds * NS_PER_S)))
        for port in self._voyage.config.port:
            lines = takewhile(lambda line: line.ready_ns < look_ns, self._lines(port.name, 0, 0))
            share = sum(len(line.data) for line in lines) * BITS_PER_BYTE * NS_PER_S / (port.baud * look_ns)
            if share > 1.0:
                yield (
                    f"{port.name}: {port.baud} baud carry {1.0 / share:.0%} of what its sensors send, so lines come "
                    "later and later; raise baud or lower rate_hz"
                )

    def started(self, directory: Path, start_ns: int) -> None:
        """Write the truth, whose times are boat times."""
        self._truth.write(directory / "truth.csv", start_ns)

    def done(self, counts: Mapping[str, int]) -> dict[str, Any]:
        """Nothing more."""
        del counts
        return {}
