"""Atomic file replacement: files appear under their name only when they are whole."""

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from common.errors import WayfixError


def part_of(path: Path) -> Path:
    """Path at which `path` grows: hidden beside it, with this process in its name."""
    return path.with_name(f".{path.name}.{os.getpid()}.part")


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A new file, put in the place of `path` when the block ends well; nothing is left behind when it does not.

    Raises: OSError.
    """
    part = part_of(path)
    part.unlink(missing_ok=True)  # of a process that had our number before a power cut
    try:
        with part.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
        sync_directory(path.parent)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


def sync_directory(directory: Path) -> None:
    """Without this a new name may be gone after a power cut, with all the synced data behind it. Raises OSError.

    A file system that cannot sync a directory (some network shares) is left alone.
    """
    entry = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(entry)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(entry)


def check_target(path: Path, inputs: Iterable[Path], cure: str) -> None:
    """Before the work: raises WayfixError when nothing can be written there, or an input would be lost."""
    try:
        if any(given.exists() and path.exists() and path.samefile(given) for given in inputs):
            raise WayfixError("is what is read, it would be lost", str(path), cure)
        if (path.exists() and not stat.S_ISREG(path.stat().st_mode)) or not path.absolute().parent.is_dir():
            raise WayfixError("cannot be written (no such directory, or no plain file)", str(path), cure)
    except OSError as error:
        raise WayfixError(f"cannot be looked at ({error.strerror})", str(path), cure) from error
