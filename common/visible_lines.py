"""Escaping of serial lines for a terminal: control characters by their number, what is no text in hexadecimal."""

import re
from collections.abc import Callable
from typing import Final

SAMPLE: Final = 76
"""Number of characters of a line that are shown as a sample."""
_DEGREES: Final = re.compile(rb"(?<=[0-9]) ?\xc2?\xb0")
_PRINTABLE: Final = bytes((*b"\t\r\n", *range(0x20, 0x7F)))


def strange_bytes(data: bytes) -> int:
    """Number of bytes that are neither printable ASCII nor ends of lines, nor the degree sign of a number."""
    if b"\xb0" in data:
        data = _DEGREES.sub(b"", data)
    return len(data.translate(None, _PRINTABLE))


def is_text(data: bytes) -> bool:
    """Printable, but for one letter in ten of another alphabet (a degree sign)."""
    return 10 * strange_bytes(data) <= len(data)


def visible(data: bytes) -> str:
    """A line as people see it."""
    if 10 * strange_bytes(data) > 3 * len(data):
        return data.hex(" ")
    return "".join(chr(byte) if 0x20 <= byte < 0x7F else f"\\x{byte:02x}" for byte in data)


def shown(data: bytes) -> str:
    """The same, shortened."""
    text = visible(data)
    return text if len(text) <= SAMPLE else f"{text[: SAMPLE - 3]}..."


class VisibleLines:
    """Bytes as they come in, lines to show out."""

    def __init__(self, show: Callable[[str], None]) -> None:
        """show: takes each line."""
        self._show = show
        self._pending = b""

    def feed(self, data: bytes) -> None:
        """Take some bytes; none = there was a pause, and a line that has not ended is shown as it is."""
        *lines, self._pending = (self._pending + data).replace(b"\r", b"\n").split(b"\n")
        if not data:
            lines, self._pending = [*lines, self._pending], b""
        for line in filter(None, lines):
            self._show(visible(line))
