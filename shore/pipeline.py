"""One path for live and replay: frames in, estimates and events out. No clock, no timer, no knowledge of which it is.

The same frames in the same order give the same estimates, bit for bit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from common.boat_start import BoatStart
from common.errors import WayfixError
from common.events import event
from common.messages import Event, Frame
from common.sensors import BoatConfig
from common.seqset import SeqSet
from common.units import NS_PER_S
from shore.navigation.alignment import Alignment, before_start
from shore.navigation.bank import Bank, Batch, Moment
from shore.navigation.estimate import Estimate, estimate_of
from shore.navigation.filters import build_filter, facts_of
from shore.navigation.imu import ImuTrack, blocks_of, driving_sensor
from shore.navigation.measurements import FARTHEST_M, Reader
from shore.navigation.synchronous import LONGEST_STEP_S, SHORTEST_STEP_S, Synchronous
from shore.navigation.timeline import AHEAD_S, HORIZON_S, Timeline

WAITING_AFTER_S: Final = 5.0
FAR_FIXES: Final = 10
"""So many fixes in a row beyond the plane's reach: it was the origin that was wrong (or the boat was carried away)."""
SUMMED_S: Final = 10.0
"""Measurements that are not fused are summed up, and told at most this often."""


@dataclass(frozen=True, slots=True)
class Output:
    """What one frame led to: one estimate for each filter that runs, when the frame is the newest."""

    estimates: tuple[Estimate, ...] = ()
    events: tuple[Event, ...] = ()
    waiting: tuple[str, ...] | None = None
    """What the first filter lacks before its estimates are valid, empty = nothing; `None` = not the newest frame."""


class Pipeline:
    """The filters of one boat; the first of `filters` drives targets and outputs.

    `step_s` = fuse synchronously every so many seconds as in the thesis, instead of each measurement at its own time.
    Raises: WayfixError for an unknown filter, none at all, or a step that is not positive.
    """

    def __init__(self, config: BoatConfig, filters: Sequence[str], step_s: float | None = None) -> None:
        if not filters:
            raise WayfixError("no filter named", "--filters", "name at least one, for example fuzzy")
        if step_s is not None and not SHORTEST_STEP_S <= step_s <= LONGEST_STEP_S:
            cure = f"give {SHORTEST_STEP_S:g} to {LONGEST_STEP_S:g} s"
            raise WayfixError(f"a step of {step_s:g} s is impossible", "--step", cure)
        self._new_run: Callable[[], _Run] = partial(_Run, config, tuple(filters), step_s)
        self._run = self._new_run()
        self._newest: BoatStart | None = None
        self._seen: dict[str, SeqSet] = {}
        """By boot_id."""

    def push(self, frame: Frame) -> Output:
        """Take in one frame, in any order; known frames and frames of an older clock lead to nothing."""
        start = BoatStart.of(frame)
        newest = self._newest or start
        if start.is_before(newest):
            return Output()
        if start.clock_id != newest.clock_id:
            self._run = self._new_run()
            self._seen.clear()
            self._run.tell("board-rebooted", frame.t0_ns, "filter")
        elif self._seen and frame.boot_id not in self._seen:
            self._run.tell("daemon-restarted", frame.t0_ns, "filter")
        self._newest = newest.followed_by(frame)
        is_new = self._seen.setdefault(frame.boot_id, SeqSet()).add(frame.first, frame.seq)
        output = self._run.push(frame) if is_new else Output()
        if self._run.far_fixes >= FAR_FIXES:
            self._run = self._new_run()
            limit_km = round(FARTHEST_M / 1000.0)
            self._run.tell("origin-moved", frame.t1_ns, "filter", count=FAR_FIXES, limit_km=limit_km)
        return output


