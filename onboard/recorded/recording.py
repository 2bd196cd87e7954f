"""Log parser: a serial recording as its lines, what was on the wire and what a program or person wrote around it.

A line ends at CR, LF or any number of them, as for `onboard.reading.line_splitter`; empty lines are sent with the
line before and not counted. `#` lines at the beginning are the head of a gpsd log. In a table (CSV rows with a quoted
sentence, tag blocks or time stamps before it) the sentence is what was sent; every other file is what was sent,
whatever it holds.
"""

import hashlib
import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

from common.errors import WayfixError
from onboard.recorded.line_times import (
    Schedule,
    at_line_rate,
    on_the_wire,
    recorded_times,
    time_on_wire_ns,
    without_long_gaps,
)
from onboard.recorded.stamps import HostStamp, stamp_in, stamp_of_block

MAX_FILE_BYTES: Final = 128 << 20
"""Largest file, bytes: most of a day of a busy 38400 baud port. It is held in memory, and takes some 15 times its size
there."""

BAUDS: Final = (4800, 9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 921_600)
LAG_NS: Final = 100_000_000
"""Longest lag at a baud rate that fits, ns: the time for which a line with a new time waits for those before it."""

_LINE = re.compile(rb"(?:\A[\r\n]+)?[^\r\n]+[\r\n]*")
_BYTE_ORDER_MARK: Final = b"\xef\xbb\xbf"
"""Some editors put it before a text."""
_LINE_ENDS: Final = b"\r\n"
_SENTENCE: Final = rb"([$!][^\"\\\r\n$!]*\*[0-9A-Fa-f]{2})"
_BLOCK: Final = re.compile(rb"\\([^\\\r\n]*)\\([$!][^\r\n]*)[\r\n]*")
"""A tag block, and the sentence behind it, damaged or not."""
_WRAPPED: Final = (
    re.compile(rb'([^\r\n]*)"' + _SENTENCE + rb'".*', re.DOTALL),
    re.compile(rb"([\[(]?(?:[A-Z][a-z]{2} +)*[0-9][0-9TZUC :.,;/+-]*[\])]?)[ \t,;:>|]" + _SENTENCE + rb"\s*"),
)
"""Before and around a sentence: a row of a table, a time stamp."""
_BEHIND: Final = re.compile(_SENTENCE + rb"[ \t,;:|]+([\[(]?[0-9][0-9TZUC :.,/+-]*[\])]?)\s*")
"""A time stamp behind a sentence."""


@dataclass(frozen=True, slots=True)
class Recording:
    """The lines of one file."""

    path: Path
    lines: tuple[bytes, ...]
    """Lines that were on the wire, line ends included."""
    numbers: tuple[int, ...]
    """Number of each line among those of the file; 1 = the first that is not empty."""
    total: int
    """Number of lines of the file that are not empty."""
    skipped: dict[str, int]
    """Number of lines that were not on the wire: `comment` lines at the head, table rows without a sentence
    (`no-sentence`)."""
    digest: str
    """SHA-256 of the file, hexadecimal."""
    stamps: tuple[HostStamp | None, ...]
    """What was written beside each line to say when it came."""

    @property
    def bare(self) -> list[bytes]:
        """The lines without their ends."""
        return [line.strip(_LINE_ENDS) for line in self.lines]

    def in_order(self, order: Sequence[int]) -> "Recording":
        """The same with its lines in another order."""
        lines = tuple(self.lines[line] for line in order)
        numbers, stamps = (tuple(self.numbers[line] for line in order), tuple(self.stamps[line] for line in order))
        return replace(self, lines=lines, numbers=numbers, stamps=stamps)


@dataclass(frozen=True, slots=True)
class Paced:
    """A recording and when each of its lines is wanted."""

    recording: Recording
    schedule: Schedule
    baud: int
    lag_ns: int
    """Longest time for which a line with a new time has to wait at this baud rate, ns."""
    starts_ns: list[int]
    """Time at which the first byte of each line goes out at this baud rate, ns after the first line's."""

    @property
    def ends_ns(self) -> list[int]:
        """When the last byte of each line goes out."""
        sizes = map(len, self.recording.lines)
        return [start + time_on_wire_ns(size, self.baud) for start, size in zip(self.starts_ns, sizes, strict=True)]

    @property
    def timed(self) -> bool:
        """There are times in it."""
        return self.schedule.timed


