"""The daemon (event loop): one asyncio loop owns ports, acquisition (bytes to frames) and socket."""

import asyncio
import logging
import secrets
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import zmq

from common.boat_config import BoatConfig
from common.clock import BoatClock, boottime_ns, machine_clock_id
from common.events import line_of
from common.framer import Identity
from common.messages import Event, Frame
from common.settings import as_dict
from common.units import NS_PER_S, NS_PER_US
from common.words import counted
from onboard.alive import AliveMark
from onboard.control.handlers import Commands
from onboard.control.key_handlers import KeyRequests
from onboard.control.socket import Control, has_terminal
from onboard.journal import Journal
from onboard.link.access import Access
from onboard.link.allow_list import AllowList
from onboard.link.client_leases import Pace
from onboard.link.pairing_port import PairingPort
from onboard.link.router import Router
from onboard.link.server import Limits, Server
from onboard.notify import Notifier
from onboard.reading.acquisition import Acquisition, versions
from onboard.reading.polled_port import PolledPort
from onboard.spool import Spool
from onboard.start_counter import count_start, is_kept, keep_count

log = logging.getLogger(__name__)

DRAIN_S: Final = 0.5
GOODBYE_S: Final = 1.0
"""Time that clients have to say goodbye, s; with the other waits of the end less than TimeoutStopSec= of the
service."""
CONNECTIONS_OF_CLIENT: Final = 4
"""Connections for each client that has a place: some have just come, others are gone and not yet missed."""
CUTS_AT_ONCE: Final = 3
CUTS_PER_S: Final = 0.05
"""Rate limit of what is said of cut connections, and of faults of the loop, a second: a flood fills no journal."""
STATE_LOOK_S: Final = 1.0
"""Interval at which the daemon looks whether its state directory is still there, s."""
CATCH_UP_NS: Final = 60 * NS_PER_S
"""Longest gap that is filled with empty frames, ns; a board that slept longer (suspend) leaves a hole in the grid."""
_LOG_LEVELS: Final = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


def status_text(boat_id: str, delivering: int, sensors: int, clients: int) -> str:
    """How the boat is, for `systemctl status`."""
    return f"boat {boat_id}, {delivering} of {sensors} sensors deliver, {counted(clients, 'client')}"


