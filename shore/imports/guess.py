"""Proposal of a column mapping (schema matching): by the columns' names, then by what their values mean together."""

import re
from collections.abc import Sequence
from itertools import islice, pairwise
from pathlib import Path
from typing import Any, Final

from common.errors import WayfixError
from common.simulation.column_map import ColumnMap, TableShape
from shore.imports.cells import number_and_unit
from shore.imports.columns import ColumnReader
from shore.imports.guess_names import candidates, plain
from shore.imports.guess_places import first, place_of, values_of
from shore.imports.guess_time import time_of
from shore.imports.line_counts import Rejected
from shore.imports.meaning import LON_SIGN, MIRRORED, SWAPPED, Doubt, MeaningCheck, cured
from shore.imports.proposal import Proposal
from shore.imports.reader import opened
from shore.imports.recognise import HEAD_BYTES
from shore.imports.table_file import TableFile

ROWS: Final = 50_000
"""So many rows are read to compare the columns with each other."""
ROUNDS: Final = 3
"""So often the proposal is read again after a correction."""
HELD_SHARE: Final = 0.3
"""Share of rows that repeat the place of the row before, from which on the columns hold their last value."""
_RAD: Final = 57.29577951308232
_MOST_RAD: Final = 6.2832
_VBOX: Final = frozenset(("sats", "time", "lat", "long", "velocity", "heading", "height"))
"""Columns of a file of a VBOX data logger."""
_OF_VBOX: Final[dict[str, Any]] = {
    "lat": "lat", "lon": "long", "scale": 1.0 / 60.0, "lon_scale": -1.0 / 60.0, "alt": "height", "sog": "velocity",
    "sog_scale": 0.539956803, "cog": "heading",
}  # fmt: skip


def proposed(path: Path, now_s: float) -> Proposal:
    """A mapping that reads the table; raises WayfixError for a table of which no column can be told.

    now_s: UTC, s since 1970.
    """
    _refuse_json(path)
    file, shape = _opened(path)
    time = time_of(path, file, now_s, by_name=not shape)
    if time is None:
        raise WayfixError("has no column that looks like a time", str(path), _by_hand(file))
    boat = re.sub(r"[^A-Za-z0-9_-]+", "-", path.stem).strip("-")[:32] or "boat"
    proposal = Proposal({"boat": {"id": boat}, **({"table": shape} if shape else {}), "time": time.keys})
    proposal.comments.update({("time", key): words for key, words in time.unsure.items()})
    if time.question[1]:
        proposal.questions["time"] = time.question
    used = time.columns
    for add in (_add_fix, _add_heading, _add_quaternion, _add_imu):
        add(proposal, file, used)
    if not {"fix", "heading", "imu"} & proposal.tables.keys():
        raise WayfixError("has no column that looks like a place, a heading or a yaw rate", str(path), _by_hand(file))
    if not proposal.questions:  # else it cannot be read yet
        _compare(proposal, path)
    left = [name for name in file.table.columns if name and name not in used]
    proposal.above = [
        f"Proposed by `wayfix import --guess` for {path.name}. Look at each comment (docs/mapping.md).",
        *proposal.above,
        *([f"Not used: {', '.join(left)}"] if left else []),
    ]
    return proposal


def _refuse_json(path: Path) -> None:
    with opened(path) as stream:
        head = stream.read(HEAD_BYTES).lstrip()[:1]
    if head in (b"{", b"["):
        cure = "gpsd's and Signal K's JSON is imported as it is, without a mapping; make a CSV table of other JSON"
        raise WayfixError("is JSON, no table", str(path), cure)


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
    if set(file.table.columns) >= _VBOX:
        proposal.tables["fix"] = dict(_OF_VBOX)
        proposal.comments["fix", "lon_scale"] = "VBOX: minutes, + is west; km/h; its heading is the course"
        used |= {"lat", "long", "velocity", "heading", "height"}
        return
    fix = place_of(proposal, file, used)
    if not fix:
        return
    if _is_held(file, [fix[key] for key in ("lat", "lon", "place") if key in fix]):
        fix["held"] = True
        proposal.comments["fix", "held"] = "many rows repeat the place of the row before"
    for role in ("alt", "sog", "cog"):
        column = first(file, candidates(file.table.columns, role), used)
        if column is not None:
            fix[role] = column
            used.add(column)
    proposal.tables["fix"] = fix
    if "sog" in fix and file.unit(fix["sog"], "speed") is None and not _has_unit(file, fix["sog"]):
        proposal.comments["fix", "sog"] = "knots? sog_scale = 1.943844 for m/s, 0.5399568 for km/h"
    if "cog" in fix:
        _set_angle(proposal, file, ("fix", "cog", "cog_scale"))


