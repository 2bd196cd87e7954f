"""FIFO queue of frames in memory, and the batch that a read gathers. Pure."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

MAX_BATCH: Final = 4096
"""Most frames that one read gives."""
_COMPACT: Final = 1024

Item = tuple[int, bytes]
"""A frame in the spool: its seq and its encoded bytes."""


@dataclass(frozen=True, slots=True)
class Batch:
    """What a read found in one go."""

    frames: list[Item]
    """Frames that were found, in order of seq."""
    gone: list[tuple[int, int]]
    """Ranges [first, last] inside what was looked through that no longer exist, or never did."""
    next_seq: int | None
    """Number of the frame where the next read goes on; None = the range is done."""


class FrameList:
    """Frames of rising seq; the oldest are taken away first."""

    def __init__(self) -> None:
        self.size = 0
        """Number of bytes of all frames."""
        self._seqs: list[int] = []
        self._data: list[bytes] = []
        self._head = 0

    def __len__(self) -> int:
        return len(self._seqs) - self._head

    @property
    def first_seq(self) -> int | None:
        """Number of the oldest frame; None = empty."""
        return self._seqs[self._head] if len(self) else None

    @property
    def newest(self) -> Item | None:
        """The newest frame."""
        return (self._seqs[-1], self._data[-1]) if len(self) else None

    def add(self, seq: int, data: bytes) -> None:
        """One more; seq is higher than all before."""
        self._seqs.append(seq)
        self._data.append(data)
        self.size += len(data)

    def put_back(self, items: Sequence[Item]) -> None:
        """Older ones than all that are here."""
        self._seqs[: self._head] = [seq for seq, _ in items]
        self._data[: self._head] = [data for _, data in items]
        self._head = 0
        self.size += sum(len(data) for _, data in items)

    def drop_first(self) -> None:
        """Let the oldest go."""
        self.size -= len(self._data[self._head])
        self._data[self._head] = b""
        self._head += 1
        if self._head > _COMPACT and 2 * self._head > len(self._seqs):
            del self._seqs[: self._head], self._data[: self._head]
            self._head = 0

    def drop_to(self, seq: int) -> None:
        """Let all up to `seq` go."""
        while (first := self.first_seq) is not None and first <= seq:
            self.drop_first()

    def before(self, seq: int) -> list[Item]:
        """All frames below `seq`."""
        end = bisect_left(self._seqs, seq, lo=self._head)
        return list(zip(self._seqs[self._head : end], self._data[self._head : end], strict=True))

    def between(self, first: int, last: int, max_bytes: int) -> list[Item]:
        """Frames of [first, last], with one more than `Gathering` takes where there are more than fit."""
        at = bisect_left(self._seqs, first, lo=self._head)
        found: list[Item] = []
        size = 0
        while at < len(self._seqs) and self._seqs[at] <= last:
            if len(found) > MAX_BATCH or (size > max_bytes and len(found) > 1):
                break
            found.append((self._seqs[at], self._data[at]))
            size += len(self._data[at])
            at += 1
        return found


class Gathering:
    """Takes frames in order and keeps account of those that do not come."""

    def __init__(self, first: int, last: int, max_bytes: int) -> None:
        self.at = first
        """Number of the next frame that is looked for."""
        self.full = False
        self._last = last
        self._room = max_bytes
        self._frames: list[Item] = []
        self._gone: list[tuple[int, int]] = []

    def take(self, seq: int, data: bytes) -> bool:
        """False = it does not fit any more. What was passed over since the one before is gone."""
        if self._frames and (len(data) > self._room or len(self._frames) >= MAX_BATCH):
            self.full = True
            return False
        if seq > self.at:
            self._gone.append((self.at, seq - 1))
        self._frames.append((seq, data))
        self._room -= len(data)
        self.at = seq + 1
        return True

    def batch(self) -> Batch:
        """After the last frame: what was not found is gone, unless the batch was full before."""
        if self.full:
            return Batch(self._frames, self._gone, self.at)
        if self.at <= self._last:
            self._gone.append((self.at, self._last))
        return Batch(self._frames, self._gone, None)
