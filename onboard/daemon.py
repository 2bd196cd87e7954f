"""The daemon: one asyncio loop owns ports, framer and socket.

port chunk -> lines -> devices -> framer --tick--> server
                          |
                          `-> health (counts, silence)
"""

import asyncio
import logging
import os
import secrets
import signal
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from common.clock import BoatClock, machine_clock_id
from common.events import event, line_of
from common.messages import ClockPair, Event, Frame, RawLine
from common.sensors import BoatConfig, PortTable
from common.settings import as_dict
from common.units import NS_PER_S, NS_PER_US
from onboard.budget import ByteBudget
from onboard.clockmap import ClockMap
from onboard.config import byte_budget
from onboard.devices import PortDecoder, make_driver
from onboard.devices.base import Accepted, Measurement, Rejected
from onboard.framer import Framer, Identity
from onboard.health import SensorMonitor
from onboard.lines import LineSplitter
from onboard.ports import Port
from onboard.server import Server

log = logging.getLogger(__name__)

DRAIN_S: Final = 0.5
CATCH_UP_NS: Final = 60 * NS_PER_S
"""A board that slept longer than this (suspend) leaves a hole in the grid instead of a burst of empty frames."""
COMPANIONS: Final = (RawLine, ClockPair)
"""What comes along with a measurement and is none itself: not counted in a sensor's rate."""
_LOG_LEVELS: Final = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


