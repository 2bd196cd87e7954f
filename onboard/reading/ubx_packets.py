"""UBX framing: whole packets of u-blox' binary protocol are taken out of a byte stream, the text between them is left.

    B5 62 | class | id | length (2, little endian) | payload | checksum (2, Fletcher's over class to payload)

A packet has no line end of its own and holds any byte, `$` and line feed too: what is left of one between two lines
would look like damage. (u-blox, interface description, section UBX frame structure.)

Any device may send the two sync bytes, and a length that never comes. What may be a packet is therefore held no longer
than a line may take, and all bytes keep the time of the chunk that brought them.
"""

import re
from bisect import bisect_right
from itertools import accumulate
from typing import Final

from common.checks import fletcher
from common.units import NS_PER_MS

LONGEST_PAYLOAD: Final = 4096
"""A longer one is none, bytes: RAWX with 96 signals has 3,088."""
LONGEST_HOLD_NS: Final = 1_100 * NS_PER_MS
"""Time after which what began like a packet is none, ns: as long as a line may take."""
MOST_WRONG: Final = 8
"""Number of beginnings that were none, one behind the other, after which bytes pass unseen: looking is bounded."""
_SYNC: Final = b"\xb5\x62"
_HEADER: Final = 6
_AROUND: Final = 8
"""Number of bytes of a packet beside its payload."""
_SENTENCE: Final = re.compile(rb"[\r\n][$!%#][A-Z0-9]{2}")
"""A new line that begins as a sentence does, or as a compass's own line."""
_LEAST_SENTENCE: Final = 4
"""Number of bytes that it needs."""

Timed = tuple[int, bytes]
"""Bytes and the boat time of the chunk that brought them, ns."""


class UbxPackets:
    """Removes the packets of one port. What begins like one and has another checksum is left as it came."""

    def __init__(self) -> None:
        self.packets = 0
        """Number of packets so far."""
        self.packet_bytes = 0
        """Number of bytes in them."""
        self.busy_ns = 0
        """Time that packets took on the wire, ns since it was last set to 0."""
        self._held: list[Timed] = []
        self._held_bytes = 0
        self._wanted = 0
        self._tail = b""
        self._wrong = 0

    @property
    def held_bytes(self) -> int:
        """Number of bytes that may be the beginning of a packet."""
        return self._held_bytes

    @property
    def held_ns(self) -> int | None:
        """Boat time of the first of these bytes; `None` = there are none."""
        return self._held[0][0] if self._held else None

    def text(self, data: bytes, t_ns: int) -> list[Timed]:
        """What is no packet, of what was held and of `data` stamped `t_ns`, in order; no data = look at the time."""
        if not self._held and b"\xb5" not in data:
            return [(t_ns, data)]
        if self._held and self._is_waiting(data, t_ns):
            self._hold([(t_ns, data)])
            return []
        stream = _Stream([*self._held, (t_ns, data)])
        self._forget()
        text: list[Timed] = []
        data, passed, at = stream.data, 0, 0
        while self._wrong < MOST_WRONG and (at := data.find(b"\xb5", at)) >= 0:
            size = _packet_size(data[at : at + LONGEST_PAYLOAD + _AROUND])
            if size is None and t_ns - stream.time_of(at) <= LONGEST_HOLD_NS:
                self._wanted = _wanted(data[at : at + _HEADER])
                self._hold(stream.cut(at, len(data)))
                return text + stream.cut(passed, at)
            if not size:
                self._wrong += data.startswith(_SYNC, at)
                at += 1
                continue
            text += stream.cut(passed, at)
            self._taken(size, stream.time_of(at + size - 1) - stream.time_of(at))
            passed = at = at + size
        self._wrong = 0
        return text + stream.cut(passed, len(data))

    def reset(self) -> int:
        """Forget what is held; returns the number of its bytes."""
        held = self.held_bytes
        self._forget()
        self._wrong = 0
        return held

    def _is_waiting(self, data: bytes, t_ns: int) -> bool:
        """Whether `data` decides nothing: readers of single bytes are not to look at all that is held each time."""
        is_late = t_ns - self._held[0][0] > LONGEST_HOLD_NS
        is_enough = self._held_bytes + len(data) >= self._wanted
        return not (is_late or is_enough or _SENTENCE.search(self._tail + data))

    def _hold(self, chunks: list[Timed]) -> None:
        self._held += chunks
        for _, data in chunks:
            self._held_bytes += len(data)
            self._tail = (self._tail + data)[-_LEAST_SENTENCE + 1 :]

    def _forget(self) -> None:
        self._held, self._held_bytes, self._tail = [], 0, b""

    def _taken(self, size: int, took_ns: int) -> None:
        self.packets += 1
        self.packet_bytes += size
        self.busy_ns += took_ns
        self._wrong = 0


class _Stream:
    """Chunks in a row, each byte with the time of its own."""

    def __init__(self, chunks: list[Timed]) -> None:
        self.data = b"".join(data for _, data in chunks)
        self._times = [t_ns for t_ns, _ in chunks]
        self._edges = list(accumulate((len(data) for _, data in chunks), initial=0))

    def time_of(self, at: int) -> int:
        """Time of the byte at `at`, ns."""
        return self._times[bisect_right(self._edges, at) - 1]

    def cut(self, begin: int, end: int) -> list[Timed]:
        """The bytes from `begin` up to `end`."""
        found = []
        chunk = bisect_right(self._edges, begin) - 1
        while begin < end:
            edge = min(end, self._edges[chunk + 1])
            found.append((self._times[chunk], self.data[begin:edge]))
            begin, chunk = edge, chunk + 1
        return found


def _packet_size(data: bytes) -> int | None:
    """Size of the packet at the beginning of `data`; 0 = it is none, `None` = more bytes are needed to tell."""
    if not _SYNC.startswith(data[:2]):
        return 0
    if len(data) < _HEADER:
        return None
    length = int.from_bytes(data[4:_HEADER], "little")
    if length > LONGEST_PAYLOAD:
        return 0
    if len(data) < length + _AROUND:
        # A damaged length must not hold back what follows.
        return 0 if _SENTENCE.search(data) else None
    sent = int.from_bytes(data[_HEADER + length : _AROUND + length], "big")
    return length + _AROUND if fletcher(data[2 : _HEADER + length]) == sent else 0


def _wanted(head: bytes) -> int:
    """Number of bytes that are needed before more is known of what begins with `head`."""
    return int.from_bytes(head[4:], "little") + _AROUND if len(head) == _HEADER else len(head) + 1
