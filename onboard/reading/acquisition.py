"""From bytes to frames, pure: the daemon feeds it from ports by its clock, `convert` from files on sentence time.

port chunk -> lines -> devices -> framer --tick--> frame
                          |
                          `-> health (counts, silence)
"""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from common.events import event
from common.framer import Framer, Identity, Measurement
from common.messages import ClockPair, Event, Frame, RawLine
from common.sensors import BoatConfig, PortTable
from common.settings import as_dict
from common.units import NS_PER_S
from onboard.config import byte_budget
from onboard.devices import PortDecoder, make_driver, recognised
from onboard.devices.base import Accepted, Ignored, Outcome, Rejected
from onboard.devices.sentence import address
from onboard.reading.budget import ByteBudget
from onboard.reading.clockmap import ClockMap
from onboard.reading.dates import Dates
from onboard.reading.health import SensorMonitor
from onboard.reading.line_quality import DamageWatch, Wire
from onboard.reading.lines import LineSplitter

COMPANIONS: Final = (RawLine, ClockPair)
"""What comes along with a measurement and is none itself: not counted in a sensor's rate."""
DAMAGE: Final = frozenset(
    {"checksum", "not-ascii", "not-nmea", "no-checksum", "run-together", "too-long", "marks", "duplicate", "form"}
)
"""Reasons that blame the wire; the others blame what the device says."""


def versions() -> dict[str, str]:
    """Versions of what decides the result; goes into `connected` and the log."""
    found = {}
    for name in ("wayfix", "pyserial", "pynmea2", "pyzmq", "msgpack"):
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


@dataclass(slots=True)
class Tally:
    """What became of every line of a port."""

    accepted: Counter[tuple[str, str]] = field(default_factory=Counter)
    """By (sensor, kind)."""
    rejected: Counter[str] = field(default_factory=Counter)
    """By reason."""
    ignored: Counter[str] = field(default_factory=Counter)
    """By kind: well-formed, nobody asked for it."""

    def count(self, outcome: Outcome) -> None:
        """One line."""
        match outcome:
            case Accepted():
                self.accepted[outcome.sensor, outcome.kind] += 1
            case Rejected():
                self.rejected[outcome.reason] += 1
            case Ignored():
                self.ignored[outcome.kind] += 1

    @property
    def lines(self) -> int:
        """All lines so far."""
        return self.accepted.total() + self.rejected.total() + self.ignored.total()


class PortChain:
    """One port and everything its bytes run through before they are a measurement."""

    def __init__(self, acquisition: "Acquisition", table: PortTable) -> None:
        config = acquisition.config
        sensors = [sensor for sensor in config.sensor if sensor.port == table.name]
        self.table = table
        self.wire = acquisition.wires[table.name]
        self.monitors = [acquisition.monitors[sensor.id] for sensor in sensors]
        self.decoder = PortDecoder([make_driver(sensor) for sensor in sensors])
        self._acquisition = acquisition
        self.splitter = LineSplitter()
        self._overflows = 0
        self._budget = ByteBudget(byte_budget(table, config))
        self._damage = DamageWatch(self.wire, periodic=any(monitor.periodic for monitor in self.monitors))
        self.tally = Tally()
        self._flood_ns: int | None = None
        self._state = "new"

    def chunk(self, data: bytes, t_ns: int) -> None:
        """Bytes as read, stamped once."""
        self.wire.heard_bytes += len(data)
        allowed = self._budget.take(len(data), t_ns)
        for line in self.splitter.feed(data[:allowed], t_ns):
            self._dispose(self.decoder.feed(line), t_ns)
        if allowed < len(data):
            self._cut(len(data) - allowed, t_ns)

    def flush(self, now_ns: int) -> None:
        """What is due without another line, the end of a flood, and what there is to say about the lines."""
        for measurement in self.decoder.flush(self.splitter.complete_until(now_ns)):
            if not isinstance(measurement, COMPANIONS):
                self._acquisition.monitors[measurement.sensor].measured()
            self._acquisition.take(measurement, now_ns)
        if self._flood_ns is not None and now_ns - self._flood_ns > NS_PER_S and self._budget.calm(now_ns):
            self._flood_ns = None
            self._mark_flood(False, now_ns)
        self._tell_damage(now_ns)
        for monitor in self.monitors:
            if monitor.wants_hint(now_ns):
                monitor.hint = self._whose_lines(monitor)

    def changed(self, reason: str | None, now_ns: int) -> None:
        """The port opened (None) or was lost. One event for each loss and each return, whatever is tried in between."""
        name = self.table.name
        self._damage.reset()
        self.decoder.unclaimed.clear()
        if reason is None:
            self.splitter.reset()
            self._acquisition.happened(event("port-opened", now_ns, name, port=name, path=self.table.path))
        elif self._state == "open":
            self._acquisition.happened(event("port-lost", now_ns, name, port=name, reason=reason))
        elif self._state == "new":
            self._acquisition.happened(event("port-missing", now_ns, name, port=name, reason=reason))
        self._state = "open" if reason is None else "closed"
        for monitor in self.monitors:
            monitor.port_changed(reason, now_ns)

    def silent(self, now_ns: int) -> bool:
        """All periodic sensors of the port fell silent: it should be opened anew, some adapters need it."""
        periodic = [monitor for monitor in self.monitors if monitor.periodic]
        return bool(periodic) and all(monitor.overdue(now_ns) for monitor in periodic)

    def reopening(self, now_ns: int) -> None:
        """The silent port is being opened anew."""
        self.splitter.reset()
        for monitor in self.monitors:
            monitor.reopening(now_ns)

    def _tell_damage(self, now_ns: int) -> None:
        self.wire.damaged += self.splitter.overflows - self._overflows
        self._overflows = self.splitter.overflows
        found = self._damage.look(now_ns)
        if found is not None:
            code, damaged, lines = found
            name = self.table.name
            self._acquisition.happened(event(code, now_ns, name, port=name, damaged=damaged, lines=lines))

    def _whose_lines(self, monitor: SensorMonitor) -> str | None:
        """A sensor came back as another model, or the plugs were swapped: say so."""
        model = recognised(self.decoder.unclaimed)
        if model is None:
            return None
        table = monitor.table
        if model == f"{table.role} {table.model}":
            found = {address(line.data) for line in self.decoder.unclaimed}
            talkers = ", ".join(sorted({where[0] for where in found if where is not None})[:4])
            return f"its lines come from talker {talkers}; configured: {', '.join(table.talkers) or 'all'}"
        return f"lines like those of {model} come; configured: {table.role} {table.model}"

    def _dispose(self, outcome: Outcome, t_ns: int) -> None:
        self.tally.count(outcome)
        if isinstance(outcome, Accepted):
            self.wire.readable += 1
            measured = False
            for measurement in outcome.measurements:
                measured = measured or not isinstance(measurement, COMPANIONS)
                self._acquisition.take(measurement, t_ns)
            self._acquisition.monitors[outcome.sensor].accept(t_ns, measured)
        elif isinstance(outcome, Rejected):
            if outcome.reason in DAMAGE:
                self.wire.damaged += 1
            else:
                self.wire.readable += 1
            # A line that names no sensor counts for every sensor of the port: each of them may have sent it.
            for monitor in self.monitors:
                if outcome.sensor in (None, monitor.table.id):
                    monitor.reject(outcome.reason)
        elif outcome.kind != "text":  # what a wrong baud rate makes of a line may happen to be printable
            self.wire.readable += 1

    def _cut(self, count: int, t_ns: int) -> None:
        self.splitter.note_cut()
        self.wire.discarded_bytes += count
        if self._flood_ns is None:
            self._mark_flood(True, t_ns)
        self._flood_ns = t_ns

    def _mark_flood(self, flooded: bool, t_ns: int) -> None:
        self.wire.flooded = flooded
        code = "port-flooded" if flooded else "port-calm"
        budget = self._budget.bytes_per_s
        self._acquisition.happened(event(code, t_ns, self.table.name, port=self.table.name, budget=budget))


