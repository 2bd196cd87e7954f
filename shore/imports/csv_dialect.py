"""CSV dialect detection: the columns of a table and the character that parts them."""

import csv
from collections.abc import Iterator
from typing import Final, NamedTuple, TextIO

_DELIMITERS: Final = (",", ";", "\t")
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
    """The head of a CSV file."""

    columns: tuple[str, ...]
    delimiter: str


def table_in(head: bytes) -> Table | None:
    """The table that begins with these bytes; `None` where the first lines have no two columns in common."""
    text = head.decode("utf-8-sig", errors="replace")
    lines = [line for line in text.splitlines()[:20] if line.strip()]
    if len(lines) < 2:
        return None
    delimiter = max(_DELIMITERS, key=lines[0].count)
    try:
        rows = [row for row in csv.reader(lines, delimiter=delimiter) if row]
    except csv.Error:
        return None
    columns = tuple(name.strip() for name in rows[0])
    # The last line of the head may be cut.
    alike = sum(len(row) == len(columns) for row in rows[1:])
    if len(columns) < 2 or 2 * alike < len(rows) - 1 or _are_numbers(columns):
        return None
    return Table(columns, delimiter)


def rows_of(stream: TextIO, table: Table) -> Iterator[dict[str, str] | None]:
    """Each row as column -> text without blanks around, "" where it is missing; `None` for what is no row of CSV."""
    reader = csv.reader(stream, delimiter=table.delimiter)
    next(reader, None)
    while True:
        try:
            row = next(reader, None)
        except csv.Error:
            yield None
            continue
        if row is None:
            return
        if row:
            texts = [text.strip() for text in row[: len(table.columns)]]
            yield dict(zip(table.columns, texts + [""] * (len(table.columns) - len(texts)), strict=True))


def example_of(table: Table) -> str | None:
    """The example mapping that fits these columns."""
    return next((name for name, columns in _EXAMPLES.items() if columns <= set(table.columns)), None)


def _are_numbers(columns: tuple[str, ...]) -> bool:
    return all(text.replace(".", "", 1).replace("-", "", 1).isdigit() for text in columns if text)
