"""State estimation of our own ship: frames of one clock of the board in, the estimates of each filter out.

frame -> Intake (corrected measurements) -> Timeline or Synchronous (order) -> Bank (filters) -> estimates, events
"""

from collections.abc import Sequence
from typing import NamedTuple

from common.boat_config import BoatConfig
from common.messages import Event, Frame
from shore.navigation.basis import Bases
from shore.navigation.basis_events import BasisEvents
from shore.navigation.estimate import Estimate, estimate_of
from shore.navigation.filter_bank import Bank, Moment
from shore.navigation.filter_registry import build_filter
from shore.navigation.fixed_steps import Synchronous
from shore.navigation.imu_track import driving_sensor
from shore.navigation.initial_alignment import Alignment, before_start
from shore.navigation.intake import FAR_FIXES, Intake
from shore.navigation.judge import Judge
from shore.navigation.measurements import FARTHEST_M
from shore.navigation.notices import Notices
from shore.navigation.sensor_facts import facts_of
from shore.navigation.start_events import StartEvents
from shore.navigation.timeline import AHEAD_S, HORIZON_S, Timeline
from shore.navigation.trust_events import TrustEvents


class Estimated(NamedTuple):
    """What one frame led to."""

    estimates: tuple[Estimate, ...]
    events: tuple[Event, ...]
    waiting: tuple[str, ...] | None
    """What the first filter lacks before its estimates are valid, empty = nothing; `None` = not the newest frame."""


class OwnShip:
    """The filters over one clock of the board, whose times are comparable, and one local plane."""

    def __init__(
        self, config: BoatConfig, names: Sequence[str], step_s: float | None, judge: Judge | None = None
    ) -> None:
        """`step_s`: fuse synchronously every so many seconds, as in the thesis. `judge`: each filter begins with it.

        Raises: WayfixError for an unknown filter.
        """
        facts = facts_of(config)
        self.notices = Notices()
        self._intake = Intake(config, self.notices.add)
        self._names = tuple(names)
        self._alignments = {name: Alignment() for name in names}
        filters = [build_filter(name, facts, judge=judge) for name in names]
        self._bases = Bases(config)
        self._bank = Bank(filters, bool(config.with_role("compass")), self._bases.lost_after_ns)
        self._feeder: Timeline | Synchronous = (
            Timeline(self._bank, self._intake.imu)
            if step_s is None
            else Synchronous(self._bank, self._intake.imu, step_s)
        )
        driver = driving_sensor(config)
        self._trust_events = TrustEvents(self.notices, self._intake.imu, driver.id if driver else "")
        self._start_events = StartEvents(self.notices, has_compass=self._bank.has_compass)
        self._basis_events = BasisEvents(self.notices, self._bases.lost_after_ns)
        self._first_ns: int | None = None
        self._newest_ns = 0

    @property
    def is_out_of_reach(self) -> bool:
        """The plane's origin is wrong: so many fixes in a row lie too far away."""
        return self._intake.is_out_of_reach

    def moved(self, t_ns: int) -> None:
        """Say that this run begins because the one before was out of reach."""
        self.notices.say("origin-moved", t_ns, count=FAR_FIXES, limit_km=round(FARTHEST_M / 1000.0))

    def push(self, frame: Frame) -> Estimated:
        """Take in one new frame."""
        if self._first_ns is None:
            self._first_ns, self._newest_ns = frame.t0_ns, frame.t1_ns
        self._newest_ns = max(self._newest_ns, frame.t1_ns)
        self._bases.see(frame)
        moments = self._feeder.push(self._intake.batch(frame))
        self._notice_resets()
        estimates = [estimate for moment in moments for estimate in self._estimates(moment, frame)]
        newest = next((item for item in reversed(estimates) if item.filter == self._names[0]), None)
        waiting = self._waiting(moments[-1], newest) if moments else None
        self._start_events.take(moments, estimates, waiting, first_ns=self._first_ns, newest_ns=self._newest_ns)
        if moments:
            self._trust_events.take(moments[-1])
            self._basis_events.take(frame, moments[-1], newest)
        self._notice_unused()
        return Estimated(tuple(estimates), self.notices.take(), waiting)

    def _estimates(self, moment: Moment, frame: Frame) -> list[Estimate]:
        plane = self._intake.plane
        if plane is None:
            return []
        estimates = []
        for name, state in zip(self._names, moment.states, strict=True):
            if state is not None:
                waiting = self._alignments[name].waiting(state)
                basis = self._bases.of(moment, state)
                made = estimate_of(state, frame, plane, name=name, t_ns=moment.t_ns, waiting=waiting, basis=basis)
                estimates.append(made)
        return [estimate for estimate in estimates if estimate is not None]

    def _waiting(self, moment: Moment, newest: Estimate | None) -> tuple[str, ...]:
        """What the first filter lacks. newest: its estimate."""
        if newest is not None:
            return newest.waiting
        return before_start(moment.position, moment.heading, self._bank.has_compass) or ("restart",)

    def _notice_resets(self) -> None:
        for name, t_ns in self._bank.resets:
            if self.notices.once(("filter-reset", name, t_ns)):
                self._alignments[name].begin_again()
                self.notices.say("filter-reset", t_ns, filter=name)
        self._bank.resets.clear()

    def _notice_unused(self) -> None:
        self.notices.summed("late-dropped", self._feeder.late, self._newest_ns, limit_s=HORIZON_S)
        self.notices.summed("ahead-dropped", self._feeder.ahead, self._newest_ns, limit_s=AHEAD_S)
        self.notices.summed("imu-implausible", self._intake.implausible, self._newest_ns)
