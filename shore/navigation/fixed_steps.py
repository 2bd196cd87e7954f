"""Fixed-step fusion (thesis Fig. 3.14): one record px, py, ax, ay, omega, psi for each step, times inside it ignored.

A step closes when a frame reaches its end. It takes the mean of the IMU over the step, the newest fix if there is one
that no step has used, and the newest heading likewise.
"""

from collections import Counter
from typing import Final

from common.units import NS_PER_S
from shore.navigation.filter_bank import Bank, Batch, Moment, not_finite_is_found
from shore.navigation.imu_track import ImuTrack, TimeStep
from shore.navigation.measurements import Measurement
from shore.navigation.timeline import AHEAD_NS

SHORTEST_STEP_S: Final = 0.05
LONGEST_STEP_S: Final = 60.0
_LONGEST_HOLE_NS: Final = 60 * NS_PER_S
"""After a longer silence (a suspended board) the steps begin again at its end instead of filling it one by one."""


class Synchronous:
    """Feeds a bank of filters once every `step_s`; same interface as `Timeline`."""

    def __init__(self, bank: Bank, imu: ImuTrack | None, step_s: float) -> None:
        self._bank = bank
        self._imu = imu
        self._step_s = step_s
        self._step_ns = round(step_s * NS_PER_S)
        self._end_ns: int | None = None
        self._moment = bank.at_rest()
        self._waiting: list[Measurement] = []
        self.late: Counter[str] = Counter()
        """Always empty: a step takes what has arrived, whatever its age."""
        self.ahead: Counter[str] = Counter()
        """Number of measurements of each sensor that are stamped after their frame and not fused."""
        self._used_ns: dict[int, int] = {}
        """Boat time of the newest measurement of each rank that a step has used, ns."""

    @not_finite_is_found
    def push(self, batch: Batch) -> list[Moment]:
        """Take in a batch. Returns the moment of every step that its end closes; the first frame's end is the first."""
        self._waiting += [measured for measured in batch.measurements if not self._is_ahead(measured, batch)]
        for block in batch.blocks:
            if self._imu is not None:
                self._imu.insert(block, batch.boot_id)
        if self._end_ns is None or batch.t1_ns - self._end_ns > _LONGEST_HOLE_NS:
            self._end_ns = batch.t1_ns
        closed = []
        while self._end_ns <= batch.t1_ns:
            self._moment = self._close(self._end_ns)
            closed.append(self._moment)
            self._end_ns += self._step_ns
        return closed

    def _is_ahead(self, measured: Measurement, batch: Batch) -> bool:
        """They would wait for a step that is far away, and be fused then."""
        if measured.t_ns <= batch.t1_ns + AHEAD_NS:
            return False
        self.ahead[measured.sensor] += 1
        return True

    def _close(self, end_ns: int) -> Moment:
        """Predict over the step, then fuse its record."""
        imu = self._imu.mean(end_ns - self._step_ns, end_ns) if self._imu is not None else None
        record = self._record(end_ns)
        self._waiting = [measured for measured in self._waiting if measured.t_ns > end_ns]
        if self._imu is not None:
            self._imu.forget_before(end_ns)
        return self._bank.advance(self._moment, end_ns, [TimeStep(self._step_s, imu)], record, imu)

    def _record(self, end_ns: int) -> list[Measurement]:
        """The newest of each rank up to the end of the step, unless an earlier step has used it or a newer one."""
        newest: dict[int, Measurement] = {}
        for measured in self._waiting:
            known = newest.get(measured.rank)
            if measured.t_ns <= end_ns and (known is None or measured.t_ns > known.t_ns):
                newest[measured.rank] = measured
        fresh = {rank: newest[rank] for rank in sorted(newest) if newest[rank].t_ns > self._used_ns.get(rank, -1)}
        self._used_ns |= {rank: measured.t_ns for rank, measured in fresh.items()}
        return list(fresh.values())
