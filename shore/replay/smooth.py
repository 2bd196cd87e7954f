"""Fixed-interval smoothing: each estimate uses the whole log. Frames in order of boat time in, estimates out.

Each measurement and each IMU sample is taken once and at its own time, when nothing older can come any more: that is
what the timeline's order ends in, without its rewinding.
"""

import csv
from codecs import getwriter
from collections import deque
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from typing import Final

from common.atomic_file import whole_file
from common.boat_config import BoatConfig
from common.errors import WayfixError
from common.messages import Frame
from common.units import NS_PER_S
from shore.navigation.basis import Bases, Basis
from shore.navigation.estimate import Estimate, estimate_of
from shore.navigation.filter_bank import Bank
from shore.navigation.filters import FilterState
from shore.navigation.intake import Intake
from shore.navigation.sensor_facts import facts_of
from shore.navigation.smoother import Smoother
from shore.navigation.timeline import HORIZON_NS, Order

SUFFIX: Final = "-smoothed"
"""Suffix of the filter's name in smoothed estimates."""
COLUMNS: Final = (
    "t_s", "lat_deg", "lon_deg", "heading_true_deg", "t_ns", "sog_kn", "sigma_east_m", "sigma_north_m",
    "sigma_heading_deg", "position_from", "heading_from",
)  # fmt: skip
"""Columns of the CSV file, which is also a reference track; a heading of too much doubt is empty."""


def smooth_log(config: BoatConfig, frames: Iterable[Frame], name: str) -> list[Estimate]:
    """An estimate of filter `name` for the end of each frame since its start; `frames` in order of boat time.

    As live, everything begins again with another clock of the board, and where the origin was wrong.
    Raises: WayfixError for an unknown filter.
    """
    estimates: list[Estimate] = []
    for _, comparable in groupby(frames, key=lambda frame: frame.clock_id):
        run = _Run(config, name)
        for frame in comparable:
            run.take(frame)
            if run.is_out_of_reach:
                estimates += run.finish()
                run = _Run(config, name)
        estimates += run.finish()
    return estimates


class _Run:
    """One filter over one clock of the board and one plane."""

    def __init__(self, config: BoatConfig, name: str) -> None:
        facts = facts_of(config)
        self._intake = Intake(config, lambda _event: None)
        self._order = Order(self._intake.imu)
        self._smoother = Smoother(name, facts)
        self._bases = Bases(config)
        self._bank = Bank([self._smoother.filter], bool(config.with_role("compass")), self._bases.lost_after_ns)
        self._moment = self._bank.at_rest()
        """Memory of the filter after the last settled event."""
        self._name = name + SUFFIX
        self._ends: deque[Frame] = deque()
        """Frames whose end is still to come."""
        self._kept: list[tuple[Frame, Basis]] = []
        """Frames for whose end the smoother keeps a state, and what that rested on."""
        self._estimates: list[Estimate] = []

    @property
    def is_out_of_reach(self) -> bool:
        """True when everything must begin again on another plane."""
        return self._intake.is_out_of_reach

    def take(self, frame: Frame) -> None:
        """Put a frame in its place, and settle what is older than the horizon."""
        self._bases.see(frame)
        self._order.put(self._intake.batch(frame))
        self._order.put_end(frame.t1_ns)
        self._ends.append(_bare(frame))
        self._settle(frame.t1_ns - HORIZON_NS)

    def finish(self) -> list[Estimate]:
        """Settle the rest; the estimates of the whole run."""
        if self._order.events:
            self._settle(self._order.events[-1].t_ns + 1)
        self._smooth()
        return self._estimates

    def _settle(self, until_ns: int) -> None:
        """Feed the events before `until_ns`, in order."""
        order = self._order
        for event in order.events[: order.before(until_ns)]:
            steps, shown = order.steps(self._moment, event.t_ns), order.shown(self._moment, event.t_ns)
            self._moment = self._bank.advance(self._moment, event.t_ns, steps, event.measured, shown)
            if self._bank.resets:
                self._bank.resets.clear()
                self._smooth()
            if event.ends_frame:
                frame = self._ends.popleft()
                if (state := self._moment.states[0]) is not None:
                    self._smoother.keep()
                    self._kept.append((frame, self._bases.of(self._moment, state)))
        order.forget(until_ns)

    def _smooth(self) -> None:
        """Smooth what has been kept; the smoother begins again after that."""
        plane = self._intake.plane
        if not self._kept or plane is None:
            return
        repairs = self._smoother.filter.estimate.repairs
        for (frame, basis), (space, x, P) in zip(self._kept, self._smoother.smoothed(), strict=True):
            state = FilterState(space, x, P, {}, repairs)
            estimate = estimate_of(state, frame, plane, name=self._name, t_ns=frame.t1_ns, waiting=(), basis=basis)
            if estimate is not None:
                self._estimates.append(estimate)
        self._kept.clear()


def _bare(frame: Frame) -> Frame:
    """The frame with identity and times only, because as many stay in memory as the log has frames."""
    return Frame(
        boat_id=frame.boat_id,
        boot_id=frame.boot_id,
        seq=frame.seq,
        clock_id=frame.clock_id,
        start_no=frame.start_no,
        t0_ns=frame.t0_ns,
        t1_ns=frame.t1_ns,
    )


def write_track(path: Path, estimates: Iterable[Estimate]) -> int:
    """Write `COLUMNS`, t_s from the first row; how many. Raises WayfixError when the file cannot be written."""
    count, first_ns = 0, None
    try:
        with whole_file(path) as file:
            writer = csv.writer(getwriter("utf-8")(file))
            writer.writerow(COLUMNS)
            for estimate in estimates:
                if "position" not in estimate.aligned_parts:
                    continue
                count += 1
                first_ns = estimate.t_ns if first_ns is None else first_ns
                t_s = (estimate.t_ns - first_ns) / NS_PER_S
                writer.writerow([t_s, *(getattr(estimate, column) for column in COLUMNS[1:])])
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(path), "choose another --smooth file") from error
    return count
