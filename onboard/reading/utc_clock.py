"""Clock synchronisation from GNSS pairs (lower envelope filter): boat time to UTC.

A sentence always arrives late, never early, so the smallest (arrival - UTC) of the last minute is the best offset
(lower envelope). UTC that disagrees for three pairs in a row is a step: `epoch` + 1, start again. One or two are a
damaged date, a receiver just woken, or a board that was busy; they are left out. A leap second is a step of -1 s: POSIX
time has no name for it. A date that does not go on at midnight is no step: the time of day counts.

Of receivers that disagree the one that was there first holds, until none has agreed with the mapping for ten seconds.
The boat clock itself is never touched: a board without a battery clock just learns its UTC later.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

from common.events import event
from common.framer import Utc
from common.messages import ClockPair, Event
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.gps.dates import TOLD_AFTER

WINDOW_NS: Final = 60 * NS_PER_S
LATE_NS: Final = 750 * NS_PER_MS
"""Most that a pair may come later than the quickest one, ns: what stands before it in the burst changes, boards are
busy."""
EARLY_NS: Final = 500 * NS_PER_MS
"""Most that a pair may come earlier than the quickest one, ns: a minute's quickest pair is seldom beaten by much. Both
limits are below a leap second."""
UNCERTAINTY_NS: Final = 100 * NS_PER_MS
"""Spread of NMEA latency without PPS that no envelope can see, 1-sigma, ns."""
DRIFT_PER_S: Final = 50e-6
"""Largest drift of a board's crystal, s/s."""
BELIEVED: Final = 3
"""Number of pairs in a row, of one receiver and agreeing with each other, that make a step."""
FIRST_BELIEVED: Final = 2
"""Number of pairs in a row that make the first mapping: a receiver's first date may be its default one."""
DAY_NS: Final = 86_400 * NS_PER_S
HELD_NS: Final = 10 * NS_PER_S
"""So long after it agreed a receiver holds the mapping against others."""
_AGREE_NS: Final = NS_PER_S // 2
"""Largest disagreement of pairs that agree, ns, below 1 s: the epochs that waited in a busy board share one arrival,
and differ by a second each."""
_AT_ONCE_NS: Final = 20 * NS_PER_MS
"""Pairs that arrive within this waited together, ns; only the last shows the time. No receiver has over 20 epochs a
second."""


@dataclass(slots=True)
class _Receiver:
    """State of one receiver beside the mapping."""

    doubted: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=BELIEVED))
    """Time and offset (ns) of pairs in a row that disagree with the mapping and agree with each other."""
    against: int = 0
    """Number of pairs in a row that disagree with the mapping."""
    agreed_ns: int | None = None
    """Boat time when the receiver last agreed, ns; `None` = never."""
    day: int | None = None
    """The day that it said then, since 1970."""
    is_told: bool = False

    def doubt(self, t_ns: int, offset: int) -> None:
        """Keep a pair that disagrees with the mapping."""
        self.against += 1
        if self.doubted:
            last_ns, last = self.doubted[-1]
            if 0 <= t_ns - last_ns < _AT_ONCE_NS:
                self.doubted[-1] = t_ns, min(offset, last)
                return
            if abs(offset - last) > _AGREE_NS:
                self.doubted.clear()
        self.doubted.append((t_ns, offset))


class ClockMap:
    """Pairs in, UTC of any boat time out."""

    def __init__(self, tell: Callable[[Event], None] = lambda _: None) -> None:
        """tell: takes the event of receivers that disagree."""
        self.epoch = 0
        self._tell = tell
        self._envelope: deque[tuple[int, int]] = deque()
        """Time and offset (ns) of the pairs that may still become the smallest of the window: offsets grow, the last is
        the newest."""
        self._newest_ns = 0
        self._receivers: dict[str, _Receiver] = {}

    def add(self, pair: ClockPair) -> float | None:
        """Take one pair; returns the size of a step (s) when UTC jumped against the boat clock."""
        receiver = self._receivers.setdefault(pair.sensor, _Receiver())
        offset = pair.t_ns - pair.utc_ns - self._days_behind(receiver, pair) * DAY_NS
        if self._envelope and self._agrees(pair.t_ns, offset):
            receiver.doubted.clear()
            receiver.against, receiver.agreed_ns, receiver.day = 0, pair.t_ns, pair.utc_ns // DAY_NS
            self._take(pair.t_ns, offset)
            return None
        receiver.doubt(pair.t_ns, offset)
        if holder := self._held_by(pair):
            if receiver.against >= TOLD_AFTER and not receiver.is_told:
                receiver.is_told = True
                apart_s = round((self._envelope[0][1] - offset) / NS_PER_S, 1)
                known: dict[str, str | float] = {"sensor": pair.sensor, "other": holder, "apart_s": apart_s}
                self._tell(event("receivers-disagree", pair.t_ns, pair.sensor, **known))
            return None
        if len(receiver.doubted) < (BELIEVED if self._envelope else FIRST_BELIEVED):
            return None
        return self._start_anew(pair)

    def _days_behind(self, receiver: _Receiver, pair: ClockPair) -> int:
        """Number of days that the date of a receiver stands still while its time of day begins again."""
        if not self._envelope or pair.utc_ns // DAY_NS != receiver.day:
            return 0
        return max(0, round((pair.t_ns - self._envelope[0][1] - pair.utc_ns) / DAY_NS))

    def _agrees(self, t_ns: int, offset: int) -> bool:
        """Whether the offset agrees; the boat clock may have drifted since the last pair."""
        drift_ns = DRIFT_PER_S * max(0, t_ns - self._newest_ns)
        return -EARLY_NS - drift_ns <= offset - self._envelope[0][1] <= LATE_NS + drift_ns

    def _held_by(self, pair: ClockPair) -> str | None:
        """Another receiver that agreed with the mapping lately."""
        return next(
            (
                sensor
                for sensor, other in self._receivers.items()
                if sensor != pair.sensor and other.agreed_ns is not None and pair.t_ns - other.agreed_ns <= HELD_NS
            ),
            None,
        )

    def _start_anew(self, pair: ClockPair) -> float | None:
        """Begin the mapping again with what this receiver says; returns the step from the former one, if any."""
        receiver = self._receivers[pair.sensor]
        step_s = None
        if self._envelope:
            step_s = (self._envelope[0][1] - min(offset for _, offset in receiver.doubted)) / NS_PER_S
            self.epoch += 1
        self._envelope.clear()
        for t_ns, believed in receiver.doubted:
            self._take(t_ns, believed)
        receiver.doubted.clear()
        receiver.against, receiver.agreed_ns, receiver.day = 0, pair.t_ns, pair.utc_ns // DAY_NS
        return step_s

    def _take(self, t_ns: int, offset: int) -> None:
        while self._envelope and self._envelope[-1][1] >= offset:
            self._envelope.pop()
        self._envelope.append((t_ns, offset))
        while self._envelope[0][0] < t_ns - WINDOW_NS:
            self._envelope.popleft()
        self._newest_ns = t_ns

    def at(self, t_ns: int) -> Utc:
        """UTC of boat time `t_ns`, its sigma growing while no pair comes; None before the mapping exists."""
        if not self._envelope:
            return Utc(None, None, "none")
        drift_ns = round(DRIFT_PER_S * max(0, t_ns - self._newest_ns - WINDOW_NS))
        return Utc(t_ns - self._envelope[0][1], UNCERTAINTY_NS + drift_ns, "gnss")
