"""Boat clock -> UTC from GNSS pairs, first form.

A sentence always arrives late, never early, so the smallest (arrival - UTC) of the last minute is the best offset
(lower envelope). A disagreement of more than a second is a step: `epoch` + 1, start anew.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

from common.messages import ClockPair
from common.units import NS_PER_MS, NS_PER_S

WINDOW_NS: Final = 60 * NS_PER_S
STEP_NS: Final = NS_PER_S
UNCERTAINTY_NS: Final = 100 * NS_PER_MS
"""Spread of NMEA latency without PPS that no envelope can see (1-sigma)."""


@dataclass(frozen=True, slots=True)
class Utc:
    """UTC of one boat time with its 1-sigma doubt and where it comes from."""

    utc_ns: int | None
    uncertainty_ns: int | None
    source: str


class ClockMap:
    """Pairs in, UTC of any boat time out."""

    def __init__(self) -> None:
        self.epoch = 0
        self._pairs: deque[tuple[int, int]] = deque()

    def add(self, pair: ClockPair) -> float | None:
        """Take one pair; returns the size of a step (s) when UTC jumped against the boat clock."""
        offset = pair.t_ns - pair.utc_ns
        step_s = None
        if self._pairs and abs(offset - self._pairs[-1][1]) > STEP_NS:
            step_s = (self._pairs[-1][1] - offset) / NS_PER_S
            self._pairs.clear()
            self.epoch += 1
        self._pairs.append((pair.t_ns, offset))
        while self._pairs[0][0] < pair.t_ns - WINDOW_NS:
            self._pairs.popleft()
        return step_s

    def at(self, t_ns: int) -> Utc:
        """UTC of boat time `t_ns`; None before the first pair."""
        if not self._pairs:
            return Utc(None, None, "none")
        return Utc(t_ns - min(offset for _, offset in self._pairs), UNCERTAINTY_NS, "gnss")
