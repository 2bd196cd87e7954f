"""Index at the end of a closed MCAP file: channels, chunk offsets and counts, used only when its CRC holds."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from io import BytesIO
from typing import BinaryIO, Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, MetadataIndex, Schema, Statistics

from shore.logbook.mcap.records import BLOCK, HEAD, LIMIT, LOG_START, MAGIC, ChunkHead, define, parsed

FOOTER_SIZE: Final = HEAD.size + 20
DATA_END_SIZE: Final = HEAD.size + 4
DATA_END: Final = HEAD.pack(Opcode.DATA_END, 4)
"""Head of the record that follows the last record of the data."""


@dataclass
class Tail:
    """What stands behind the records of a log."""

    data_end: int
    """Offset where the record that ends the data begins, bytes."""
    end: int
    """Offset behind the last byte of the log, bytes."""
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    statistics: Statistics | None = None
    raw_chunks: list[bytes] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    base: int = 0
    """Offset where the log begins, bytes; 0 unless other bytes were put before it."""
    moved: int = 0
    """Bytes by which the tail lies behind the place that the footer gives; negative when bytes before it are gone."""

    @cached_property
    def chunks(self) -> dict[int, ChunkIndex] | None:
        """All chunks by their place, in file order; `None` when the writer listed none or not all."""
        try:
            found = [ChunkIndex.read(ReadDataStream(BytesIO(content))) for content in self.raw_chunks]
        except Exception:  # the library raises nearly anything
            return None
        if self.statistics is None or self.statistics.chunk_count != len(found):
            return None
        return {self.base + each.chunk_start_offset: each for each in found}

    def lists(self, head: ChunkHead, size: int) -> bool:
        """Whether a chunk of this head and size (bytes of the whole record) is one of this log, wherever it stands."""
        return (head.start_ns, head.end_ns, head.size, size) in self._kinds

    @cached_property
    def _kinds(self) -> frozenset[tuple[int, int, int, int]]:
        return frozenset(
            (each.message_start_time, each.message_end_time, each.uncompressed_size, each.chunk_length)
            for each in (self.chunks or {}).values()
        )


def tail_at(stream: BinaryIO, base: int, footer_at: int, found_at: int | None = None) -> Tail | None:
    """The tail whose footer stands at `footer_at`; `None` when there is none or it is damaged. Raises OSError.

    found_at: where it was seen to begin, though the footer may name another place (a piece of the log is gone).
    """
    stream.seek(max(0, footer_at))
    footer = stream.read(FOOTER_SIZE + len(MAGIC))
    if len(footer) < FOOTER_SIZE + len(MAGIC) or not footer.endswith(MAGIC):
        return None
    if HEAD.unpack_from(footer) != (Opcode.FOOTER, 20):
        return None
    fields = Footer.read(ReadDataStream(BytesIO(footer[HEAD.size :])))
    start = base + fields.summary_start if fields.summary_start else footer_at
    if found_at is not None and fields.summary_start and fields.summary_crc:
        start = found_at
    if not base <= start - DATA_END_SIZE <= footer_at or footer_at - start > LIMIT:
        return None
    stream.seek(start)
    summary = stream.read(footer_at - start)
    if fields.summary_crc and zlib.crc32(summary + footer[: FOOTER_SIZE - 4]) != fields.summary_crc:
        return None
    tail = Tail(start - DATA_END_SIZE, footer_at + FOOTER_SIZE + len(MAGIC), base=base)
    tail.moved = start - base - fields.summary_start if fields.summary_start else 0
    stream.seek(tail.data_end)
    is_ended = stream.read(HEAD.size) == DATA_END
    # Without a checksum over it, the footer is believed when it leads to the end of the data.
    if not is_ended and not fields.summary_crc:
        return None
    return tail if _fill(tail, summary) else None


def tail_of(stream: BinaryIO) -> Tail | None:
    """The tail of a file that holds one closed log. Raises OSError."""
    return tail_at(stream, 0, stream.seek(0, 2) - FOOTER_SIZE - len(MAGIC))


def moved_tail(stream: BinaryIO, base: int, at: int) -> Tail | None:
    """The tail of the log that `at` is in, wherever it stands, for a log of which bytes are gone or which has too many.

    Its chunks are not where it says. `None` when no checksum vouches for it. Raises OSError.
    """
    end = end_behind(stream, at)
    footer_at = (end or 0) - FOOTER_SIZE - len(MAGIC)
    stream.seek(max(0, footer_at))
    if footer_at < base or stream.read(HEAD.size) != HEAD.pack(Opcode.FOOTER, 20):
        return None
    places = _data_ends(stream, max(base, footer_at - LIMIT), footer_at)
    return next((tail for place in places if (tail := tail_at(stream, base, footer_at, place)) is not None), None)


def _data_ends(stream: BinaryIO, start: int, end: int) -> Iterator[int]:
    """Behind what looks like the record that ends the data, the last one first."""
    while end > start:
        low = max(start, end - BLOCK)
        stream.seek(low)
        block = stream.read(end - low + len(DATA_END) - 1)
        place = block.rfind(DATA_END)
        while place >= 0:
            yield low + place + DATA_END_SIZE
            place = block.rfind(DATA_END, 0, place + len(DATA_END) - 1)
        end = low


def end_behind(stream: BinaryIO, at: int) -> int | None:
    """Behind the magic that ends the log which `at` is in; its own may be damaged: then where the next log begins."""
    while True:
        stream.seek(at)
        block = stream.read(BLOCK)
        found = at + block.find(MAGIC)
        if found >= at:
            stream.seek(max(0, found - FOOTER_SIZE))
            is_end = stream.read(HEAD.size) == HEAD.pack(Opcode.FOOTER, 20)
            stream.seek(found)
            return found if stream.read(len(LOG_START)) == LOG_START and not is_end else found + len(MAGIC)
        if len(block) < BLOCK:
            return None
        at += len(block) - len(MAGIC)


def _fill(tail: Tail, summary: bytes) -> bool:
    at = 0
    while at < len(summary):
        if len(summary) - at < HEAD.size:
            return False
        opcode, length = HEAD.unpack_from(summary, at)
        after = at + HEAD.size + length
        if after > len(summary):
            return False
        content = summary[at + HEAD.size : after]
        try:
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                define(parsed(opcode, content), tail.channels, tail.schemas)
            elif opcode == Opcode.CHUNK_INDEX:
                tail.raw_chunks.append(content)
            elif opcode == Opcode.METADATA_INDEX:
                tail.metadata.append(MetadataIndex.read(ReadDataStream(BytesIO(content))))
            elif opcode == Opcode.STATISTICS:
                tail.statistics = Statistics.read(ReadDataStream(BytesIO(content)))
        except Exception:  # the library raises nearly anything
            return False
        at = after
    return True