class _Run:
    """The filters over one clock of the board: its times are comparable."""

    def __init__(self, config: BoatConfig, names: tuple[str, ...], step_s: float | None) -> None:
        facts = facts_of(config)
        self._driver = driving_sensor(config)
        imu = self._imu = ImuTrack(self._driver) if self._driver else None
        self._names = names
        self._alignments = {name: Alignment() for name in names}
        filters = [build_filter(name, facts) for name in names]
        self._bank = Bank(filters, facts, has_compass=bool(config.with_role("compass")))
        self._feeder: Timeline | Synchronous = (
            Timeline(self._bank, imu) if step_s is None else Synchronous(self._bank, imu, step_s)
        )
        self._events: list[Event] = []
        self._reader = Reader(config, self._events.append)
        self._first_ns: int | None = None
        self._newest_ns = 0
        self._is_started = self._has_waited = self._is_aligned = False
        self._resets_told: set[tuple[str, int]] = set()
        self._unused_told: dict[tuple[str, str], tuple[int, int]] = {}
        """(code, sensor) -> measurements told so far, and when."""

    @property
    def far_fixes(self) -> int:
        """Fixes in a row that lie beyond the plane's reach."""
        return self._reader.far_in_a_row

    def tell(self, code: str, t_ns: int, source: str, **evidence: str | float | bool | None) -> None:
        """Add an event to the next output."""
        self._events.append(event(code, t_ns, source, **evidence))

    def push(self, frame: Frame) -> Output:
        """Take in one new frame."""
        if self._first_ns is None:
            self._first_ns, self._newest_ns = frame.t0_ns, frame.t1_ns
        self._newest_ns = max(self._newest_ns, frame.t1_ns)
        moments = self._feeder.push(self._batch(frame))
        self._tell_resets()
        estimates = [estimate for moment in moments for estimate in self._estimates(moment, frame)]
        if estimates and not self._is_started:
            self._is_started = True
            lat_deg, lon_deg = round(estimates[0].lat_deg, 6), round(estimates[0].lon_deg, 6)
            self.tell("filter-started", estimates[0].t_ns, "filter", lat_deg=lat_deg, lon_deg=lon_deg)
        waiting = self._waiting(moments[-1], estimates) if moments else None
        for moment in moments:
            self._tell_waiting(moment, self._first_ns)
        if waiting == () and not self._is_aligned:
            self._is_aligned = True
            self.tell("filter-aligned", self._newest_ns, "filter")
        self._tell_unused()
        told = tuple(self._events)
        self._events.clear()
        return Output(tuple(estimates), told, waiting)

    def _batch(self, frame: Frame) -> Batch:
        """The frame's measurements, converted; those of no use are left out."""
        blocks = blocks_of(frame, self._driver) if self._driver else ()
        return Batch(frame.t1_ns, frame.boot_id, self._reader.read(frame), blocks)

    def _estimates(self, moment: Moment, frame: Frame) -> list[Estimate]:
        plane = self._reader.plane
        if plane is None:
            return []
        estimates = []
        for name, state in zip(self._names, moment.states, strict=True):
            if state is not None:
                waiting = self._alignments[name].waiting(state)
                estimates.append(estimate_of(state, frame, plane, name=name, t_ns=moment.t_ns, waiting=waiting))
        return [estimate for estimate in estimates if estimate is not None]

    def _waiting(self, moment: Moment, estimates: Sequence[Estimate]) -> tuple[str, ...]:
        """What the first filter lacks."""
        newest = [item for item in estimates if item.filter == self._names[0]]
        if newest:
            return newest[-1].waiting
        return before_start(moment.position, moment.heading, self._bank.has_compass) or ("restart",)

    def _tell_waiting(self, moment: Moment, first_ns: int) -> None:
        """Once, when the start takes longer than 5 s."""
        if self._is_started or self._has_waited or moment.t_ns - first_ns < WAITING_AFTER_S * NS_PER_S:
            return
        self._has_waited = True
        waiting = before_start(moment.position, moment.heading, self._bank.has_compass)
        self.tell("filter-waiting", moment.t_ns, "filter", missing=", ".join(waiting))

    def _tell_resets(self) -> None:
        """Each once, though a rewind may find it again."""
        for name, t_ns in self._bank.resets:
            if (name, t_ns) not in self._resets_told:
                self._resets_told.add((name, t_ns))
                self._alignments[name].begin_again()
                self.tell("filter-reset", t_ns, "filter", filter=name)
        self._bank.resets.clear()

    def _tell_unused(self) -> None:
        """Summed up, so that a backfill after a cut of the link is a few events instead of thousands."""
        self._tell_counts("late-dropped", self._feeder.late, limit_s=HORIZON_S)
        self._tell_counts("ahead-dropped", self._feeder.ahead, limit_s=AHEAD_S)
        if self._imu and self._driver and self._imu.left_out:
            self._tell_counts("imu-implausible", {self._driver.id: self._imu.left_out})

    def _tell_counts(self, code: str, counts: Mapping[str, int], **evidence: float) -> None:
        now_ns = self._newest_ns
        for sensor, count in counts.items():
            told, told_at_ns = self._unused_told.get((code, sensor), (0, None))
            if count == told or (told_at_ns is not None and now_ns - told_at_ns < SUMMED_S * NS_PER_S):
                continue
            self._unused_told[code, sensor] = (count, now_ns)
            self.tell(code, now_ns, sensor, sensor=sensor, count=count - told, **evidence)
