"""Proposal of a column mapping (schema matching): by the columns' names, then by what their values mean together."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final

from common.errors import WayfixError
from common.settings import convert
from common.simulation.column_map import IMPORT, ColumnMap, FixColumns, TableShape
from common.toml_text import toml_lines
from shore.imports.cells import is_nothing, number_and_unit
from shore.imports.columns import ColumnReader
from shore.imports.guess_names import candidates, plain
from shore.imports.guess_time import time_of
from shore.imports.line_counts import Rejected
from shore.imports.meaning import Doubt, MeaningCheck, cured
from shore.imports.place_columns import PlaceColumns
from shore.imports.table_file import TableFile

ROWS: Final = 50_000
"""So many rows are read to compare the columns with each other."""
ROUNDS: Final = 3
"""So often the proposal is read again after a correction."""
HELD_SHARE: Final = 0.3
"""Share of rows that repeat the place of the row before, from which on the columns hold their last value."""
_LEAST_SHARE: Final = 0.8
"""Share of a column's cells that must be of the kind its name says."""
_RAD: Final = 57.29577951308232
_MOST_RAD: Final = 6.2832
_DECIMALS: Final = 4
"""So many decimals a place has, where no name tells it."""
_WHOLE_DEGREES: Final = 1_000_000
"""Whole numbers from here on are 1e-7 deg (MAVLink)."""


@dataclass(slots=True)
class Proposal:
    """A mapping on its way, with a comment for each key that is not sure."""

    tables: dict[str, dict[str, Any]]
    comments: dict[tuple[str, str], str] = field(default_factory=dict)
    above: list[str] = field(default_factory=list)
    """Comments on the whole."""

    def mapping(self) -> ColumnMap:
        """The mapping that the tables are."""
        return convert(self.tables, ColumnMap, "the proposal", use=IMPORT)

    def text(self) -> str:
        """The mapping as TOML."""
        lines, table = [f"# {line}" for line in self.above], ""
        for line in toml_lines(self.tables):
            if line.startswith("\n["):
                table = line.strip("\n[]")
            comment = self.comments.get((table, line.partition(" = ")[0]))
            lines.append(f"{line}  # {comment}" if comment else line)
        return "\n".join(lines) + "\n"


def proposed(path: Path) -> Proposal:
    """A mapping that reads the table; raises WayfixError for a table of which no column can be told."""
    file, shape = _opened(path)
    time = time_of(file, by_name=not shape)
    if time is None:
        raise WayfixError("has no column that looks like a time", str(path), _by_hand(file))
    boat = re.sub(r"[^A-Za-z0-9_-]+", "-", path.stem).strip("-")[:32] or "boat"
    proposal = Proposal({"boat": {"id": boat}, **({"table": shape} if shape else {}), "time": time.keys})
    proposal.comments.update({("time", key): words for key, words in time.unsure.items()})
    used = {time.keys["column"], *time.keys.get("more", ())}
    for add in (_add_fix, _add_heading, _add_imu):
        add(proposal, file, used)
    if not {"fix", "heading", "imu"} & proposal.tables.keys():
        raise WayfixError("has no column that looks like a place, a heading or a yaw rate", str(path), _by_hand(file))
    _compare(proposal, path)
    left = [name for name in file.table.columns if name and name not in used]
    proposal.above = [
        f"Proposed by `wayfix import --guess` for {path.name}. Look at each comment (docs/mapping.md).",
        *proposal.above,
        *([f"Not used: {', '.join(left)}"] if left else []),
    ]
    return proposal


def _opened(path: Path) -> tuple[TableFile, dict[str, Any]]:
    """The table, and what `[table]` must say of it: the names of its columns, where it has no head."""
    try:
        return TableFile(path, TableShape(), ()), {}
    except WayfixError:
        pass
    probe = TableFile(path, TableShape(columns=("c1",)), ())
    rows = probe.raw_rows()
    width = max(map(len, rows), default=0)
    if rows and 1 < len(rows[0]) < width and not any(map(str.isdigit, rows[0])):
        what = f"has {width} fields in a row for {len(rows[0])} names: are its decimal commas not quoted?"
        raise WayfixError(what, str(path), "export it with semicolons between the columns, or with decimal points")
    if width < 2:
        raise WayfixError("is no table", str(path), "give a CSV file with a line of column names")
    columns = tuple(f"c{number}" for number in range(1, width + 1))
    return TableFile(path, TableShape(columns=columns), ()), {"columns": list(columns)}


def _by_hand(file: TableFile) -> str:
    return (
        f"write the mapping by hand (docs/mapping.md); it has: {', '.join(name for name in file.table.columns if name)}"
    )


