"""Missing-frame ledger (sequence gaps, backfill): which frames are here, which are wanted, whose trip they are. Pure.

A station wants every frame made since it first met the boat, of whatever start of the daemon, but for those the boat no
longer holds.

A trip begins with the daemon start in which the station joined, or where it joined when another trip is of that start
already. It ends where the next one begins: so each frame is of one trip, whenever it comes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import Any, Final

from common.link_messages import MAX_MISSING, FrameRange
from common.seqset import SeqSet

MAX_STARTS: Final = 2000
"""Most starts of the daemon that are remembered. What the oldest beyond them lacks counts as lost."""
MAX_RANGES: Final = 1000
"""Most ranges of missing, and of lost, frames that a log lists; it counts the frames of the others."""


@dataclass(slots=True)
class StartLedger:
    """The frames of one daemon start: `first` up to, not including, `upto` are wanted."""

    boot_id: str
    first: int
    upto: int
    seen: SeqSet = field(default_factory=SeqSet)
    gone: SeqSet = field(default_factory=SeqSet)
    """Numbers of frames that the board does not hold any more."""
    trips: list[tuple[int, str]] = field(default_factory=list)
    """The trips that begin in this start, oldest first: number of the first frame, name of the log."""

    def missing(self) -> Iterator[tuple[int, int]]:
        """Ranges that are neither here nor gone, in order."""
        for first, last in self.seen.gaps(self.first, self.upto - 1):
            yield from self.gone.gaps(first, last)


class Ledger:
    """Starts of the daemon in their order."""

    def __init__(self, starts: Iterable[StartLedger] = (), forgotten: int = 0) -> None:
        self._starts = {start.boot_id: start for start in starts}
        self.forgotten = forgotten
        """Number of frames that starts lacked which are not remembered any more."""
        self._running: str | None = None
        """The start that greeted last."""

    def greet(self, boot_id: str, next_seq: int, runs: Iterable[tuple[str, int, int]]) -> bool:
        """`connected` came: own start, its next frame, and (boot_id, first_seq, next_seq) of what the board holds.

        Runs are in the order of the daemon's starts, the own one last. Returns whether older ones are wanted too: the
        station knows starts of this board, and none of them is among these.
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
        self._running = boot_id
        own = self._starts[boot_id]
        own.upto = max(own.upto, next_seq)
        while len(self._starts) > MAX_STARTS:
            oldest = self._starts.pop(next(iter(self._starts)))
            self.forgotten += len(oldest.gone) + sum(last - first + 1 for first, last in oldest.missing())
        return known is None and not is_new_here

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
        return tuple(islice(self.all_missing(), limit))

    def begin_trip(self, boot_id: str, next_seq: int, name: str) -> None:
        """The station joined this start for the trip `name`, or came back to it; its next frame is `next_seq`.

        The first trip that is known has whatever was made before it, too.
        """
        start = self._starts[boot_id]
        if not self.trips:
            oldest = next(iter(self._starts.values()))
            oldest.trips.append((oldest.first, name))
        if not start.trips:
            start.trips.append((start.first, name))
        elif start.trips[-1][1] != name:
            start.trips.append((next_seq, name))

    @property
    def since(self) -> tuple[str, int] | None:
        """Start and number of the first frame that is wanted, where the station met the boat; `None` = it has not."""
        oldest = next(iter(self._starts.values()), None)
        return None if oldest is None else (oldest.boot_id, oldest.first)

    @property
    def trips(self) -> set[str]:
        """Names of the logs of the trips that it knows."""
        return {name for start in self._starts.values() for _, name in start.trips}

    def rename_trip(self, before: str, name: str) -> None:
        """The log of a trip has another name now."""
        for start in self._starts.values():
            start.trips[:] = [(first, name if known == before else known) for first, known in start.trips]

    def trip_of(self, boot_id: str, seq: int) -> str | None:
        """The trip that a frame is of: the newest that had begun when it was made; `None` = it is not known."""
        found = None
        for start in self._starts.values():
            is_own = start.boot_id == boot_id
            found = next((name for first, name in reversed(start.trips) if not is_own or first <= seq), found)
            if is_own:
                break
        return found

    def missing_of(self, name: str) -> Iterator[FrameRange]:
        """What a trip lacks still."""
        return self._of_trip(name, self.all_missing())

    def holes_of(self, name: str) -> dict[str, Any]:
        """What a trip lacks still and what of it is lost, for the records of its log: [boot_id, first, last] each.

        Beyond the oldest ranges the frames are counted.
        """
        gone = (FrameRange(start.boot_id, *seqs) for start in self._starts.values() for seqs in start.gone)
        record: dict[str, Any] = {}
        for word, ranges in (("lacks", self.missing_of(name)), ("lost", self._of_trip(name, gone))):
            record[word] = [[item.boot_id, item.first, item.last] for item in islice(ranges, MAX_RANGES)]
            if more := sum(item.last - item.first + 1 for item in ranges):
                record[f"{word}_more"] = more
        return record

    def _of_trip(self, name: str, ranges: Iterable[FrameRange]) -> Iterator[FrameRange]:
        for item in ranges:
            for first, last in self._parts(self._starts[item.boot_id], item.first, item.last):
                if self.trip_of(item.boot_id, first) == name:
                    yield FrameRange(item.boot_id, first, last)

    def forget_trip(self, name: str) -> None:
        """Its log is gone: its frames are wanted once more."""
        for start in self._starts.values():
            parts = [part for first, last in start.seen for part in self._parts(start, first, last)]
            start.seen = SeqSet(part for part in parts if self.trip_of(start.boot_id, part[0]) != name)

    @staticmethod
    def _parts(start: StartLedger, first: int, last: int) -> Iterator[tuple[int, int]]:
        """A range cut where trips begin."""
        begins = (begin for begin, _ in start.trips if first < begin <= last)
        for part, end in pairwise((first, *begins, last + 1)):
            if part < end:
                yield part, end - 1

    def is_newest(self, boot_id: str, seq: int) -> bool:
        """True for the newest frame of the start that greeted last, as far as is known."""
        return boot_id == self._running and seq + 1 >= self._starts[boot_id].upto

    @property
    def next(self) -> tuple[str, int] | None:
        """Start and number of the next frame that will be made, as far as is known; `None` = no board has greeted."""
        return None if self._running is None else (self._running, self._starts[self._running].upto)

    @property
    def has_hole(self) -> bool:
        """True when a frame is missing."""
        return next(self.all_missing(), None) is not None

    @property
    def missing_count(self) -> int:
        """Number of frames that are still to come."""
        return sum(item.last - item.first + 1 for item in self.all_missing())

    @property
    def gone_count(self) -> int:
        """Number of frames that are lost for good."""
        return self.forgotten + sum(len(start.gone) for start in self._starts.values())

    def all_missing(self) -> Iterator[FrameRange]:
        """Every missing range, oldest first."""
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
                "trips": [list(item) for item in start.trips],
            }
            for start in self._starts.values()
        ]