class Acquisition:
    """All ports of one boat on their way into frames. Reads no clock: every call brings its time."""

    def __init__(
        self, config: BoatConfig, identity: Identity, t0_ns: int, now_ns: int, tell: Callable[[Event], None]
    ) -> None:
        """t0_ns: start of the first frame; tell: where every event goes beside the frame."""
        self.config = config
        self.identity = identity
        self.framer = Framer(identity, [sensor.id for sensor in config.with_role("imu")], t0_ns)
        self.wires = {table.name: Wire() for table in config.port}
        self.monitors = {sensor.id: SensorMonitor(sensor, now_ns, self.wires[sensor.port]) for sensor in config.sensor}
        self.clock_map = ClockMap(self.happened)
        self.dates = Dates(self.happened, [sensor.id for sensor in config.sensor if sensor.week_rollover])
        self.chains = [PortChain(self, table) for table in config.port]
        self._tell = tell

    def take(self, measurement: Measurement, now_ns: int) -> None:
        """A measurement of any driver goes into the frame; clock pairs whose date can be also move the UTC mapping."""
        if isinstance(measurement, ClockPair):
            pair = self.dates.judge(measurement, self.clock_map.at(measurement.t_ns))
            if pair is None:
                return
            if (step_s := self.clock_map.add(pair)) is not None:
                self.happened(event("clock-stepped", now_ns, pair.sensor, sensor=pair.sensor, step_s=step_s))
            measurement = pair
        self.framer.add(measurement)

    def happened(self, happening: Event) -> None:
        """Every event is a record in the frame, and is told."""
        self._tell(happening)
        self.framer.add(happening)

    def frame(self, t1_ns: int) -> Frame:
        """The frame that ends at t1, with the health that is due."""
        health = []
        for monitor in self.monitors.values():
            report, happening = monitor.report(t1_ns)
            if happening is not None:
                self.happened(happening)
            if report is not None:
                health.append(report)
        utc = self.clock_map.at(self.framer.t0_ns)
        return self.framer.tick(t1_ns, utc, self.clock_map.epoch, health)

    def greeting(self, now_ns: int, clock_rate: float) -> dict[str, Any]:
        """The fields of `connected` (docs/protocol.md): who sends, how it is made, how its sensors are."""
        identity = self.identity
        states = ((monitor.table.id, *monitor.state(now_ns)) for monitor in self.monitors.values())
        return {
            "boat_id": identity.boat_id,
            "boot_id": identity.boot_id,
            "clock_id": identity.clock_id,
            "start_no": identity.start_no,
            "next_seq": self.framer.next_seq,
            "clock_rate": clock_rate,
            "config": as_dict(self.config),
            "versions": versions(),
            "sensors": [{"id": sensor, "state": state, "reason": reason} for sensor, state, reason in states],
        }
