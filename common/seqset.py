"""Interval set of the sequence numbers of one daemon start: what came, what is missing, what is in flight."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator


class SeqSet:
    """Whole numbers >= 0 as disjoint, non-adjacent ranges [first, last], in order."""

    __slots__ = ("_firsts", "_stops")

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._firsts: list[int] = []
        self._stops: list[int] = []
        for first, last in ranges:
            self.add(first, last)

    def add(self, first: int, last: int) -> bool:
        """Take in first..last; False when all of them were known."""
        index = bisect_right(self._firsts, first)
        if index and self._stops[index - 1] > last:
            return False
        low = index - 1 if index and self._stops[index - 1] >= first else index
        high = bisect_right(self._firsts, last + 1)
        start = min([first, *self._firsts[low:high]])
        stop = max([last + 1, *self._stops[low:high]])
        self._firsts[low:high], self._stops[low:high] = [start], [stop]
        return True

    def __contains__(self, seq: int) -> bool:
        index = bisect_right(self._firsts, seq)
        return index > 0 and self._stops[index - 1] > seq

    def __iter__(self) -> Iterator[tuple[int, int]]:
        """The ranges (first, last)."""
        return ((first, stop - 1) for first, stop in zip(self._firsts, self._stops, strict=True))

    def __len__(self) -> int:
        """How many numbers."""
        return sum(self._stops) - sum(self._firsts)

    def gaps(self, first: int, last: int) -> Iterator[tuple[int, int]]:
        """What of first..last is not in the set, as ranges in order."""
        index = bisect_right(self._firsts, first)
        if index and self._stops[index - 1] > first:
            first = self._stops[index - 1]
        while first <= last:
            stop = self._firsts[index] if index < len(self._firsts) else last + 1
            if first < stop:
                yield first, min(stop - 1, last)
            if index == len(self._firsts):
                return
            first = self._stops[index]
            index += 1