def _add_heading(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    for column in candidates(file.table.columns, "heading"):
        values = values_of(file, column)
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


def _add_quaternion(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    """A rotation instead of a heading; whether it counts from north or from east, the places say."""
    columns = [first(file, candidates(file.table.columns, f"quat_{axis}"), used) for axis in "xyzw"]
    if "heading" not in proposal.tables and None not in columns and len(set(columns)) == len(columns):
        proposal.tables["heading"] = {"quaternion": tuple(columns)}
        proposal.comments["heading", "quaternion"] = (
            "from north, to starboard? scale = -1.0 and offset_deg = 90.0 where it counts from east (ROS)"
        )
        used |= {name for name in columns if name is not None}


def _add_imu(proposal: Proposal, file: TableFile, used: set[str]) -> None:
    columns = file.table.columns
    rate = first(file, candidates(columns, "yaw_rate"), used)
    if rate is None:
        return
    imu: dict[str, Any] = {"yaw_rate": rate}
    used.add(rate)
    if file.unit(rate, "rate") is None:
        proposal.comments["imu", "yaw_rate"] = "in deg/s, + bow to starboard? yaw_rate_scale = 57.29578 for rad/s"
    fwd, stb = (first(file, candidates(columns, role), used) for role in ("accel_fwd", "accel_stb"))
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
    values = values_of(file, column)
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
        changes = [_correct(proposal, finding, mapping) for finding in check.findings()]
        if not any(changes):
            break
    proposal.above += [words for account in reader.accounts if (words := account.too_little()) is not None]


def _mirrored(proposal: Proposal, finding: Doubt, fix: dict[str, Any]) -> bool:
    """Turn places round that the receiver's own course contradicts; True = that changed them."""
    if finding.key == SWAPPED and "lat" in fix:
        fix["lat"], fix["lon"] = fix["lon"], fix["lat"]
        proposal.comments["fix", "lat"] = finding.text
    elif finding.key == LON_SIGN and "lat" in fix and "lon_scale" not in fix and not fix.get("packed"):
        fix["lon_scale"] = -float(fix.get("scale", 1.0))
        proposal.comments["fix", "lon_scale"] = finding.text
    else:
        proposal.above.append(f"Look at lat and lon: {finding.text}")
        return False
    return True


def _correct(proposal: Proposal, finding: Doubt, mapping: ColumnMap) -> bool:
    """Put a finding into the proposal; True = the table must be read once more."""
    if finding.key in MIRRORED:
        return _mirrored(proposal, finding, proposal.tables["fix"])
    table = {"sog_scale": "fix", "scale": "heading", "heading": "heading"}.get(finding.key, "imu")
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
            return True
        return False
    column = {"sog_scale": "sog", "scale": "column", "accel_scale": "accel_fwd", "accel_stb_scale": "accel_stb"}.get(
        finding.key, "yaw_rate"
    )
    if finding.factor == 1.0:
        # The unit is right; which north a heading has, no course can tell.
        if column != "column":
            proposal.comments.pop((table, column), None)
        return False
    changed = cured(finding, mapping)
    proposal.tables[table] |= {key: float(f"{value:.10g}") for key, value in changed.items()}
    proposal.comments[table, finding.key] = finding.text
    proposal.comments.pop((table, column), None)
    return True


def _is_held(file: TableFile, columns: Sequence[str]) -> bool:
    """True when many rows repeat these cells, and others do not."""
    cells = [cells for row in file.sample if any(cells := tuple(row[name] for name in columns))]
    repeats = sum(a == b for a, b in pairwise(cells))
    return len(set(cells)) > 2 and repeats > HELD_SHARE * len(cells)


def _is_held_too(proposal: Proposal, file: TableFile, columns: Sequence[str]) -> bool:
    """The same for another sensor of a table whose places are held."""
    return proposal.tables.get("fix", {}).get("held", False) and _is_held(file, columns)


def _has_unit(file: TableFile, column: str) -> bool:
    for row in file.sample:
        try:
            return bool(number_and_unit(row[column], file.table.decimal)[1])
        except Rejected:
            continue
    return False
