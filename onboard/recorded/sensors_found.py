"""Sensor detection: which sensors speak in a recording, by the drivers that accept its lines."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from common.boat_config import SensorTable
from common.units import NS_PER_S
from onboard.devices import Line
from onboard.devices.recognise import heard_by, recognised_by_role
from onboard.recorded.line_times import BITS_PER_BYTE
from onboard.recorded.recording import Paced

PAUSE_NS: Final = 10 * NS_PER_S
"""A longer time without lines does not count for a sensor's rate."""
_RATES_HZ: Final = (0.01, 1000.0)


@dataclass(frozen=True, slots=True)
class Found:
    """One sensor of a recording."""

    role: str
    model: str
    rate_hz: float | None
    """Rate of measurements, Hz; `None` where the recording has no times."""


def sensors_in(paced: Paced) -> tuple[Found, ...]:
    """One sensor for each role of which the recording has good lines, in the order of `ROLES`.

    Of several models the one that accepts most lines, the first of the registry among equals. All talkers are one
    sensor: a second receiver or compass in the same stream needs a configuration of one's own with `talkers`.
    Sentences of other clocks (`onboard.recorded.clocks`) are left out.
    A recording without any known line gets a receiver, so that the daemon has something to count refusals for.
    """
    lines = [
        Line(*line)
        for number, line in enumerate(zip(paced.starts_ns, paced.recording.bare, paced.ends_ns, strict=True))
        if number not in paced.schedule.unused
    ]
    found = [Found(role, model, None) for role, model in recognised_by_role(lines).items()]
    tables = sensor_tables(found, "")
    # Again, together: of two drivers that would take the same lines the first has them.
    measured = heard_by(tables, lines).measured
    active_s = _active_s([line.t_ns for line in lines]) if paced.timed else 0.0
    speaking = tuple(
        Found(table.role, table.model, _rate_hz(measured[table.id], active_s)) for table in tables if measured[table.id]
    )
    return speaking or (Found("gps", "nmea", None),)


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


def _active_s(times_ns: list[int]) -> float:
    return sum(min(b - a, PAUSE_NS) for a, b in pairwise(times_ns)) / NS_PER_S


def _rate_hz(count: int, active_s: float) -> float | None:
    if count < 2 or active_s <= 0.0:
        return None
    low, high = _RATES_HZ
    return min(high, max(low, float(f"{count / active_s:.3g}")))
