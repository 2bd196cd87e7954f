"""One port's pipeline, pure: chunks of bytes through byte budget, line splitter and drivers to measurements and events.

chunk -> budget -> lines -> devices -> sink
                     |         |
                     |         `-> monitors (what each sensor delivers)
                     `-> line quality (what the port's bytes are like)
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final, Protocol

from common.boat_config import PortTable
from common.events import event
from common.framer import Measurement
from common.messages import Event
from common.units import NS_PER_S
from onboard.devices import PortDecoder, make_driver
from onboard.devices.driver import COMPANIONS, Accepted, Ignored, Outcome, Rejected
from onboard.devices.nmea_fields import ZERO_POSITION
from onboard.devices.recognise import Stranger, is_whole, stranger
from onboard.reading.byte_budget import ByteBudget
from onboard.reading.line_quality import DamageWatch, Wire
from onboard.reading.line_splitter import LineSplitter
from onboard.reading.recent_bytes import RecentBytes
from onboard.reading.sensor_health import SensorMonitor

DAMAGE: Final = frozenset(
    {"checksum", "not-ascii", "not-nmea", "no-checksum", "run-together", "too-long", "marks", "duplicate", "form"}
)
"""Reasons of rejection that blame the wire; the others blame the device."""


MOST_KINDS: Final = 64
"""Most kinds of ignored lines that are counted apart: a device may send any name."""


@dataclass(slots=True)
class Tally:
    """What became of every line of a port."""

    accepted: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Number of accepted lines, by (sensor, kind)."""
    rejected: Counter[str] = field(default_factory=Counter)
    """Number of rejected lines, by reason."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Number of ignored lines, by kind: they are well-formed, but no sensor of the port needs them."""

    def count(self, outcome: Outcome) -> None:
        """Count one line."""
        match outcome:
            case Accepted():
                self.accepted[outcome.sensor, outcome.kind] += 1
            case Rejected():
                self.rejected[outcome.reason] += 1
            case Ignored():
                is_known = outcome.kind in self.ignored or len(self.ignored) < MOST_KINDS
                self.ignored[outcome.kind if is_known else "others"] += 1

    @property
    def lines(self) -> int:
        """Number of all lines so far."""
        return self.accepted.total() + self.rejected.total() + self.ignored.total()


class Sink(Protocol):
    """Receiver of a port's measurements and events."""

    def take(self, measurement: Measurement, now_ns: int) -> None:
        """Take a measurement that became known at `now_ns`."""
        ...

    def happened(self, happening: Event) -> None:
        """Take an event about the port or its lines."""
        ...


