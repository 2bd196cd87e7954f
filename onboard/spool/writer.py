"""Writer thread: segments, syncing (fdatasync), retention, retry with back-off, and what goes wrong with them."""

import errno
import logging
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from common.boat_config import SpoolTable
from common.framer import Identity
from onboard.spool.memory_ring import Item
from onboard.spool.segment_format import (
    END,
    RECORD_BYTES,
    SEGMENT_BYTES,
    Header,
    Name,
    pack_header,
    pack_record,
    seed_of,
)
from onboard.spool.segment_index import Segment, Shelf, recovered, segments_in
from onboard.spool.shared_state import SpoolState
from onboard.spool.system_calls import LOCK_NAME, Disk

log = logging.getLogger(__name__)

MIB: Final = 1 << 20
LONGEST_DELAY_S: Final = 60.0
STEADY_S: Final = 5.0
"""Time without a new fault after which a fault is over, s: a full disk takes a few frames now and then."""
LOOK_S: Final = 1.0
"""Interval at which the writer looks whether its files are still there, s."""
_NO_ROOM: Final = (errno.ENOSPC, errno.EDQUOT)
DOUBTED: Final = 3
"""Number of times in a row that a disk may say it is full, while it says that it has room, before it is believed: a
quota, or no more files, look like that too."""


class _GoneError(Exception):
    """The directory of the spool was removed, or another disk is there."""


