"""Missing-frame ledger (sequence gaps, backfill): which frames of one boat are here, and which are wanted still. Pure.

A station wants every frame made since it first met the boat, of whatever start of the daemon, but for those the boat no
longer holds.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, Final

from common.link_messages import MAX_MISSING, FrameRange
from common.seqset import SeqSet

MAX_STARTS: Final = 200
"""Most starts of the daemon that are remembered."""


@dataclass(slots=True)
class StartLedger:
    """The frames of one daemon start: `first` up to, not including, `upto` are wanted."""

    boot_id: str
    first: int
    upto: int
    seen: SeqSet = field(default_factory=SeqSet)
    gone: SeqSet = field(default_factory=SeqSet)
    """Numbers of frames that the board does not hold any more."""

    def missing(self) -> Iterator[tuple[int, int]]:
        """Ranges that are neither here nor gone, in order."""
        for first, last in self.seen.gaps(self.first, self.upto - 1):
            yield from self.gone.gaps(first, last)


class Ledger:
    """Starts of the daemon in their order."""

    def __init__(self, starts: Iterable[StartLedger] = ()) -> None:
        self._starts = {start.boot_id: start for start in starts}

    def greet(self, boot_id: str, next_seq: int, runs: Iterable[tuple[str, int, int]]) -> None:
        """`connected` came: own start, its next frame, and (boot_id, first_seq, next_seq) of what the board holds.

        Runs are in the order of the daemon's starts, the own one last.
        """
        is_new_here = not self._starts
        order = [name for name, _, _ in runs if name in self._starts]
        known = order[0] if order else None
        after_known = known is None and not is_new_here
        for name, _, upto in runs:
            after_known = after_known or name == known
            if name in self._starts:
                self._starts[name].upto = max(self._starts[name].upto, upto)
            elif after_known and name != boot_id:
                self._starts[name] = StartLedger(name, 0, upto)
        if boot_id not in self._starts:
            self._starts[boot_id] = StartLedger(boot_id, next_seq if is_new_here else 0, next_seq)
        own = self._starts[boot_id]
        own.upto = max(own.upto, next_seq)
        while len(self._starts) > MAX_STARTS:
            del self._starts[next(iter(self._starts))]

    def take(self, boot_id: str, first: int, last: int) -> bool:
        """A frame came (a merged one covers several); False when it was here before."""
        if boot_id not in self._starts:  # a new start of a boat that is known: all its frames are wanted
            self._starts[boot_id] = StartLedger(boot_id, 0 if self._starts else first, last + 1)
        start = self._starts[boot_id]
        start.upto = max(start.upto, last + 1)
        return start.seen.add(first, last)

    def exists(self, boot_id: str, next_seq: int) -> None:
        """The board has made the frames before `next_seq`."""
        if boot_id in self._starts:
            self._starts[boot_id].upto = max(self._starts[boot_id].upto, next_seq)

    def is_gone(self, item: FrameRange) -> int:
        """The board does not hold these any more; returns how many of them are missing for good, newly."""
        start = self._starts.get(item.boot_id)
        if start is None:
            return 0
        before = len(start.gone)
        for first, last in start.missing():
            if first <= item.last and item.first <= last:
                start.gone.add(max(first, item.first), min(last, item.last))
        return len(start.gone) - before

    def missing(self, limit: int = MAX_MISSING) -> tuple[FrameRange, ...]:
        """The oldest missing ranges, as a lease lists them."""
        return tuple(islice(self._missing(), limit))

    @property
    def has_hole(self) -> bool:
        """True when a frame is missing."""
        return next(self._missing(), None) is not None

    @property
    def missing_count(self) -> int:
        """Number of frames that are still to come."""
        return sum(item.last - item.first + 1 for item in self._missing())

    @property
    def gone_count(self) -> int:
        """Number of frames that are lost for good."""
        return sum(len(start.gone) for start in self._starts.values())

    def _missing(self) -> Iterator[FrameRange]:
        for start in self._starts.values():
            for first, last in start.missing():
                yield FrameRange(start.boot_id, first, last)

    def as_record(self) -> list[dict[str, Any]]:
        """The ledger for the cursor's file."""
        return [
            {
                "boot_id": start.boot_id,
                "first": start.first,
                "upto": start.upto,
                "seen": [list(item) for item in start.seen],
                "gone": [list(item) for item in start.gone],
            }
            for start in self._starts.values()
        ]
