"""Boat time to UTC by linear interpolation, and to seconds of the log, for each clock the board had.

UTC is what the frames say of it, by the best source a clock ever had (gnss before rtc): the boat clock is steady, so
the first minutes get theirs from when it was known. A log whose frames never knew it goes by their arrivals: live those
are the station's UTC, in an import the recording's own where it had a date, and boat time (before 2000) where not.
"""

from bisect import bisect_right, insort
from statistics import median_low
from typing import Any, Final, NamedTuple

from common.messages import UTC_SOURCES, Frame
from common.units import NS_PER_S

KNOT_NS: Final = 10 * NS_PER_S
"""Boat time between two points taken from the frames' UTC, ns; between them UTC is interpolated linearly."""
ARRIVAL_NS: Final = 60 * NS_PER_S
"""The frame with the shortest delay within each interval of this length stands for its arrivals, ns."""
EARLIEST_NS: Final = 946_684_800 * NS_PER_S
"""1 January 2000, ns since 1970: earlier arrivals belong to a log whose times are not UTC."""
WRONG_DATE_NS: Final = 365 * 86_400 * NS_PER_S
_ARRIVAL: Final = 0
"""Rank of arrival times as a source of UTC, the same as that of `none`."""


class _Knot(NamedTuple):
    t_ns: int
    offset_ns: int
    """UTC less boat time."""
    epoch: int


class BoardClock:
    """One clock of the board: its times can be compared."""

    def __init__(self, number: int, first_ns: int, begin_s: float) -> None:
        self.number = number
        """Number of the clock in the order of the log."""
        self._first_ns = first_ns
        self._begin_s = begin_s
        self._knots: dict[int, list[_Knot]] = {}
        """Points of the mapping from boat time to UTC, by rank of their source."""
        self._best: list[_Knot] = []
        self._quickest: _Knot | None = None
        self._minute = -1

    def seconds(self, t_ns: int) -> float:
        """Seconds of the log, counted as `wayfix replay` counts them."""
        return self._begin_s + (t_ns - self._first_ns) / NS_PER_S

    def utc_ns(self, t_ns: int) -> int | None:
        """UTC of a boat time, ns; `None` where it is not known."""
        knots = self._best
        if not knots:
            return None
        after = bisect_right(knots, t_ns, key=lambda knot: knot.t_ns)
        left, right = knots[max(after - 1, 0)], knots[min(after, len(knots) - 1)]
        if left.t_ns == right.t_ns:
            return t_ns + left.offset_ns
        if left.epoch != right.epoch:  # a step: the nearer side holds
            return t_ns + (left if t_ns - left.t_ns <= right.t_ns - t_ns else right).offset_ns
        part = (right.offset_ns - left.offset_ns) * (t_ns - left.t_ns) // (right.t_ns - left.t_ns)
        return t_ns + left.offset_ns + part

    def told(self, frame: Frame) -> None:
        """Take what a frame says of UTC."""
        if frame.utc_ns is None or frame.utc_src == "none":
            return
        knots = self._knots.setdefault(UTC_SOURCES.index(frame.utc_src), [])
        knot = _Knot(frame.t0_ns, frame.utc_ns - frame.t0_ns, frame.clk_epoch)
        if not knots or knot.epoch != knots[-1].epoch or abs(knot.t_ns - knots[-1].t_ns) >= KNOT_NS:
            insort(knots, knot)

    def arrived(self, t_ns: int, log_time_ns: int) -> None:
        """Take the end of a frame that is the newest so far, and its arrival."""
        if log_time_ns < EARLIEST_NS:
            return
        minute, knot = t_ns // ARRIVAL_NS, _Knot(t_ns, log_time_ns - t_ns, 0)
        if minute != self._minute:
            self._keep_quickest()
            self._minute, self._quickest = minute, knot
        elif self._quickest is None or knot.offset_ns < self._quickest.offset_ns:
            self._quickest = knot

    def settle(self) -> None:
        """After the last frame: choose the best source, and drop the date of a clock that was wrong for a while."""
        self._keep_quickest()
        knots = self._knots[max(self._knots)] if self._knots else []
        usual_ns = median_low(knot.offset_ns for knot in knots) if knots else 0
        self._best = [knot for knot in knots if abs(knot.offset_ns - usual_ns) < WRONG_DATE_NS]

    def _keep_quickest(self) -> None:
        if self._quickest is not None:
            insort(self._knots.setdefault(_ARRIVAL, []), self._quickest)
            self._quickest = None


class Clocks:
    """All clocks of a log, fed by its frames in file order."""

    def __init__(self, start: dict[str, Any] | None) -> None:
        """The log's first `/session` start."""
        made = ((start or {}).get("connected") or {}).get("file") or {}
        self.has_time_of_day = made.get("clock") == "utc-time-of-day"
        """True when boat time less whole days is UTC without its date."""
        self._of_clock: dict[str, BoardClock] = {}
        self._of_boot: dict[str, BoardClock] = {}
        self.all: list[BoardClock] = []
        self.newest_s = 0.0

    def of_frame(self, frame: Frame) -> BoardClock:
        """The clock of a frame."""
        clock = self._of_clock.get(frame.clock_id)
        if clock is None:
            clock = self._of_clock[frame.clock_id] = BoardClock(len(self.all), frame.t0_ns, self.newest_s)
            self.all.append(clock)
        self._of_boot[frame.boot_id] = clock
        return clock

    def of_boot(self, boot_id: str, t_ns: int) -> BoardClock:
        """The clock of a start of the daemon; the last clock for a start that no frame belongs to."""
        return self._of_boot.get(boot_id) or self.any(t_ns)

    def any(self, t_ns: int) -> BoardClock:
        """The last clock; where no frame came at all, one that begins at `t_ns`."""
        if not self.all:
            self.all.append(BoardClock(0, t_ns, 0.0))
        return self.all[-1]

    def came(self, clock: BoardClock, t_ns: int, log_time_ns: int) -> None:
        """Take the end of a frame that is the newest so far, and its arrival."""
        self.newest_s = max(self.newest_s, clock.seconds(t_ns))
        clock.arrived(t_ns, log_time_ns)

    def settle(self) -> None:
        """After the last frame."""
        for clock in self.all:
            clock.settle()

    @property
    def know_utc(self) -> bool:
        """True when UTC is known for all of them."""
        return bool(self.all) and all(clock.utc_ns(0) is not None for clock in self.all)
