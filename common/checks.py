"""Checksums and cyclic redundancy checks (CRC) of binary protocols: sums, Fletcher's, and the 16, 24 and 32 bit CRCs.

Each takes the covered bytes and returns a number. The CRCs go through the C code of the standard library: a reflected
CRC is the plain one of the reflected bytes.
"""

import zlib
from binascii import crc_hqx
from functools import reduce
from itertools import accumulate
from operator import xor
from typing import Final

_REFLECTED: Final = bytes(int(f"{value:08b}"[::-1], 2) for value in range(256))
_CRC24Q: Final = 0x1864CFB


def sum8(data: bytes) -> int:
    """Sum of the bytes modulo 256."""
    return sum(data) & 0xFF


def xor8(data: bytes) -> int:
    """Exclusive or of the bytes."""
    return reduce(xor, data, 0)


def fletcher(data: bytes) -> int:
    """Fletcher's checksum with 8 bit sums: first the sum, in the upper byte, then the sum of sums (RFC 1145)."""
    return (sum(data) & 0xFF) << 8 | sum(accumulate(data)) & 0xFF


def crc16(data: bytes, start: int = 0) -> int:
    """CRC-16 with the polynomial 0x1021, highest bit first (XMODEM; with start 0xFFFF CCITT-FALSE)."""
    return crc_hqx(data, start)


def crc16_reflected(data: bytes, start: int = 0) -> int:
    """CRC-16 with the polynomial 0x1021, lowest bit first (KERMIT; with start 0xFFFF the X.25 of MAVLink)."""
    found = crc_hqx(data.translate(_REFLECTED), start)
    return _REFLECTED[found & 0xFF] << 8 | _REFLECTED[found >> 8]


X25_STEPS: Final = frozenset(crc16_reflected(bytes([value])) for value in range(256))
"""What one more byte may change in a reflected CRC-16 after its shift: 256 of 65,536 values."""


def crc24q(data: bytes) -> int:
    """CRC-24Q of Qualcomm, as RTCM 10403 has it."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFFFFFF) ^ _CRC24Q_OF[value >> 16 ^ byte]
    return value


def _after_a_byte(value: int) -> int:
    value <<= 16
    for _ in range(8):
        value = value << 1 ^ (_CRC24Q if value & 0x800000 else 0)
    return value


_CRC24Q_OF: Final = tuple(map(_after_a_byte, range(256)))
"""What the upper byte of the value leaves behind when it is shifted out."""


def crc32_from_zero(data: bytes) -> int:
    """CRC-32 of Ethernet without its two inversions, as NovAtel and Unicore have it."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF
