"""The outside of an NMEA sentence: address and checksum, before any field is looked at.

`$ttfff,field,...*hh`: talker (two characters), formatter (three), checksum = XOR of all bytes between `$` and `*`.
AIS sentences begin with `!`. The checksum is required: a sentence without one cannot be told from a damaged one.
"""

import re
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Final

LONGEST_SENTENCE: Final = 512

# A talker never begins with P: that letter marks proprietary sentences (`$PSRFTXT`), which have no talker.
_ADDRESS = re.compile(rb"[$!]([A-OQ-Z][A-Z0-9])([A-Z]{3})(?:[,*]|$)")
_PRINTABLE = re.compile(rb"[ -~]*")
_CHECKSUM = re.compile(rb"\*[0-9A-Fa-f]{2}")


@dataclass(frozen=True, slots=True)
class Sentence:
    """One sentence whose checksum is right; its fields are not judged yet."""

    talker: str
    """Empty for a proprietary sentence."""
    formatter: str
    """Empty for a proprietary sentence."""
    text: str
    """The whole of it, `$` to checksum."""


def address(data: bytes) -> tuple[str, str] | None:
    """Talker and formatter a line claims to have, checksum not looked at; `None` = no talker sentence."""
    match = _ADDRESS.match(data)
    return None if match is None else (match[1].decode("ascii"), match[2].decode("ascii"))


def check_sentence(data: bytes) -> Sentence | str:
    """The sentence, or why it is none.

    Reasons: `too-long`, `not-ascii`, `not-nmea`, `no-checksum`, `run-together` (a second `$`, `!` or `*` inside: two
    sentences whose line end was lost), `checksum`.
    """
    if len(data) > LONGEST_SENTENCE:
        return "too-long"
    if not _PRINTABLE.fullmatch(data):
        return "not-ascii"
    if data[:1] not in (b"$", b"!"):
        return "not-nmea"
    if not _CHECKSUM.fullmatch(data[-3:]):
        return "run-together" if b"$" in data[1:] else "no-checksum"
    body = data[1:-3]
    if b"$" in body or b"!" in body or b"*" in body:
        return "run-together"
    if reduce(xor, body, 0) != int(data[-2:], 16):
        return "checksum"
    talker, formatter = address(data) or ("", "")
    return Sentence(talker, formatter, data.decode("ascii"))
