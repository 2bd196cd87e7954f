"""What the tests of the spool share: identities, frames known by their number, a disk with faults."""

import errno
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

from common.boat_config import SpoolTable
from common.framer import Identity
from common.messages import Event
from onboard.journal import Journal
from onboard.spool import Spool
from onboard.spool.system_calls import Disk

MIB = 1 << 20
QUICK = SpoolTable(max_mib=16, min_free_mib=0, sync_s=0.0)


def identity(start_no: int = 1) -> Identity:
    return Identity("springer", f"{start_no:016x}", "c" * 32, start_no)


def payload(seq: int, size: int = 200) -> bytes:
    """Other bytes for every number, with the magic of a record now and then."""
    word = b"\xf5WFR" if seq % 7 == 0 else b""
    return (word + f"<{seq}>".encode() * size)[:size]


class Told(list[Event]):
    def __call__(self, event: Event) -> None:
        self.append(event)

    @property
    def codes(self) -> list[str]:
        return [event.code for event in self]


def spool_at(
    directory: Path | None,
    start_no: int = 1,
    *,
    table: SpoolTable = QUICK,
    disk: Disk | None = None,
    told: Told | None = None,
) -> Spool:
    journal = Journal(Told() if told is None else told, lambda: 0)
    return Spool(directory, identity(start_no), table, journal, disk=disk)


def until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, "it did not come to pass"
        time.sleep(0.002)


def filled(directory: Path, count: int, start_no: int = 1, size: int = 200) -> None:
    """A start of `count` frames that ended in good order."""
    spool = spool_at(directory, start_no)
    for seq in range(count):
        spool.append(seq, payload(seq, size))
        if seq % 1000 == 999:  # the queue is bounded
            until(lambda seq=seq: spool.synced_seq == seq)  # type: ignore[misc]
    spool.close(20.0)
    assert spool.synced_seq == count - 1


def read_all(
    spool: Spool, boot_id: str, first: int, last: int, max_bytes: int = 50_000
) -> tuple[dict[int, bytes], set[int]]:
    """All batches of a range: frames, and every number that is gone."""
    frames: dict[int, bytes] = {}
    gone: set[int] = set()
    at: int | None = first
    while at is not None:
        batch = spool.read(boot_id, at, last, max_bytes)
        assert batch.next_seq is None or batch.next_seq > at
        assert batch.next_seq is None or batch.frames
        assert [seq for seq, _ in batch.frames] == sorted({seq for seq, _ in batch.frames})
        frames.update(batch.frames)
        for begin, end in batch.gone:
            assert begin <= end
            gone.update(range(begin, end + 1))
        at = batch.next_seq
    assert not gone & frames.keys()
    return frames, gone


class FaultyDisk(Disk):
    """A disk on which things go wrong at request."""

    def __init__(self) -> None:
        self.sync_s = 0.0
        self.sync_faults = 0
        self.full_faults = 0
        """Number of writes that say the disk is full, though it has room."""
        self.room: int | None = None
        """Bytes that are left; unlinking gives them back."""
        self.read_only = False
        self.syncs = 0
        self.written = 0
        self.gate = threading.Event()
        """Cleared = writes hang."""
        self.gate.set()

    def _refuse(self, number: int) -> None:
        raise OSError(number, os.strerror(number))

    def lock(self, directory: Path) -> int:
        if self.read_only:
            self._refuse(errno.EROFS)
        return super().lock(directory)

    def create(self, path: Path) -> int:
        if self.read_only:
            self._refuse(errno.EROFS)
        return super().create(path)

    def write(self, descriptor: int, data: bytes | memoryview) -> int:
        self.gate.wait()
        if self.read_only:
            self._refuse(errno.EROFS)
        if self.full_faults:
            self.full_faults -= 1
            self._refuse(errno.ENOSPC)
        if self.room is not None:
            if self.room == 0:
                self._refuse(errno.ENOSPC)
            data = data[: self.room]
            self.room -= len(data)
        count = super().write(descriptor, data)
        self.written += count
        return count

    def sync(self, descriptor: int) -> None:
        time.sleep(self.sync_s)
        self.syncs += 1
        if self.sync_faults:
            self.sync_faults -= 1
            self._refuse(errno.EIO)
        super().sync(descriptor)

    def unlink(self, path: Path) -> None:
        if self.room is not None and path.exists():
            self.room += path.stat().st_size
        super().unlink(path)

    def free_bytes(self, directory: Path) -> int:
        return super().free_bytes(directory) if self.room is None else self.room

    def truncate(self, descriptor: int, size: int) -> None:
        if self.room is not None:
            self.room += os.fstat(descriptor).st_size - size
        super().truncate(descriptor, size)
