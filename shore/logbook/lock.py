"""File lock (flock): the writer of a log holds it, and the kernel releases it when the process dies."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
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


@contextmanager
def turn_in(directory: Path, wait: Callable[[], None]) -> Iterator[None]:
    """Only one program at a time is inside such a block of one directory. wait: is called before it has to wait.

    Raises OSError when there is no such directory.
    """
    if fcntl is None:
        yield
        return
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            wait()
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except OSError:  # a network disk that knows no locks
            pass
        yield
    finally:
        os.close(descriptor)


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
