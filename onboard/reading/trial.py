"""Port monitor outside the daemon: all ports of a boat are read for some seconds, by the daemon's own chains."""

import asyncio
import re
from dataclasses import dataclass
from typing import Final

from common.boat_config import ROLES, BoatConfig, PortTable, SensorTable
from common.clock import BoatClock, machine_clock_id
from common.framer import Identity
from common.units import NS_PER_S
from common.visible_lines import is_text, shown, strange_bytes
from onboard.devices.recognise import WANTED
from onboard.reading.acquisition import Acquisition
from onboard.reading.polled_port import PolledPort
from onboard.reading.port_access import Holder, holders_of, owner_of
from onboard.reading.port_chain import PortChain
from onboard.reading.sensor_health import SensorMonitor

_TICK_S: Final = 0.1
_SAMPLES: Final = 2
_HEX_BYTES: Final = 16


@dataclass(frozen=True, slots=True)
class SensorHeard:
    """One sensor after the trial."""

    table: SensorTable
    delivers: bool
    rate_hz: float
    """Rate of its measurements over the trial, Hz."""
    kinds: dict[str, int]
    """Number of good lines, by kind."""
    why: str
    """Why it does not deliver and what to do; "" = it does, or its silence is no fault (AIS, radar)."""


@dataclass(frozen=True, slots=True)
class PortHeard:
    """One port after the trial."""

    table: PortTable
    fault: str | None
    """Why it could not be opened, or was lost; `None` = it is open."""
    owner: str | None
    """Mode, owner and group of the device; `None` = it is not there."""
    holders: tuple[Holder, ...]
    """Other processes that have it open."""
    size: int
    """Number of bytes that came."""
    readable: float
    """Share of them in lines of text, 0 to 1."""
    unread: tuple[str, ...]
    """Names of the sentences that no sensor of the port takes."""
    samples: tuple[str, ...]
    """The last lines, or the last bytes in hexadecimal."""
    sensors: tuple[SensorHeard, ...]


async def heard(config: BoatConfig, seconds: float) -> list[PortHeard]:
    """Open all ports, read them for so long, and close them."""
    clock = BoatClock()
    now_ns = clock.now_ns()
    acquisition = Acquisition(
        config, Identity(config.boat.id, "0" * 16, machine_clock_id(), 0), now_ns, now_ns, _nothing
    )
    ports = [PolledPort(chain, clock) for chain in acquisition.chains]
    work = [asyncio.create_task(polled.port.run()) for polled in ports]
    try:
        await asyncio.gather(*(polled.port.tried.wait() for polled in ports))
        end_ns = clock.now_ns() + round(seconds * NS_PER_S)
        while (now_ns := clock.now_ns()) < end_ns:
            for polled in ports:
                polled.chain.flush(now_ns)
            await asyncio.sleep(_TICK_S)
        return [_port_heard(polled, now_ns, seconds) for polled in ports]
    finally:
        for task in work:
            task.cancel()
        await asyncio.gather(*work, return_exceptions=True)


def _nothing(_happening: object) -> None:
    """Nobody listens to the events of a trial."""


def _port_heard(polled: PolledPort, now_ns: int, seconds: float) -> PortHeard:
    chain, table = polled.chain, polled.chain.table
    data = chain.recent.newest()
    lines = [line for line in re.split(rb"[\r\n]+", data) if line]
    return PortHeard(
        table=table,
        fault=polled.port.reason,
        owner=owner_of(table.path),
        holders=tuple(holders_of(table.path)),
        size=chain.wire.heard_bytes,
        readable=_readable(lines),
        unread=tuple(name for name, _ in chain.tally.ignored.most_common() if name != "text"),
        samples=_samples(data, lines),
        sensors=tuple(_sensor_heard(chain, monitor, now_ns, seconds) for monitor in chain.monitors.values()),
    )


def _sensor_heard(chain: PortChain, monitor: SensorMonitor, now_ns: int, seconds: float) -> SensorHeard:
    table = monitor.table
    kinds = {kind: count for (sensor, kind), count in chain.tally.accepted.items() if sensor == table.id}
    monitor.report(now_ns)
    delivers, why = monitor.rate_hz > 0.0, ""
    if kinds and not delivers:
        why = f"{', '.join(kinds)} come, which say nothing of it alone: {WANTED.get(table.role, '')}"
    elif not delivers and (ROLES[table.role].periodic or chain.wire.heard_bytes):
        why = str(monitor.why_not(now_ns, chain.stranger(monitor)))
        if not chain.wire.heard_bytes and seconds * (table.rate_hz or ROLES[table.role].nominal_rate_hz) < 2.0:
            why = f"{why}; it sends seldom: listen longer (--listen S)"
    return SensorHeard(table, delivers, monitor.rate_hz, kinds, why)


def _readable(lines: list[bytes]) -> float:
    total = sum(map(len, lines))
    return sum(len(line) for line in lines if is_text(line)) / total if total else 0.0


def _samples(data: bytes, lines: list[bytes]) -> tuple[str, ...]:
    if 10 * strange_bytes(data) <= 3 * len(data):
        return tuple(map(shown, lines[-1 - _SAMPLES : -1] or lines))
    newest = data[-_SAMPLES * _HEX_BYTES :]
    return tuple(newest[at : at + _HEX_BYTES].hex(" ") for at in range(0, len(newest), _HEX_BYTES))
