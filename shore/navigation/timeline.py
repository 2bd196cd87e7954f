"""Every measurement at its own time: late data rewind the filters; the result depends only on what was measured.

All measurements of the last 5 s stay in order of time with the filters' memory after each. What arrives late is put in
its place and everything after it is run again. The order is (t_ns, kind, sensor, arrival); the end of each IMU block is
an event of its own, so that a rewind is short even when nothing but the IMU delivers.
"""

from bisect import bisect_left, bisect_right, insort
from collections import Counter
from dataclasses import dataclass
from typing import Final

from common.units import NS_PER_S
from shore.navigation.bank import Bank, Batch, Moment
from shore.navigation.imu import ImuTrack, Step, split
from shore.navigation.measurements import Measurement, Position
from shore.navigation.models import ImuInput

HORIZON_S: Final = 5.0
"""What is older than this, against the newest boat time seen, is counted and not fused."""
HORIZON_NS: Final = int(HORIZON_S * NS_PER_S)
AHEAD_S: Final = 1.0
"""A stamp this far after its own frame is a fault of the stamp: counted, not fused."""
AHEAD_NS: Final = int(AHEAD_S * NS_PER_S)

_TICK, _POSITION, _HEADING = range(3)


@dataclass(frozen=True, slots=True)
class _Event:
    """One place in the order of time; a tick (end of an IMU block) measures nothing."""

    key: tuple[int, int, str, int]
    measured: Measurement | None

    @property
    def t_ns(self) -> int:
        return self.key[0]


def _key(event: _Event) -> tuple[int, int, str, int]:
    return event.key


class Timeline:
    """Feeds a bank of filters in order of time."""

    def __init__(self, bank: Bank, imu: ImuTrack | None) -> None:
        self._bank = bank
        self._imu = imu
        self._events: list[_Event] = []
        self._moments: list[Moment] = []
        """The memory after each event."""
        self._base = bank.at_rest()
        """The memory before the first event."""
        self._newest_ns: int | None = None
        self._arrivals = 0
        self.late: Counter[str] = Counter()
        """Sensor -> measurements older than the horizon, not fused."""
        self.ahead: Counter[str] = Counter()
        """Sensor -> measurements stamped after their frame, not fused."""

    def push(self, batch: Batch) -> list[Moment]:
        """Fuse a batch. Returns the moment at its end when it is the newest so far, else nothing."""
        is_newest = self._newest_ns is None or batch.t1_ns > self._newest_ns
        if self._newest_ns is None or is_newest:
            self._newest_ns = batch.t1_ns
        changed = [self._insert(measured, batch) for measured in batch.measurements]
        changed += [self._insert_block(index, batch) for index in range(len(batch.blocks))]
        changed_from = min((t_ns for t_ns in changed if t_ns is not None), default=None)
        if changed_from is not None:
            self._run_again(changed_from)
            self._forget(self._newest_ns - HORIZON_NS)
        return [self.at(batch.t1_ns)] if is_newest else []

    def at(self, t_ns: int) -> Moment:
        """The memory at `t_ns` (not before the horizon): the newest event's before it, predicted on."""
        index = bisect_right(self._events, t_ns, key=lambda event: event.t_ns)
        moment = self._moments[index - 1] if index else self._base
        return self._bank.advance(moment, t_ns, self._steps(moment, t_ns))

    def _fits(self, t_ns: int, sensor: str, batch: Batch) -> bool:
        """Neither too late nor ahead of its frame; the others are counted."""
        assert self._newest_ns is not None
        if t_ns < self._newest_ns - HORIZON_NS:
            self.late[sensor] += 1
            return False
        if t_ns > batch.t1_ns + AHEAD_NS:
            self.ahead[sensor] += 1
            return False
        return True

    def _insert(self, measured: Measurement, batch: Batch) -> int | None:
        """Put a measurement in its place; returns the time from which the track changes."""
        if not self._fits(measured.t_ns, measured.sensor, batch):
            return None
        kind = _POSITION if isinstance(measured, Position) else _HEADING
        place = bisect_left(self._events, (measured.t_ns, kind, measured.sensor, 0), key=_key)
        if place < len(self._events) and self._events[place].measured == measured:
            return None
        self._add(measured.t_ns, kind, measured.sensor, measured)
        return measured.t_ns

    def _insert_block(self, index: int, batch: Batch) -> int | None:
        block = batch.blocks[index]
        if self._imu is None or not block.offset_us or not self._fits(block.sample_t_ns[-1], block.sensor, batch):
            return None
        changed = self._imu.insert(block, batch.boot_id)
        if changed is None:
            return None
        changed_after_ns, end_ns = changed
        self._add(end_ns, _TICK, block.sensor, None)
        return min(changed_after_ns + 1, end_ns)

    def _add(self, t_ns: int, kind: int, sensor: str, measured: Measurement | None) -> None:
        self._arrivals += 1
        insort(self._events, _Event((t_ns, kind, sensor, self._arrivals), measured), key=_key)

    def _run_again(self, from_ns: int) -> None:
        """All events from `from_ns` on, starting from the memory before them."""
        first = bisect_left(self._events, from_ns, key=lambda event: event.t_ns)
        del self._moments[first:]
        moment = self._moments[-1] if self._moments else self._base
        for event in self._events[first:]:
            measured = () if event.measured is None else (event.measured,)
            steps, shown = self._steps(moment, event.t_ns), self._shown(moment, event.t_ns)
            moment = self._bank.advance(moment, event.t_ns, steps, measured, shown)
            self._moments.append(moment)

    def _steps(self, moment: Moment, to_ns: int) -> list[Step]:
        """The predictions from a moment on; none while no filter runs."""
        if to_ns <= moment.t_ns or all(state is None for state in moment.states):
            return []
        if self._imu is None:
            return split(moment.t_ns, to_ns, None)
        return self._imu.steps(moment.t_ns, to_ns)

    def _shown(self, moment: Moment, to_ns: int) -> ImuInput | None:
        """Mean of the last second's samples while a filter waits for its start."""
        if self._imu is None or all(state is not None for state in moment.states):
            return None
        return self._imu.mean(to_ns - NS_PER_S, to_ns)

    def _forget(self, horizon_ns: int) -> None:
        """Keep the horizon and the memory at its edge."""
        old = bisect_left(self._events, horizon_ns, key=lambda event: event.t_ns)
        if old:
            self._base = self._moments[old - 1]
            del self._events[:old], self._moments[:old]
        if self._imu is not None:
            self._imu.forget_before(horizon_ns)
