"""Backfill progress (estimated time to completion): what a station lacks still, and how long it takes."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from common.link_messages import FrameRange
from common.messages import Frame
from common.units import NS_PER_S

WINDOW_NS: Final = 10 * NS_PER_S
"""The pace is that of the last ten seconds, ns of the station's monotonic time."""


@dataclass(frozen=True, slots=True)
class CatchingUp:
    """What is missing; UTC in ns, `None` = not known."""

    frames: int
    from_utc_ns: int | None = None
    to_utc_ns: int | None = None
    left_s: float | None = None
    """Time until none is missing, s, when it goes on like this; `None` = it does not become less."""


class Backfill:
    """Follows the frames that come, and says once a second what is missing."""

    def __init__(self) -> None:
        self._known: dict[str, Frame] = {}
        """A frame of each start of the daemon that knows its UTC, the newest, by boot_id."""
        self._pace: deque[tuple[int, int]] = deque()
        """Time (ns) and number of missing frames, once a second."""

    def take(self, frame: Frame) -> None:
        """A frame came, in any order."""
        known = self._known.get(frame.boot_id)
        if frame.utc_ns is not None and (known is None or frame.seq > known.seq):
            self._known[frame.boot_id] = frame

    def missing(self, ranges: Iterable[FrameRange], now_ns: int) -> CatchingUp | None:
        """What is missing now; `None` = nothing. now_ns: the station's monotonic time."""
        wanted = tuple(ranges)
        count = sum(item.last - item.first + 1 for item in wanted)
        self._pace.append((now_ns, count))
        while now_ns - self._pace[0][0] > WINDOW_NS:
            self._pace.popleft()
        if not wanted:
            return None
        since_ns, before = self._pace[0]
        less = before - count
        left_s = None if less <= 0 else count / less * (now_ns - since_ns) / NS_PER_S
        first, last = wanted[0], wanted[-1]
        begin_ns, end_ns = self._utc_ns(first.boot_id, first.first), self._utc_ns(last.boot_id, last.last)
        return CatchingUp(count, begin_ns, end_ns, left_s)

    def _utc_ns(self, boot_id: str, seq: int) -> int | None:
        """UTC of a frame that is not here: frames are made at an even pace."""
        known = self._known.get(boot_id)
        if known is None or known.utc_ns is None:
            return None
        return known.utc_ns + (seq - known.seq) * (known.t1_ns - known.t0_ns)
