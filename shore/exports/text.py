"""Shared parts of the text formats: ISO 8601 times, text that XML can hold, and a buffer for what comes further on."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import lru_cache
from shutil import copyfileobj
from tempfile import SpooledTemporaryFile
from typing import BinaryIO, Final, cast

from common.units import NS_PER_S, NS_PER_US

PLACE_DECIMALS: Final = 9
"""Decimals of latitude and longitude (deg), as many as in the log."""
_IN_MEMORY: Final = 16 * 2**20
_NOT_XML: Final = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no escape can bring into XML 1.0."""


def iso(utc_ns: int) -> str:
    """`2026-11-22T14:34:25.123456Z`, whole microseconds."""
    seconds, rest_ns = divmod(utc_ns, NS_PER_S)
    return f"{_second(seconds)}.{rest_ns // NS_PER_US:06d}Z"


@lru_cache(maxsize=64)
def _second(seconds: int) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")


def xml_text(text: str) -> str:
    """The text without the characters that no XML file may hold."""
    return _NOT_XML.sub("\ufffd", text)


class Aside:
    """Bytes that are written now and belong behind others; on the disk when they are many."""

    def __init__(self, file: "SpooledTemporaryFile[bytes]") -> None:
        self._file = file

    def write(self, text: str) -> None:
        """Add to the end."""
        self._file.write(text.encode())

    def append(self, other: "Aside") -> None:
        """Add all of another, which is empty after that."""
        other.pour(cast("BinaryIO", self._file))

    def pour(self, stream: BinaryIO) -> None:
        """Everything into `stream`; empty after that."""
        self._file.seek(0)
        copyfileobj(self._file, stream)
        self._file.seek(0)
        self._file.truncate()


@contextmanager
def aside() -> Iterator[Aside]:
    """A new buffer, which is thrown away at the end. Raises OSError when the disk is full."""
    with SpooledTemporaryFile(max_size=_IN_MEMORY) as file:
        yield Aside(file)