def versions() -> dict[str, str]:
    """Versions of what decides the result; goes into `connected` and the log."""
    found = {}
    for name in ("wayfix", "pyserial", "pynmea2", "pyzmq", "msgpack"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def next_start_no(state_dir: Path | None) -> tuple[int, str | None]:
    """Count one more start in the state directory (0 without one): the number, and why it could not be kept.

    A boat must sail: a counter that is damaged or cannot be written is a warning, never a refusal.
    """
    if state_dir is None:
        return 0, None
    file = state_dir / "start_no"
    number, fault = 1, None
    try:
        if file.exists():
            number = int(file.read_text(encoding="ascii")) + 1
    except (OSError, ValueError) as error:
        fault = f"{file}: {error}"
    try:
        state_dir.mkdir(parents=True, exist_ok=True)
        temporary = file.with_suffix(".new")
        with temporary.open("w", encoding="ascii") as stream:
            stream.write(f"{number}\n")
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(file)
    except OSError as error:
        fault = f"{file}: {error.strerror}"
    return number, fault


class PortChain:
    """One port and everything its bytes run through before they are a measurement."""

    def __init__(self, daemon: "Daemon", table: PortTable) -> None:
        sensors = [sensor for sensor in daemon.config.sensor if sensor.port == table.name]
        self.table = table
        self.monitors = [daemon.monitors[sensor.id] for sensor in sensors]
        self.decoder = PortDecoder([make_driver(sensor) for sensor in sensors])
        self._daemon = daemon
        self._splitter = LineSplitter()
        self._budget = ByteBudget(byte_budget(table, daemon.config))
        self._flood_ns: int | None = None
        self._state = "new"
        self.port = Port(table, daemon.clock, self.chunk, self.changed)

    def chunk(self, data: bytes, t_ns: int) -> None:
        """Bytes as read, stamped once."""
        for monitor in self.monitors:
            monitor.heard_bytes += len(data)
        allowed = self._budget.take(len(data), t_ns)
        for line in self._splitter.feed(data[:allowed], t_ns):
            self._count(self.decoder.feed(line), t_ns)
        if allowed < len(data):
            self._cut(len(data) - allowed, t_ns)

    def flush(self, now_ns: int) -> None:
        """What is due without another line, and the end of a flood."""
        for measurement in self.decoder.flush(self._splitter.complete_until(now_ns)):
            if not isinstance(measurement, COMPANIONS):
                self._daemon.monitors[measurement.sensor].measured(now_ns)
            self._daemon.take(measurement)
        if self._flood_ns is not None and now_ns - self._flood_ns > NS_PER_S:
            self._flood_ns = None
            self._mark_flood(False, now_ns)

    def changed(self, reason: str | None) -> None:
        """The port opened (None) or was lost. One event for each loss and each return, whatever is tried in between."""
        now_ns = self._daemon.clock.now_ns()
        name = self.table.name
        if reason is None:
            self._splitter.reset()
            self._daemon.happened(event("port-opened", now_ns, name, port=name, path=self.table.path))
        elif self._state == "open":
            self._daemon.happened(event("port-lost", now_ns, name, port=name, reason=reason))
        elif self._state == "new":
            self._daemon.happened(event("port-missing", now_ns, name, port=name, reason=reason))
        self._state = "open" if reason is None else "closed"
        for monitor in self.monitors:
            monitor.port_changed(reason, now_ns)

    def reopen_if_silent(self, now_ns: int) -> None:
        """A port whose periodic sensors all fell silent is opened anew: some adapters need it."""
        periodic = [monitor for monitor in self.monitors if monitor.periodic]
        if periodic and all(monitor.overdue(now_ns) for monitor in periodic):
            self.port.reopen()
            self._splitter.reset()
            for monitor in self.monitors:
                monitor.port_changed(None, now_ns)

    def _count(self, outcome: object, t_ns: int) -> None:
        if isinstance(outcome, Accepted):
            measured = any(not isinstance(item, COMPANIONS) for item in outcome.measurements)
            self._daemon.monitors[outcome.sensor].accept(t_ns, measured)
            for measurement in outcome.measurements:
                self._daemon.take(measurement)
        elif isinstance(outcome, Rejected):
            # A line that names no sensor counts for every sensor of the port: each of them may have sent it.
            for monitor in self.monitors:
                if outcome.sensor in (None, monitor.table.id):
                    monitor.reject(outcome.reason)

    def _cut(self, count: int, t_ns: int) -> None:
        self._splitter.note_cut()
        for monitor in self.monitors:
            monitor.discarded_bytes += count
        if self._flood_ns is None:
            self._mark_flood(True, t_ns)
        self._flood_ns = t_ns

    def _mark_flood(self, flooded: bool, t_ns: int) -> None:
        for monitor in self.monitors:
            monitor.flooded = flooded
        code = "port-flooded" if flooded else "port-calm"
        budget = self._budget.bytes_per_s
        self._daemon.happened(event(code, t_ns, self.table.name, port=self.table.name, budget=budget))


class Daemon:
    """Owns everything that lives between start and SIGTERM."""

    def __init__(self, config: BoatConfig, clock: BoatClock, state_dir: Path | None = None) -> None:
        self.config = config
        self.clock = clock
        self.period_ns = round(NS_PER_S / config.frames.rate_hz)
        now_ns = clock.now_ns()
        start_no, self._state_fault = next_start_no(state_dir)
        identity = Identity(config.boat.id, secrets.token_hex(8), machine_clock_id(), start_no)
        self._next_tick_ns = (now_ns // self.period_ns + 1) * self.period_ns
        self.framer = Framer(
            identity, [sensor.id for sensor in config.with_role("imu")], self._next_tick_ns - self.period_ns
        )
        self.monitors = {sensor.id: SensorMonitor(sensor, now_ns) for sensor in config.sensor}
        self.clock_map = ClockMap()
        self.chains = [PortChain(self, table) for table in config.port]
        self.server = Server(self._connected, self.period_ns, self.happened, clock.now_ns)
        self._stop = asyncio.Event()
        self._stop_reason = ""

    def take(self, measurement: Measurement) -> None:
        """A measurement of any driver goes into the frame; clock pairs also move the UTC mapping."""
        self.framer.add(measurement)
        if isinstance(measurement, ClockPair) and (step_s := self.clock_map.add(measurement)) is not None:
            now_ns = self.clock.now_ns()
            self.happened(event("clock-stepped", now_ns, measurement.sensor, sensor=measurement.sensor, step_s=step_s))

    def happened(self, happening: Event) -> None:
        """Every event is a record in the frame and one line in the log."""
        log.log(_LOG_LEVELS[happening.level], "%s", line_of(happening))
        self.framer.add(happening)

    def stop(self, reason: str) -> None:
        """Ask the daemon to end."""
        self._stop_reason = reason
        self._stop.set()

    async def run(self, bind: str, on_ready: Callable[[dict[str, Any]], None]) -> None:
        """Run until `stop`; on_ready is told where the socket listens once ports are polled. Raises WayfixError."""
        endpoint = self.server.bind(bind)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            loop.add_signal_handler(number, self.stop, signal.Signals(number).name)
        self.happened(event("daemon-started", self.clock.now_ns(), "daemon", sensors=len(self.config.sensor)))
        if self._state_fault is not None:
            self.happened(event("state-unusable", self.clock.now_ns(), "daemon", reason=self._state_fault))
        workers = [asyncio.create_task(chain.port.run()) for chain in self.chains]
        workers += [asyncio.create_task(self.server.run()), asyncio.create_task(self._tick_for_ever())]
        stopping = asyncio.create_task(self._stop.wait())
        try:
            tried = asyncio.create_task(self._all_tried())
            await asyncio.wait([tried, *workers, stopping], return_when=asyncio.FIRST_COMPLETED)
            tried.cancel()
            on_ready({"bind": endpoint, "boot_id": self.framer.identity.boot_id, "boat_id": self.config.boat.id})
            done, _ = await asyncio.wait([*workers, stopping], return_when=asyncio.FIRST_COMPLETED)
            for task in done - {stopping}:
                task.result()  # a worker never ends by itself: let its error out
        finally:
            stopping.cancel()
            for worker in workers:
                worker.cancel()
            await asyncio.gather(*workers, stopping, return_exceptions=True)
            await self._finish()

    async def _all_tried(self) -> None:
        for chain in self.chains:
            await chain.port.tried.wait()

    async def _finish(self) -> None:
        """The last, shorter frame and `end` to every client."""
        now_ns = self.clock.now_ns()
        self.happened(event("daemon-stopping", now_ns, "daemon", reason=self._stop_reason or "error"))
        for chain in self.chains:
            chain.flush(now_ns + NS_PER_S)
        self.server.publish(self._frame(max(now_ns, self.framer.t0_ns) + NS_PER_US))
        self.server.end_all("the daemon stops")
        await self.server.drain(DRAIN_S)
        self.server.close()

    async def _tick_for_ever(self) -> None:
        """Frames on an absolute grid; a late tick is caught up frame by frame, only a long sleep is skipped."""
        while True:
            await asyncio.sleep(self.clock.seconds_until(self._next_tick_ns))
            now_ns = self.clock.now_ns()
            if now_ns < self._next_tick_ns:  # the loop's timer may fire a little early
                continue
            if now_ns - self._next_tick_ns > CATCH_UP_NS:
                missed = (now_ns - self._next_tick_ns) // self.period_ns
                self._next_tick_ns += missed * self.period_ns
                self.happened(event("ticks-missed", now_ns, "daemon", count=missed))
            for chain in self.chains:
                chain.flush(now_ns)
                chain.reopen_if_silent(now_ns)
            frame = self._frame(self._next_tick_ns)
            self._next_tick_ns += self.period_ns
            self.server.publish(frame)

    def _frame(self, t1_ns: int) -> Frame:
        health = []
        for monitor in self.monitors.values():
            report, happening = monitor.report(t1_ns)
            if happening is not None:
                self.happened(happening)
            if report is not None:
                health.append(report)
        utc = self.clock_map.at(self.framer.t0_ns)
        return self.framer.tick(t1_ns, utc, self.clock_map.epoch, health)

    def _connected(self) -> dict[str, Any]:
        identity = self.framer.identity
        now_ns = self.clock.now_ns()
        states = ((monitor.table.id, *monitor.state(now_ns)) for monitor in self.monitors.values())
        return {
            "boat_id": identity.boat_id,
            "boot_id": identity.boot_id,
            "clock_id": identity.clock_id,
            "start_no": identity.start_no,
            "next_seq": self.framer.next_seq,
            "clock_rate": self.clock.rate,
            "config": as_dict(self.config),
            "versions": versions(),
            "sensors": [{"id": sensor, "state": state, "reason": reason} for sensor, state, reason in states],
        }
