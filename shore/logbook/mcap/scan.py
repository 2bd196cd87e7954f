"""Scan of an MCAP file that may be cut or damaged anywhere: all sound records in file order, and what is missing.

    scan = Scan(stream)
    for item in scan.items(): ...            # messages, metadata, attachments
    scan.losses, scan.cut, scan.flaws

The checksum of a chunk decides: a chunk whose checksum holds is read, any other is left out as a whole and the walk
goes on with the next one. Messages outside of chunks have no checksum: behind damage they are not believed. The index
is used only where something is broken, and only while its own checksum holds; where bytes before it are gone or too
many, it names the channels of those chunks that it lists. A log behind the first one is said, not read: it may be the
same once more. One chunk is in memory at a time.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import BinaryIO

from shore.logbook.mcap.damage import AnotherLog
from shore.logbook.mcap.findings import Findings
from shore.logbook.mcap.records import BLOCK, LOG_START, MAGIC
from shore.logbook.mcap.source import Source
from shore.logbook.mcap.walk import Item, Log


class Scan(Findings):
    """One walk over a file, up to the end of its first log, and what it finds. Raises OSError."""

    def __init__(self, stream: BinaryIO, *, check_index: bool = False) -> None:
        """check_index: compare each message index with its chunk, which only `verify` cares for."""
        self._source = Source(stream)
        self._check_index = check_index
        super().__init__(self._source.size)

    def items(self) -> Iterator[Item]:
        """All sound messages, metadata and attachments in file order; what is wrong is complete after the last."""
        base: int | None = self._first_log()
        while base is not None:
            log = Log(self._source, self, base, check_index=self._check_index)
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
        if MAGIC.startswith(self._source.read(0, len(MAGIC))):
            return 0
        place = self._source.search(0, self.size)
        if place is None or self._source.read(place, len(LOG_START)) != LOG_START:
            return 0
        self.flaw(0, place, "bytes before the log")
        return place


def is_log(stream: BinaryIO) -> bool:
    """Whether the file begins like a log, or holds one near its beginning. Raises OSError."""
    source = Source(stream)
    return MAGIC.startswith(source.read(0, len(MAGIC))) or source.search(0, min(source.size, BLOCK)) is not None
