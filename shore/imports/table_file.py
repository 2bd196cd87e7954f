"""CSV file with its mapping: the head is found, the first rows tell how the cells are written (schema inference)."""

import csv
from collections.abc import Callable, Iterator, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Final

from common.errors import WayfixError
from common.simulation.column_map import TableShape
from shore.imports.cell_columns import Cells
from shore.imports.csv_dialect import Table, TableRow, rows_of, table_in
from shore.imports.reader import opened
from shore.imports.recognise import HEAD_BYTES
from shore.imports.text_encoding import decoded
from shore.imports.units import UNITS, factor_of, unit_of_name

SAMPLED: Final = 1000
"""So many rows at the beginning tell how the cells are written, and whether the newest row stands first."""


class TableFile:
    """A CSV file: its head, its rows, and the first of them to look at."""

    def __init__(
        self,
        path: Path,
        shape: TableShape,
        wanted: Sequence[str],
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """wanted: the columns that must be there. Raises WayfixError."""
        self._path = path
        self._progress = progress
        self.table = _table(path, shape, wanted)
        self.sample: list[Cells] = []
        """The first rows."""
        for row in self.rows():
            if row.cells is not None:
                self.sample.append(row.cells)
            if len(self.sample) >= SAMPLED:
                break
        self._units = _unit_row(self.sample)
        if self._units:
            del self.sample[0]

    def rows(self, *, is_counted: bool = False) -> Iterator[TableRow]:
        """The rows; is_counted: their bytes move the progress bar."""
        encoding = self.table.encoding
        with opened(self._path) as stream, TextIOWrapper(stream, encoding, errors="replace", newline="") as text:
            counted = 0
            for row in rows_of(text, self.table):
                if is_counted and self._progress and (now := stream.tell()) > counted:
                    self._progress(now - counted)
                    counted = now
                yield row

    def raw_rows(self) -> list[list[str]]:
        """The fields of the first lines, whatever the columns are."""
        with opened(self._path) as stream:
            lines = decoded(stream.read(HEAD_BYTES), self.table.encoding).splitlines()[self.table.first_line :][
                :SAMPLED
            ]
        delimiter = self.table.delimiter
        return list(csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter == " "))

    def is_units(self, cells: Cells) -> bool:
        """True for the row below the head that holds the units."""
        return bool(self._units) and cells == self._units

    def unit(self, column: str, quantity: str) -> str | None:
        """The unit that the row of units, or the column's name, says; `None` = neither does."""
        written = self._units.get(column, "")
        return written if written and factor_of(written, quantity) is not None else unit_of_name(column, quantity)

    def factor(self, column: str | None, quantity: str) -> float:
        """Factor of that unit; 1 where there is none."""
        unit = None if column is None else self.unit(column, quantity)
        return 1.0 if unit is None else factor_of(unit, quantity) or 1.0


def _table(path: Path, shape: TableShape, wanted: Sequence[str]) -> Table:
    with opened(path) as stream:
        table = table_in(stream.read(HEAD_BYTES), shape, wanted)
    if table is None:
        cure = "give a CSV file with a line of column names, or name them in the mapping ([table] columns)"
        raise WayfixError("is no table", str(path), cure)
    missing = [name for name in wanted if name not in table.columns]
    if missing:
        known = ", ".join(name for name in table.columns if name)
        raise WayfixError(f"has no column {', '.join(missing)}", str(path), f"correct the mapping; it has: {known}")
    twice = [name for name in wanted if table.columns.count(name) > 1]
    if twice:
        cure = "give every column a name of its own in the file"
        raise WayfixError(f"has more than one column {', '.join(twice)}", str(path), cure)
    return table


def _unit_row(rows: Sequence[Cells]) -> Cells:
    """The first row, when it holds units and no number; else nothing."""
    if not rows:
        return {}
    cells = [cell for cell in rows[0].values() if cell]
    is_unit = [any(factor_of(cell, quantity) is not None for quantity in UNITS) for cell in cells]
    has_digits = any(cell[0].isdigit() or cell[0] in "+-." for cell in cells)
    return rows[0] if cells and 2 * sum(is_unit) >= len(cells) and not has_digits else {}
