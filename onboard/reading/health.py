"""Health of each sensor from its line counts and the state of its port: delivering, silent or missing.

Pure: told of every outcome and of every port change, asked at each tick.

Three limits on silence. The state turns `silent` at stale-after, which follows the configured rate. The event waits for
five learned periods too, so that a sensor slower than its configuration is no line of the log for each sample. The
port is opened anew at the same limit, then after ever longer pauses: opening resets an Arduino, which needs seconds
to boot and would never come up.
"""

from collections import Counter, deque
from typing import Final

from common.events import event
from common.messages import Event, SensorHealth
from common.sensors import ROLES, SensorTable, stale_after_s
from common.units import NS_PER_S
from onboard.reading.line_quality import Wire

REPORT_NS: Final = NS_PER_S
RATE_WINDOW_REPORTS: Final = 5
QUIET_NS: Final = 30 * NS_PER_S
"""After this an event sensor's reason says for how long it has been quiet."""
SHORTEST_SILENT_BYTES: Final = 512
"""Fewer bytes without a line end may be the beginning of a line."""
HINT_NS: Final = 10 * NS_PER_S
LONGEST_REOPEN_PAUSE_NS: Final = 60 * NS_PER_S
MAX_REASON: Final = 256

_BEAT_NS: Final = 3 * NS_PER_S // 5
"""Lines closer together than this are one beat: five of them are within the least limit of 3 s."""
_BEATS: Final = 8
_LONGEST_PERIOD_NS: Final = 60 * NS_PER_S
"""A longer gap is an outage, nobody's period, unless the configuration says so."""


class Rhythm:
    """Learns the period of lines that come in bursts: the mean distance of the last beats."""

    def __init__(self, longest_ns: int) -> None:
        self._longest_ns = max(longest_ns, _LONGEST_PERIOD_NS)
        self._beats: deque[int] = deque(maxlen=_BEATS + 1)
        self._last_ns: int | None = None

    def line(self, t_ns: int) -> None:
        """A good line came."""
        last_ns = self._last_ns
        if last_ns is not None and 0 <= t_ns - last_ns < _BEAT_NS:
            return
        if last_ns is not None and not 0 <= t_ns - last_ns <= self._longest_ns:
            self._beats.clear()
        self._beats.append(t_ns)
        self._last_ns = t_ns

    def forget(self) -> None:
        """The port was lost: what comes back may be another device."""
        self._beats.clear()
        self._last_ns = None

    @property
    def period_ns(self) -> int | None:
        """Mean distance of the beats; `None` before the second."""
        if len(self._beats) < 2:
            return None
        return (self._beats[-1] - self._beats[0]) // (len(self._beats) - 1)


