"""Bytes of an MCAP file, and resynchronisation: the next place behind damage where a chunk or a log begins.

All methods raise OSError.
"""

import re
from typing import BinaryIO, Final

from shore.logbook.mcap.records import BLOCK, HEAD, LOG_START, chunk_head

_OVERLAP: Final = 64
_SYNC: Final = re.compile(
    rb"\x06[\s\S]{4}\0{4}[\s\S]{28}(?:\x04\0\0\0zstd|\x03\0\0\0lz4|\0\0\0\0)|" + re.escape(LOG_START)
)
"""Sync pattern: the head of a chunk or of a log."""


class Source:
    """A file that is read at any place."""

    def __init__(self, stream: BinaryIO) -> None:
        self.stream = stream
        self.size = stream.seek(0, 2)

    def read(self, at: int, size: int) -> bytes:
        """Bytes of the file; fewer at its end."""
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
