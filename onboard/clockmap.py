"""Boat clock -> UTC from GNSS pairs, first form.

A sentence always arrives late, never early, so the smallest (arrival - UTC) of the last minute is the best offset
(lower envelope). UTC that disagrees by more than a second for three pairs in a row is a step: `epoch` + 1, start anew.
One or two are a damaged date, a receiver just woken, or a board that was busy; they are left out.
"""

from collections import deque
from typing import Final

from common.framer import Utc
from common.messages import ClockPair
from common.units import NS_PER_MS, NS_PER_S

WINDOW_NS: Final = 60 * NS_PER_S
STEP_NS: Final = NS_PER_S
UNCERTAINTY_NS: Final = 100 * NS_PER_MS
"""Spread of NMEA latency without PPS that no envelope can see (1-sigma)."""
BELIEVED: Final = 3
"""Pairs in a row, of one receiver and agreeing with each other, that make a step."""
FIRST_BELIEVED: Final = 2
"""The same for the first mapping: a receiver's first date may be its default one."""
_AGREE_NS: Final = STEP_NS // 2
"""Less than a second: the epochs that waited in a busy board share one arrival, and differ by a second each."""


class ClockMap:
    """Pairs in, UTC of any boat time out."""

    def __init__(self) -> None:
        self.epoch = 0
        self._envelope: deque[tuple[int, int]] = deque()
        """(time, offset) that may still become the smallest of the window: offsets grow, the last is the newest."""
        self._doubted: dict[str, list[tuple[int, int]]] = {}
        """By sensor: pairs in a row that disagree with the mapping and agree with each other."""

    def add(self, pair: ClockPair) -> float | None:
        """Take one pair; returns the size of a step (s) when UTC jumped against the boat clock."""
        offset = pair.t_ns - pair.utc_ns
        if self._envelope and abs(offset - self._envelope[-1][1]) <= STEP_NS:
            self._doubted.clear()
            self._take(pair.t_ns, offset)
            return None
        doubted = self._doubted.setdefault(pair.sensor, [])
        if doubted and abs(offset - doubted[-1][1]) > _AGREE_NS:
            doubted.clear()
        doubted.append((pair.t_ns, offset))
        if len(doubted) < (BELIEVED if self._envelope else FIRST_BELIEVED):
            return None
        step_s = None
        if self._envelope:
            step_s = (self._envelope[-1][1] - offset) / NS_PER_S
            self.epoch += 1
        self._envelope.clear()
        self._doubted.clear()
        for t_ns, believed in doubted:
            self._take(t_ns, believed)
        return step_s

    def _take(self, t_ns: int, offset: int) -> None:
        while self._envelope and self._envelope[-1][1] >= offset:
            self._envelope.pop()
        self._envelope.append((t_ns, offset))
        while self._envelope[0][0] < t_ns - WINDOW_NS:
            self._envelope.popleft()

    def at(self, t_ns: int) -> Utc:
        """UTC of boat time `t_ns`; None before the mapping exists."""
        if not self._envelope:
            return Utc(None, None, "none")
        return Utc(t_ns - self._envelope[0][1], UNCERTAINTY_NS, "gnss")
