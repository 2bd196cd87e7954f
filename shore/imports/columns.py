"""CSV reader: a table and its column mapping, of which every row is taken as it is (docs/mapping.md)."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

from common.boat_config import SensorTable
from common.framer import Measurement
from common.simulation.column_map import ColumnMap
from common.units import NS_PER_S
from shore.imports.cell_columns import BadCell, Cells
from shore.imports.csv_dialect import TableRow
from shore.imports.frames import PORT
from shore.imports.line_counts import Account, Rejected
from shore.imports.reader import ForeignRecord, Sources
from shore.imports.record_times import LATEST_NS
from shore.imports.table_file import TableFile
from shore.imports.table_parts import parts_of
from shore.imports.time_cells import TimeCells


class ColumnReader:
    """Reader of one table. A row without time is rejected; of the others each part is counted for itself."""

    def __init__(self, path: Path, mapping: ColumnMap, progress: Callable[[int], None] | None = None) -> None:
        """Raises WayfixError for columns that are not there."""
        self.mapping = mapping
        self.boat = mapping.boat
        time = mapping.time
        self.is_utc = time.is_utc
        self.sources = Sources()
        self._file = TableFile(path, mapping.table, mapping.columns, progress)
        self._time = TimeCells(time, self._file.table.decimal, self._file.factor(time.column, "time"))
        self._rows = Account("rows")
        self._parts = [(part, Account(f"rows for {part.name}")) for part in parts_of(mapping, self._file)]
        self.accounts = (self._rows, *(account for _, account in self._parts))
        self._before: dict[str, Any] = {}
        """What the cells of each part said in the row before."""
        self.notes = list(dict.fromkeys(note for part, _ in self._parts for note in part.notes))
        steps = _steps_ns(self._file.sample, self._time)
        moves = [step for step in steps if step]
        self._is_newest_first = len(moves) > 1 and 10 * sum(step < 0 for step in moves) > 9 * len(moves)
        if 2 * steps.count(0) > len(steps) > 1 and not time.spread:
            self.notes.append(
                "most rows have the time of the row before; spread = true spreads them up to the next time"
            )
        if self._is_newest_first:
            self.notes.append("the newest row stands first: the rows are taken from the last to the first")

    def records(self) -> Iterator[ForeignRecord]:
        """Records of the table, one for each row, the oldest first."""
        wraps = 0
        before_ns: int | None = None
        wraps_ns = round(self.mapping.time.wraps_s * NS_PER_S)
        for t_ns, row in self._timed():
            if wraps_ns and before_ns is not None and t_ns < before_ns - wraps_ns // 2:
                wraps += 1
            before_ns = t_ns
            yield ForeignRecord(min(t_ns + wraps * wraps_ns, LATEST_NS), row)

    def measure(self, record: ForeignRecord, t_ns: int) -> Iterator[Measurement]:
        """Measurements of a row, up to one of each part."""
        self._rows.taken["with time"] += 1
        utc_ns = record.t_ns if self.is_utc and record.t_ns is not None and record.t_ns >= 0 else None
        row: TableRow = record.content
        assert row.cells is not None
        for part, account in self._parts:
            try:
                made = part.read(row.cells, t_ns, utc_ns)
            except Rejected as reason:
                _reject(account, str(reason), row, reason)
                continue
            if made is None:
                account.ignored["empty"] += 1
                continue
            if part.held and self._before.get(part.name) == made[0]:
                account.ignored["the same as before"] += 1
            else:
                account.taken[type(made[1]).__name__] += 1
                yield made[1]
            self._before[part.name] = made[0]

    def leave_out(self, record: ForeignRecord, reason: str) -> None:
        """Count a row that is left out."""
        _reject(self._rows, f"time: {reason}", record.content)

    def sensors(self, rates_hz: dict[str, float | None]) -> tuple[SensorTable, ...]:
        """Sensors of the table, one for each part, with what the mapping's `[facts]` say of them."""
        facts = asdict(self.mapping.facts)
        return tuple(
            SensorTable(id=f"{role}1", port=PORT, role=role, rate_hz=rates_hz[f"{role}1"], **facts)
            for role in ("gps", "compass", "imu", "gyro")
            if f"{role}1" in rates_hz
        )

    def _timed(self) -> Iterator[tuple[int, TableRow]]:
        """The rows that have a time, the oldest first."""
        rows = self._in_the_file()
        # Tables that begin with the newest row are exports of web pages: they fit into memory.
        yield from reversed(list(rows)) if self._is_newest_first else rows

    def _in_the_file(self) -> Iterator[tuple[int, TableRow]]:
        for row in self._file.rows(is_counted=True):
            if row.cells is None:
                if row.is_fault:
                    _reject(self._rows, "no row of this table", row)
                else:
                    self._rows.ignored[row.fault] += 1
                continue
            if self._file.is_units(row.cells):
                self._rows.ignored["units"] += 1
                continue
            try:
                t_ns = self._time.read(row.cells)
            except Rejected as reason:
                _reject(self._rows, f"time: {reason}", row, reason)
                continue
            yield t_ns, row


def _reject(account: Account, reason: str, row: TableRow, why: Rejected | None = None) -> None:
    details = why.where if isinstance(why, BadCell) else row.fault
    account.reject(reason, f"line {row.line}" + (f", {details}" if details else ""))


def _steps_ns(rows: Sequence[Cells], time: TimeCells) -> list[int]:
    """Steps of time from each of the first rows to the next, ns."""
    times = []
    for cells in rows:
        try:
            times.append(time.read(cells))
        except Rejected:
            continue
    return [b - a for a, b in pairwise(times)]
