"""Latest-value cache: the newest of everything a screen shows, each with its source, quality, age and staleness.

An age counts on the boat's clock up to the newest frame. From there on it counts on the station's own clock and, where
round trips say what the boat's clock shows now, on that one: whatever keeps frames away, what is shown grows old, and
so does a picture of frames that come late.
"""

from collections.abc import Callable
from typing import Final, NamedTuple, TypeVar

from common.boat_config import BoatConfig, stale_after_s
from common.messages import Fix, Frame, Heading
from common.units import NS_PER_S
from shore.navigation.estimate import Estimate
from shore.pipeline import Output
from shore.settings.station import DEFAULTS, LimitSettings
from shore.watchers.watcher import BoardNow

_QUALITY: Final = {1: "GPS", 2: "DGPS", 3: "PPS", 4: "RTK fixed", 5: "RTK float"}
"""Names of the GGA qualities of fixes that are fused."""

MOST_OVERDUE_S: Final = 2.0
"""Everything is stale once the next frame is late by more than this, s, whatever the limits of the settings."""

_Item = TypeVar("_Item")


class Age(NamedTuple):
    """How old a value is."""

    s: float
    is_stale: bool
    """True when the value is older than its sensor's rate allows, or the newest frame is too old."""


class Newest:
    """Takes frames in any order: one from before a reboot of the board, or a backfilled one, replaces nothing newer."""

    def __init__(
        self,
        config: BoatConfig,
        shown_filter: str,
        limits: LimitSettings = DEFAULTS.limits,
        now_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """now_s: a clock of the station that runs as fast as the boat's, s; the default stands still."""
        self._config = config
        self.filter = shown_filter
        self._limits = limits
        self._now_s = now_s
        self._clock_id: str | None = None
        self.board_now: BoardNow | None = None
        """The board's clock, while a live run knows it."""
        self._forget()

    def _forget(self) -> None:
        self.t_ns = 0
        """Boat time of the newest frame, ns."""
        self._period_s = 0.0
        """Length of the newest frame, s."""
        self._due_s = self._now_s()
        """When the next frame is due, on the station's clock, s."""
        self.fix: Fix | None = None
        self.heading: Heading | None = None
        self.estimate: Estimate | None = None
        self.waiting: tuple[str, ...] = ()
        """What the shown filter lacks before its estimates are valid; empty = nothing."""

    def take(self, frame: Frame, output: Output) -> None:
        """One frame and what the pipeline made of it."""
        if output.is_past:
            return
        if self._clock_id not in (None, frame.clock_id):
            self._forget()  # the board was rebooted: its time begins again
        self._clock_id = frame.clock_id
        if frame.t1_ns > self.t_ns:
            self.t_ns = frame.t1_ns
            self._period_s = (frame.t1_ns - frame.t0_ns) / NS_PER_S
            self._due_s = self._now_s() + self._period_s
        self.fix = max((*frame.fixes, *_if_any(self.fix)), key=_time, default=None)
        self.heading = max((*frame.headings, *_if_any(self.heading)), key=_time, default=None)
        self.estimate = next((item for item in output.estimates if item.filter == self.filter), self.estimate)
        self.waiting = self.waiting if output.waiting is None else output.waiting

    def age(self, item: Fix | Heading) -> Age:
        """Age of a fix or heading; that of a sensor which is not configured has no rate and is no limit."""
        table = next((each for each in self._config.sensor if each.id == item.sensor), None)
        return self._age(item.t_ns, float("inf") if table is None else stale_after_s(table.role, table.rate_hz))

    def age_of_estimate(self, estimate: Estimate) -> Age:
        """Age of an estimate, which each frame should bring."""
        return self._age(estimate.t_ns, self._limits.estimate_stale_s)

    def _age(self, t_ns: int, most_s: float) -> Age:
        overdue_s, board = max(0.0, self._now_s() - self._due_s), self.board_now
        is_of_clock = board is None or self._clock_id in (None, board.clock_id)
        if board is not None and is_of_clock and board.t_ns is not None:
            overdue_s = max(overdue_s, (board.t_ns - self.t_ns) / NS_PER_S - self._period_s)
        age_s = (self.t_ns - t_ns) / NS_PER_S + overdue_s
        return Age(age_s, age_s > most_s or overdue_s > MOST_OVERDUE_S or not is_of_clock)


def quality_of(fix: Fix) -> str:
    """How good a fix is, in a word or two, or why it is not fused."""
    if fix.usable:
        return "fix" if fix.fix_quality is None else _QUALITY.get(fix.fix_quality, "fix")
    return "position repeated, not used" if fix.held else "not usable"


def _if_any(item: _Item | None) -> tuple[_Item, ...]:
    return () if item is None else (item,)


def _time(item: Fix | Heading) -> int:
    return item.t_ns
