"""Start counter (boot counter): the number of this daemon start, kept in the state directory.

A boat must sail: what the file holds may be empty, of an older backup or anything else, and then the spool says how far
the count was. A number is never below that of a start whose frames are still held.
"""

import re
from pathlib import Path
from typing import Final, NamedTuple

from common.atomic_file import whole_file
from onboard.spool.segment_index import highest_number

HIGHEST: Final = 2**53 - 1
"""Highest number of a start that a frame can carry (`Frame.start_no`)."""
_NUMBER: Final = re.compile(rb"\s*(\d{1,16})\s*")
_MOST_BYTES: Final = 64


class StartCount(NamedTuple):
    """The number of a start, and what a person should know of how it was found."""

    number: int
    mended: str | None = None
    """What was wrong with the file; None = it was right."""
    fault: str | None = None
    """Why the number could not be kept; None = it was."""


def count_start(state_dir: Path | None) -> StartCount:
    """Count one more start in the state directory; 0 without one. Never an exception."""
    if state_dir is None:
        return StartCount(0)
    file = state_dir / "start_no"
    kept, wrong = _kept(file)
    spooled = highest_number(state_dir / "spool", HIGHEST - 1)
    if wrong is None and kept < spooled:
        wrong = f"says {kept}, but the spool holds frames of start {spooled}"
    number = max(kept, spooled) + 1
    return StartCount(number, None if wrong is None else f"{file} {wrong}", keep_count(state_dir, number))


def is_kept(state_dir: Path) -> bool:
    """Whether the state directory still holds a count. A disk that does not answer counts as one that does."""
    try:
        return (state_dir / "start_no").exists()
    except OSError:
        return True


def keep_count(state_dir: Path, number: int) -> str | None:
    """Write the number of this start, into a directory that is made where there is none; why not, if that fails."""
    file = state_dir / "start_no"
    try:
        state_dir.mkdir(parents=True, exist_ok=True)
        if file.is_dir():
            raise IsADirectoryError(None, "is a directory")
        with whole_file(file) as stream:
            stream.write(b"%d\n" % number)
    except OSError as error:
        return f"{file}: {error.strerror}"
    return None


def _kept(file: Path) -> tuple[int, str | None]:
    """The number in the file, 0 = there is none; and what is wrong with it."""
    try:
        with file.open("rb") as stream:
            content = stream.read(_MOST_BYTES + 1)
    except FileNotFoundError:
        return 0, None
    except OSError as error:
        return 0, f"cannot be read ({error.strerror})"
    if not content.strip():
        return 0, "is empty"
    found = _NUMBER.fullmatch(content)
    if found is None or int(found[1]) >= HIGHEST:
        return 0, f"holds no number of a start ({content[:20]!r})"
    return int(found[1]), None
