"""Segment format: the bytes of header and records, with CRC (docs/spool-format.md). Pure.

    header: magic, version, length, CRC-32, MessagePack map      records: magic, flags, length, seq, CRC-32, frame

All numbers are little-endian. The CRC of a record is begun with that of the boot id: a block of another start, which a
file system may show after a power cut, is no record of this one.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple
from zlib import crc32

import msgpack

from common.codec import MAX_FRAME_BYTES
from common.framer import Identity

SEGMENT_BYTES: Final = 4 << 20
VERSION: Final = 1
SEGMENT_MAGIC: Final = b"WFSPOOL\x1a"
RECORD_MAGIC: Final = b"\xf5WFR"
FRAME: Final = 0
"""Flags of a record that holds a frame."""
END: Final = 1
"""Flags of the last record of a segment that was ended in good order: no bytes, `seq` is one past the last frame."""
MAX_HEADER_BYTES: Final = 65_536

_HEADER: Final = struct.Struct("<8sIII")
_SIZES: Final = struct.Struct("<II")
_RECORD: Final = struct.Struct("<4sIIQI")
_HEAD: Final = struct.Struct("<4sIIQ")
RECORD_BYTES: Final = _RECORD.size
_NAME: Final = re.compile(r"(\d{10,19})-([0-9a-f]{16})-(\d{12,19})\.seg")


class Name(NamedTuple):
    """What a file name says; segments sort by it."""

    number: int
    """Number by which starts are sorted: start_no, or one more than the highest there is when the start counter was
    lost."""
    first_seq: int
    """Number of the first frame in the segment."""
    boot_id: str

    def __str__(self) -> str:
        return f"{self.number:010d}-{self.boot_id}-{self.first_seq:012d}.seg"


def name_of(file: str) -> Name | None:
    """None for a file that is no segment."""
    match = _NAME.fullmatch(file)
    return None if match is None else Name(int(match[1]), int(match[3]), match[2])


@dataclass(frozen=True, slots=True)
class Header:
    """Whose frames follow."""

    identity: Identity
    first_seq: int
    after_seq: int
    """Number of the last frame in the segment before it, of the same start; -1 = there was none."""
    about: Mapping[str, Any]
    """Configuration and versions of the daemon, for `export`; may be empty."""


def pack_header(header: Header) -> bytes:
    """The first bytes of a segment; `about` is left out when it would not fit."""
    identity = header.identity
    fields = {
        "boat_id": identity.boat_id,
        "boot_id": identity.boot_id,
        "clock_id": identity.clock_id,
        "start_no": identity.start_no,
        "first_seq": header.first_seq,
        "after_seq": header.after_seq,
    }
    data = msgpack.packb({**fields, "about": dict(header.about)})
    if len(data) > MAX_HEADER_BYTES:
        data = msgpack.packb({**fields, "about": {}})
    crc = crc32(data, crc32(_SIZES.pack(VERSION, len(data))))
    return _HEADER.pack(SEGMENT_MAGIC, VERSION, len(data), crc) + bytes(data)


def unpack_header(data: bytes) -> tuple[Header, int] | None:
    """Header and number of its bytes; None when it is damaged, cut or of a newer version."""
    if len(data) < _HEADER.size:
        return None
    magic, version, length, crc = _HEADER.unpack_from(data)
    end = _HEADER.size + length
    if magic != SEGMENT_MAGIC or version != VERSION or length > MAX_HEADER_BYTES or len(data) < end:
        return None
    packed = data[_HEADER.size : end]
    if crc32(packed, crc32(_SIZES.pack(version, length))) != crc:
        return None
    try:
        fields = msgpack.unpackb(packed, raw=False)
        identity = Identity(*(fields[name] for name in ("boat_id", "boot_id", "clock_id", "start_no")))
        return Header(identity, fields["first_seq"], fields["after_seq"], fields["about"]), end
    except Exception:  # msgpack's own errors, and what is no such map
        return None


def seed_of(boot_id: str) -> int:
    """What the CRC of every record of this start begins with."""
    return crc32(boot_id.encode("ascii"))


def pack_record(seq: int, data: bytes, seed: int, flags: int = FRAME) -> bytes:
    """The bytes of one record."""
    head = _HEAD.pack(RECORD_MAGIC, flags, len(data), seq)
    return head + crc32(data, crc32(head, seed)).to_bytes(4, "little") + data


class Record(NamedTuple):
    """A whole record: `data[body:end]` is the frame."""

    flags: int
    seq: int
    start: int
    body: int
    end: int


class Damage(NamedTuple):
    """Bytes that are no record."""

    start: int
    end: int


def record_at(data: bytes, at: int, seed: int) -> Record | None:
    """The record that begins at `at`; None when there is none, or none that is whole."""
    body = at + RECORD_BYTES
    if body > len(data):
        return None
    magic, flags, length, seq, crc = _RECORD.unpack_from(data, at)
    end = body + length
    if magic != RECORD_MAGIC or length > MAX_FRAME_BYTES or end > len(data):
        return None
    with memoryview(data) as view:
        if crc32(view[body:end], crc32(view[at : at + _HEAD.size], seed)) != crc:
            return None
    return Record(flags, seq, at, body, end)


def scan(data: bytes, at: int, seed: int, above: int = -1) -> Iterator[Record | Damage]:
    """Everything from `at` on, in order and without a hole; after a damaged stretch it goes on at the next record.

    `seq` rises, beginning above `above`: a whole record that steps back (an old block that the file system shows)
    counts as damage.
    """
    bad = None
    while 0 <= at < len(data):
        record = record_at(data, at, seed)
        if record is None or record.seq <= above:
            bad = at if bad is None else bad
            at = data.find(RECORD_MAGIC, at + 1)
            continue
        if bad is not None:
            yield Damage(bad, at)
            bad = None
        yield record
        above, at = record.seq, record.end
    if bad is not None:
        yield Damage(bad, len(data))


def last_seq_of(tail: bytes, seed: int) -> int | None:
    """The last frame of a segment by its last bytes; None when these do not end with a whole record."""
    at = len(tail)
    for _ in range(64):  # the magic may stand in a frame by chance, not often
        at = tail.rfind(RECORD_MAGIC, 0, at)
        if at < 0:
            return None
        record = record_at(tail, at, seed)
        if record is not None and record.end == len(tail):
            return record.seq - (1 if record.flags == END else 0)
    return None
