"""CSV dialect detection: encoding, title lines, head, the character that parts the columns, the decimal mark."""

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, NamedTuple, TextIO

from common.simulation.column_map import TableShape
from shore.imports.text_encoding import decoded, encoding_of

_DELIMITERS: Final = (",", ";", "\t", "|", " ")
_NO_SHAPE: Final = TableShape()
LAST_TITLE_LINE: Final = 100
"""So many lines at the beginning are looked at for the head of the table."""
_LOOKED_AT: Final = 20
"""So many rows behind a line say whether it is their head."""
_SEP_LINE: Final = re.compile(r"sep=(.)\s*", re.IGNORECASE)
_COMMENTS: Final = ("#", "//", "%")
_VALUE: Final = re.compile(r"[+-]?[0-9.][0-9:.,/ TZeE+-]*")
_WITH_COMMA: Final = re.compile(r"[+-]?[0-9]+,[0-9]+")
_GROUPED: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}(,[0-9]{3})+")
_COMMA_GROUPS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}((,[0-9]{3})+\.[0-9]+|(,[0-9]{3}){2,})")
_POINT_GROUPS: Final = re.compile(r"[+-]?[1-9][0-9]{0,2}((\.[0-9]{3})+,[0-9]+|(\.[0-9]{3}){2,})")
_WITH_POINT: Final = re.compile(r"[+-]?[0-9]+\.[0-9]+")
_EXAMPLES: Final[dict[str, frozenset[str]]] = {
    "blueboat-map.toml": frozenset({"original_timestamp", "surge_dot", "sway_dot"}),
    "milliampere-fix-map.toml": frozenset({"header_stamp_secs", "status_status", "latitude"}),
    "milliampere-heading-map.toml": frozenset({"header_stamp_secs", "quaternion_w"}),
    "milliampere-imu-map.toml": frozenset({"header_stamp_secs", "linear_acceleration_x"}),
    "milliampere-nav-map.toml": frozenset({"header_stamp_secs", "pose_position_x"}),
    "car-imu-gps-map.toml": frozenset({"millis", "yawrate", "latitude"}),
    "catabot-map.toml": frozenset({"mavlink_attitude_t.yawspeed", "mavlink_global_position_int_t.lat"}),
}
"""Mapping file -> columns by which it is recognised as fitting."""


class Table(NamedTuple):
    """How a CSV file is written."""

    columns: tuple[str, ...]
    delimiter: str
    encoding: str
    first_line: int
    """Number of lines before the first row: title, comments, head."""
    decimal: str
    """Mark before the decimals, a point or a comma; behind it the mark of thousands, where cells have one."""


class TableRow(NamedTuple):
    """A row of a table."""

    line: int
    """Number of its last line in the file, from 1."""
    cells: dict[str, str] | None
    """Column -> text without blanks around, "" where it is missing; `None` for what is no row of this table."""
    fault: str = ""
    """Why there are no cells: what is wrong, or what stands there instead."""
    is_fault: bool = True
    """False for a comment, or the head once more: nothing is wrong with it."""


def table_in(head: bytes, shape: TableShape = _NO_SHAPE, wanted: Sequence[str] = ()) -> Table | None:
    """The table that begins with these bytes; `None` where no line is the head of the rows behind it.

    shape: what the mapping says of it. wanted: columns that the mapping names: the first line with all of them is the
    head.
    """
    encoding = shape.encoding or encoding_of(head)
    lines = io.StringIO(decoded(head, encoding), newline="").readlines()
    if len(head) > 1 << 10 and len(lines) > _LOOKED_AT:
        lines.pop()  # it may be cut
    start = shape.skip_lines
    delimiters = _DELIMITERS if shape.delimiter is None else (shape.delimiter,)
    if start < len(lines) and (given := _SEP_LINE.fullmatch(lines[start].removeprefix("\ufeff"))) is not None:
        start, delimiters = start + 1, (given[1],)
    found = _headless(lines, start, shape.columns, delimiters) if shape.columns else None
    if found is None and not shape.columns:
        places = [place for place in range(start, min(len(lines), start + LAST_TITLE_LINE)) if lines[place].strip()]
        first = places[0] + 1 if places else 0
        heads = [head for place in places for head in _heads(lines, place, delimiters)]
        found = next((head for head in heads if wanted and set(wanted) <= set(head[0])), None)
        found = found or next((head for head in heads if _fits(head, lines, is_first=head[2] == first)), None)
    if found is None:
        return None
    columns, delimiter, first_line = found
    decimal = shape.decimal or _decimal_of(lines[first_line:], delimiter)
    return Table(columns, delimiter, encoding, first_line, decimal)


def rows_of(stream: TextIO, table: Table) -> Iterator[TableRow]:
    """Each row that holds anything; the stream is at its beginning."""
    for _ in range(table.first_line):
        stream.readline()
    reader = _reader(stream, table.delimiter)
    columns, width, has_rows, is_over = table.columns, len(table.columns), False, False
    while True:
        try:
            row = next(reader, None)
        except csv.Error:
            yield TableRow(table.first_line + reader.line_num, None, "no row of CSV")
            continue
        if row is None:
            return
        line = table.first_line + reader.line_num
        texts = [text.strip() for text in row]
        if not any(texts):
            continue
        if texts[0].startswith(_COMMENTS) or tuple(texts[:width]) == columns:
            yield TableRow(line, None, "comment" if texts[0].startswith(_COMMENTS) else "head again", is_fault=False)
        elif any(texts[width:]):
            yield TableRow(line, None, f"{len(texts)} fields for {width} columns")
        elif sorted(texts) == sorted(columns):
            columns = tuple(texts)
            yield TableRow(line, None, "head again, in another order", is_fault=False)
        elif is_over or (has_rows and _is_head(texts, width)):
            is_over = True
            yield TableRow(line, None, "from another head on it is another table")
        else:
            has_rows = has_rows or any(map(_VALUE.fullmatch, texts))
            yield TableRow(line, dict(zip(columns, texts + [""] * (width - len(texts)), strict=False)))


def _is_head(texts: Sequence[str], width: int) -> bool:
    """True for a row of words alone, a word in each column."""
    return len(texts) == width > 2 and all(re.fullmatch(r"[^\W\d][^\d]*", text) for text in texts)


def example_of(table: Table) -> str | None:
    """The example mapping that fits these columns."""
    return next((name for name, columns in _EXAMPLES.items() if columns <= set(table.columns)), None)


def _heads(lines: Sequence[str], place: int, delimiters: Sequence[str]) -> Iterator[tuple[tuple[str, ...], str, int]]:
    """What the line at a place would be as a head: columns, delimiter, number of the first line behind it."""
    for delimiter in sorted(delimiters, key=lambda each: (each != " ", lines[place].count(each)), reverse=True):
        reader = _reader(lines[place : place + _LOOKED_AT], delimiter)
        try:
            row: list[str] = next(reader, [])
        except csv.Error:
            continue
        names = [name.strip() for name in row]
        while names and not names[-1]:
            names.pop()
        if len(names) < 2:
            continue
        yield tuple(names), delimiter, place + reader.line_num
        if names[0].startswith(_COMMENTS):
            yield (names[0].lstrip("#/% "), *names[1:]), delimiter, place + reader.line_num


def _fits(head: tuple[tuple[str, ...], str, int], lines: Sequence[str], *, is_first: bool) -> bool:
    """True when the rows behind a line have its columns, and it holds names.

    is_first: nothing stands before it. A later head, and one whose names are parted by blanks, has at least two rows of
    values behind it: prose has commas and blanks too.
    """
    columns, delimiter, place = head
    if columns[0].startswith(_COMMENTS) or _are_numbers(columns):
        return False
    try:
        rows = [row for row in islice(_reader(lines[place:], delimiter), _LOOKED_AT) if any(row)]
    except csv.Error:
        return False
    rows = [row for row in rows if not row[0].startswith(_COMMENTS)]
    width = len(columns)
    alike = [row for row in rows if len(row) >= width and not any(map(str.strip, row[width:]))]
    cells = [cell for row in alike for cell in row if cell.strip()]
    has_values = len(alike) > 1 and 2 * sum(any(map(str.isdigit, cell)) for cell in cells) >= len(cells)
    return bool(rows) and 2 * len(alike) >= len(rows) and ((is_first and delimiter != " ") or has_values)


def _reader(lines: Iterable[str], delimiter: str) -> Any:
    """A reader of CSV; several blanks part columns as one does."""
    return csv.reader(lines, delimiter=delimiter, skipinitialspace=delimiter == " ")


def _headless(
    lines: Sequence[str], start: int, columns: tuple[str, ...], delimiters: Sequence[str]
) -> tuple[tuple[str, ...], str, int] | None:
    """A table without a head, whose mapping names the columns."""
    rows = [line for line in lines[start:] if line.strip() and not line.startswith(_COMMENTS)]
    if not rows:
        return None
    return columns, max(delimiters, key=lambda each: (each != " " and each in rows[0], rows[0].count(each))), start


def _decimal_of(lines: Sequence[str], delimiter: str) -> str:
    """The marks of decimals and thousands.

    A comma is for decimals where a cell has it so, and for thousands where a cell with a decimal point, or with two
    groups, has it so. Where columns are not parted by commas both decimals are read.
    """
    try:
        rows = list(islice(csv.reader(lines, delimiter=delimiter), _LOOKED_AT))
    except csv.Error:
        rows = []
    cells = [cell.strip() for row in rows for cell in row]
    has_comma = any(_WITH_COMMA.fullmatch(cell) and not _GROUPED.fullmatch(cell) for cell in cells)
    has_point = any(map(_WITH_POINT.fullmatch, cells))
    if has_comma and (delimiter != "," or not has_point):
        return ",." if any(map(_POINT_GROUPS.fullmatch, cells)) else ","
    if any(map(_COMMA_GROUPS.fullmatch, cells)) or (has_point and any(map(_GROUPED.fullmatch, cells))):
        return ".,"
    return "." if delimiter == "," else ","


def _are_numbers(columns: tuple[str, ...]) -> bool:
    """True when half of the cells or more are numbers, dates or times: no line of names."""
    cells = [text for text in columns if text]
    return 2 * sum(_VALUE.fullmatch(text) is not None for text in cells) >= len(cells)
