"""Walk over an MCAP file that may be cut or damaged anywhere: all sound records in file order, and what is missing.

    scan = Scan(stream)
    for item in scan.items(): ...            # messages, metadata, attachments
    scan.losses, scan.cut, scan.flaws

The checksum of a chunk decides: a chunk whose checksum holds is read, any other is left out as a whole and the walk
goes on with the next one. Messages outside of chunks have no checksum: behind damage they are not believed. The index
is used only where something is broken, and only while its own checksum holds; where bytes before it are gone or too
many, it names the channels of those chunks that it lists. A log behind the first one is said, not read: it may be the
same once more. One chunk is in memory at a time.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO, Final

from mcap.records import Schema

from shore.logbook.damage import AnotherLog, Flaw, Loss
from shore.logbook.mcap_records import BLOCK, HEAD, LOG_START, MAGIC, chunk_head
from shore.logbook.walk import Item, Log

_OVERLAP: Final = 64
_SYNC: Final = re.compile(
    rb"\x06[\s\S]{4}\0{4}[\s\S]{28}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)|" + re.escape(LOG_START)
)
"""The head of a chunk or of a log."""


class Scan:
    """One walk over a file, up to the end of its first log. Raises OSError."""

    def __init__(self, stream: BinaryIO, *, check_index: bool = False) -> None:
        """check_index: compare each message index with its chunk, which only `verify` cares for."""
        self.stream = stream
        self.size = stream.seek(0, 2)
        self.check_index = check_index
        self.at = 0
        """Bytes walked over, for a progress bar."""
        self.losses: list[Loss] = []
        self.cut: Loss | None = None
        """What a log that was not closed lost at its end."""
        self.flaws: list[Flaw] = []
        self.chunks = self.checked = 0
        """Sound chunks; those with a checksum."""
        self.messages = 0
        self.schemas: dict[int, Schema] = {}
        """Of the log that is being walked over."""
        self.profile = ""
        """What the head of the file says of its use."""

    def items(self) -> Iterator[Item]:
        """All sound messages, metadata and attachments in file order; what is wrong is complete after the last."""
        base: int | None = self._first_log()
        while base is not None:
            log = Log(self, base)
            yield from log.items()
            self.messages += log.kept
            base = log.next_base
            if base is not None and log.kept:
                self.flaws.append(AnotherLog(base, self.size, "another log begins"))
                break
            if base is not None and self.cut is not None:
                self.losses.append(replace(self.cut, reason=f"{self.cut.reason}; another log begins there"))
                self.cut = None
        self.at = self.size

    def _first_log(self) -> int:
        """Where a log begins: at 0, unless other bytes stand before it."""
        if MAGIC.startswith(self.read(0, len(MAGIC))):
            return 0
        place = self.search(0, self.size)
        if place is None or self.read(place, len(LOG_START)) != LOG_START:
            return 0
        self.flaw(0, place, "bytes before the log")
        return place

    def flaw(self, first_byte: int, end_byte: int, what: str) -> None:
        """Note damage that costs no record; neighbours of one kind are one."""
        last = self.flaws[-1] if self.flaws else None
        if last is not None and last.end_byte == first_byte and last.what == what:
            self.flaws[-1] = replace(last, end_byte=end_byte)
        else:
            self.flaws.append(Flaw(first_byte, end_byte, what))

    def read(self, at: int, size: int) -> bytes:
        """Bytes of the file."""
        self.stream.seek(at)
        return self.stream.read(size)

    def search(self, start: int, end: int) -> int | None:
        """The next place in [start, end) where a chunk or a log begins."""
        at = start
        while at < end:
            block = self.read(at, min(BLOCK, end - at))
            match = _SYNC.search(block)
            while match is not None:
                if self._is_sync(at + match.start(), match.group(), end):
                    return at + match.start()
                match = _SYNC.search(block, match.start() + 1)  # one that is none may overlap one that is
            if at + len(block) >= end:
                break
            at += max(len(block) - _OVERLAP, 1)
        return None

    def find_log(self, start: int) -> int | None:
        """The next place from `start` on where a log begins."""
        for at in range(start, self.size, BLOCK):
            found = self.read(at, BLOCK + len(LOG_START) - 1).find(LOG_START)
            if found >= 0:
                return at + found
        return None

    def _is_sync(self, at: int, found: bytes, end: int) -> bool:
        if found == LOG_START:
            return True
        head = self.read(at, HEAD.size + 48)
        length = HEAD.unpack_from(head)[1]
        return at + HEAD.size + length <= end and chunk_head(head[HEAD.size :], length) is not None


def is_log(stream: BinaryIO) -> bool:
    """Whether the file begins like a log, or holds one near its beginning. Raises OSError."""
    scan = Scan(stream)
    return MAGIC.startswith(scan.read(0, len(MAGIC))) or scan.search(0, min(scan.size, BLOCK)) is not None
