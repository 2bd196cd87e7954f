"""Line error rate of one port, with hysteresis: when a notable share of its lines comes damaged. Pure."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from common.units import NS_PER_S

WINDOW_NS: Final = 10 * NS_PER_S
CONFIRM_NS: Final = 4 * NS_PER_S
"""Time that damage must last, ns, longer than the shortest silence limit: where no good line comes, the silence is
reported and not the damage."""
BAD_SHARE: Final = 0.2
CLEAN_SHARE: Final = 0.05
LEAST_BAD: Final = 5


@dataclass(slots=True)
class Wire:
    """What one port's bytes were like since start, whichever sensor sent them. Shared by the sensors of the port."""

    heard_bytes: int = 0
    discarded_bytes: int = 0
    """Number of bytes over the byte budget."""
    readable: int = 0
    """Number of lines that came whole, of any sensor, usable or not."""
    damaged: int = 0
    """Number of lines that came damaged (checksum, no text, cut, too long)."""
    flooded: bool = False
    damage: str | None = None
    """Description of the damage while a notable share of the lines is damaged; `None` = it is not."""


class DamageWatch:
    """Says when more than one line in five of a port comes damaged, and when that is over (hysteresis)."""

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._marks: deque[tuple[int, int, int]] = deque()
        self._since: tuple[int, int, int] | None = None
        """Mark from which the damage has to last to be reported: time (ns), readable and damaged lines until then."""
        self._told = False

    def reset(self) -> None:
        """The port was lost or opened: what was before does not count any more."""
        self._marks.clear()
        self._since, self._told, self._wire.damage = None, False, None

    def look(self, now_ns: int) -> tuple[str, int, int] | None:
        """Step at each tick: the code of an event that is due now, the damaged and all lines of the window."""
        if self._marks and now_ns - self._marks[-1][0] < NS_PER_S:
            return None
        wire = self._wire
        has_more = not self._marks or wire.readable > self._marks[-1][1]
        self._marks.append((now_ns, wire.readable, wire.damaged))
        while self._marks[0][0] < now_ns - WINDOW_NS:
            self._marks.popleft()
        begin_ns, readable, damaged = self._marks[0]
        bad = wire.damaged - damaged
        count = bad + wire.readable - readable
        if self._told:
            wire.damage = _share(bad, count)
            if count == 0 or now_ns - begin_ns < WINDOW_NS - NS_PER_S or bad > CLEAN_SHARE * count:
                return None
            self._told, wire.damage = False, None
            return "lines-clean", bad, count
        if bad < LEAST_BAD or bad <= BAD_SHARE * count:
            self._since = None
            return None
        if self._since is None:
            # Where no good line comes at all the silence is reported; it is no damage of the lines after it.
            self._since = self._marks[-1] if has_more else None
            return None
        since_ns, readable_then, damaged_then = self._since
        if now_ns - since_ns < CONFIRM_NS:
            return None
        self._since = None
        more, more_bad = wire.readable - readable_then, wire.damaged - damaged_then
        if more == 0 or more_bad <= BAD_SHARE * (more + more_bad):
            return None
        self._told, wire.damage = True, _share(bad, count)
        return "lines-damaged", bad, count


def _share(bad: int, count: int) -> str | None:
    return f"{bad} of {count} lines damaged: loose plug, wrong baud rate or a second reader?" if bad else None
