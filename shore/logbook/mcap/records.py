"""Record parser of MCAP: bytes in, records out; it accepts only what fits exactly.

https://mcap.dev/spec: a record is its type (1 byte), its length (8 bytes) and its content.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from struct import Struct
from typing import Any, Final

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

MAGIC: Final = MCAP0_MAGIC
LOG_START: Final = MAGIC + b"\x01"
"""Bytes with which every log begins, and with which none ends."""
HEAD: Final = Struct("<BQ")
"""Type and length of a record."""
LIMIT: Final = 256 * 2**20
"""Most bytes of one record; chunks are about 1 MiB, so a longer one means a damaged length."""
BLOCK: Final = 4 * 2**20
"""Number of bytes that are searched at once."""
PRIVATE: Final = 0x80
"""First of the record types that belong to the writers themselves."""

Message = tuple[Channel | None, int, int, int, bytes]
"""Channel, sequence, log time (ns), publish time (ns), content; the channel is `None` where it is not known."""

_CHUNK: Final = Struct("<QQQII")
_MESSAGE: Final = Struct("<HIQQ")
MESSAGE_SIZE: Final = _MESSAGE.size
"""Length of a message without its content, bytes."""
_INSIDE: Final = Struct("<BQHIQQ")
_ENTRY: Final = Struct("<QQ")
_SIZE: Final = Struct("<Q")
_INDEX: Final = Struct("<HI")
_COMPRESSIONS: Final = (b"", b"lz4", b"zstd")
_READERS: Final[dict[int, Callable[[ReadDataStream], Any]]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
    Opcode.ATTACHMENT: Attachment.read,
}
_ZSTD: Final = zstandard.ZstdDecompressor()


class BrokenError(ValueError):
    """Bytes that are not what they should be; the text says why."""


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """What stands before the records of a chunk, itself without checksum."""

    start_ns: int
    end_ns: int
    size: int
    """Length of the chunk when unpacked, bytes."""
    crc: int
    """Checksum (CRC-32) of the unpacked chunk; 0 = the writer made none."""
    compression: bytes
    data_at: int
    """Offset of the packed records within the content of the record, bytes."""


def chunk_head(content: bytes, length: int) -> ChunkHead | None:
    """The head of a chunk of this length; `None` for anything else: both its lengths and its words must fit."""
    if length < 40 or len(content) < 40:
        return None
    start_ns, end_ns, size, crc, name_length = _CHUNK.unpack_from(content)
    name = content[32 : 32 + min(name_length, 8)]
    data_at = 40 + name_length
    if len(name) != name_length or name not in _COMPRESSIONS or len(content) < data_at:
        return None
    if data_at + _SIZE.unpack_from(content, 32 + name_length)[0] != length:
        return None
    return ChunkHead(start_ns, end_ns, size, crc, name, data_at)


def unpacked(content: bytes, head: ChunkHead) -> bytes:
    """The records inside a chunk. Raises BrokenError: what its checksum does not vouch for is not handed out."""
    data = memoryview(content)[head.data_at :]
    try:
        plain = _plain(data, head)
    except Exception as error:  # the libraries raise their own errors, MemoryError and RuntimeError
        raise BrokenError("cannot be unpacked") from error
    if head.crc and zlib.crc32(plain) != head.crc:
        raise BrokenError("its checksum does not hold")
    if not head.crc and len(plain) != head.size:
        raise BrokenError("it has another length than it says")
    return plain


def _plain(data: memoryview, head: ChunkHead) -> bytes:
    if head.compression == b"":
        return bytes(data)
    if not data and not head.size:
        return b""
    if head.compression == b"lz4":
        stream = lz4.frame.LZ4FrameDecompressor()
        plain = bytes(stream.decompress(data, max_length=LIMIT))
        if not stream.eof or stream.unused_data:
            raise BrokenError("cannot be unpacked")
        return plain
    if zstandard.frame_content_size(data) > LIMIT:
        raise BrokenError("cannot be unpacked")
    return _ZSTD.decompress(data, max_output_size=min(head.size, LIMIT))


def messages_in(data: bytes, channels: dict[int, Channel], schemas: dict[int, Schema]) -> tuple[list[Message], int]:
    """Messages of an unpacked chunk in their order, and how many are of no known channel; adds what it defines.

    Raises BrokenError.
    """
    messages: list[Message] = []
    at, end, unknown = 0, len(data), 0
    while at < end:
        if end - at >= _INSIDE.size:
            opcode, length, channel_id, sequence, log_ns, publish_ns = _INSIDE.unpack_from(data, at)
        elif end - at >= HEAD.size:
            opcode, length = HEAD.unpack_from(data, at)
        else:
            raise BrokenError("a record in it is cut")
        after = at + HEAD.size + length
        if after > end or (opcode == Opcode.MESSAGE and length < _MESSAGE.size):
            raise BrokenError("a record in it is cut")
        if opcode == Opcode.MESSAGE:
            channel = channels.get(channel_id)
            if channel is None:
                unknown += 1
            messages.append((channel, sequence, log_ns, publish_ns, data[at + _INSIDE.size : after]))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            define(parsed(opcode, data[at + HEAD.size : after]), channels, schemas)
        elif opcode == 0:
            raise BrokenError("a record in it is of no kind")
        at = after
    return messages, unknown


def message_of(content: bytes, channels: dict[int, Channel]) -> Message:
    """A message outside of chunks. Raises BrokenError."""
    if len(content) < _MESSAGE.size:
        raise BrokenError("a message is cut")
    channel_id, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content)
    return channels.get(channel_id), sequence, log_ns, publish_ns, content[_MESSAGE.size :]


def define(record: Schema | Channel, channels: dict[int, Channel], schemas: dict[int, Schema]) -> None:
    """Remember a channel or schema."""
    if isinstance(record, Channel):
        # The same object for the same words: most writers repeat them in every chunk.
        if channels.get(record.id) != record:
            channels[record.id] = record
    elif schemas.get(record.id) != record:
        schemas[record.id] = record


def parsed(opcode: int, content: bytes) -> Any:
    """A header, schema, channel, metadata or attachment that fills its content exactly. Raises BrokenError."""
    stream = ReadDataStream(BytesIO(content))
    try:
        record = _READERS[opcode](stream)
    except Exception as error:  # the library raises nearly anything
        raise BrokenError("its fields do not fit its length") from error
    if stream.count != len(content):
        raise BrokenError("its fields do not fit its length")
    return record


def is_parsed(opcode: int, content: bytes) -> bool:
    """Whether the content fits this kind of record."""
    if opcode == Opcode.MESSAGE_INDEX:
        return is_index(content)
    try:
        parsed(opcode, content)
    except BrokenError:
        return False
    return True


def is_index(content: bytes) -> bool:
    """Whether it has the form of a message index."""
    if len(content) < _INDEX.size:
        return False
    size: int = _INDEX.unpack_from(content)[1]
    return size == len(content) - _INDEX.size and size % _ENTRY.size == 0


def index_times(content: bytes) -> list[int]:
    """Log time of each message in a message index."""
    return [log_ns for log_ns, _ in _ENTRY.iter_unpack(content[_INDEX.size :])]


def index_entries(content: bytes) -> tuple[int, list[tuple[int, int]]]:
    """Channel and sorted (log time, offset) of a message index."""
    return _INDEX.unpack_from(content)[0], sorted(_ENTRY.iter_unpack(content[_INDEX.size :]))


def index_of(data: bytes) -> dict[int, list[tuple[int, int]]]:
    """The entries that belong to an unpacked sound chunk, by channel."""
    entries: dict[int, list[tuple[int, int]]] = {}
    at, end = 0, len(data)
    while at < end:
        opcode, length = HEAD.unpack_from(data, at)
        if opcode == Opcode.MESSAGE:
            channel_id, _, log_ns, _ = _MESSAGE.unpack_from(data, at + HEAD.size)
            entries.setdefault(channel_id, []).append((log_ns, at))
        at += HEAD.size + length
    return {channel_id: sorted(each) for channel_id, each in entries.items()}


def index_size(messages: list[Message]) -> int:
    """Bytes of all message indexes behind a chunk that holds these messages."""
    used = {channel.id for channel, *_ in messages if channel is not None}
    return len(used) * (HEAD.size + _INDEX.size) + len(messages) * _ENTRY.size
