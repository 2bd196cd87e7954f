"""Sequential walk over one log of an MCAP file, record by record (scan.py says which records are believed)."""

import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema, Statistics

from shore.logbook.mcap.damage import Loss, Part, all_named, loss_of
from shore.logbook.mcap.findings import Findings
from shore.logbook.mcap.index_at_end import DATA_END_SIZE, FOOTER_SIZE, Tail, end_behind, moved_tail, tail_at
from shore.logbook.mcap.index_check import IndexCheck
from shore.logbook.mcap.record_at import Record, Records
from shore.logbook.mcap.records import (
    BLOCK,
    HEAD,
    LOG_START,
    MAGIC,
    BrokenError,
    ChunkHead,
    Message,
    define,
    index_size,
    index_times,
    message_of,
    messages_in,
    parsed,
    unpacked,
)
from shore.logbook.mcap.source import Source

Item = Message | Metadata | Attachment


class Log:
    """One log of the file, from its first magic to the one that ends it."""

    def __init__(self, source: Source, findings: Findings, base: int, *, check_index: bool) -> None:
        self.next_base: int | None = None
        """Offset where another log begins behind this one, which is not read; `None` = there is none."""
        self.kept = 0
        self._at = base
        """Offset where the walk goes on."""
        self._source = source
        self._findings = findings
        self._base = base
        self._tail: Tail | None = tail_at(source.stream, base, source.size - FOOTER_SIZE - len(MAGIC))
        self._limit = self._tail.data_end if self._tail else source.size
        self._records = Records(source, self._limit, self._tail)
        self._moved: list[Tail | None] = []
        """The tail that is not at the place it gives, once it was looked for; empty before that."""
        self._channels: dict[int, Channel] = dict(self._tail.channels) if self._tail else {}
        findings.schemas = dict(self._tail.schemas) if self._tail else {}
        self._parts: list[Part] = []
        """Neighbouring stretches that are being passed over."""
        self._losses_before = len(findings.losses)
        self._kept_before_loss = 0
        self._last_ns: int | None = None
        self._has_looked_ahead = False
        self._kinds: set[tuple[int, int, int, int]] = set()
        """Start and end time (ns), checksum and length of each chunk that was read, by which a repeated chunk is
        found."""
        self._chunk: tuple[int, list[Message]] = base, []
        """End offset and messages of the last sound chunk."""
        self._index_check = IndexCheck(findings) if check_index else None

    def items(self) -> Iterator[Item]:
        """All that is sound; what is wrong goes into the findings."""
        findings = self._findings
        self._at = self._start()
        is_ended = False
        while self._at < self._limit and self.next_base is None and not is_ended:
            findings.at = self._at
            record = self._records.at(self._at)
            if record is None:
                self._at = self._pass_over(self._at)
                continue
            is_ended = record.opcode == Opcode.DATA_END
            self._at = record.end
            yield from self._take(record)
        if self._tail is not None:
            self._finish(self._tail)
        elif is_ended:
            self._finish_without_tail(self._at)
        else:
            self._cut(self._at)

    def _start(self) -> int:
        """Where the first record is to be expected; the magic before it may be damaged, or gone."""
        base, behind = self._base, self._base + len(MAGIC)
        if MAGIC.startswith(self._source.read(base, len(MAGIC))):
            return behind
        record = self._records.at(behind)
        if record is None or record.opcode != Opcode.HEADER:
            return base
        self._findings.flaw(base, behind, "the first bytes are damaged")
        return behind

    def _take(self, record: Record) -> Iterator[Item]:
        findings = self._findings
        if record.is_mistyped:
            findings.flaw(record.at, record.at + 1, "a damaged type byte of a chunk")
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
            define(parsed(record.opcode, record.content), self._channels, findings.schemas)
        elif record.opcode == Opcode.HEADER:
            findings.profile = findings.profile or parsed(record.opcode, record.content).profile
        elif record.opcode == Opcode.METADATA:
            yield parsed(record.opcode, record.content)
        elif record.opcode == Opcode.ATTACHMENT:
            crc = int.from_bytes(record.content[-4:], "little")
            if crc and zlib.crc32(record.content[:-4]) != crc:
                findings.flaw(record.at, record.end, "the checksum of an attachment does not hold")
            yield parsed(record.opcode, record.content)

    def _take_chunk(self, record: Record, head: ChunkHead) -> Iterator[Message]:
        self._records.has_chunks = True
        channels, schemas = dict(self._channels), dict(self._findings.schemas)
        try:
            data = unpacked(record.content, head)
            messages, unknown = messages_in(data, channels, schemas)
            if unknown:
                self._name(record, head, channels, schemas)
                messages, unknown = messages_in(data, channels, schemas)
        except BrokenError as fault:
            span = head.start_ns, head.end_ns
            following = self._records.swallowed(record) if self._tail is None else None
            self._at = following or record.end
            self._parts.append(Part(record.at, self._at, f"a damaged chunk ({fault})", None if following else span))
            new_log = record.content.find(LOG_START)
            if new_log >= 0 and self._tail is None:
                self._end_at_new_log(record.at, record.at + HEAD.size + new_log)
            return
        if self._is_double(record, head):
            self._findings.flaw(record.at, record.end, "a chunk that stands there twice")
            return
        self._channels, self._findings.schemas = channels, schemas
        self._findings.chunks += 1
        self._findings.checked += head.crc != 0
        self._chunk = record.end, messages
        if self._index_check is not None:
            self._index_check.chunk(record, head, data, messages)
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

    def _is_double(self, record: Record, head: ChunkHead) -> bool:
        """Whether the chunk was read before; beside a sound index, which lists each at its place, that cannot be."""
        if self._tail is not None or head.crc == 0:
            return False
        kind = head.start_ns, head.end_ns, head.crc, len(record.content)
        is_double = kind in self._kinds
        self._kinds.add(kind)
        return is_double

    def _name(self, record: Record, head: ChunkHead, channels: dict[int, Channel], schemas: dict[int, Schema]) -> None:
        """Look elsewhere for channels that a chunk does not name: at the end of the log, or in the chunks behind."""
        tail = self._moved_tail(record.end)
        if tail is not None and tail.chunks:
            if tail.lists(head, record.end - record.at):  # else it may be one of another log
                channels.update({key: each for key, each in tail.channels.items() if key not in channels})
                schemas.update({key: each for key, each in tail.schemas.items() if key not in schemas})
        elif not self._has_looked_ahead:
            self._look_ahead(record.end, channels, schemas)

    def _moved_tail(self, at: int) -> Tail | None:
        """The tail of a log of which bytes are gone or which has too many; `None` where the tail is sound, or lost."""
        if not self._moved:
            self._moved.append(moved_tail(self._source.stream, self._base, at) if self._tail is None else None)
        return self._moved[0]

    def _lose_unknown(self, loss: Loss) -> None:
        """Record a loss of records whose channel is unknown; neighbouring losses become one."""
        losses = self._findings.losses
        last = losses[-1] if losses[self._losses_before :] else None
        is_next = last is not None and last.reason == loss.reason and self.kept == self._kept_before_loss
        if last is not None and is_next:
            count = (last.records or 0) + (loss.records or 0)
            losses[-1] = replace(last, end_byte=loss.end_byte, end_ns=loss.end_ns, records=count)
        else:
            losses.append(loss)
        self._kept_before_loss = self.kept

    def _take_index(self, record: Record) -> None:
        if self._parts and self._parts[-1].span_ns is not None:
            part = self._parts[-1]
            part.times_ns += index_times(record.content)
            part.end_byte = record.end
        elif self._index_check is not None and not self._parts:
            self._index_check.index(record)

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
            self._findings.losses.append(loss_of(self._parts, self._last_ns, after_ns, is_end=False))
            self._parts = []

    def _pass_over(self, at: int) -> int:
        """Where the walk goes on behind bytes that are no record."""
        if self._tail is None:
            near = max(at - len(LOG_START) + 1, self._base + 1)
            new_log = self._source.read(near, 2 * len(LOG_START)).find(LOG_START)
            if new_log >= 0:
                return self._end_at_new_log(at, near + new_log)
        chunk_end, messages = self._chunk
        index_end = chunk_end + index_size(messages)
        is_inside = chunk_end <= at < index_end <= self._limit and self._begins(index_end)
        if is_inside and LOG_START not in self._source.read(at, index_end - at):
            self._findings.flaw(at, index_end, "damage in a message index")
            return index_end
        chunks = self._tail.chunks if self._tail is not None else None
        if chunks:
            return self._pass_over_listed(at)
        after = self._source.search(at + 1, self._limit)
        if after is None or self._begins_log(after):
            end = self._data_end(at)
            if end is None:
                return self._cut_at(at) if after is None else self._end_at_new_log(at, after)
            after = end
        self._parts.append(Part(at, after, "damage"))
        return after

    def _data_end(self, at: int) -> int | None:
        """Where the data of this log end, behind the last of its chunks; `None` when it was not closed."""
        if self._tail is not None:
            return self._limit
        tail = self._moved_tail(at)
        return tail.data_end if tail is not None and tail.data_end > at else None

    def _end_at_new_log(self, at: int, new_log: int) -> int:
        """This log was cut at or behind `at`, and another was put behind it."""
        self.next_base = self._at = new_log
        self._parts.append(Part(min(at, new_log), new_log, "cut"))
        return new_log

    def _begins_log(self, at: int) -> bool:
        return self._source.read(at, len(LOG_START)) == LOG_START

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
                self._findings.flaw(at, after, "damage between chunks")
            return after
        span = listed.message_start_time, listed.message_end_time
        end = at + listed.chunk_length
        self._parts.append(Part(at, end, "a damaged chunk (its head)", span))
        return min(end, after)

    def _begins(self, at: int) -> bool:
        return at == self._limit or self._records.at(at) is not None

    def _look_ahead(self, at: int, channels: dict[int, Channel], schemas: dict[int, Schema]) -> None:
        """Some writers say in every chunk what its channels are: for records whose own chunk of channels is damaged."""
        self._has_looked_ahead = True
        found: dict[int, Channel] = {}
        more: dict[int, Schema] = {}
        while at < self._limit:
            record = self._records.at(at)
            if record is None:
                at = self._source.search(at + 1, self._limit) or self._limit
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
        zeros = not any(any(self._source.read(place, BLOCK)) for place in range(at, self._source.size, BLOCK))
        self._parts.append(Part(at, self._source.size, "zeros to the end of the file" if zeros else "cut"))
        return self._limit

    def _cut(self, at: int) -> None:
        if not self._parts:
            self._parts.append(Part(at, at, "cut between two records"))
        self._findings.cut = loss_of(self._parts, self._last_ns, None, is_end=True)
        self._parts = []

    def _finish(self, tail: Tail) -> None:
        """Compare with what the log says of itself."""
        source, findings, statistics = self._source, self._findings, tail.statistics
        self._end_parts(statistics.message_end_time if statistics is not None else None)
        if HEAD.unpack(source.read(tail.data_end, HEAD.size)) != (Opcode.DATA_END, 4):
            findings.flaw(tail.data_end, tail.data_end + DATA_END_SIZE, "the end of the data is damaged")
        if statistics is not None:
            self._count(statistics, tail.end)

    def _count(self, statistics: Statistics, end: int) -> None:
        """Compare with how many records the log says it holds."""
        start_ns, end_ns = statistics.message_start_time, statistics.message_end_time
        losses = self._findings.losses[self._losses_before :]
        if self.kept == statistics.message_count:  # what was not readable held no record
            for loss in (loss for loss in losses if loss.records is None):
                self._findings.flaw(loss.first_byte, loss.end_byte, "damage between chunks")
            self._findings.losses[self._losses_before :] = [loss for loss in losses if loss.records is not None]
            return
        whole = Loss(
            self._base, end, start_ns, end_ns, is_exact=False, records=statistics.message_count - self.kept,
            reason="the log counts more records than it holds",
        )  # fmt: skip
        self._findings.losses[self._losses_before :] = all_named(losses, whole)

    def _finish_without_tail(self, at: int) -> None:
        """The data ended in order; the index behind them is damaged, cut, or not where it says."""
        source, findings = self._source, self._findings
        end = end_behind(source.stream, at)
        if end is None:
            self._end_parts(None)
            findings.flaw(at, source.size, "the index is cut or damaged")
            return
        footer_at = end - FOOTER_SIZE - len(MAGIC)
        tail = tail_at(source.stream, self._base, footer_at, found_at=at)
        statistics = tail.statistics if tail is not None else None
        self._end_parts(statistics.message_end_time if statistics is not None else None)
        if tail is None:
            findings.flaw(at, end, "the index is damaged")
        elif tail.moved:
            gone = "gone" if tail.moved < 0 else "too many"
            findings.flaw(at, end, f"the index does not fit ({abs(tail.moved)} bytes before it are {gone})")
        if statistics is not None:
            self._count(statistics, end)
        if end == source.size:
            return
        self.next_base = source.find_log(end)
        if self.next_base != end:
            findings.flaw(end, self.next_base or source.size, "bytes behind the end of the log")
