"""Health monitoring of each sensor: counts of its lines and the state of its port become reports and events. Pure.

A monitor is given every outcome and every change of the port, and is asked at each tick.

    lines, port --> Delivery (state machine: what is news) --> words --> SensorHealth, Event
                      |
                      `--> ReopenPauses (when the silent port is opened once more)
"""

from collections import Counter
from typing import Final

from common.boat_config import ROLES, SensorTable, stale_after_s
from common.events import event
from common.messages import Event, SensorHealth
from common.units import NS_PER_S
from onboard.reading import diagnosis as words
from onboard.reading.line_quality import Wire
from onboard.reading.reopen_pauses import ReopenPauses
from onboard.reading.rhythm import BEAT_NS, REPORT_NS, Rate
from onboard.reading.silence_watchdog import PERIODS, SHOWN, Delivery, State

HINT_NS: Final = 10 * NS_PER_S
MAX_REASON: Final = 256


class SinceGood:
    """What a port has brought since a sensor's last good line, or since it was opened."""

    def __init__(self, wire: Wire, rejected: Counter[str]) -> None:
        self._wire = wire
        self._rejected = rejected
        self._size = self._readable = 0
        self._rejected_then: Counter[str] = Counter()

    def restart(self) -> None:
        """Count from here on."""
        self._size, self._readable = self._wire.heard_bytes, self._wire.readable
        self._rejected_then = self._rejected.copy()

    @property
    def size(self) -> int:
        """Number of bytes."""
        return self._wire.heard_bytes - self._size

    def instead(self, hint: str | None) -> words.Instead:
        """All that came, for a sentence; hint: whose lines they are, in words."""
        readable = self._wire.readable - self._readable
        return words.Instead(self.size, readable, self._rejected - self._rejected_then, self._wire.flooded, hint)


