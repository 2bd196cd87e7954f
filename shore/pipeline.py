"""Pipeline for live, replay and import: frames in, estimates and events out. No clock, no timer, no side effect.

A row of stages, each behind the one before: own ship (`shore/navigation`); targets will stand behind its estimate. The
same frames in the same order give the same output, bit for bit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from common.boat_config import BoatConfig
from common.boat_start import BoatStart, StartOrder
from common.errors import WayfixError
from common.messages import Event, Frame
from common.seqset import SeqSet
from shore.navigation.estimate import Estimate
from shore.navigation.fixed_steps import LONGEST_STEP_S, SHORTEST_STEP_S
from shore.navigation.judge import Judge
from shore.navigation.own_ship import OwnShip


@dataclass(frozen=True, slots=True)
class Output:
    """What one frame led to: one estimate for each filter that runs, when the frame is the newest."""

    estimates: tuple[Estimate, ...] = ()
    events: tuple[Event, ...] = ()
    waiting: tuple[str, ...] | None = None
    """What the first filter lacks before its estimates are valid, empty = nothing; `None` = not the newest frame."""
    is_past: bool = False
    """True for a frame of an older clock of the board, and for one that came when its trip was over: all is left as it
    was."""


class Pipeline:
    """The stages of one boat; the first of `filters` drives targets and outputs.

    `step_s` = fuse synchronously every so many seconds as in the thesis, instead of each measurement at its own time.
    `judge` = what each filter begins with, after each restart too; `None` = every measurement is fused.
    `starts` = the order of the board's starts, which the source of the frames keeps; `None` = their numbers say it.
    Raises: WayfixError for an unknown filter, none at all, or a step that is not positive.
    """

    def __init__(
        self,
        config: BoatConfig,
        filters: Sequence[str],
        step_s: float | None = None,
        judge: Judge | None = None,
        *,
        starts: StartOrder | None = None,
    ) -> None:
        if not filters:
            raise WayfixError("no filter named", "--filters", "name at least one, for example fuzzy")
        if step_s is not None and not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S:
            cure = f"give {SHORTEST_STEP_S:g} to {LONGEST_STEP_S:g} s"
            raise WayfixError(f"a step of {step_s:g} s is impossible", "--step", cure)
        self._new_own_ship: Callable[[], OwnShip] = partial(OwnShip, config, tuple(filters), step_s, judge)
        self._own_ship = self._new_own_ship()
        self._starts = starts or StartOrder()
        self._start: BoatStart | None = None
        """The newest start of the board; `None` before the first frame."""
        self._seen: dict[str, SeqSet] = {}
        """Numbers of the frames that were taken in, by boot_id."""

    def push(self, frame: Frame) -> Output:
        """Take in one frame, in any order; known frames and frames of an older clock lead to nothing."""
        start = BoatStart.of(frame)
        newest = self._start or start
        is_older = self._starts.is_before(start, newest)
        if start.clock_id != newest.clock_id and is_older:
            return Output(is_past=True)
        if start.clock_id != newest.clock_id:
            self._own_ship = self._new_own_ship()
            self._seen.clear()
            self._own_ship.notices.say("board-rebooted", frame.t0_ns)
            if 0 < start.start_no <= newest.start_no:
                self._own_ship.notices.say(
                    "start-counter-back", frame.t0_ns, start_no=start.start_no, before=newest.start_no
                )
        elif self._seen and frame.boot_id not in self._seen:
            self._own_ship.notices.say("daemon-restarted", frame.t0_ns)
        self._start = newest if is_older else start
        if not self._seen.setdefault(frame.boot_id, SeqSet()).add(frame.first, frame.seq):
            return Output()
        return self._through(frame)

    def has(self, frame: Frame) -> bool:
        """Whether this frame was taken in, under the newest clock."""
        return frame.boot_id in self._seen and frame.seq in self._seen[frame.boot_id]

    def _through(self, frame: Frame) -> Output:
        """The row of stages."""
        output = Output(*self._own_ship.push(frame))
        if self._own_ship.is_out_of_reach:
            self._own_ship = self._new_own_ship()
            self._own_ship.moved(frame.t1_ns)
        return output