def _add_fix(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    columns = file.table.columns
    fix: dict[str, Any] = {}
    lat = _first(file, candidates(columns, "lat"), used)
    lon = _first(file, candidates(columns, "lon"), used)
    if "table" in proposal.tables:
        lat, lon = _pair(file, used)
    if lat is not None and lon is not None:
        fix = {"lat": lat, "lon": lon}
        used |= {lat, lon}
        if all(abs(value) >= _WHOLE_DEGREES and value == int(value) for value in _values(file, lat)):
            if file.unit(lat, "angle") is None:
                fix["scale"] = 1e-7
        else:
            fix |= _letters(file, fix, used)
        if fix.get("packed"):
            proposal.comments["fix", "packed"] = "ddmm.mmmm? For minutes alone: scale = 0.01666667 instead"
    else:
        place = _first_place(file, candidates(columns, "place"))
        if place is None:
            return
        fix = {"place": place}
        used.add(place)
    if _is_held(file, [fix[key] for key in ("lat", "lon", "place") if key in fix]):
        fix["held"] = True
        proposal.comments["fix", "held"] = "many rows repeat the place of the row before"
    for role in ("alt", "sog", "cog"):
        column = _first(file, candidates(columns, role), used)
        if column is not None:
            fix[role] = column
            used.add(column)
    proposal.tables["fix"] = fix
    if "sog" in fix and file.unit(fix["sog"], "speed") is None and not _has_unit(file, fix["sog"]):
        proposal.comments["fix", "sog"] = "knots? sog_scale = 1.943844 for m/s, 0.5399568 for km/h"
    if "cog" in fix:
        _set_angle(proposal, file, ("fix", "cog", "cog_scale"))


def _pair(file: TableFile, used: set[str]) -> tuple[str | None, str | None]:
    """The first two columns side by side, without names, that may be latitude and longitude."""
    for lat, lon in pairwise(name for name in file.table.columns if name not in used):
        texts = [(row[lat], row[lon]) for row in file.sample]
        values = _values(file, lat), _values(file, lon)
        if (
            all(len(each.replace(",", ".").partition(".")[2]) >= _DECIMALS for pair in texts[:20] for each in pair)
            and all(map(len, values))
            and max(map(abs, values[0])) <= 90.0
        ):
            return lat, lon
    return None, None


def _letters(file: TableFile, fix: dict[str, Any], used: set[str]) -> dict[str, Any]:
    """Columns of the hemisphere, and whether the places are ddmm.mmmm."""
    places = PlaceColumns(FixColumns(**fix), file.table.decimal, file.sample)
    found = {key: column for key, column in zip(("north_south", "east_west"), places.letters, strict=True) if column}
    used |= set(found.values())
    return {**found, **({"packed": True} if places.is_packed else {})}


def _add_heading(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    for column in candidates(file.table.columns, "heading"):
        values = _values(file, column)
        if column in used or not values or not any(values):  # a heading of 0 all the time is none
            continue
        heading: dict[str, Any] = {"column": column}
        words = plain(column).split()
        if {"mag", "magnetic", "hdm"} & set(words):
            heading["magnetic"] = True
        elif not {"true", "hdt", "yaw"} & set(words):
            proposal.comments["heading", "column"] = "true or magnetic? magnetic = true for a compass"
        used.add(column)
        if _is_held_too(proposal, file, [column]):
            heading["held"] = True
        proposal.tables["heading"] = heading
        _set_angle(proposal, file, ("heading", "column", "scale"))
        return


def _add_imu(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    columns = file.table.columns
    rate = _first(file, candidates(columns, "yaw_rate"), used)
    if rate is None:
        return
    imu: dict[str, Any] = {"yaw_rate": rate}
    used.add(rate)
    if file.unit(rate, "rate") is None:
        proposal.comments["imu", "yaw_rate"] = "in deg/s, + bow to starboard? yaw_rate_scale = 57.29578 for rad/s"
    fwd, stb = (_first(file, candidates(columns, role), used) for role in ("accel_fwd", "accel_stb"))
    if fwd is not None and stb is not None:
        imu = {"accel_fwd": fwd, "accel_stb": stb, **imu}
        used |= {fwd, stb}
        words = "forward, and accel_stb to starboard"
        unit = "" if file.unit(fwd, "acceleration") else ", in m/s^2? accel_scale = 9.80665 for g"
        proposal.comments["imu", "accel_fwd"] = f"{words}{unit}"
    if _is_held_too(proposal, file, list(imu.values())):
        imu["held"] = True
    proposal.tables["imu"] = imu


def _set_angle(proposal: Proposal, file: TableFile, where: tuple[str, str, str]) -> None:
    """The scale of a direction, where its range tells it and its name does not."""
    table, key, scale = where
    column = proposal.tables[table][key]
    values = _values(file, column)
    if not values or file.unit(column, "angle") is not None:
        return
    most = max(map(abs, values))
    if 361.0 < most <= 36_100.0:
        proposal.tables[table][scale] = 0.01
        proposal.comments[table, scale] = "values reach beyond 360: hundredths of a degree"
    elif most <= _MOST_RAD and max(values) - min(values) > 0.5 and any(value != int(value) for value in values):
        proposal.tables[table][scale] = _RAD
        proposal.comments[table, scale] = "all values lie within 2 pi: radians?"


def _compare(proposal: Proposal, path: Path) -> None:
    """Read the table by the proposal; units and signs that its own values contradict are corrected."""
    for _ in range(ROUNDS):
        mapping = proposal.mapping()
        reader, check = ColumnReader(path, mapping), MeaningCheck()
        for record in islice(reader.records(), ROWS):
            for measurement in reader.measure(record, record.t_ns or 0):
                check.add(measurement)
        findings = check.findings()
        for finding in findings:
            _correct(proposal, finding, mapping)
        if all(finding.factor in {1.0, None} for finding in findings):
            break
    proposal.above += [words for account in reader.accounts if (words := account.too_little()) is not None]


def _correct(proposal: Proposal, finding: Doubt, mapping: ColumnMap) -> None:
    table = {"sog_scale": "fix", "scale": "heading", "heading": "heading"}.get(finding.key, "imu")
    if finding.factor is None and finding.key == "lat":
        proposal.above.append(f"Look at lat and lon: {finding.text}")
        return
    if finding.factor is None:
        column = "column" if finding.key == "heading" else finding.key
        proposal.comments[table, column] = finding.text
        if finding.key == "heading" and len({"fix", "imu"} & proposal.tables.keys()) > 0:
            del proposal.tables["heading"]
            proposal.above.append(
                f"Left out: [heading] column = {mapping.heading.column!r}, for {finding.text}"
                if mapping.heading
                else finding.text
            )
        return
    column = {"sog_scale": "sog", "scale": "column", "accel_scale": "accel_fwd", "accel_stb_scale": "accel_stb"}.get(
        finding.key, "yaw_rate"
    )
    if finding.factor == 1.0:
        # The unit is right; which north a heading has, no course can tell.
        if column != "column":
            proposal.comments.pop((table, column), None)
        return
    changed = cured(finding, mapping)
    proposal.tables[table] |= {key: float(f"{value:.10g}") for key, value in changed.items()}
    proposal.comments[table, finding.key] = finding.text
    proposal.comments.pop((table, column), None)


def _is_held(file: TableFile, columns: Sequence[str]) -> bool:
    """True when many rows repeat these cells, and others do not."""
    cells = [cells for row in file.sample if any(cells := tuple(row[name] for name in columns))]
    repeats = sum(a == b for a, b in pairwise(cells))
    return len(set(cells)) > 2 and repeats > HELD_SHARE * len(cells)


def _is_held_too(proposal: Proposal, file: TableFile, columns: Sequence[str]) -> bool:
    """The same for another sensor of a table whose places are held."""
    return proposal.tables.get("fix", {}).get("held", False) and _is_held(file, columns)


def _first(file: TableFile, columns: Sequence[str], used: set[str]) -> str | None:
    """The first column that holds numbers (or angles), and is not used yet."""
    return next((name for name in columns if name not in used and _are_values(file, name)), None)


def _first_place(file: TableFile, columns: Sequence[str]) -> str | None:
    for column in columns:
        places = PlaceColumns(FixColumns(place=column), file.table.decimal, file.sample)
        try:
            if any(places.read(row) is not None for row in file.sample[:20]):
                return column
        except Rejected:
            continue
    return None


def _are_values(file: TableFile, column: str) -> bool:
    texts = [row[column] for row in file.sample if not is_nothing(row[column])]
    good = sum(any(map(str.isdigit, text)) and len(text) < 24 and ":" not in text for text in texts)
    return bool(texts) and good >= _LEAST_SHARE * len(texts)


def _values(file: TableFile, column: str) -> list[float]:
    found = []
    for row in file.sample:
        try:
            found.append(number_and_unit(row[column], file.table.decimal)[0])
        except Rejected:
            continue
    return found


def _has_unit(file: TableFile, column: str) -> bool:
    for row in file.sample:
        try:
            return bool(number_and_unit(row[column], file.table.decimal)[1])
        except Rejected:
            continue
    return False
