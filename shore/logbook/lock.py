"""File lock (flock): the writer of a log holds it, and the kernel releases it when the process dies."""

from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # not on this system: nothing is locked, and nothing seems to be written
    fcntl = None  # type: ignore[assignment]


def lock(descriptor: int) -> None:
    """Say that this open file is being written; some network disks know no locks, which is no fault."""
    if fcntl is not None:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_being_written(path: Path) -> bool:
    """Does another open file hold the lock of a writer? False for what cannot be read."""
    if fcntl is None:
        return False
    try:
        with path.open("rb") as stream:
            fcntl.flock(stream.fileno(), fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False
