"""CSV tables (comma-separated values): the estimates in one file, or (into a directory) all measurements too."""

import csv
from codecs import getwriter
from collections.abc import Iterable
from typing import Any, BinaryIO, Final

from shore.exports import table
from shore.exports.text import iso
from shore.exports.track import ExportTrack

_UTC: Final = table.TIMES.index("utc")


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """The estimates. Raises OSError."""
    table.fill(track, lambda _, columns: _Sheet(stream, columns))


def write_all(streams: dict[str, BinaryIO], track: ExportTrack) -> None:
    """A file for each of `table.NAMES`. Raises OSError."""
    table.fill_all(track, lambda name, columns: _Sheet(streams[name], columns))


class _Sheet:
    def __init__(self, stream: BinaryIO, columns: tuple[str, ...]) -> None:
        self._writer = csv.writer(getwriter("utf-8")(stream))
        self._writer.writerow(columns)

    def add(self, rows: Iterable[table.Values]) -> None:
        self._writer.writerows(map(_words, rows))

    def finish(self) -> None:
        """Nothing follows the last row."""


def _words(values: table.Values) -> list[Any]:
    """Missing = empty; true and false as every other program writes them."""
    words: list[Any] = [str(value).lower() if type(value) is bool else value for value in values]
    words[_UTC] = None if words[_UTC] is None else iso(words[_UTC])
    return words