def read_recording(path: Path) -> Recording:
    """Read a file. Raises WayfixError where it is none, or has no line."""
    data = _content(path)
    pieces = _LINE.findall(data.removeprefix(_BYTE_ORDER_MARK))
    if not pieces:
        raise WayfixError("there is nothing in it", str(path), "give a recording of a serial port")
    head = 0
    while head < len(pieces) and pieces[head].lstrip(_LINE_ENDS).startswith(b"#"):
        head += 1
    skipped = {"comment": head} if head else {}
    body = pieces[head:]
    inside = [_unwrapped(piece) for piece in body]
    found = len(inside) - inside.count(None)
    if 2 * found > len(body):
        # A table: rows without a sentence (its head, a damaged row) were never on the wire; a bare sentence was.
        kept = [
            (line or (piece, None), number)
            for number, (line, piece) in enumerate(zip(inside, body, strict=True), head + 1)
            if line is not None or piece.lstrip(_LINE_ENDS)[:1] in (b"$", b"!")
        ]
        if len(kept) < len(body):
            skipped["no-sentence"] = len(body) - len(kept)
    else:
        kept = [((piece, None), number) for number, piece in enumerate(body, head + 1)]
    if not kept:
        raise WayfixError("there are only comments in it", str(path), "give a recording of a serial port")
    stamped, numbers = zip(*kept, strict=True)
    lines, stamps = zip(*stamped, strict=True)
    return Recording(path, lines, numbers, len(pieces), skipped, hashlib.sha256(data).hexdigest(), stamps)


def pace(
    recording: Recording,
    baud: int | None = None,
    lines_per_second: float | None = None,
    longest_gap_s: float | None = None,
    least_baud: int = BAUDS[0],
) -> Paced:
    """When each line is wanted: by the times inside, else `lines_per_second`, else as fast as the baud rate goes.

    Without `baud`: `least_baud`, or the lowest of `BAUDS` above it that carries the lines.
    """
    bare = recording.bare
    schedule = recorded_times(bare, recording.stamps)
    if schedule.order is not None:
        recording = recording.in_order(schedule.order)
    if not schedule.timed and lines_per_second is not None:
        schedule = replace(schedule, at_ns=at_line_rate(len(bare), lines_per_second))
    if longest_gap_s is not None:
        schedule = replace(schedule, at_ns=without_long_gaps(schedule.at_ns, round(longest_gap_s * 1e9)))
    sizes = [len(line) for line in recording.lines]
    fitting = (least_baud, *(rate for rate in BAUDS if rate > least_baud)) if baud is None else (baud,)
    if not schedule.at_ns[-1]:
        fitting = fitting[:1]
    for candidate in fitting:
        starts_ns = on_the_wire(schedule.at_ns, sizes, candidate)
        lag_ns = _lag_ns(schedule.at_ns, starts_ns)
        if lag_ns <= LAG_NS:
            break
    return Paced(recording, schedule, candidate, lag_ns, starts_ns)


def _lag_ns(at_ns: Sequence[int], starts_ns: Sequence[int]) -> int:
    """The longest wait of a line that is wanted later than the one before it."""
    waits = (start - at for start, (before, at) in zip(starts_ns[1:], pairwise(at_ns), strict=True) if at > before)
    return max(waits, default=0)


def _unwrapped(piece: bytes) -> tuple[bytes, HostStamp | None] | None:
    """The sentence in a line of a log, and the time beside it; `None` = nothing stands around a sentence."""
    if match := _BEHIND.fullmatch(piece):
        stamp = stamp_in(match[2].decode("ascii"))
        return None if stamp is None else (match[1] + _LINE_ENDS, stamp)
    if piece[:1] in b"$!":
        return None
    if match := _BLOCK.fullmatch(piece):
        return match[2] + _LINE_ENDS, stamp_of_block(match[1].decode("latin-1"))
    for pattern in _WRAPPED:
        if match := pattern.fullmatch(piece):
            return match[2] + _LINE_ENDS, stamp_in(match[1].decode("latin-1"))
    return None


def _content(path: Path) -> bytes:
    try:
        # Non-blocking: opening a pipe without a writer would wait for ever.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give the path of a file") from error
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise WayfixError("is no plain file", str(path), "give a recording of a serial port")
    with os.fdopen(descriptor, "rb") as stream:
        if status.st_size > MAX_FILE_BYTES:
            cure = "split it, for example with `split -C 100m`"
            raise WayfixError(f"is longer than {MAX_FILE_BYTES >> 20} MiB", str(path), cure)
        return stream.read()