class SensorMonitor:
    """One sensor. Event sensors (AIS, radar) are delivering as long as their port is open."""

    def __init__(self, table: SensorTable, started_ns: int, wire: Wire | None = None) -> None:
        """Wire: of the sensor's port."""
        self.table = table
        self.wire = Wire() if wire is None else wire
        self.rejected: Counter[str] = Counter()
        self.accepted = 0
        self.hint: str | None = None
        """Whose lines come instead of this sensor's, in words (`PortChain`)."""
        self.periodic = ROLES[table.role].periodic
        self._stale_ns = int(min(stale_after_s(table.role, table.rate_hz), 1e9) * NS_PER_S)
        self._rhythm = Rhythm(self._stale_ns)
        self._measured = 0
        self._marks = deque([(started_ns, 0)], maxlen=RATE_WINDOW_REPORTS + 1)
        """(time, measurements until then) of the last reports."""
        self._last_good_ns: int | None = None
        self._good_seen = 0
        self._heard_then = self._readable_then = 0
        self._rejected_then: Counter[str] = Counter()
        self._silence_told = self._delivery_told = False
        self._since_ns = self._opened_ns = started_ns
        """From when silence is counted: start or the port's last opening."""
        self._reopened = 0
        self._hint_ns = started_ns
        self._port_reason: str | None = "not opened yet"
        self._state: str | None = None
        self._reported_ns = 0

    def accept(self, t_ns: int, measured: bool) -> None:
        """A good line at `t_ns`; measured = it completed a measurement (a fix, a sample, a heading)."""
        self.accepted += 1
        self._measured += measured
        self._last_good_ns = t_ns
        self._rhythm.line(t_ns)

    def measured(self) -> None:
        """A measurement became due without a line of its own (end of a GPS epoch)."""
        self._measured += 1

    def reject(self, reason: str) -> None:
        """A bad line of this sensor."""
        self.rejected[reason] += 1

    def port_changed(self, reason: str | None, t_ns: int) -> None:
        """The port opened (None) or was lost."""
        if reason is None:
            self._opened_ns = t_ns
            self._count_from_here()
        else:
            self._rhythm.forget()
            self._silence_told = self._delivery_told = False
        self.hint, self._reopened, self._hint_ns = None, 0, t_ns
        self._port_reason = reason
        self._since_ns = t_ns

    def reopening(self, t_ns: int) -> None:
        """The open port is being closed and opened because of the silence, which goes on."""
        self._reopened += 1
        self._since_ns = t_ns

    def state(self, now_ns: int) -> tuple[str, str | None]:
        """State (delivering, silent or missing) and its reason, in words of at most 256 characters."""
        state, reason = self._judged(now_ns)
        return state, None if reason is None else reason[:MAX_REASON]

    def _judged(self, now_ns: int) -> tuple[str, str | None]:
        if self._port_reason is not None:
            return "missing", self._port_reason
        if not self.periodic:
            return "delivering", self._quiet(now_ns) or self.wire.damage
        last_ns = self._last_good_ns
        # What came before the port was lost and opened says nothing of what is plugged in now.
        if last_ns is not None and last_ns >= self._opened_ns and now_ns - last_ns <= self._stale_ns:
            return "delivering", self.wire.damage
        return "silent", "; ".join(filter(None, (self._why_silent(now_ns), self.wire.damage)))

    def _quiet(self, now_ns: int) -> str | None:
        quiet_ns = now_ns - max(self._last_good_ns or 0, self._opened_ns)
        if quiet_ns < QUIET_NS:
            return None
        text = f"quiet for {quiet_ns // NS_PER_S} s"
        return text if self.wire.heard_bytes == self._heard_then else f"{text}; {self._instead()}"

    def _why_silent(self, now_ns: int) -> str:
        if self.wire.heard_bytes != self._heard_then:
            return self._instead()
        if self._last_good_ns is None:
            return "nothing received yet"
        text = f"nothing received for {(now_ns - self._last_good_ns) / NS_PER_S:.0f} s"
        period_ns = self._rhythm.period_ns
        configured_ns = max(NS_PER_S / (self.table.rate_hz or ROLES[self.table.role].nominal_rate_hz), _BEAT_NS)
        if period_ns is None or 5 * period_ns <= self._stale_ns or period_ns <= 1.5 * configured_ns:
            return text
        return f"{text}; it sends every {period_ns / NS_PER_S:.3g} s, slower than configured"

    def _instead(self) -> str:
        """What came in place of this sensor's lines."""
        if self.hint is not None:
            return self.hint
        count = self.wire.heard_bytes - self._heard_then
        bad = self.rejected - self._rejected_then
        if self.wire.flooded:
            return f"{count} bytes came, more than the port's byte budget: no whole line of this sensor is left of them"
        if count < SHORTEST_SILENT_BYTES and not bad and self.wire.readable == self._readable_then:
            return f"{count} bytes came, no whole line yet"
        if self.wire.readable == self._readable_then and 2 * bad["not-ascii"] >= bad.total():
            return f"{count} bytes came, none readable: wrong baud rate?"
        if bad:
            reasons = ", ".join(f"{reason} {number}" for reason, number in bad.most_common(4))
            return f"{bad.total()} bad lines came, no good one: {reasons}"
        return f"{count} bytes came, no line of this sensor: wrong port or talker?"

    def limit_ns(self) -> int:
        """How long a silence may be before it is told and the port is opened anew."""
        return max(self._stale_ns, 5 * (self._rhythm.period_ns or 0))

    def overdue(self, now_ns: int) -> bool:
        """True when the open port has been silent so long that it should be reopened."""
        if not self.periodic or self._port_reason is not None:
            return False
        last_ns = max(self._since_ns, self._last_good_ns or 0)
        limit_ns = self.limit_ns()
        pause_ns = min(limit_ns << min(self._reopened, 8), max(limit_ns, LONGEST_REOPEN_PAUSE_NS))
        return now_ns - last_ns > pause_ns

    def wants_hint(self, now_ns: int) -> bool:
        """True now and then while other bytes come and none of this sensor's lines: set `hint`."""
        if self._port_reason is not None or self.wire.heard_bytes == self._heard_then or now_ns < self._hint_ns:
            return False
        quiet_ns = now_ns - max(self._last_good_ns or 0, self._opened_ns)
        if quiet_ns <= (self._stale_ns if self.periodic else QUIET_NS):
            return False
        self._hint_ns = now_ns + HINT_NS
        return True

    def report(self, now_ns: int) -> tuple[SensorHealth | None, Event | None]:
        """Health when due (once a second, and on every change of state), and the event of a change."""
        if self.accepted != self._good_seen:
            self._note_good()
        state, reason = self.state(now_ns)
        changed = state != self._state
        happening = self._happening(state, reason, now_ns)
        if not changed and happening is None and now_ns - self._reported_ns < REPORT_NS:
            return None, None
        self._state, self._reported_ns = state, now_ns
        return self._health(state, reason, now_ns), happening

    def _note_good(self) -> None:
        """Good lines came since the last report: from here on it is counted what came instead."""
        self._good_seen = self.accepted
        self._count_from_here()
        self._reopened, self.hint = 0, None

    def _count_from_here(self) -> None:
        self._heard_then, self._readable_then = self.wire.heard_bytes, self.wire.readable
        self._rejected_then = self.rejected.copy()

    def _happening(self, state: str, reason: str | None, now_ns: int) -> Event | None:
        """One event for each silence longer than the limit, and one for its end or the port's return."""
        if not self.periodic:
            return None
        sensor = self.table.id
        if state == "delivering" and not self._delivery_told:
            self._silence_told, self._delivery_told = False, True
            return event("sensor-delivering", now_ns, sensor, sensor=sensor)
        since_ns = max(self._last_good_ns or 0, self._opened_ns)
        if state != "silent" or self._silence_told or now_ns - since_ns <= self.limit_ns():
            return None
        self._silence_told, self._delivery_told = True, False
        age_s = round((now_ns - since_ns) / NS_PER_S)
        return event("sensor-silent", now_ns, sensor, sensor=sensor, age_s=age_s, reason=reason)

    def _health(self, state: str, reason: str | None, now_ns: int) -> SensorHealth:
        begin_ns, before = self._marks[0]
        span_ns = max(now_ns - begin_ns, NS_PER_S)
        if now_ns - self._marks[-1][0] >= REPORT_NS:
            self._marks.append((now_ns, self._measured))
        return SensorHealth(
            sensor=self.table.id,
            t_ns=now_ns,
            state=state,
            reason=reason,
            last_good_t_ns=self._last_good_ns,
            rate_hz=(self._measured - before) / (span_ns / NS_PER_S),
            flooded=self.wire.flooded,
            accepted=self.accepted,
            rejected=dict(self.rejected),
            discarded_bytes=self.wire.discarded_bytes,
        )
