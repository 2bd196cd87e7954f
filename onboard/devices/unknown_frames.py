"""Frame inference: packets of a binary protocol that is not known, by a repeating mark and a length or checksum.

Noise of a wrong baud rate repeats too, for lines repeat, but nothing in it counts its bytes or adds them up. A mark of
two bytes is believed where a field behind it gives the distance to the next one, which is of several sizes, or where
packets of one size differ and all end with the same kind of checksum, which has several values.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Final

from common.checks import crc16, crc16_reflected, fletcher, sum8, xor8

_MARKS: Final = 24
"""Number of pairs of bytes that are tried as a mark, the most common ones."""
_LEAST_MARKS: Final = 4
_LEAST_DIFFERENT: Final = 6
"""Number of packets of one length that must differ from each other."""
_LEAST_LENGTHS: Final = 4
_LEAST_SUMS: Final = 5
"""Number of values that a checksum must have in them."""
_SIZES: Final = range(6, 513)
_LENGTH_AT: Final = range(2, 9)
_LONGEST_AROUND: Final = 24
_BEGINS: Final = range(4)
_TAILS: Final = range(3)

_ONE_BYTE: Final[tuple[Callable[[bytes], int], ...]] = (
    sum8, xor8, lambda data: -sum(data) & 0xFF, lambda data: ~sum(data) & 0xFF,
)  # fmt: skip
_TWO_BYTES: Final[tuple[Callable[[bytes], int], ...]] = (
    fletcher, lambda data: sum(data) & 0xFFFF, crc16, lambda data: crc16(data, 0xFFFF), crc16_reflected,
    lambda data: crc16_reflected(data, 0xFFFF),
)  # fmt: skip


def unknown_mark(data: bytes) -> bytes | None:
    """The two bytes with which the packets of an unknown protocol begin; `None` = there are no such packets."""
    counts = Counter(data[at : at + 2] for at in range(len(data) - 1))
    for mark, count in counts.most_common(_MARKS):
        if count < _LEAST_MARKS:
            return None
        places = list(_places(data, mark))
        packets = [data[begin:end] for begin, end in pairwise(places)]
        if len(packets) >= _LEAST_MARKS - 1 and (_has_length(packets) or _has_checksum(packets)):
            return mark
    return None


def _places(data: bytes, mark: bytes) -> Iterator[int]:
    at = data.find(mark)
    while at >= 0:
        yield at
        at = data.find(mark, at + len(mark))


def _has_length(packets: list[bytes]) -> bool:
    """Some field gives the length of each packet, and there are several lengths."""
    if len({len(packet) for packet in packets}) < _LEAST_LENGTHS or any(
        len(packet) not in _SIZES for packet in packets
    ):
        return False
    shortest = min(map(len, packets))
    fields = [(at, width, order) for at in _LENGTH_AT for width, order in ((1, "big"), (2, "big"), (2, "little"))]
    for at, width, order in fields:
        if at + width > shortest:
            continue
        around = {len(packet) - _number(packet[at : at + width], order) for packet in packets}
        if len(around) == 1 and 0 <= around.pop() <= _LONGEST_AROUND:
            return True
    return False


def _number(data: bytes, order: str) -> int:
    return int.from_bytes(data, "big" if order == "big" else "little")


def _has_checksum(packets: list[bytes]) -> bool:
    """Packets of one length end with one kind of checksum, which has several values."""
    size, _ = Counter(map(len, packets)).most_common(1)[0]
    different = sorted({packet for packet in packets if len(packet) == size})
    if size not in _SIZES or len(different) < max(_LEAST_DIFFERENT, len(packets) // 2):
        return False
    for tail in _TAILS:
        whole = [packet[: size - tail] for packet in different]
        for rules, width in ((_ONE_BYTE, 1), (_TWO_BYTES, 2)):
            if len({packet[-width:] for packet in whole}) < _LEAST_SUMS:
                continue
            if any(_all_end_with(whole, rule, begin, width) for rule in rules for begin in _BEGINS):
                return True
    return False


def _all_end_with(packets: list[bytes], rule: Callable[[bytes], int], begin: int, width: int) -> bool:
    for packet in packets:
        value = rule(packet[begin:-width])
        if packet[-width:] not in (value.to_bytes(width, "big"), value.to_bytes(width, "little")):
            return False
    return True
