"""The smoothed track of a log: every estimate knows the whole log. Frames in order of boat time in, estimates out.

Each measurement and each IMU sample is taken once and at its own time, when nothing older can come any more: that is
what the timeline's order ends in, without its rewinding.
"""

import csv
from bisect import bisect_left
from codecs import getwriter
from collections import deque
from collections.abc import Iterable
from itertools import groupby
from pathlib import Path
from typing import Final

from common.errors import WayfixError
from common.messages import Frame
from common.sensors import BoatConfig
from common.units import NS_PER_S
from common.whole_file import whole_file
from shore.navigation.bank import Bank, Batch
from shore.navigation.estimate import Estimate, estimate_of
from shore.navigation.filters import FilterState, facts_of
from shore.navigation.imu import ImuTrack, blocks_of, driving_sensor
from shore.navigation.measurements import Reader
from shore.navigation.own_ship import FAR_FIXES
from shore.navigation.smoother import build_recorder
from shore.navigation.timeline import HORIZON_NS, Timeline

SUFFIX: Final = "-smoothed"
"""Behind the filter's name in the estimates."""
COLUMNS: Final = (
    "t_s", "lat_deg", "lon_deg", "heading_true_deg", "t_ns", "sog_kn", "sigma_east_m", "sigma_north_m",
    "sigma_heading_deg",
)  # fmt: skip
"""Of the CSV file, which is also a reference track."""
_END: Final = 3
"""The end of a frame, after all that is measured at the same time."""


def smooth_log(config: BoatConfig, frames: Iterable[Frame], name: str) -> list[Estimate]:
    """An estimate of filter `name` for the end of each frame since its start; `frames` in order of boat time.

    As live, everything begins anew with another clock of the board, and where the origin was wrong.
    Raises: WayfixError for an unknown filter.
    """
    estimates: list[Estimate] = []
    for _, comparable in groupby(frames, key=lambda frame: frame.clock_id):
        run = _Run(config, name)
        for frame in comparable:
            run.take(frame)
            if run.far_fixes >= FAR_FIXES:
                estimates += run.finish()
                run = _Run(config, name)
        estimates += run.finish()
    return estimates


class _Run(Timeline):
    """One filter over one clock of the board and one plane."""

    def __init__(self, config: BoatConfig, name: str) -> None:
        facts = facts_of(config)
        self._driver = driving_sensor(config)
        self._recorder = build_recorder(name, facts)
        bank = Bank([self._recorder], facts, has_compass=bool(config.with_role("compass")))
        super().__init__(bank, ImuTrack(self._driver) if self._driver else None)
        self._reader = Reader(config, lambda _event: None)
        self._name = name + SUFFIX
        self._ends: deque[Frame] = deque()
        """Frames whose end is still to come."""
        self._kept: list[Frame] = []
        """Frames for whose end the recorder keeps a state."""
        self._estimates: list[Estimate] = []

    @property
    def far_fixes(self) -> int:
        """Fixes in a row that lie beyond the plane's reach."""
        return self._reader.far_in_a_row

    def take(self, frame: Frame) -> None:
        """Put a frame in its place, and settle what is older than the horizon."""
        batch = Batch(
            frame.t1_ns,
            frame.boot_id,
            self._reader.read(frame),
            blocks_of(frame, self._driver) if self._driver else (),
        )
        self._newest_ns = frame.t1_ns
        for measured in batch.measurements:
            self._insert(measured, batch)
        for index in range(len(batch.blocks)):
            self._insert_block(index, batch)
        self._add(frame.t1_ns, _END, "", None)
        self._ends.append(_bare(frame))
        self._settle(frame.t1_ns - HORIZON_NS)

    def finish(self) -> list[Estimate]:
        """Settle the rest; the estimates of the whole run."""
        if self._events:
            self._settle(self._events[-1].t_ns + 1)
        self._smooth()
        return self._estimates

    def _settle(self, until_ns: int) -> None:
        """Feed the events before `until_ns`, in order."""
        old = bisect_left(self._events, until_ns, key=lambda event: event.t_ns)
        for event in self._events[:old]:
            measured = () if event.measured is None else (event.measured,)
            steps, shown = self._steps(self._base, event.t_ns), self._shown(self._base, event.t_ns)
            self._base = self._bank.advance(self._base, event.t_ns, steps, measured, shown)
            if self._bank.resets:
                self._bank.resets.clear()
                self._smooth()
            if event.key[1] == _END:
                frame = self._ends.popleft()
                if self._base.states[0] is not None:
                    self._recorder.keep()
                    self._kept.append(frame)
        del self._events[:old]
        if self._imu is not None:
            self._imu.forget_before(until_ns)

    def _smooth(self) -> None:
        """Smooth what has been kept; the recorder begins anew after that."""
        plane = self._reader.plane
        if not self._kept or plane is None:
            return
        repairs = self._recorder.estimate.repairs
        for frame, (space, x, P) in zip(self._kept, self._recorder.smoothed(), strict=True):
            state = FilterState(space, x, P, {}, repairs)
            estimate = estimate_of(state, frame, plane, name=self._name, t_ns=frame.t1_ns, waiting=())
            if estimate is not None:
                self._estimates.append(estimate)
        self._kept.clear()


def _bare(frame: Frame) -> Frame:
    """Identity and times, without what was measured: as many stay in memory as the log has frames."""
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
                count += 1
                first_ns = estimate.t_ns if first_ns is None else first_ns
                t_s = (estimate.t_ns - first_ns) / NS_PER_S
                writer.writerow([t_s, *(getattr(estimate, column) for column in COLUMNS[1:])])
    except OSError as error:
        raise WayfixError(f"cannot be written ({error.strerror})", str(path), "choose another --smooth file") from error
    return count