class Daemon:
    """Owns everything that lives between start and SIGTERM."""

    def __init__(
        self,
        config: BoatConfig,
        clock: BoatClock,
        state_dir: Path | None = None,
        runtime_dir: Path | None = None,
        *,
        notifier: Notifier | None = None,
        allow_list: AllowList | None = None,
    ) -> None:
        """state_dir keeps start counter and spool, runtime_dir (in memory) the mark of a run that still lives.

        allow_list: whose keys are let in; None = everybody, in clear.
        """
        self.config = config
        self.clock = clock
        self.period_ns = round(NS_PER_S / config.frames.rate_hz)
        now_ns = clock.now_ns()
        self._next_tick_ns = (now_ns // self.period_ns + 1) * self.period_ns
        self._state_dir = state_dir
        self._counted = count_start(state_dir)
        identity = Identity(config.boat.id, secrets.token_hex(8), machine_clock_id(), self._counted.number)
        self.acquisition = Acquisition(config, identity, self._next_tick_ns - self.period_ns, now_ns, _log_event)
        self.ports = [PolledPort(chain, clock) for chain in self.acquisition.chains]
        self._journal = Journal(self.acquisition.happened, clock.now_ns)
        spool_dir = None if state_dir is None else state_dir / "spool"
        about = {"config": as_dict(config), "versions": versions()}
        self.spool = Spool(spool_dir, identity, config.spool, self._journal, about=about)
        reopen = {sensor: port.reopen for port in self.ports for sensor in port.chain.monitors}
        recent = {sensor: chain.recent.since for chain in self.acquisition.chains for sensor in chain.monitors}
        self._cuts = 0
        """Number of connections that were cut and not said."""
        self._cut_pace = Pace(CUTS_AT_ONCE, CUTS_PER_S)
        self._fault_pace = Pace(CUTS_AT_ONCE, CUTS_PER_S)
        self._commands = Commands(self._status, reopen, recent, self._journal)
        self._context = zmq.Context()
        self._access = Access(self._context, allow_list, self._journal)
        self.server = Server(
            Router(self._context, self._access.secret_key, self._cut, CONNECTIONS_OF_CLIENT * config.link.max_clients),
            self.spool,
            connected=self._connected,
            frame_period_ns=self.period_ns,
            journal=self._journal,
            rights=self._access.rights,
            command=self._asked_by_link,
            limits=Limits(config.link.max_clients, config.link.fill_kb_per_s * 1000),
        )
        self._runtime_dir = runtime_dir
        self._notifier = notifier or Notifier(None)
        # The mark's times are compared with those of the run before: only the real boat clock goes on over a restart.
        self._mark = AliveMark(runtime_dir if clock.rate == 1.0 else None, identity)
        self.parts: list[Callable[[], bool]] = []
        """Functions that each return True while their part lives; the watchdog is fed only while all do."""
        self._stop = asyncio.Event()
        self._stop_reason = ""

    def stop(self, reason: str) -> None:
        """Ask the daemon to end."""
        self._stop_reason = reason
        self._stop.set()

    async def run(self, bind: str, on_ready: Callable[[dict[str, Any]], None]) -> None:
        """Run until `stop`; on_ready gets the socket's address once ports are polled. Raises WayfixError."""
        workers = await self._access.start()
        endpoint = self.server.bind(bind)
        self._keys = self._key_requests(endpoint)
        requests = {**self._commands.handlers(), **(self._keys.handlers() if self._keys is not None else {})}
        control = Control(self._runtime_dir, requests, self._journal)
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(self._loop_fault)
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.stop, signal.Signals(number).name)
        loop.add_signal_handler(signal.SIGHUP, self._hung_up)
        self._journal.tell("daemon-started", sensors=len(self.config.sensor))
        self._access.opened(endpoint)
        self._tell_gap()
        if self._counted.mended is not None:
            self._journal.tell("state-mended", reason=self._counted.mended, start_no=self._counted.number)
        if self._counted.fault is not None:
            self._journal.tell("state-unusable", reason=self._counted.fault)
        workers += [asyncio.create_task(polled.port.run()) for polled in self.ports]
        for work in (self.server.run(), control.run(), self._tick_for_ever(), self._watch_state()):
            workers.append(asyncio.create_task(work))
        self.parts.append(lambda: not any(worker.done() for worker in workers))
        stopping = asyncio.create_task(self._stop.wait())
        try:
            tried = asyncio.create_task(self._all_tried(control))
            await asyncio.wait([tried, *workers, stopping], return_when=asyncio.FIRST_COMPLETED)
            if not tried.cancel():
                on_ready(self._ready(endpoint))
                self._notifier.ready()
            done, _ = await asyncio.wait([*workers, stopping], return_when=asyncio.FIRST_COMPLETED)
            for task in done - {stopping}:
                task.result()  # a worker never ends by itself: let its error out
        finally:
            stopping.cancel()
            for worker in workers:
                worker.cancel()
            await asyncio.gather(*workers, stopping, return_exceptions=True)
            await self._finish()

    async def _all_tried(self, control: Control) -> None:
        await control.tried.wait()
        for polled in self.ports:
            await polled.port.tried.wait()

    def _loop_fault(self, _loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """A fault that nobody waits for (no more descriptors): one line, and not for each time."""
        if self._fault_pace.allows(boottime_ns()):
            error = context.get("exception")
            log.error("%s: %s", context.get("message"), error, exc_info=None if isinstance(error, OSError) else error)

    def _ready(self, endpoint: str) -> dict[str, Any]:
        identity, key = self.acquisition.identity, self._access.public_key
        return {"bind": endpoint, "boot_id": identity.boot_id, "boat_id": identity.boat_id, "public_key": key}

    def _tell_gap(self) -> None:
        """Make an event when the former run died: nothing else shows how long there were no frames."""
        first_ns = self._next_tick_ns - self.period_ns
        gap = self._mark.former(first_ns)
        if gap is not None:
            gap_s = round(gap.gap_ns / NS_PER_S, 1)
            self._journal.tell("daemon-resumed", gap_s=gap_s, former_boot_id=gap.boot_id)

    async def _finish(self) -> None:
        """Send the last, shorter frame and `end` to every client."""
        self._notifier.stopping()
        now_ns = self.clock.now_ns()
        self._journal.tell_at(now_ns, "daemon-stopping", reason=self._stop_reason or "error")
        for chain in self.acquisition.chains:
            chain.flush(now_ns + NS_PER_S)
        self.server.publish(self.acquisition.frame(max(now_ns, self.acquisition.framer.t0_ns) + NS_PER_US))
        serving = asyncio.create_task(self.server.run())
        await self.server.drain(DRAIN_S)
        await self.server.end_all("the daemon stops", GOODBYE_S)
        serving.cancel()
        self.server.close()
        self._access.close()
        self._context.term()
        await asyncio.to_thread(self.spool.close, DRAIN_S)
        if self._stop.is_set():
            self._mark.goodbye()  # a run that ends by an error keeps its mark: frames will be missing too

    async def _tick_for_ever(self) -> None:
        """Make frames on an absolute grid; a late tick is caught up frame by frame, only a long sleep is skipped."""
        while True:
            await asyncio.sleep(self.clock.seconds_until(self._next_tick_ns))
            now_ns = self.clock.now_ns()
            if now_ns < self._next_tick_ns:  # the loop's timer may fire a little early
                continue
            if now_ns - self._next_tick_ns > CATCH_UP_NS:
                missed = (now_ns - self._next_tick_ns) // self.period_ns
                self._next_tick_ns += missed * self.period_ns
                self._journal.tell_at(now_ns, "ticks-missed", count=missed)
            for port in self.ports:
                port.tick(now_ns)
            frame = self.acquisition.frame(self._next_tick_ns)
            self._next_tick_ns += self.period_ns
            self.server.publish(frame)
            self._published(frame)

    async def _watch_state(self) -> None:
        """A state directory that is removed is made again: the next start goes on counting. The disk may be slow."""
        fault = self._counted.fault
        while True:
            await asyncio.sleep(STATE_LOOK_S)
            if self._state_dir is None or fault is not None or await asyncio.to_thread(is_kept, self._state_dir):
                continue
            fault = await asyncio.to_thread(keep_count, self._state_dir, self._counted.number)
            self._journal.tell("state-gone", path=str(self._state_dir))
            if fault is not None:
                self._journal.tell("state-unusable", reason=fault)

    def _published(self, frame: Frame) -> None:
        """Proof of life, given by the tick itself: a hanging loop or tick leaves the mark and the watchdog alone."""
        self._mark.keep(frame.t1_ns)
        if all(lives() for lives in self.parts):
            self._notifier.watchdog()
        if frame.t1_ns % NS_PER_S == 0:
            states = [monitor.state(frame.t1_ns)[0] for monitor in self.acquisition.monitors.values()]
            delivering = states.count("delivering")
            self._notifier.status(status_text(self.config.boat.id, delivering, len(states), self.server.clients))

    def _key_requests(self, endpoint: str) -> KeyRequests | None:
        """What may be asked about keys; None on an open link, which has none."""
        allow_list = self._access.allow_list
        if allow_list is None:
            return None
        port = PairingPort(allow_list, self.config.boat.id, endpoint, self._journal)
        keys = KeyRequests(allow_list, port, self._journal, self.server.reload)
        keys.tell_faults()
        return keys

    def _hung_up(self) -> None:
        """SIGHUP: a closed terminal ends the daemon in it; a service reads its allow list again."""
        if self._keys is None or has_terminal():
            self.stop("SIGHUP")
        else:
            self._reloading = asyncio.create_task(self._keys.reload())

    def _status(self) -> dict[str, Any]:
        """The answer to the command `status`."""
        now_ns = self.clock.now_ns()
        sensors = {name: monitor.status(now_ns) for name, monitor in self.acquisition.monitors.items()}
        identity = self.acquisition.identity
        return {
            "boat_id": identity.boat_id,
            "boot_id": identity.boot_id,
            "start_no": identity.start_no,
            "next_seq": self.acquisition.framer.next_seq,
            "clients": self.server.clients,
            "sensors": sensors,
            "spool": self.spool.status(),
        }

    async def _asked_by_link(self, name: str, argument: str, key: str) -> str:
        return await self._commands.from_link(name, argument, self._access.name_of(key))

    def _cut(self, address: str, reason: str) -> None:
        """A connection was cut: said at once, and of a flood a line in 20 s."""
        self._cuts += 1
        if self._cut_pace.allows(boottime_ns()):
            self._journal.child("link").tell("peer-cut", address=address, reason=reason, count=self._cuts)
            self._cuts = 0

    def _connected(self) -> dict[str, Any]:
        return self.acquisition.greeting(self.clock.now_ns(), self.clock.rate)


def _log_event(happening: Event) -> None:
    """Every event is one line in the log, with fields where the log has some."""
    fields = {"sensor": happening.source, "code": happening.code}
    log.log(_LOG_LEVELS[happening.level], "%s", line_of(happening), extra=fields)
