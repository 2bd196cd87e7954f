"""Character encoding detection: UTF-8, UTF-16, or Windows' own (cp1252)."""

import codecs
from typing import Final

UTF8: Final = "utf-8-sig"
UTF16: Final = "utf-16"
WINDOWS: Final = "cp1252"
_LEAST_ZEROS: Final = 0.8
"""Share of zeros among every other byte, without one among the rest: UTF-16 without a mark."""
_MARKS: Final = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def encoding_of(head: bytes) -> str:
    """The encoding of a text that begins with these bytes; a character that is cut at their end is no fault."""
    if head.startswith(_MARKS):
        return UTF16
    for place, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        halves = head[place::2], head[1 - place :: 2]
        if halves[0] and halves[0].count(0) > _LEAST_ZEROS * len(halves[0]) and halves[1].count(0) == 0:
            return name
    try:
        codecs.getincrementaldecoder(UTF8)().decode(head)
    except UnicodeDecodeError:
        return WINDOWS
    return UTF8


def decoded(head: bytes, encoding: str | None = None) -> str:
    """The text; what is no character of the encoding (`None` = the one it seems to have) becomes a question mark."""
    return head.decode(encoding or encoding_of(head), errors="replace").removeprefix("\ufeff")
