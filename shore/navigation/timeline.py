"""Out-of-sequence measurements: checkpoints and rewinds; the result depends on what was measured, not on arrival.

`Order` keeps the measurements of the last 5 s in order of time; `Timeline` adds the filters' memory after each. What
arrives late is put in its place and everything after it is run again. The order is (t_ns, rank, sensor, arrival); the
end of each IMU block is an event of its own, so that a rewind is short even when nothing but the IMU delivers.
"""

from bisect import bisect_left, bisect_right, insort
from collections import Counter
from dataclasses import dataclass
from sys import maxsize
from typing import Final

from common.units import NS_PER_S
from shore.navigation.filter_bank import Bank, Batch, Moment, not_finite_is_found
from shore.navigation.imu_track import ImuTrack, TimeStep, split
from shore.navigation.measurements import Measurement
from shore.navigation.motion_model import ImuInput

HORIZON_S: Final = 5.0
"""What is older than this, against the newest boat time seen, is counted and not fused."""
HORIZON_NS: Final = int(HORIZON_S * NS_PER_S)
AHEAD_S: Final = 1.0
"""A stamp this far after its own frame is a fault of the stamp: counted, not fused."""
AHEAD_NS: Final = int(AHEAD_S * NS_PER_S)

_TICK: Final = 0
"""Rank of the end of an IMU block: before all that is measured at the same time."""
_END: Final = maxsize
"""Rank of the end of a frame: after all that is measured at the same time."""

_Key = tuple[int, int, str, int]


@dataclass(frozen=True, slots=True)
class Event:
    """One place in the order of time."""

    key: _Key
    measured: tuple[Measurement, ...] = ()
    """One measurement, or none at the end of an IMU block or of a frame."""

    @property
    def t_ns(self) -> int:
        """Boat time of the event, ns."""
        return self.key[0]

    @property
    def ends_frame(self) -> bool:
        """Marked by `Order.put_end`."""
        return self.key[1] == _END


def _key(event: Event) -> _Key:
    return event.key


def _t_ns(event: Event) -> int:
    return event.key[0]


class Order:
    """The events of one boat in order of time, and the IMU between them; it knows of no filter but whether it runs."""

    def __init__(self, imu: ImuTrack | None) -> None:
        self.events: list[Event] = []
        """Events in order of time; `forget` drops the old ones."""
        self.newest_ns: int | None = None
        """Boat time of the newest end of a frame, ns; `None` before the first."""
        self.late: Counter[str] = Counter()
        """Number of measurements of each sensor that are older than the horizon and not fused."""
        self.ahead: Counter[str] = Counter()
        """Number of measurements of each sensor that are stamped after their frame and not fused."""
        self._imu = imu
        self._arrivals = 0

    def put(self, batch: Batch) -> int | None:
        """Put what a frame brings in its place. Returns the time from which the track changes, `None` = it does not."""
        self.newest_ns = batch.t1_ns if self.newest_ns is None else max(self.newest_ns, batch.t1_ns)
        oldest_ns = self.newest_ns - HORIZON_NS
        changed = [self._put(measured, batch, oldest_ns) for measured in batch.measurements]
        changed += [self._put_block(index, batch, oldest_ns) for index in range(len(batch.blocks))]
        return min((t_ns for t_ns in changed if t_ns is not None), default=None)

    def put_end(self, t_ns: int) -> None:
        """Mark the end of a frame, after all that is measured at the same time."""
        self._add(t_ns, _END, "")

    def before(self, t_ns: int) -> int:
        """How many events are older than `t_ns`."""
        return bisect_left(self.events, t_ns, key=_t_ns)

    def until(self, t_ns: int) -> int:
        """How many events are not newer than `t_ns`."""
        return bisect_right(self.events, t_ns, key=_t_ns)

    def forget(self, t_ns: int) -> None:
        """Drop the events before `t_ns`, and the IMU that no later one needs."""
        del self.events[: self.before(t_ns)]
        if self._imu is not None:
            self._imu.forget_before(t_ns)

    def steps(self, moment: Moment, to_ns: int) -> list[TimeStep]:
        """The predictions from a moment on; none while no filter runs."""
        if to_ns <= moment.t_ns or all(state is None for state in moment.states):
            return []
        if self._imu is None:
            return split(moment.t_ns, to_ns, None)
        return self._imu.steps(moment.t_ns, to_ns)

    def shown(self, moment: Moment, to_ns: int) -> ImuInput | None:
        """Mean of the last second's samples while a filter waits for its start."""
        if self._imu is None or all(state is not None for state in moment.states):
            return None
        return self._imu.mean(to_ns - NS_PER_S, to_ns)

    def _fits(self, t_ns: int, sensor: str, batch: Batch, oldest_ns: int) -> bool:
        """Neither too late nor ahead of its frame; the others are counted."""
        if t_ns < oldest_ns:
            self.late[sensor] += 1
            return False
        if t_ns > batch.t1_ns + AHEAD_NS:
            self.ahead[sensor] += 1
            return False
        return True

    def _put(self, measured: Measurement, batch: Batch, oldest_ns: int) -> int | None:
        """Put a measurement in its place; returns the time from which the track changes."""
        if not self._fits(measured.t_ns, measured.sensor, batch, oldest_ns):
            return None
        place = bisect_left(self.events, (measured.t_ns, measured.rank, measured.sensor, 0), key=_key)
        if place < len(self.events) and self.events[place].measured == (measured,):
            return None
        self._add(measured.t_ns, measured.rank, measured.sensor, measured)
        return measured.t_ns

    def _put_block(self, index: int, batch: Batch, oldest_ns: int) -> int | None:
        block = batch.blocks[index]
        if self._imu is None or not block.offset_us:
            return None
        if not self._fits(block.sample_t_ns[-1], block.sensor, batch, oldest_ns):
            return None
        changed = self._imu.insert(block, batch.boot_id)
        if changed is None:
            return None
        changed_after_ns, end_ns = changed
        self._add(end_ns, _TICK, block.sensor)
        return min(changed_after_ns + 1, end_ns)

    def _add(self, t_ns: int, rank: int, sensor: str, *measured: Measurement) -> None:
        self._arrivals += 1
        insort(self.events, Event((t_ns, rank, sensor, self._arrivals), measured), key=_key)


