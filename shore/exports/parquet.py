"""Parquet (columnar file), by polars (extra `analysis`): the tables of `table.py` with typed columns."""

from collections.abc import Iterable
from io import BytesIO
from itertools import islice
from typing import Any, BinaryIO, Final

from shore.exports import table
from shore.exports.track import ExportTrack

ROWS: Final = 50_000
"""Most rows held as Python objects at once; after that they are columns of bytes."""
_INTEGERS: Final = frozenset({"t_ns", "utc", "fix_quality", "fix_mode", "satellites", "tod_ms", "position_since_ns"})
_FLAGS: Final = frozenset({"aligned", "held", "usable", "status_valid"})
_WORDS: Final = frozenset({
    "aligned_parts", "waiting", "position_from", "heading_from", "level", "source", "code", "text", "evidence",
    "sensor", "warning",
})  # fmt: skip


def write(stream: BinaryIO, track: ExportTrack) -> None:
    """The estimates. Raises OSError."""
    table.fill(track, lambda _, columns: _Sheet(stream, columns))


def write_all(streams: dict[str, BinaryIO], track: ExportTrack) -> None:
    """A file for each of `table.NAMES`. Raises OSError."""
    table.fill_all(track, lambda name, columns: _Sheet(streams[name], columns))


class _Sheet:
    def __init__(self, stream: BinaryIO, columns: tuple[str, ...]) -> None:
        import polars as pl

        self._stream = stream
        self._schema = {name: _type(name) for name in columns}
        self._done: list[pl.DataFrame] = []
        self._rows: list[table.Values] = []

    def add(self, rows: Iterable[table.Values]) -> None:
        some = iter(rows)
        while more := list(islice(some, ROWS - len(self._rows))):
            self._rows += more
            if len(self._rows) == ROWS:
                self._settle()

    def finish(self) -> None:
        import polars as pl

        self._settle()
        whole = pl.concat(self._done) if self._done else pl.DataFrame(schema=self._schema)
        utc = pl.col("utc").cast(pl.Datetime("ns", "UTC"))
        packed = BytesIO()  # polars would make an error of its own out of a full disk
        whole.with_columns(utc).write_parquet(packed)
        self._stream.write(packed.getbuffer())

    def _settle(self) -> None:
        import polars as pl

        if self._rows:
            columns = zip(self._schema, zip(*self._rows, strict=True), strict=True)
            self._done.append(pl.DataFrame(dict(columns), schema=self._schema, strict=False))
            self._rows = []


def _type(name: str) -> Any:
    import polars as pl

    if name in _INTEGERS:
        return pl.Int64
    if name in _FLAGS:
        return pl.Boolean
    return pl.String if name in _WORDS else pl.Float64
