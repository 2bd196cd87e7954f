"""Sensor detection: which sensors speak in a recording, by the drivers that accept its lines."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from common.sensors import ROLES, SensorTable
from common.units import NS_PER_S
from onboard.devices import MODELS, Accepted, Line, PortDecoder, make_driver
from onboard.reading.port_chain import COMPANIONS
from onboard.recorded.recording import Paced
from onboard.recorded.sentence_time import BITS_PER_BYTE

PAUSE_NS: Final = 10 * NS_PER_S
"""A longer time without lines does not count for a sensor's rate."""
_RATES_HZ: Final = (0.01, 1000.0)
_PORT: Final = "recorded"


@dataclass(frozen=True, slots=True)
class Found:
    """One sensor of a recording."""

    role: str
    model: str
    rate_hz: float | None
    """Measurements a second; `None` where the recording has no times."""


def sensors_in(paced: Paced) -> tuple[Found, ...]:
    """One sensor for each role of which the recording has good lines, in the order of `ROLES`.

    Of several models the one that accepts most lines, the first of the registry among equals. All talkers are one
    sensor: a second receiver or compass in the same stream is told apart by `talkers` in a configuration of one's own.
    A recording without any known line gets a receiver, so that the daemon has something to count refusals for.
    """
    lines = [Line(*line) for line in zip(paced.starts_ns, paced.recording.bare, paced.ends_ns, strict=True)]
    best: dict[str, tuple[int, str]] = {}
    for role, model in MODELS:
        count = _counts(lines, [_table(role, model)]).accepted[role]
        if count > best.get(role, (0, ""))[0]:
            best[role] = (count, model)
    tables = [_table(role, best[role][1]) for role in ROLES if role in best]
    # Again, together: of two drivers that would take the same lines the first has them.
    measured = _counts(lines, tables).measured
    active_s = _active_s([line.t_ns for line in lines]) if paced.timed else 0.0
    found = [
        Found(table.role, table.model, _rate_hz(measured[table.role], active_s))
        for table in tables
        if measured[table.role]
    ]
    return tuple(found) or (Found("gps", "nmea", None),)


def port_budget(baud: int) -> int:
    """Bytes a second that a port of this speed may send: what it can carry, never less than a second of it."""
    return max(2000, baud // BITS_PER_BYTE)


def sensor_tables(found: Sequence[Found], port: str, taken: Counter[str] | None = None) -> tuple[SensorTable, ...]:
    """`[[sensor]]` for each, numbered on from `taken` (how many of each role there are already)."""
    taken = Counter() if taken is None else taken
    tables = []
    for item in found:
        taken[item.role] += 1
        name = f"{item.role}{taken[item.role]}"
        tables.append(SensorTable(id=name, port=port, role=item.role, model=item.model, rate_hz=item.rate_hz))
    return tuple(tables)


def _table(role: str, model: str) -> SensorTable:
    return SensorTable(id=f"{role}1", port=_PORT, role=role, model=model)


@dataclass(slots=True)
class _Counts:
    """By role."""

    accepted: Counter[str] = field(default_factory=Counter)
    """Lines."""
    measured: Counter[str] = field(default_factory=Counter)
    """Measurements, companions left out."""


def _counts(lines: list[Line], tables: list[SensorTable]) -> _Counts:
    """What the sensors make of the lines."""
    drivers = [make_driver(table) for table in tables]
    decoder = PortDecoder(drivers)
    roles = {table.id: table.role for table in tables}
    counts = _Counts()
    for line in lines:
        if not any(driver.claims(line) for driver in drivers):
            continue
        made = decoder.flush(line.t_ns)
        outcome = decoder.feed(line)
        if isinstance(outcome, Accepted):
            counts.accepted[roles[outcome.sensor]] += 1
            made = (*made, *outcome.measurements)
        counts.measured.update(roles[item.sensor] for item in made if not isinstance(item, COMPANIONS))
    made = decoder.flush(lines[-1].t_ns + NS_PER_S)
    counts.measured.update(roles[item.sensor] for item in made if not isinstance(item, COMPANIONS))
    return counts


def _active_s(times_ns: list[int]) -> float:
    return sum(min(b - a, PAUSE_NS) for a, b in pairwise(times_ns)) / NS_PER_S


def _rate_hz(count: int, active_s: float) -> float | None:
    if count < 2 or active_s <= 0.0:
        return None
    low, high = _RATES_HZ
    return min(high, max(low, float(f"{count / active_s:.3g}")))
