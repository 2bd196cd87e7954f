"""Device identification: whose lines are these? Judged by what the drivers of all models make of them. Pure."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from common.boat_config import ROLES, SensorTable
from common.framer import Measurement
from common.units import NS_PER_S
from onboard.devices.driver import COMPANIONS, Accepted, Line
from onboard.devices.port_decoder import PortDecoder
from onboard.devices.registry import MODELS, make_driver


@dataclass(slots=True)
class Heard:
    """What sensors made of lines, by sensor id."""

    accepted: Counter[str] = field(default_factory=Counter)
    """Number of accepted lines of each sensor."""
    measured: Counter[str] = field(default_factory=Counter)
    """Number of measurements of each sensor, companions left out."""

    def measure(self, measurements: Iterable[Measurement]) -> None:
        """Count what came of one line, or of a pause."""
        self.measured.update(item.sensor for item in measurements if not isinstance(item, COMPANIONS))


def heard_by(tables: Iterable[SensorTable], lines: Sequence[Line]) -> Heard:
    """What these sensors, together on one port, make of the lines: the first that claims a line has it."""
    drivers = [make_driver(table) for table in tables]
    decoder = PortDecoder(drivers)
    heard = Heard()
    for line in lines:
        if not any(driver.claims(line) for driver in drivers):
            continue
        heard.measure(decoder.flush(line.t_ns))
        outcome = decoder.feed(line)
        if isinstance(outcome, Accepted):
            heard.accepted[outcome.sensor] += 1
            heard.measure(outcome.measurements)
    if lines:
        heard.measure(decoder.flush(lines[-1].t_ns + NS_PER_S))
    return heard


def accepted_by_model(lines: Sequence[Line]) -> dict[tuple[str, str], int]:
    """Good lines by (role, model), in the order of `MODELS`, each model by itself; those without any are left out."""
    counts = {}
    for role, model in MODELS:
        table = SensorTable(id=f"{role}1", port="", role=role, model=model)
        counts[role, model] = heard_by([table], lines).accepted[table.id]
    return {key: count for key, count in counts.items() if count}


def recognised(lines: Iterable[Line]) -> tuple[str, str] | None:
    """Role and model whose driver accepts most of these lines, the first in `MODELS` of equals; None = none."""
    counts = accepted_by_model(tuple(lines))
    return max(counts, key=lambda key: counts[key], default=None)


def recognised_by_role(lines: Sequence[Line]) -> dict[str, str]:
    """The model that accepts most of the lines, for each role with good lines, in the order of `ROLES`.

    The first in `MODELS` of equals.
    """
    counts = accepted_by_model(lines)
    best: dict[str, str] = {}
    for role, model in counts:
        if role not in best or counts[role, model] > counts[role, best[role]]:
            best[role] = model
    return {role: best[role] for role in ROLES if role in best}
