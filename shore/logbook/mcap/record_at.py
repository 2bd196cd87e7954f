"""Record validation: which record begins at an offset of a log, if a whole one of a known form does."""

from dataclasses import dataclass
from typing import Final

from mcap.opcode import Opcode

from shore.logbook.mcap.index_at_end import DATA_END, DATA_END_SIZE, Tail
from shore.logbook.mcap.records import (
    HEAD,
    LIMIT,
    MESSAGE_SIZE,
    PRIVATE,
    ChunkHead,
    chunk_head,
    is_index,
    is_parsed,
)
from shore.logbook.mcap.source import Source

_OTHER_KINDS: Final = (
    Opcode.MESSAGE_INDEX,
    Opcode.METADATA,
    Opcode.ATTACHMENT,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.HEADER,
)


@dataclass(frozen=True, slots=True)
class Record:
    """A whole record of a known form."""

    opcode: int
    """Kind of the record, which is known even where its type byte is damaged."""
    at: int
    end: int
    content: bytes
    head: ChunkHead | None
    is_mistyped: bool


class Records:
    """The records of one log, which ends at `limit` at the latest. tail: its sound end, where it has one."""

    def __init__(self, source: Source, limit: int, tail: Tail | None) -> None:
        self.has_chunks = False
        """True once a chunk was read; after that, messages outside of chunks are not expected any more."""
        self._source = source
        self._limit = limit
        self._tail = tail

    def at(self, at: int) -> Record | None:
        """The record that begins at `at`; `None` when no whole one of a known form does."""
        head = self._source.read(at, HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        end = at + HEAD.size + length
        if length > LIMIT or end > self._limit:
            return None
        content = self._source.read(at + HEAD.size, length)
        chunk = chunk_head(content, length) if opcode != Opcode.MESSAGE_INDEX or not is_index(content) else None
        if chunk is not None:
            is_mistyped = opcode != Opcode.CHUNK
            is_vouched_for = chunk.crc != 0 or not is_mistyped
            return Record(Opcode.CHUNK, at, end, content, chunk, is_mistyped) if is_vouched_for else None
        if opcode >= PRIVATE and self._tail is not None and at in (self._tail.chunks or ()):
            return None
        record = Record(opcode, at, end, content, None, False)
        is_sound = self._fits(opcode, content) and (self._tail is not None or self.swallowed(record) is None)
        return record if is_sound else None

    def swallowed(self, record: Record) -> int | None:
        """Where something begins that a record seems to reach into, because bytes of its own are gone."""
        behind = self._source.read(record.end, HEAD.size)
        if len(behind) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(behind)
        if length <= LIMIT and (0 < opcode <= Opcode.DATA_END or opcode >= PRIVATE):
            return None
        following = self._source.search(record.at + 1, self._limit)
        if following is not None and following < record.end:
            return following
        data_end = self._source.read(record.at, record.end - record.at + len(DATA_END)).find(DATA_END, HEAD.size)
        return record.at + data_end if 0 <= data_end < record.end - record.at else None

    def _fits(self, opcode: int, content: bytes) -> bool:
        """Whether the content has the form of its kind, and such a record may stand here."""
        if opcode == Opcode.MESSAGE:
            is_other = self.has_chunks and any(is_parsed(kind, content) for kind in _OTHER_KINDS)
            return len(content) >= MESSAGE_SIZE and not is_other
        if opcode == Opcode.DATA_END:
            return self._tail is None and len(content) == DATA_END_SIZE - HEAD.size
        if opcode in _OTHER_KINDS:
            return is_parsed(opcode, content)
        return opcode >= PRIVATE
