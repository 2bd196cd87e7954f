"""Index of segments on disk: listing, crash recovery, reading. Nothing here writes."""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from onboard.spool.segment_format import (
    FRAME,
    MAX_HEADER_BYTES,
    SEGMENT_BYTES,
    Damage,
    Header,
    Name,
    Record,
    last_seq_of,
    name_of,
    scan,
    seed_of,
    unpack_header,
)

CHUNK_BYTES: Final = 65_536
"""Number of bytes that are read at once."""
PROBE_BYTES: Final = 8_192
TAIL_BYTES: Final = 131_072
_MOST_BYTES: Final = 4 * SEGMENT_BYTES
"""Most bytes of one file that are read: a larger file was not made by us."""


@dataclass(frozen=True, slots=True)
class Run:
    """The frames of one daemon start that are held: `first_seq` up to, not including, `next_seq`."""

    boot_id: str
    start_no: int
    first_seq: int
    next_seq: int


@dataclass(slots=True)
class Segment:
    """One file. Only the one being written changes, in the writer's thread and under its lock."""

    path: Path
    name: Name
    size: int
    last_seq: int | None = None
    """Number of the last frame; below the first seq = the segment holds no frame; None = not looked."""
    place: tuple[int, int] = (-1, 0)
    """Number and offset of the record that was read last, where the next read most often goes on: (seq, offset)."""


class Shelf:
    """All segments, oldest first; replaced as a whole when one comes or goes."""

    def __init__(self, segments: Iterable[Segment] = (), start_nos: Mapping[str, int] | None = None) -> None:
        """start_nos: boot_id -> start_no as the headers say; for other starts the number in the name counts."""
        self.segments = tuple(segments)
        self.by_boot: dict[str, list[Segment]] = {}
        self._start_nos = dict(start_nos or {})
        for segment in self.segments:
            self.by_boot.setdefault(segment.name.boot_id, []).append(segment)
        self.runs = [run for held in self.by_boot.values() if (run := self._run(held)) is not None]
        """Runs of the starts whose end was looked at and that hold a frame."""

    def _run(self, held: list[Segment]) -> Run | None:
        name = held[0].name
        for segment in reversed(held):
            if segment.last_seq is not None and segment.last_seq >= segment.name.first_seq:
                start_no = self._start_nos.get(name.boot_id, name.number)
                return Run(name.boot_id, start_no, name.first_seq, segment.last_seq + 1)
        return None

    def with_segment(self, segment: Segment) -> "Shelf":
        """The shelf with one segment more, the newest."""
        return Shelf((*self.segments, segment), self._start_nos)

    def without(self, segment: Segment) -> "Shelf":
        """The shelf with one segment less."""
        return Shelf((item for item in self.segments if item is not segment), self._start_nos)


def segments_in(directory: Path) -> list[Segment]:
    """Every segment there, oldest first; nothing is opened. Raises OSError."""
    found = []
    with os.scandir(directory) as entries:
        for entry in entries:
            name = name_of(entry.name)
            try:
                if name is not None and entry.is_file(follow_symlinks=False):
                    found.append(Segment(Path(entry.path), name, entry.stat().st_size))
            except FileNotFoundError:  # unlinked meanwhile
                continue
    return sorted(found, key=lambda segment: segment.name)


def highest_number(directory: Path, most: int) -> int:
    """The highest number of a start, up to `most`, that a segment is named after; 0 = there is none."""
    try:
        return max((each.name.number for each in segments_in(directory) if each.name.number <= most), default=0)
    except OSError:
        return 0


def recovered(segments: Iterable[Segment]) -> tuple[Shelf, list[Damage]]:
    """What earlier starts left behind, and the damaged stretches of the newest segment, which is read whole.

    Of the other starts the end is looked at, as far back as there is a frame.
    """
    ordered = list(segments)
    damages = look_through(ordered[-1]) if ordered else []
    start_nos = {}
    for boot_id, held in Shelf(ordered).by_boot.items():
        head = header_of(held[-1].path) or header_of(held[0].path)
        if head is not None:
            start_nos[boot_id] = head.identity.start_no
        for segment in reversed(held):
            if last_seq(segment) >= segment.name.first_seq:
                break
    return Shelf(ordered, start_nos), damages


