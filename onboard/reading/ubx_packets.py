"""UBX framing: whole packets of u-blox' binary protocol are taken out of a byte stream, the text between them is left.

    B5 62 | class | id | length (2, little endian) | payload | checksum (2, Fletcher's over class to payload)

A packet has no line end of its own and holds any byte, `$` and line feed too: what is left of one between two lines
would look like damage. (u-blox, interface description, section UBX frame structure.)
"""

import re
from typing import Final

from common.checks import fletcher

LONGEST_PAYLOAD: Final = 4096
"""A longer one is none, bytes: RAWX with 96 signals has 3,088."""
_SYNC: Final = b"\xb5\x62"
_HEADER: Final = 6
_AROUND: Final = 8
"""Number of bytes of a packet beside its payload."""
_SENTENCE: Final = re.compile(rb"[\r\n][$!][A-Z]{5},")
"""A new line that begins as a sentence does."""


class UbxPackets:
    """Removes the packets of one port. What begins like one and has another checksum is left as it came."""

    def __init__(self) -> None:
        self.packets = 0
        """Number of packets so far."""
        self.packet_bytes = 0
        """Number of bytes in them."""
        self._held = bytearray()

    @property
    def held_bytes(self) -> int:
        """Number of bytes that may be the beginning of a packet."""
        return len(self._held)

    def text(self, data: bytes) -> bytes:
        """What is no packet, of what was held and of `data`."""
        if not self._held and b"\xb5" not in data:
            return data
        data = bytes(self._held) + data
        self._held.clear()
        text, done = bytearray(), 0
        while (start := data.find(b"\xb5", done)) >= 0:
            text += data[done:start]
            size = _packet_size(data[start : start + LONGEST_PAYLOAD + _AROUND])
            if size is None:
                self._held += data[start:]
                return bytes(text)
            if size:
                self.packets += 1
                self.packet_bytes += size
            else:
                text += data[start : start + 1]
            done = start + max(size, 1)
        return bytes(text + data[done:])

    def reset(self) -> int:
        """Forget what is held; returns the number of its bytes."""
        held = len(self._held)
        self._held.clear()
        return held


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
