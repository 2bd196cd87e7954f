"""Health of each sensor from its line counts and the state of its port: delivering, silent or missing.

Pure: told of every outcome and of every port change, asked at each tick.
"""

from collections import deque
from typing import Final

from common.events import event
from common.messages import Event, SensorHealth
from common.sensors import ROLES, SensorTable, stale_after_s
from common.units import NS_PER_S

REPORT_NS: Final = NS_PER_S
RATE_WINDOW_NS: Final = 5 * NS_PER_S


class SensorMonitor:
    """One sensor. Event sensors (AIS, radar) are delivering as long as their port is open."""

    def __init__(self, table: SensorTable, started_ns: int) -> None:
        self.table = table
        self.rejected: dict[str, int] = {}
        self.accepted = 0
        self.heard_bytes = 0
        """Bytes that came in on the sensor's port, readable or not."""
        self.flooded = False
        self.discarded_bytes = 0
        self.periodic = ROLES[table.role].periodic
        self._stale_ns = int(min(stale_after_s(table.role, table.rate_hz), 1e9) * NS_PER_S)
        self._started_ns = started_ns
        self._last_good_ns: int | None = None
        self._heard_at_good = self._bad_at_good = 0
        self._silence_told = False
        self._since_ns = self._opened_ns = started_ns
        """From when silence is counted: start or the port's last opening."""
        self._recent: deque[int] = deque(maxlen=4096)
        self._port_reason: str | None = "not opened yet"
        self._state: str | None = None
        self._reported_ns = 0

    def accept(self, t_ns: int, measured: bool) -> None:
        """A good line at `t_ns`; measured = it completed a measurement (a fix, a sample, a heading)."""
        self.accepted += 1
        self._last_good_ns = t_ns
        self._heard_at_good = self.heard_bytes
        self._bad_at_good = sum(self.rejected.values())
        if measured:
            self._recent.append(t_ns)

    def measured(self, t_ns: int) -> None:
        """A measurement that became due without a line of its own (end of a GPS epoch)."""
        self._recent.append(t_ns)

    def reject(self, reason: str) -> None:
        """A bad line of this sensor."""
        self.rejected[reason] = self.rejected.get(reason, 0) + 1

    def port_changed(self, reason: str | None, t_ns: int) -> None:
        """The port opened (None) or was lost."""
        if reason is None and self._port_reason is not None:
            self._opened_ns = t_ns
        self._port_reason = reason
        self._since_ns = t_ns

    def state(self, now_ns: int) -> tuple[str, str | None]:
        """State (delivering, silent or missing) and its reason."""
        if self._port_reason is not None:
            return "missing", self._port_reason
        if not self.periodic:
            return "delivering", None
        if self._last_good_ns is not None and now_ns - self._last_good_ns <= self._stale_ns:
            return "delivering", None
        return "silent", self._why_silent(now_ns)

    def _why_silent(self, now_ns: int) -> str:
        if self.heard_bytes == self._heard_at_good:
            if self._last_good_ns is None:
                return "nothing received yet"
            return f"nothing received for {(now_ns - self._last_good_ns) / NS_PER_S:.0f} s"
        bad = sum(self.rejected.values()) - self._bad_at_good
        count = self.heard_bytes - self._heard_at_good
        return f"{count} bytes came, no line of this sensor, {bad} bad ones; wrong baud rate, wrong port or talker?"

    def overdue(self, now_ns: int) -> bool:
        """True when the open port has been silent so long that it should be reopened."""
        last = max(self._since_ns, self._last_good_ns or 0)
        return self.periodic and self._port_reason is None and now_ns - last > self._stale_ns

    def report(self, now_ns: int) -> tuple[SensorHealth | None, Event | None]:
        """Health when due (once a second, and on every change of state), and the event of a change."""
        state, reason = self.state(now_ns)
        changed = state != self._state
        happening = self._silence_event(state, reason, now_ns)
        if not changed and happening is None and now_ns - self._reported_ns < REPORT_NS:
            return None, None
        if changed and state == "delivering" and self.periodic:
            happening = event("sensor-delivering", now_ns, self.table.id, sensor=self.table.id)
        self._state, self._reported_ns = state, now_ns
        return self._health(state, reason, now_ns), happening

    def _silence_event(self, state: str, reason: str | None, now_ns: int) -> Event | None:
        """Once for each silence longer than the limit, counted from the last good line or the port's opening."""
        if state != "silent":
            self._silence_told = False
            return None
        since_ns = max(self._last_good_ns or 0, self._opened_ns)
        if self._silence_told or now_ns - since_ns <= self._stale_ns:
            return None
        self._silence_told = True
        age_s = round((now_ns - since_ns) / NS_PER_S)
        sensor = self.table.id
        return event("sensor-silent", now_ns, sensor, sensor=sensor, age_s=age_s, reason=reason)

    def _health(self, state: str, reason: str | None, now_ns: int) -> SensorHealth:
        while self._recent and self._recent[0] < now_ns - RATE_WINDOW_NS:
            self._recent.popleft()
        span_ns = min(RATE_WINDOW_NS, max(now_ns - self._started_ns, NS_PER_S))
        return SensorHealth(
            sensor=self.table.id,
            t_ns=now_ns,
            state=state,
            reason=reason,
            last_good_t_ns=self._last_good_ns,
            rate_hz=len(self._recent) / (span_ns / NS_PER_S),
            flooded=self.flooded,
            accepted=self.accepted,
            rejected=dict(self.rejected),
            discarded_bytes=self.discarded_bytes,
        )
