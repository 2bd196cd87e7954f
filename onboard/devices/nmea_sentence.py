r"""NMEA 0183 framing: address, checksum and tag block of a sentence, before any field is looked at.

`$ttfff,field,...*hh`: talker (two characters), formatter (three), checksum = XOR of all bytes between `$` and `*`.
AIS sentences begin with `!`. The checksum is required: without one, a damaged sentence looks like a sound one.

Two things may stand before the `$`: a tag block of IEC 61162-450 (`\s:GP0001,c:1326055296*3C\$GPGGA...`), and bytes
that are no text. The second is what a receiver that mixes a binary protocol with NMEA sends (the packet has no line end
of its own), and what the first line after a wrong baud rate looks like. The sentence behind either is whole and has its
own checksum; behind bytes that are no text it begins at the last `$` that begins an address, for a packet's last bytes
may look like text. Text alone before the `$` is the rest of another sentence, and the line is refused.
"""

import re
from dataclasses import dataclass
from typing import Final

LONGEST_SENTENCE: Final = 512

# A talker never begins with P: that letter marks proprietary sentences (`$PSRFTXT`), which have no talker. Gateways
# from NMEA 2000 write two digits, the address of a device on the bus, instead of letters (`$04HDM`).
_ADDRESS = re.compile(rb"[$!]([A-OQ-Z0-9][A-Z0-9])([A-Z]{3})(?:[,*]|$)")
_TAG_BLOCK = re.compile(rb"\\[ -\[\]-~]*\\")
# The last bytes of a binary packet may be a `$`, and text behind it, too.
_START = re.compile(rb"[$!](?![$!])")
_ADDRESSED = re.compile(rb"[$!](?:[A-Z0-9]{5}|P[A-Z][A-Z0-9]{1,6}),")
_TEXT: Final = bytes((*b"\t", *range(0x20, 0x7F)))
PADDING: Final = b" \t\0"
"""Bytes that editors and loggers leave behind a sentence."""
_CHECKSUM = re.compile(rb"\*[0-9A-Fa-f]{2}")
_HALVES: Final = tuple(8 * LONGEST_SENTENCE >> step for step in range(1, 10))


@dataclass(frozen=True, slots=True)
class Sentence:
    """One sentence whose checksum is right; its fields are not judged yet."""

    talker: str
    """Talker, two letters; empty for a proprietary sentence."""
    formatter: str
    """Formatter, three letters; empty for a proprietary sentence."""
    text: str
    """The whole sentence, from `$` to the checksum."""


def address(data: bytes) -> tuple[str, str] | None:
    """Talker and formatter a line claims to have, checksum not looked at; `None` = no talker sentence."""
    match = _ADDRESS.match(sentence_of(data))
    return None if match is None else (match[1].decode("ascii"), match[2].decode("ascii"))


def sentence_of(data: bytes) -> bytes:
    """The line without a tag block, or without bytes that are no text, before its `$` or `!` (see the module)."""
    no_text = len(data.rstrip(PADDING).rstrip(_TEXT))
    if no_text:
        *_, start = None, *_ADDRESSED.finditer(data, no_text)
        start = start or _START.search(data, no_text)
        return data if start is None else data[start.start() :]
    block = _TAG_BLOCK.match(data) if data[:1] == b"\\" else None
    return data if block is None else data[block.end() :]


def checksum(data: bytes) -> int:
    """XOR of at most 512 bytes: the upper half of one big number is laid over its lower half, until a byte is left.

    Several times as fast as byte by byte, and this is done for every line.
    """
    value = int.from_bytes(data, "big")
    for bits in _HALVES:
        value ^= value >> bits
    return value & 0xFF


def check_sentence(data: bytes) -> Sentence | str:
    """The sentence, or why it is none.

    Reasons: `too-long`, `not-ascii`, `not-nmea`, `no-checksum`, `run-together` (a second `$`, `!` or `*` inside: two
    sentences whose line end was lost), `checksum`.
    """
    if len(data) > LONGEST_SENTENCE:
        return "too-long"
    data = sentence_of(data).rstrip(PADDING)
    if not data.isascii() or not (text := data.decode("ascii")).isprintable():
        return "not-ascii"
    if data[:1] not in (b"$", b"!"):
        return "not-nmea"
    if not _CHECKSUM.fullmatch(data[-3:]):
        return "run-together" if b"$" in data[1:] else "no-checksum"
    body = data[1:-3]
    if b"$" in body or b"!" in body or b"*" in body:
        return "run-together"
    if checksum(body) != int(data[-2:], 16):
        return "checksum"
    talker, formatter = address(data) or ("", "")
    return Sentence(talker, formatter, text)