class SensorMonitor:
    """One sensor. Event sensors (AIS, radar) are delivering as long as their port is open."""

    def __init__(self, table: SensorTable, started_ns: int, wire: Wire | None = None) -> None:
        """wire: the byte counts of the sensor's port."""
        self.table = table
        self.wire = Wire() if wire is None else wire
        self.rejected: Counter[str] = Counter()
        self.accepted = 0
        self.unchecked = 0
        self.hint: str | None = None
        """Which device sends the lines that come instead of this sensor's, in words (`PortChain`)."""
        self.periodic = ROLES[table.role].periodic
        stale_ns = int(min(stale_after_s(table.role, table.rate_hz), 1e9) * NS_PER_S)
        self._delivery = Delivery(self.periodic, stale_ns, started_ns)
        self._pauses = ReopenPauses(started_ns)
        self._since_good = SinceGood(self.wire, self.rejected)
        self._rate = Rate(started_ns)
        self._accepted_then = 0
        """Number of good lines at the last report."""
        self._hint_ns = started_ns
        self._port_reason = "not opened yet"
        self._shown: str | None = None
        """State in the last report; `None` before the first."""
        self._reported_ns = 0

    def accept(self, t_ns: int, measured: bool, unchecked: bool = False) -> None:
        """A good line at `t_ns`; measured = it completed a measurement (a fix, a sample, a heading).

        unchecked: it had no checksum.
        """
        self.accepted += 1
        self.unchecked += int(unchecked)
        self._rate.count(int(measured))
        self._delivery.good(t_ns)

    def measured(self) -> None:
        """A measurement became due without a line of its own (end of a GPS epoch)."""
        self._rate.count()

    def reject(self, reason: str) -> None:
        """A bad line of this sensor."""
        self.rejected[reason] += 1

    def port_changed(self, reason: str | None, t_ns: int) -> None:
        """The port opened (None) or was lost."""
        if reason is None:
            self._delivery.opened(t_ns)
            self._since_good.restart()
        else:
            self._delivery.lost()
            self._port_reason = reason
        self._pauses.restart(t_ns)
        self.hint, self._hint_ns = None, t_ns

    def reopening(self, t_ns: int) -> None:
        """The open port is being closed and opened because of the silence, which goes on."""
        self._pauses.attempted(t_ns)

    def state(self, now_ns: int) -> tuple[str, str | None]:
        """State (delivering, silent or missing) and its reason, in words of at most 256 characters."""
        state = self._delivery.state_at(now_ns)
        return SHOWN[state], self._reason(state, now_ns)

    def overdue(self, now_ns: int) -> bool:
        """True when the open port has been silent so long that it should be reopened."""
        delivery = self._delivery
        if not self.periodic or delivery.is_missing:
            return False
        return self._pauses.is_due(now_ns, delivery.last_good_ns, delivery.limit_ns())

    def wants_hint(self, now_ns: int) -> bool:
        """True now and then while other bytes come and none of this sensor's lines: set `hint`."""
        if self._delivery.is_missing or not self._since_good.size or now_ns < self._hint_ns:
            return False
        if self._delivery.quiet_ns(now_ns) <= (self._delivery.stale_ns if self.periodic else words.QUIET_NS):
            return False
        self._hint_ns = now_ns + HINT_NS
        return True

    def report(self, now_ns: int) -> tuple[SensorHealth | None, Event | None]:
        """Health when due (once a second, and on every change of state), and the event of a change."""
        if self.accepted != self._accepted_then:
            self._note_good()
        code = self._delivery.look(now_ns)
        state = self._delivery.state
        if SHOWN[state] == self._shown and code is None and now_ns - self._reported_ns < REPORT_NS:
            return None, None
        self._shown, self._reported_ns = SHOWN[state], now_ns
        reason = self._reason(state, now_ns)
        happening = None if code is None else self._event(code, reason, now_ns)
        return self._health(SHOWN[state], reason, now_ns), happening

    def _note_good(self) -> None:
        """Good lines came since the last report: from here on it is counted what came instead."""
        self._accepted_then = self.accepted
        self._since_good.restart()
        self._pauses.succeeded()
        self.hint = None

    def _reason(self, state: State, now_ns: int) -> str | None:
        if state is State.MISSING:
            reason: str | None = self._port_reason
        elif not self.periodic:
            reason = self._why_quiet(now_ns) or self.wire.damage
        elif state is State.DELIVERING:
            reason = self.wire.damage
        else:
            reason = "; ".join(filter(None, (self._why_silent(now_ns), self.wire.damage)))
        return None if reason is None else reason[:MAX_REASON]

    def _why_quiet(self, now_ns: int) -> str | None:
        return words.quiet(self._delivery.quiet_ns(now_ns), self._since_good.instead(self.hint))

    def _why_silent(self, now_ns: int) -> str:
        last_ns = self._delivery.last_good_ns
        age_ns = None if last_ns is None else now_ns - last_ns
        return words.silent(age_ns, self._slow_period_ns(), self._since_good.instead(self.hint))

    def _slow_period_ns(self) -> int | None:
        """The learned period of a sensor that is slower than configured, and would be silent between its lines."""
        period_ns = self._delivery.rhythm.period_ns
        configured_ns = max(NS_PER_S / (self.table.rate_hz or ROLES[self.table.role].nominal_rate_hz), BEAT_NS)
        if period_ns is None or PERIODS * period_ns <= self._delivery.stale_ns or period_ns <= 1.5 * configured_ns:
            return None
        return period_ns

    def _event(self, code: str, reason: str | None, now_ns: int) -> Event:
        sensor = self.table.id
        if code == "sensor-delivering":
            return event(code, now_ns, sensor, sensor=sensor)
        age_s = round(self._delivery.quiet_ns(now_ns) / NS_PER_S)
        return event(code, now_ns, sensor, sensor=sensor, age_s=age_s, reason=reason)

    def _health(self, state: str, reason: str | None, now_ns: int) -> SensorHealth:
        return SensorHealth(
            sensor=self.table.id,
            t_ns=now_ns,
            state=state,
            reason=reason,
            last_good_t_ns=self._delivery.last_good_ns,
            rate_hz=self._rate.report_hz(now_ns),
            flooded=self.wire.flooded,
            accepted=self.accepted,
            unchecked=self.unchecked,
            rejected=dict(self.rejected),
            discarded_bytes=self.wire.discarded_bytes,
        )