class PortChain:
    """One port and everything its bytes run through before they are a measurement."""

    def __init__(
        self, table: PortTable, budget: ByteBudget, monitors: Iterable[SensorMonitor], wire: Wire, sink: Sink
    ) -> None:
        """monitors: those of the port's sensors, in the order of the configuration file; wire: shared with them."""
        self.table = table
        self.monitors = {monitor.table.id: monitor for monitor in monitors}
        self.wire = wire
        self.decoder = PortDecoder([make_driver(monitor.table) for monitor in self.monitors.values()])
        self.splitter = LineSplitter()
        self.tally = Tally()
        self.recent = RecentBytes()
        self._sink = sink
        self._overflows = 0
        self._budget = budget
        self._damage = DamageWatch(wire)
        self._flood_ns: int | None = None
        self._told_zero: set[str] = set()
        """Sensors of which it is said that they give the place 0, 0."""
        self._state = "new"

    def chunk(self, data: bytes, t_ns: int) -> None:
        """Take bytes as read, stamped once."""
        self.wire.heard_bytes += len(data)
        self.recent.add(data)
        allowed = self._budget.take(len(data), t_ns)
        self._read(data[:allowed], t_ns)
        if allowed < len(data):
            self._cut(len(data) - allowed, t_ns)

    def flush(self, now_ns: int) -> None:
        """What is due without another line, the end of a flood, and what there is to say about the lines."""
        self._read(b"", now_ns)
        for measurement in self.decoder.flush(self.splitter.complete_until(now_ns)):
            if not isinstance(measurement, COMPANIONS):
                self.monitors[measurement.sensor].measured()
            self._sink.take(measurement, now_ns)
        if self._flood_ns is not None and now_ns - self._flood_ns > NS_PER_S and self._budget.calm(now_ns):
            self._flood_ns = None
            self._mark_flood(False, now_ns)
        self._tell_damage(now_ns)
        for monitor in self.monitors.values():
            if monitor.wants_hint(now_ns):
                monitor.hint = self.stranger(monitor)

    def stranger(self, monitor: SensorMonitor) -> Stranger | None:
        """What has come since this sensor's last good line: another device, or another model of it."""
        newest = self.recent.newest()
        return stranger(monitor.table, newest[max(0, len(newest) - monitor.unread_bytes) :], self.decoder.unclaimed)

    def changed(self, reason: str | None, now_ns: int) -> None:
        """The port opened (None) or was lost. One event for each loss and each return, whatever is tried in between."""
        self._damage.reset()
        self.decoder.unclaimed.clear()
        self.recent.clear()
        if reason is None:
            self.splitter.reset()
            self._tell("port-opened", now_ns, path=self.table.path)
        elif self._state == "open":
            self._tell("port-lost", now_ns, reason=reason)
        elif self._state == "new":
            self._tell("port-missing", now_ns, reason=reason)
        self._state = "open" if reason is None else "closed"
        for monitor in self.monitors.values():
            monitor.port_changed(reason, now_ns)

    def silent(self, now_ns: int) -> bool:
        """All periodic sensors of the port fell silent: it should be opened once more, some adapters need it."""
        periodic = [monitor for monitor in self.monitors.values() if monitor.periodic]
        return bool(periodic) and all(monitor.overdue(now_ns) for monitor in periodic)

    def reopening(self, now_ns: int) -> None:
        """The silent port is being closed and opened."""
        self.splitter.reset()
        for monitor in self.monitors.values():
            monitor.reopening(now_ns)

    def _read(self, data: bytes, t_ns: int) -> None:
        for line in self.splitter.feed(data, t_ns):
            self._dispose(self.decoder.feed(line), t_ns)

    def _tell_damage(self, now_ns: int) -> None:
        self.wire.damaged += self.splitter.overflows - self._overflows
        self._overflows = self.splitter.overflows
        found = self._damage.look(now_ns)
        if found is not None and found[0] == "lines-damaged" and is_whole(self.recent.newest()):
            self._damage.reset()
        elif found is not None:
            code, damaged, lines = found
            self._tell(code, now_ns, damaged=damaged, lines=lines)

    def _dispose(self, outcome: Outcome, t_ns: int) -> None:
        self.tally.count(outcome)
        if isinstance(outcome, Accepted):
            self.wire.readable += 1
            measured = False
            for measurement in outcome.measurements:
                measured = measured or not isinstance(measurement, COMPANIONS)
                self._sink.take(measurement, t_ns)
            self.monitors[outcome.sensor].accept(t_ns, measured, outcome.unchecked)
        elif isinstance(outcome, Rejected):
            if outcome.reason in DAMAGE:
                self.wire.damaged += 1
            else:
                self.wire.readable += 1
            self._tell_zero(outcome, t_ns)
            # A line that names no sensor counts for every sensor of the port: each of them may have sent it.
            for monitor in self.monitors.values():
                if outcome.sensor in (None, monitor.table.id):
                    monitor.reject(outcome.reason)
        elif outcome.kind != "text":  # what a wrong baud rate makes of a line may happen to be printable
            self.wire.readable += 1

    def _tell_zero(self, outcome: Rejected, t_ns: int) -> None:
        """Once for each sensor: no other sentence may show that its receiver has no place."""
        sensor = outcome.sensor
        if outcome.reason == ZERO_POSITION and sensor is not None and sensor not in self._told_zero:
            self._told_zero.add(sensor)
            self._sink.happened(event("place-zero", t_ns, sensor, sensor=sensor))

    def _cut(self, count: int, t_ns: int) -> None:
        self.splitter.note_cut()
        self.wire.discarded_bytes += count
        if self._flood_ns is None:
            self._mark_flood(True, t_ns)
        self._flood_ns = t_ns

    def _mark_flood(self, flooded: bool, t_ns: int) -> None:
        self.wire.flooded = flooded
        self._tell("port-flooded" if flooded else "port-calm", t_ns, budget=self._budget.bytes_per_s)

    def _tell(self, code: str, t_ns: int, **evidence: str | float) -> None:
        name = self.table.name
        self._sink.happened(event(code, t_ns, name, port=name, **evidence))