class Writer:
    """`open` may be called before `run` in any thread, everything else happens in the thread of `run`."""

    def __init__(
        self,
        directory: Path,
        identity: Identity,
        table: SpoolTable,
        state: SpoolState,
        *,
        about: Mapping[str, Any],
        disk: Disk,
    ) -> None:
        self._directory = directory
        self._identity = identity
        self._table = table
        self._about = about
        self._state = state
        self._disk = disk
        self._seed = seed_of(identity.boot_id)
        self._lock: int | None = None
        self._number = identity.start_no
        self._file = -1
        self._segment: Segment | None = None
        self._unsynced: list[Item] = []
        self._put_seq = self._synced_seq = -1
        """Number of the last frame in a file, and of the last durable one."""
        self._synced_s = self._retry_s = 0.0
        self._delay_s = 0.0
        self._failed_s = self._looked_s = 0.0
        self._full_count = 0
        """Number of times in a row that the disk has said it is full."""
        self._told: set[str] = set()

    def open(self) -> None:
        """Lock the directory and see what is there. Raises OSError."""
        lock = self._disk.lock(self._directory)
        try:
            shelf, damages = recovered(segments_in(self._directory))
        except OSError:
            os.close(lock)
            raise
        self._lock = lock
        if shelf.segments:
            newest = shelf.segments[-1].name
            self._number = max(self._number, newest.number + (newest.boot_id != self._identity.boot_id))
        with self._state.condition:
            self._state.shelf = shelf
            if damages:
                count = sum(damage.end - damage.start for damage in damages)
                self._state.happened.append(("spool-damaged", {"file": str(newest), "bytes": count}))

    def run(self) -> None:
        """Write until the state is closing and all that waits is written."""
        while (batch := self._next()) is not None:
            try:
                if self._lock is None:
                    self.open()
                self._look()
                self._write(batch)
                if time.monotonic() - self._synced_s >= self._table.sync_s:
                    self._sync()
            except Exception as error:  # whatever happens here, frames go on in memory
                self.failed(error)
        with suppress(OSError):
            self._end_segment()
        if self._lock is not None:
            os.close(self._lock)

    def failed(self, error: Exception) -> None:
        """Leave the file alone, keep what was not durable for a new one, and say so once.

        A full disk costs one old segment at a time, so that a program that fills it does not cost all of them.
        """
        state = self._state
        if isinstance(error, _GoneError):
            self._begin_again()
            return
        is_full = isinstance(error, OSError) and error.errno in _NO_ROOM
        self._full_count = self._full_count + 1 if is_full else 0
        made_room = is_full and self._make_room()
        self._drop_segment()
        if not isinstance(error, OSError):
            log.error("spool", exc_info=error)
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        with state.condition:
            state.waiting.put_back(self._unsynced)
            if state.fault is None and not made_room:
                code = "spool-locked" if isinstance(error, BlockingIOError) else "spool-failed"
                state.happened.append((code, {"reason": reason, "path": str(self._directory)}))
                state.fault = reason
        self._unsynced = []
        self._put_seq = self._synced_seq
        self._failed_s = time.monotonic()
        self._retry_s = self._failed_s + self._delay_s
        self._delay_s = min(LONGEST_DELAY_S, max(1.0, 2 * self._delay_s))

    def _drop_segment(self) -> None:
        if self._segment is not None:
            with suppress(OSError):
                self._disk.close(self._file)
            self._segment = None

    def _look(self) -> None:
        """Once a second: what is written must be where a person, or the next start, looks for it. Raises _GoneError."""
        now_s = time.monotonic()
        if self._lock is None or now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        files = [(self._lock, self._directory / LOCK_NAME)]
        if self._segment is not None:
            files.append((self._file, self._segment.path))
        if not all(self._disk.is_there(*file) for file in files):
            raise _GoneError

    def _begin_again(self) -> None:
        """What memory holds is written once more, to a directory that is made where there is none."""
        state = self._state
        self._drop_segment()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        with state.condition:
            state.shelf = Shelf()
            count = state.wait_again()
            state.happened.append(("spool-gone", {"path": str(self._directory), "count": count}))
        self._unsynced = []
        self._put_seq = self._synced_seq = -1

    def _next(self) -> list[Item] | None:
        """Frames to write, none when a sync is due, None when it is over."""
        state = self._state
        with state.condition:
            while True:
                now_s = time.monotonic()
                if now_s < self._retry_s:
                    if state.closing:
                        return None
                    wait_s: float | None = self._retry_s - now_s
                elif state.waiting:
                    return state.batch()
                elif state.closing:
                    return None
                elif self._unsynced:
                    wait_s = self._synced_s + self._table.sync_s - now_s
                    if wait_s <= 0.0:
                        return []
                else:
                    wait_s = None
                state.condition.wait(wait_s)

    def _write(self, batch: list[Item]) -> None:
        """Write all of it, in as few writes as there are segments."""
        ready: list[tuple[Item, bytes]] = []
        size = 0
        for item in batch:
            record = pack_record(*item, self._seed)
            if self._segment is None or self._segment.size + size + len(record) + RECORD_BYTES > SEGMENT_BYTES:
                self._put(ready)
                ready, size = [], 0
                self._begin_segment(item[0])
            ready.append((item, record))
            size += len(record)
        self._put(ready)

    def _put(self, ready: list[tuple[Item, bytes]]) -> None:
        segment = self._segment
        if not ready or segment is None:
            return
        self._write_whole(segment, b"".join(record for _, record in ready))
        self._put_seq = ready[-1][0][0]
        with self._state.condition:
            segment.size += sum(len(record) for _, record in ready)
            segment.last_seq = self._put_seq
            self._state.stored(self._put_seq)
        self._unsynced += [item for item, _ in ready]

    def _write_whole(self, segment: Segment, data: bytes) -> None:
        """Write bytes at the end of the segment as a whole, or not at all."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._disk.write(self._file, rest) :]
        except OSError:
            with suppress(OSError):
                self._disk.truncate(self._file, segment.size)
            raise

    def _begin_segment(self, first_seq: int) -> None:
        self._end_segment()
        self._trim(SEGMENT_BYTES)
        name = Name(self._number, first_seq, self._identity.boot_id)
        segment = Segment(self._directory / str(name), name, 0, first_seq - 1)
        former = next((item for item in self._state.shelf.segments if item.path == segment.path), None)
        if former is not None:  # nothing in it became durable, and all of it is written again
            self._remove(former)
        self._file = self._disk.create(segment.path)
        with self._state.condition:
            self._state.shelf = self._state.shelf.with_segment(segment)
        self._segment = segment
        header = pack_header(Header(self._identity, first_seq, self._put_seq, self._about))
        self._write_whole(segment, header)
        with self._state.condition:
            segment.size = len(header)

    def _end_segment(self) -> None:
        if self._segment is None:
            return
        end = pack_record(self._put_seq + 1, b"", self._seed, END)
        self._write_whole(self._segment, end)
        with self._state.condition:
            self._segment.size += len(end)
        self._sync()
        self._segment = None
        self._disk.close(self._file)

    def _sync(self) -> None:
        if self._segment is None:
            return
        self._disk.sync(self._file)
        self._synced_s = time.monotonic()
        self._unsynced = []
        self._synced_seq = self._put_seq
        is_steady = self._synced_s - self._failed_s >= STEADY_S
        if is_steady:
            self._delay_s = 0.0
        self._full_count = 0
        with self._state.condition:
            self._state.synced_seq = self._put_seq
            if is_steady and self._state.fault is not None:
                self._state.fault = None
                self._state.happened.append(("spool-restored", {}))
        self._trim(0)

    def _trim(self, more: int) -> None:
        """Remove the oldest segments: for `more` bytes to come within max_mib, and while too little is free."""
        segments = self._state.shelf.segments
        surplus = sum(segment.size for segment in segments) + more - self._table.max_mib * MIB
        short = self._table.min_free_mib * MIB - self._disk.free_bytes(self._directory)
        for segment in segments:
            if (surplus <= 0 and short <= 0) or segment is self._segment:
                return
            if short > 0:
                self._tell_once("spool-low", min_free_mib=self._table.min_free_mib)
            else:
                self._tell_once("spool-rolling", max_mib=self._table.max_mib)
            surplus -= segment.size
            short -= segment.size
            self._let_go(segment)

    def _make_room(self) -> bool:
        """The disk is full: let the oldest segment go. False when none can be removed, or there is room after all."""
        with suppress(OSError):
            if self._disk.free_bytes(self._directory) >= SEGMENT_BYTES and self._full_count <= DOUBTED:
                return False
        oldest = next(iter(self._state.shelf.segments), None)
        if oldest is None or oldest is self._segment:
            return False
        try:
            self._let_go(oldest)
        except OSError:
            return False
        self._tell_once("spool-full")
        return True

    def _let_go(self, segment: Segment) -> None:
        self._remove(segment)
        with self._state.condition:
            self._state.removed += 1

    def _remove(self, segment: Segment) -> None:
        self._disk.unlink(segment.path)
        with self._state.condition:
            self._state.shelf = self._state.shelf.without(segment)

    def _tell_once(self, code: str, **evidence: Any) -> None:
        if code not in self._told:
            self._told.add(code)
            with self._state.condition:
                self._state.happened.append((code, evidence))
