"""Health monitoring of each sensor: counts of its lines and the state of its port become reports and events. Pure.

A monitor is given every outcome and every change of the port, and is asked at each tick.

    lines, port --> Delivery (state machine: what is news) --> words --> SensorHealth, Event
                      |
                      `--> ReopenPauses (when the silent port is opened once more)
"""

from collections import Counter
from typing import Any, Final

from common.boat_config import ROLES, SensorTable, stale_after_s
from common.events import event
from common.messages import Event, SensorHealth
from common.units import NS_PER_S
from onboard.devices.recognise import Stranger
from onboard.reading import diagnosis as words
from onboard.reading.line_quality import Wire
from onboard.reading.reopen_pauses import ReopenPauses
from onboard.reading.rhythm import BEAT_NS, REPORT_NS, Rate
from onboard.reading.silence_watchdog import PERIODS, SHOWN, Delivery, State

HINT_NS: Final = 10 * NS_PER_S
"""Time between two looks at whose lines come, ns."""
SOON_NS: Final = 2 * NS_PER_S
"""The same while that is not known."""
MISREAD_NS: Final = 10 * NS_PER_S
"""Time without a good line after which an event sensor whose lines are all refused is said to be silent, ns."""
LEAST_REFUSED: Final = 3
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

    def instead(self, hint: Stranger | None) -> words.Instead:
        """All that came, for a sentence; hint: whose lines they are."""
        readable = self._wire.readable - self._readable
        return words.Instead(self.size, readable, self.rejected, self._wire.flooded, hint)

    @property
    def rejected(self) -> Counter[str]:
        """Number of bad lines, by reason."""
        return self._rejected - self._rejected_then


class SensorMonitor:
    """One sensor. Event sensors (AIS, radar) are delivering as long as their port is open."""

    def __init__(self, table: SensorTable, started_ns: int, wire: Wire | None = None) -> None:
        """wire: the byte counts of the sensor's port."""
        self.table = table
        self.wire = Wire() if wire is None else wire
        self.rejected: Counter[str] = Counter()
        self.accepted = 0
        self.unchecked = 0
        self.hint: Stranger | None = None
        """Which device sends the lines that come instead of this sensor's (`PortChain`)."""
        self.periodic = ROLES[table.role].periodic
        stale_ns = int(min(stale_after_s(table.role, table.rate_hz), 1e9) * NS_PER_S)
        self._delivery = Delivery(self.periodic, stale_ns, started_ns)
        self._pauses = ReopenPauses(started_ns)
        self._since_good = SinceGood(self.wire, self.rejected)
        self._rate = Rate(started_ns)
        self.rate_hz = 0.0
        """Rate of its measurements at the last report, Hz."""
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
        self._delivery.is_misread = self._is_misread(now_ns)
        state = self._delivery.state_at(now_ns)
        return SHOWN[state], self._reason(state, now_ns)

    @property
    def unread_bytes(self) -> int:
        """Number of bytes of the port since the last good line."""
        return self._since_good.size

    @property
    def last_good_ns(self) -> int | None:
        """Boat time of the last good line, ns; `None` = none yet."""
        return self._delivery.last_good_ns

    def status(self, now_ns: int) -> dict[str, Any]:
        """State, reason, rate (Hz) and age of the last good line (s), for the request `status`."""
        state, reason = self.state(now_ns)
        last_ns = self.last_good_ns
        age_s = None if last_ns is None else round(max(0, now_ns - last_ns) / NS_PER_S, 1)
        return {"state": state, "reason": reason, "rate_hz": round(self.rate_hz, 3), "age_s": age_s}

    def why_not(self, now_ns: int, hint: Stranger | None) -> words.Why:
        """Why no good line has come so far; hint: what comes instead."""
        last_ns = self._delivery.last_good_ns
        age_ns = None if last_ns is None else now_ns - last_ns
        return words.silent(age_ns, self._slow_period_ns(), self._since_good.instead(hint))

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
        self._hint_ns = now_ns + (SOON_NS if self.hint is None else HINT_NS)
        return True

    def _is_misread(self, now_ns: int) -> bool:
        """An event sensor whose port has brought lines since it opened, all of them refused or of another device.

        Once a good line has come, lines of other devices are those of a neighbour, and its own pauses are no fault.
        """
        if self.periodic or self._delivery.is_missing or self._delivery.has_delivered:
            return False
        quiet_ns = self._delivery.quiet_ns(now_ns)
        is_refused = self._since_good.rejected.total() >= LEAST_REFUSED
        return (is_refused and quiet_ns > MISREAD_NS) or (self.hint is not None and quiet_ns > words.QUIET_NS)

    def report(self, now_ns: int) -> tuple[SensorHealth | None, Event | None]:
        """Health when due (once a second, and on every change of state), and the event of a change."""
        if self.accepted != self._accepted_then:
            self._note_good()
        self._delivery.is_misread = self._is_misread(now_ns)
        code = self._delivery.look(now_ns)
        state = self._delivery.state
        if SHOWN[state] == self._shown and code is None and now_ns - self._reported_ns < REPORT_NS:
            return None, None
        self._shown, self._reported_ns = SHOWN[state], now_ns
        reason = self._reason(state, now_ns)
        happening = None if code is None else self._event(code, now_ns)
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
        elif state is not State.DELIVERING:
            reason = "; ".join(filter(None, (str(self.why_not(now_ns, self.hint)), self.wire.damage)))
        elif self.periodic:
            reason = self.wire.damage
        else:
            reason = self._why_quiet(now_ns) or self.wire.damage
        return None if reason is None else reason[:MAX_REASON]

    def _why_quiet(self, now_ns: int) -> str | None:
        return words.quiet(self._delivery.quiet_ns(now_ns), self._since_good.instead(self.hint))

    def _slow_period_ns(self) -> int | None:
        """The learned period of a sensor that is slower than configured, and would be silent between its lines."""
        period_ns = self._delivery.rhythm.period_ns
        configured_ns = max(NS_PER_S / (self.table.rate_hz or ROLES[self.table.role].nominal_rate_hz), BEAT_NS)
        if period_ns is None or PERIODS * period_ns <= self._delivery.stale_ns or period_ns <= 1.5 * configured_ns:
            return None
        return period_ns

    def _event(self, code: str, now_ns: int) -> Event:
        sensor = self.table.id
        if code == "sensor-delivering":
            return event(code, now_ns, sensor, sensor=sensor)
        age_s = round(self._delivery.quiet_ns(now_ns) / NS_PER_S)
        why = self.why_not(now_ns, self.hint)
        known = {"cure": why.cure} if why.cure else {}
        text = "; ".join(filter(None, (why.what, self.wire.damage)))
        return event(code, now_ns, sensor, sensor=sensor, age_s=age_s, reason=text[:MAX_REASON], **known)

    def _health(self, state: str, reason: str | None, now_ns: int) -> SensorHealth:
        self.rate_hz = self._rate.report_hz(now_ns)
        return SensorHealth(
            sensor=self.table.id,
            t_ns=now_ns,
            state=state,
            reason=reason,
            last_good_t_ns=self._delivery.last_good_ns,
            rate_hz=self.rate_hz,
            flooded=self.wire.flooded,
            accepted=self.accepted,
            unchecked=self.unchecked,
            rejected=dict(self.rejected),
            discarded_bytes=self.wire.discarded_bytes,
        )
