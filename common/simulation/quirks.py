"""Device quirks: what single sensors of a virtual boat do on top of their errors, switched on by name."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

from common.errors import WayfixError
from common.simulation.readings import FixReading, HeadingReading, Timed
from common.simulation.voyage import Voyage

HOLDS_BELOW_M_S: Final = 1.2
"""Speed below which static navigation holds the fix, m/s; it lets go above `FREE_ABOVE_M_S` (SiRF's application note on
static navigation, as repeated in the manuals of BU-353 and kin)."""
FREE_ABOVE_M_S: Final = 1.4
FREE_BEYOND_M: Final = 50.0
"""Distance of the true fix from the held one at which a receiver lets go at any speed, m."""
DISTURBED_S: Final = (40.0, 60.0)
"""Part of each minute in which a compass beside a switched motor says that its field is disturbed, s."""


@dataclass(frozen=True, slots=True)
class Quirk:
    """One habit of devices of a role."""

    role: str
    text: str
    change: Callable[[Iterable[Timed]], Iterator[Timed]]
    """Makes the readings of one sensor what a device with the quirk gives."""
    models: tuple[str, ...] = ()
    """Models that can show it; empty = all of the role."""


def _static_navigation(readings: Iterable[Timed]) -> Iterator[Timed]:
    held: FixReading | None = None
    for timed in readings:
        fix = timed.reading
        if not isinstance(fix, FixReading) or fix.v_east_m_s is None or fix.v_north_m_s is None:
            yield timed
            continue
        speed = math.hypot(fix.v_east_m_s, fix.v_north_m_s)
        if held is not None and (speed > FREE_ABOVE_M_S or _apart_m(held, fix) > FREE_BEYOND_M):
            held = None
        elif held is None and speed < HOLDS_BELOW_M_S:
            held = fix
        if held is not None:
            fix = replace(fix, lat_deg=held.lat_deg, lon_deg=held.lon_deg, v_east_m_s=0.0, v_north_m_s=0.0)
        yield replace(timed, reading=fix)


def _apart_m(first: FixReading, second: FixReading) -> float:
    metres_per_deg = 111_195.0
    east_deg = math.remainder(second.lon_deg - first.lon_deg, 360.0) * math.cos(math.radians(first.lat_deg))
    return metres_per_deg * math.hypot(second.lat_deg - first.lat_deg, east_deg)


def _four_decimals(readings: Iterable[Timed]) -> Iterator[Timed]:
    for timed in readings:
        fix = timed.reading
        yield replace(timed, reading=replace(fix, minute_decimals=4)) if isinstance(fix, FixReading) else timed


def _whole_degrees(readings: Iterable[Timed]) -> Iterator[Timed]:
    for timed in readings:
        heading = timed.reading
        yield replace(timed, reading=replace(heading, decimals=0)) if isinstance(heading, HeadingReading) else timed


def _disturbed(readings: Iterable[Timed]) -> Iterator[Timed]:
    for timed in readings:
        heading = timed.reading
        if isinstance(heading, HeadingReading) and DISTURBED_S[0] <= timed.t_s % 60.0 < DISTURBED_S[1]:
            yield replace(timed, reading=replace(heading, disturbed=True))
        else:
            yield timed


QUIRKS: Final = {
    "static-navigation": Quirk("gps", "a SiRF receiver repeats its fix while the boat is slow", _static_navigation),
    "four-decimals": Quirk("gps", "minutes with four decimals, 0.19 m of latitude each", _four_decimals),
    "whole-degrees": Quirk("compass", "headings without decimals", _whole_degrees),
    "disturbed": Quirk(
        "compass",
        "the distortion word (TCM2) or status letter (HMR3000), a third of each minute",
        _disturbed,
        ("tcm2", "hmr3000"),
    ),
}


def with_quirks(voyage: Voyage, wanted: Sequence[str], where: str = "--quirk") -> Voyage:
    """The voyage with quirks, each `SENSOR:NAME`; raises WayfixError where boat or role do not fit."""
    for text in wanted:
        voyage = _with_one(voyage, text, where)
    return voyage


def _with_one(voyage: Voyage, text: str, where: str) -> Voyage:
    sensor, _, name = text.partition(":")
    tables = {table.id: table for table in voyage.config.sensor}
    quirk, table = QUIRKS.get(name), tables.get(sensor)
    if quirk is None:
        raise WayfixError(f"{text!r} names no quirk", where, f"give SENSOR:NAME with one of {', '.join(QUIRKS)}")
    if table is None:
        raise WayfixError(f"the boat has no sensor {sensor!r}", where, f"choose one of: {', '.join(tables)}")
    if table.role != quirk.role:
        words = f"{name} is for a {quirk.role}, {sensor} is a {table.role}"
        raise WayfixError(words, where, "choose another sensor")
    if quirk.models and table.model not in quirk.models:
        words = f"{name} is for {' and '.join(quirk.models)}, {sensor} is a {table.model}"
        raise WayfixError(words, where, "choose another sensor")
    changed = quirk.change(timed for timed in voyage.readings if timed.sensor == sensor)
    readings = tuple(next(changed) if timed.sensor == sensor else timed for timed in voyage.readings)
    return replace(voyage, readings=readings)
