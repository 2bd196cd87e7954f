"""The walk over one log of an MCAP file, record by record (scan.py says what is believed)."""

import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema, Statistics

from shore.logbook.damage import Loss, Part, loss_of
from shore.logbook.mcap_records import (
    HEAD,
    LIMIT,
    MAGIC,
    PRIVATE,
    BrokenError,
    ChunkHead,
    Message,
    chunk_head,
    define,
    index_entries,
    index_of,
    index_size,
    index_times,
    is_index,
    is_parsed,
    message_of,
    messages_in,
    parsed,
    unpacked,
)
from shore.logbook.mcap_tail import DATA_END_SIZE, FOOTER_SIZE, Tail, tail_at

if TYPE_CHECKING:
    from shore.logbook.scan import Scan

Item = Message | Metadata | Attachment

BLOCK: Final = 4 * 2**20
"""Bytes that are searched at once."""
LOG_START: Final = MAGIC + b"\x01"
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
    """What it is, which a damaged type byte does not hide."""
    at: int
    end: int
    content: bytes
    head: ChunkHead | None
    is_mistyped: bool


class Log:
    """One log of the file, from its first magic to the one that ends it."""

    def __init__(self, scan: "Scan", base: int) -> None:
        self.next_base: int | None = None
        """Where another log begins behind this one."""
        self.kept = 0
        self._scan = scan
        self._base = base
        self._tail: Tail | None = tail_at(scan.stream, base, scan.size - FOOTER_SIZE - len(MAGIC))
        self._limit = self._tail.data_end if self._tail else scan.size
        self._channels: dict[int, Channel] = dict(self._tail.channels) if self._tail else {}
        scan.schemas = dict(self._tail.schemas) if self._tail else {}
        self._parts: list[Part] = []
        """Neighbouring stretches that are being passed over."""
        self._losses_before = len(scan.losses)
        self._kept_before_loss = 0
        self._last_ns: int | None = None
        self._has_chunks = self._has_looked_ahead = False
        self._chunk: tuple[int, list[Message]] = base, []
        """End and messages of the last sound chunk."""
        self._indexes: dict[int, list[tuple[int, int]]] = {}
        """What the message indexes behind it should say; filled only to check them."""

    def items(self) -> Iterator[Item]:
        """All that is sound; what is wrong goes into the scan."""
        scan, at = self._scan, self._base + len(MAGIC)
        is_ended = False
        while at < self._limit and self.next_base is None and not is_ended:
            scan.at = at
            record = self._record(at)
            if record is None:
                at = self._pass_over(at)
                continue
            is_ended = record.opcode == Opcode.DATA_END
            yield from self._take(record)
            at = record.end if self.next_base is None else self.next_base
        if self._tail is not None:
            self._finish(self._tail)
        elif is_ended:
            self._finish_without_tail(at)
        else:
            self._cut(at)

    def _record(self, at: int) -> Record | None:
        """The record that begins at `at`; `None` when no whole one of a known form does."""
        head = self._scan.read(at, HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        end = at + HEAD.size + length
        if length > LIMIT or end > self._limit:
            return None
        content = self._scan.read(at + HEAD.size, length)
        chunk = chunk_head(content, length) if opcode != Opcode.MESSAGE_INDEX or not is_index(content) else None
        if chunk is not None:
            is_mistyped = opcode != Opcode.CHUNK
            is_vouched_for = chunk.crc != 0 or not is_mistyped
            return Record(Opcode.CHUNK, at, end, content, chunk, is_mistyped) if is_vouched_for else None
        if opcode >= PRIVATE and self._tail is not None and at in (self._tail.chunks or ()):
            return None
        return Record(opcode, at, end, content, None, False) if self._fits(opcode, content) else None

    def _fits(self, opcode: int, content: bytes) -> bool:
        """Whether the content has the form of its kind, and such a record may stand here."""
        if opcode == Opcode.MESSAGE:
            return not self._has_chunks or not any(is_parsed(kind, content) for kind in _OTHER_KINDS)
        if opcode == Opcode.DATA_END:
            return self._tail is None and len(content) == DATA_END_SIZE - HEAD.size
        if opcode in _OTHER_KINDS:
            return is_parsed(opcode, content)
        return opcode >= PRIVATE

    def _take(self, record: Record) -> Iterator[Item]:
        scan = self._scan
        if record.is_mistyped:
            scan.flaw(record.at, record.at + 1, "a damaged type byte of a chunk")
        swallowed = -1 if record.head or record.opcode == Opcode.ATTACHMENT else record.content.find(LOG_START)
        if record.head is not None:
            yield from self._take_chunk(record, record.head)
        elif swallowed >= 0 and self._tail is None:
            self._end_at_new_log(record.at, record.at + HEAD.size + swallowed)
        elif record.opcode == Opcode.MESSAGE_INDEX:
            self._take_index(record)
        elif record.opcode == Opcode.MESSAGE:
            yield from self._take_message(record)
        elif record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            define(parsed(record.opcode, record.content), self._channels, scan.schemas)
        elif record.opcode == Opcode.HEADER:
            scan.profile = scan.profile or parsed(record.opcode, record.content).profile
        elif record.opcode == Opcode.METADATA:
            yield parsed(record.opcode, record.content)
        elif record.opcode == Opcode.ATTACHMENT:
            crc = int.from_bytes(record.content[-4:], "little")
            if crc and zlib.crc32(record.content[:-4]) != crc:
                scan.flaw(record.at, record.end, "the checksum of an attachment does not hold")
            yield parsed(record.opcode, record.content)

    def _take_chunk(self, record: Record, head: ChunkHead) -> Iterator[Message]:
        self._has_chunks = True
        channels, schemas = dict(self._channels), dict(self._scan.schemas)
        try:
            data = unpacked(record.content, head)
            messages, unknown = messages_in(data, channels, schemas)
            if unknown and not self._has_looked_ahead:
                self._look_ahead(record.end, channels, schemas)
                messages, unknown = messages_in(data, channels, schemas)
        except BrokenError as fault:
            span = head.start_ns, head.end_ns
            self._parts.append(Part(record.at, record.end, f"a damaged chunk ({fault})", span))
            new_log = record.content.find(LOG_START)
            if new_log >= 0 and self._tail is None:
                self._end_at_new_log(record.at, record.at + HEAD.size + new_log)
            return
        self._channels, self._scan.schemas = channels, schemas
        self._scan.chunks += 1
        self._scan.checked += head.crc != 0
        self._chunk = record.end, messages
        self._check_head(record, head, data, messages)
        known = [each for each in messages if each[0] is not None] if unknown else messages
        if messages:
            self._end_parts(messages[0][2])
            self._last_ns = messages[-1][2]
        if unknown:
            times = [log_ns for channel, _, log_ns, *_ in messages if channel is None]
            reason = "nothing says any more what these records are (their channel is gone)"
            part = Part(record.at, record.end, reason, (min(times), max(times)), times)
            self._lose_unknown(loss_of([part], None, None, is_end=False))
        self.kept += len(known)
        yield from known

    def _lose_unknown(self, loss: Loss) -> None:
        """Neighbours are one loss."""
        losses = self._scan.losses
        last = losses[-1] if losses[self._losses_before :] else None
        is_next = last is not None and last.reason == loss.reason and self.kept == self._kept_before_loss
        if last is not None and is_next:
            count = (last.records or 0) + (loss.records or 0)
            losses[-1] = replace(last, end_byte=loss.end_byte, end_ns=loss.end_ns, records=count)
        else:
            losses.append(loss)
        self._kept_before_loss = self.kept

    def _check_head(self, record: Record, head: ChunkHead, data: bytes, messages: list[Message]) -> None:
        if not self._scan.check_index:
            return
        self._indexes = index_of(data)
        times = [log_ns for _, _, log_ns, *_ in messages]
        are_right = not times or (head.start_ns, head.end_ns) == (min(times), max(times))
        if not are_right or head.size != len(data):
            self._scan.flaw(record.at, record.at + HEAD.size + head.data_at, "damage in the head of a chunk")

    def _take_index(self, record: Record) -> None:
        if self._parts and self._parts[-1].span_ns is not None:
            part = self._parts[-1]
            part.times_ns += index_times(record.content)
            part.end_byte = record.end
        elif self._scan.check_index and not self._parts:
            channel_id, entries = index_entries(record.content)
            if self._indexes.get(channel_id) != entries:
                self._scan.flaw(record.at, record.end, "damage in a message index")

    def _take_message(self, record: Record) -> Iterator[Message]:
        message = message_of(record.content, self._channels)
        if message[0] is None:
            span = message[2], message[2]
            self._parts.append(Part(record.at, record.end, "a record of an unknown channel", span, [message[2]]))
            return
        self._end_parts(message[2])
        self._last_ns = message[2]
        self.kept += 1
        yield message

    def _end_parts(self, after_ns: int | None) -> None:
        if self._parts:
            self._scan.losses.append(loss_of(self._parts, self._last_ns, after_ns, is_end=False))
            self._parts = []

    def _pass_over(self, at: int) -> int:
        """Where the walk goes on behind something that is no record."""
        if self._tail is None:
            near = max(at - len(LOG_START) + 1, self._base + 1)
            new_log = self._scan.read(near, 2 * len(LOG_START)).find(LOG_START)
            if new_log >= 0:
                return self._end_at_new_log(at, near + new_log)
        chunk_end, messages = self._chunk
        index_end = chunk_end + index_size(messages)
        if chunk_end <= at < index_end <= self._limit and self._begins(index_end):
            self._scan.flaw(at, index_end, "damage in a message index")
            return index_end
        chunks = self._tail.chunks if self._tail is not None else None
        if chunks:
            return self._pass_over_listed(at)
        after = self._scan.search(at + 1, self._limit)
        if after is None:
            if self._tail is not None:
                self._parts.append(Part(at, self._limit, "damage"))
            return self._limit if self._tail is not None else self._cut_at(at)
        if self._begins_log(after):
            self._end_at_new_log(at, after)
        else:
            self._parts.append(Part(at, after, "damage"))
        return after

    def _end_at_new_log(self, at: int, new_log: int) -> int:
        """This log was cut at or behind `at`, and another was put behind it."""
        self.next_base = new_log
        self._parts.append(Part(min(at, new_log), new_log, "cut"))
        return new_log

    def _begins_log(self, at: int) -> bool:
        return self._scan.read(at, len(LOG_START)) == LOG_START

    def _pass_over_listed(self, at: int) -> int:
        """The index of the file lists all chunks, so what is broken at `at` is known."""
        chunks = (self._tail and self._tail.chunks) or {}
        after = min((place for place in chunks if place > at), default=self._limit)
        listed = chunks.get(at)
        if listed is None:
            if self._parts:
                self._parts[-1].end_byte = after
                self._parts[-1].is_counted = False
            else:
                self._scan.flaw(at, after, "damage between chunks")
            return after
        span = listed.message_start_time, listed.message_end_time
        end = at + listed.chunk_length
        self._parts.append(Part(at, end, "a damaged chunk (its head)", span))
        return min(end, after)

    def _begins(self, at: int) -> bool:
        return at == self._limit or self._record(at) is not None

    def _look_ahead(self, at: int, channels: dict[int, Channel], schemas: dict[int, Schema]) -> None:
        """Some writers say in every chunk what its channels are: for records whose own chunk of channels is damaged."""
        self._has_looked_ahead = True
        found: dict[int, Channel] = {}
        more: dict[int, Schema] = {}
        while at < self._limit:
            record = self._record(at)
            if record is None:
                at = self._scan.search(at + 1, self._limit) or self._limit
                if self._begins_log(at):
                    break
                continue
            if record.head is not None:
                with suppress(BrokenError):
                    messages_in(unpacked(record.content, record.head), found, more)
            at = record.end
        channels.update({key: each for key, each in found.items() if key not in channels})
        schemas.update({key: each for key, each in more.items() if key not in schemas})

    def _cut_at(self, at: int) -> int:
        """Nothing sound follows: the log was not closed."""
        zeros = not any(any(self._scan.read(place, BLOCK)) for place in range(at, self._scan.size, BLOCK))
        self._parts.append(Part(at, self._scan.size, "zeros to the end of the file" if zeros else "cut"))
        return self._limit

    def _cut(self, at: int) -> None:
        if not self._parts:
            self._parts.append(Part(at, at, "cut between two records"))
        self._scan.cut = loss_of(self._parts, self._last_ns, None, is_end=True)
        self._parts = []

    def _finish(self, tail: Tail) -> None:
        """Compare with what the log says of itself."""
        scan, statistics = self._scan, tail.statistics
        self._end_parts(statistics.message_end_time if statistics is not None else None)
        if HEAD.unpack(scan.read(tail.data_end, HEAD.size)) != (Opcode.DATA_END, 4):
            scan.flaw(tail.data_end, tail.data_end + DATA_END_SIZE, "the end of the data is damaged")
        if statistics is not None:
            self._count(statistics, tail.end)

    def _count(self, statistics: Statistics, end: int) -> None:
        """Compare with how many records the log says it holds."""
        scan = self._scan
        missing = statistics.message_count - self.kept
        losses = scan.losses[self._losses_before :]
        open_ones = [place for place, loss in enumerate(losses, self._losses_before) if loss.records is None]
        unnamed = missing - sum(loss.records or 0 for loss in losses)
        if unnamed > 0 and not open_ones:
            span = statistics.message_start_time, statistics.message_end_time
            reason = "the log counts more records than it holds"
            scan.losses.append(Loss(self._base, end, *span, is_exact=False, records=unnamed, reason=reason))
        elif unnamed > 0 and len(open_ones) == 1:
            scan.losses[open_ones[0]] = replace(scan.losses[open_ones[0]], records=unnamed)

    def _finish_without_tail(self, at: int) -> None:
        """The data ended in order; the index behind them is damaged, cut, or that of another log's neighbour."""
        scan = self._scan
        self._end_parts(None)
        end = self._magic_behind(at)
        if end is None:
            scan.flaw(at, scan.size, "the index is cut or damaged")
            return
        footer_at = end - FOOTER_SIZE - len(MAGIC)
        tail = tail_at(scan.stream, self._base, footer_at, found_at=at)
        if tail is None or tail_at(scan.stream, self._base, footer_at) is None:
            scan.flaw(at, end, "the index is damaged")
        if tail is not None and tail.statistics is not None:
            self._count(tail.statistics, tail.end)
        if end == scan.size:
            return
        if self._begins_log(end):
            self.next_base = end
            return
        self.next_base = scan.search(end, scan.size)
        scan.flaw(end, self.next_base or scan.size, "bytes behind the end of the log")

    def _magic_behind(self, at: int) -> int | None:
        """Behind the magic that ends this log; its own may be damaged: then where the next log begins."""
        scan, place = self._scan, at
        while place < scan.size:
            block = scan.read(place, BLOCK)
            found = block.find(MAGIC)
            if found >= 0:
                found += place
                is_start = scan.read(found, len(LOG_START)) == LOG_START
                footer = scan.read(found - FOOTER_SIZE, HEAD.size)
                is_end = len(footer) == HEAD.size and HEAD.unpack(footer) == (Opcode.FOOTER, 20)
                return found if is_start and not is_end else found + len(MAGIC)
            place += max(len(block) - len(MAGIC), 1)
        return None
