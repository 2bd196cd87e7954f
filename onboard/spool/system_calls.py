"""System calls of the writer (flock, write, fdatasync, unlink): a seam where tests inject disk faults."""

import fcntl
import os
from contextlib import suppress
from pathlib import Path

from common.atomic_file import sync_directory

LOCK_NAME = "lock"


class Disk:
    """Thin calls; all raise OSError."""

    def lock(self, directory: Path) -> int:
        """Make the directory (0700) if need be and lock it for this process; the lock's descriptor.

        Raises BlockingIOError when another process has it.
        """
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        if directory.stat().st_mode & 0o077:
            directory.chmod(0o700)
        descriptor = os.open(directory / LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise
        return descriptor

    def create(self, path: Path) -> int:
        """A new file, with its name durable; none is left where that fails, for the next try takes the same name."""
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        try:
            sync_directory(path.parent)
        except OSError:
            os.close(descriptor)
            with suppress(OSError):
                path.unlink()
            raise
        return descriptor

    def is_there(self, descriptor: int, path: Path) -> bool:
        """Whether an open file still has this name: neither removed, nor under another disk that is mounted there."""
        try:
            named, held = path.stat(), os.fstat(descriptor)
        except FileNotFoundError:
            return False
        return (named.st_dev, named.st_ino) == (held.st_dev, held.st_ino)

    def write(self, descriptor: int, data: bytes | memoryview) -> int:
        """How many bytes were taken."""
        return os.write(descriptor, data)

    def sync(self, descriptor: int) -> None:
        """What was written is durable after this."""
        os.fdatasync(descriptor)

    def truncate(self, descriptor: int, size: int) -> None:
        """Cut, and go on writing there."""
        os.ftruncate(descriptor, size)
        os.lseek(descriptor, size, os.SEEK_SET)

    def close(self, descriptor: int) -> None:
        """Give it back."""
        os.close(descriptor)

    def unlink(self, path: Path) -> None:
        """Remove a file, if it is still there."""
        path.unlink(missing_ok=True)

    def free_bytes(self, directory: Path) -> int:
        """Room for programs without special rights."""
        room = os.statvfs(directory)
        return room.f_bavail * room.f_frsize
