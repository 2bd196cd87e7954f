"""Clock offset between boat and station from round trips of leases, as NTP does. For display and alarms only.

Fusion and logs go by the boat's clock alone. Over a radio that is busy one way, frames queue before the answers and the
mean of (boat - station) is wrong by half the queue; the answer with the shortest round trip met no queue, so only that
one of the last minute counts. Whatever the asymmetry, it is wrong by half its round trip at most.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

from common.units import NS_PER_S

WINDOW_NS: Final = 60 * NS_PER_S
MAX_DRIFT: Final = 200e-6
"""Largest drift of two crystals, s/s: a steeper slope is noise."""
_PART_NS: Final = 10 * NS_PER_S
"""Length of a part of the window, ns, whose best sample goes into the slope."""
_SLOPE_SPAN_NS: Final = 30 * NS_PER_S
_CLEAR: Final = 2
"""A part whose best round trip is more than this many times the window's best met a queue."""


@dataclass(frozen=True, slots=True)
class Offset:
    """Boat clock less station clock."""

    offset_ns: int
    """Offset at the time asked for, ns: boat clock less station clock."""
    bound_ns: int
    """Bound of the error, ns: half the best round trip when that answer came; `drift` is added since."""
    age_ns: int
    """Age of that answer, ns."""
    drift: float | None
    """Drift of the boat's clock against ours, s/s, + when it gains; None = not known yet, taken as 0."""


@dataclass(frozen=True, slots=True)
class _Sample:
    t_ns: int
    """Middle of the round trip on the station's clock, ns."""
    offset_ns: int
    trip_ns: int


class ClockOffset:
    """Offset of one clock of the boat: make a new one when `clock_id` changes. Not for scaled boat clocks."""

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque()

    def add(self, sent_ns: int, board_rx_ns: int, board_tx_ns: int, received_ns: int) -> bool:
        """One question (station clock), its arrival and answer (boat clock), the answer's arrival (station clock).

        False = left out: these times cannot be.
        """
        trip_ns = (received_ns - sent_ns) - (board_tx_ns - board_rx_ns)
        if trip_ns < 0 or board_tx_ns < board_rx_ns or received_ns < sent_ns:
            return False
        t_ns = (sent_ns + received_ns) // 2
        if self._samples and t_ns < self._samples[-1].t_ns:
            return False
        offset_ns = (board_rx_ns - sent_ns + board_tx_ns - received_ns) // 2
        self._samples.append(_Sample(t_ns, offset_ns, trip_ns))
        while self._samples[0].t_ns < t_ns - WINDOW_NS:
            self._samples.popleft()
        return True

    def at(self, t_ns: int) -> Offset | None:
        """The offset at a time on the station's clock; None while no answer is younger than the window."""
        fresh = [sample for sample in self._samples if sample.t_ns >= t_ns - WINDOW_NS]
        if not fresh:
            return None
        best = min(fresh, key=lambda sample: (sample.trip_ns, -sample.t_ns))
        age_ns = max(0, t_ns - best.t_ns)
        drift = _slope(fresh, best.trip_ns)
        return Offset(best.offset_ns + round((drift or 0.0) * age_ns), (best.trip_ns + 1) // 2, age_ns, drift)


def _slope(samples: list[_Sample], best_trip_ns: int) -> float | None:
    """Least squares through the clear ones of each part's best; None while they span too little time."""
    parts: dict[int, _Sample] = {}
    for sample in samples:
        part = sample.t_ns // _PART_NS
        if part not in parts or sample.trip_ns < parts[part].trip_ns:
            parts[part] = sample
    clear = [sample for sample in parts.values() if sample.trip_ns <= _CLEAR * best_trip_ns]
    if not clear or clear[-1].t_ns - clear[0].t_ns < _SLOPE_SPAN_NS:
        return None
    first = clear[0]
    times = [float(sample.t_ns - first.t_ns) for sample in clear]
    offsets = [float(sample.offset_ns - first.offset_ns) for sample in clear]
    mean_t, mean_o = sum(times) / len(times), sum(offsets) / len(offsets)
    above = sum((t - mean_t) * (o - mean_o) for t, o in zip(times, offsets, strict=True))
    slope = above / sum((t - mean_t) ** 2 for t in times)
    return slope if abs(slope) <= MAX_DRIFT else None