def last_seq(segment: Segment) -> int:
    """The last frame a segment holds, below its first = none: found by its last bytes if these are sound."""
    if segment.last_seq is None:
        try:
            tail = _bytes(segment.path, max(0, segment.size - TAIL_BYTES), TAIL_BYTES)
        except OSError:
            tail = b""
        segment.last_seq = last_seq_of(tail, seed_of(segment.name.boot_id))
        if segment.last_seq is None:
            look_through(segment)
    return segment.name.first_seq - 1 if segment.last_seq is None else segment.last_seq


def header_of(path: Path) -> Header | None:
    """None when it is damaged or the file cannot be read."""
    try:
        found = unpack_header(_bytes(path, 0, MAX_HEADER_BYTES + 32))
    except OSError:
        return None
    return None if found is None else found[0]


def items_of(path: Path, name: Name) -> tuple[bytes, list[Record | Damage]]:
    """A whole segment, read and scanned, without its header where that is sound. Raises OSError."""
    data = _bytes(path, 0, _MOST_BYTES)
    head = unpack_header(data)
    return data, list(scan(data, 0 if head is None else head[1], seed_of(name.boot_id)))


def look_through(segment: Segment) -> list[Damage]:
    """Read and scan a whole segment for its last frame; its damaged stretches. What cannot be read holds nothing."""
    try:
        _, items = items_of(segment.path, segment.name)
    except OSError:
        items = []
    frames = [item.seq for item in items if isinstance(item, Record) and item.flags == FRAME]
    segment.last_seq = frames[-1] if frames else segment.name.first_seq - 1
    return [item for item in items if isinstance(item, Damage)]


def read_from(segment: Segment, first: int) -> Iterator[tuple[int, bytes]]:
    """Frames of a segment in order, from `first` on or a little before; what cannot be read any more is passed over.

    Little is read for each frame, and nothing behind the last one that is taken.
    """
    seed = seed_of(segment.name.boot_id)
    try:
        descriptor = os.open(segment.path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return
    try:
        size = min(os.fstat(descriptor).st_size, _MOST_BYTES)
        at, above, chunk = _before(descriptor, size, segment, first), -1, CHUNK_BYTES
        while at < size:
            data = os.pread(descriptor, chunk, at)
            go_on = len(data)
            for item in scan(data, 0, seed, above):
                if isinstance(item, Damage):
                    go_on = item.start if item.end == len(data) else go_on
                else:
                    above = item.seq
                    if item.flags == FRAME:
                        segment.place = (item.seq, at + item.start)
                        yield item.seq, data[item.body : item.end]
            if not data or (go_on == 0 and at + len(data) >= size):
                return
            # A record may be cut by the end of the chunk: read on from its begin, more if it is longer than one.
            chunk = CHUNK_BYTES if go_on else 4 * chunk
            at += go_on
    except OSError:
        return
    finally:
        os.close(descriptor)


def _before(descriptor: int, size: int, segment: Segment, first: int) -> int:
    """Offset of a record at or before frame `first`, or 0: by halving, as frames lie in the order of their numbers."""
    seq, low = segment.place
    if 0 <= seq <= first <= seq + 1:
        return low
    low, high = (low if 0 <= seq <= first else 0), size
    while high - low > CHUNK_BYTES:
        middle = (low + high) // 2
        found = _record_after(descriptor, middle, high, segment.name)
        if found is not None and found[0] <= first:
            low = found[1]
        else:
            high = middle
    return low


def _record_after(descriptor: int, start: int, end: int, name: Name) -> tuple[int, int] | None:
    """(seq, offset) of the first whole record in [start, end)."""
    seed = seed_of(name.boot_id)
    for most in (PROBE_BYTES, end - start):
        data = os.pread(descriptor, min(most, end - start), start)
        for item in scan(data, 0, seed, name.first_seq - 1):
            if isinstance(item, Record):
                return item.seq, start + item.start
    return None


def _bytes(path: Path, start: int, most: int) -> bytes:
    with path.open("rb") as stream:
        stream.seek(start)
        return stream.read(most)