class Timeline:
    """Feeds a bank of filters in order of time."""

    def __init__(self, bank: Bank, imu: ImuTrack | None) -> None:
        self._bank = bank
        self._order = Order(imu)
        self._moments: list[Moment] = []
        """The memory after each event."""
        self._base = bank.at_rest()
        """The memory before the first event."""
        self.late, self.ahead = self._order.late, self._order.ahead
        """Sensor -> measurements that are not fused: older than the horizon; stamped after their frame."""

    @not_finite_is_found
    def push(self, batch: Batch) -> list[Moment]:
        """Fuse a batch. Returns the moment at its end when it is the newest so far, else nothing."""
        order = self._order
        is_newest = order.newest_ns is None or batch.t1_ns > order.newest_ns
        changed_from = order.put(batch)
        if changed_from is not None:
            self._run_again(changed_from)
            self._forget()
        return [self.at(batch.t1_ns)] if is_newest else []

    @not_finite_is_found
    def at(self, t_ns: int) -> Moment:
        """The memory at `t_ns` (not before the horizon): the newest event's before it, predicted on."""
        index = self._order.until(t_ns)
        moment = self._moments[index - 1] if index else self._base
        return self._bank.advance(moment, t_ns, self._order.steps(moment, t_ns))

    def _run_again(self, from_ns: int) -> None:
        """All events from `from_ns` on, starting from the memory before them."""
        order = self._order
        first = order.before(from_ns)
        del self._moments[first:]
        moment = self._moments[-1] if self._moments else self._base
        for event in order.events[first:]:
            steps, shown = order.steps(moment, event.t_ns), order.shown(moment, event.t_ns)
            moment = self._bank.advance(moment, event.t_ns, steps, event.measured, shown)
            self._moments.append(moment)

    def _forget(self) -> None:
        """Keep the horizon and the memory at its edge."""
        assert self._order.newest_ns is not None
        horizon_ns = self._order.newest_ns - HORIZON_NS
        old = self._order.before(horizon_ns)
        if old:
            self._base = self._moments[old - 1]
            del self._moments[:old]
        self._order.forget(horizon_ns)
