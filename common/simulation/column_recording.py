"""A column recording (CSV) and a mapping file (TOML) become the same voyage that a scenario gives.

The mapping names the columns, their scales, how often each stream is sub-sampled and which noise is added (a declared
make-believe: many recordings hold a navigation solution instead of a receiver's raw fix). A row with an empty field is
left out of the streams that need the field, and counted; it never becomes a zero.
"""

import csv
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np

from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.settings import read_toml
from common.simulation.column_map import (
    VOYAGE,
    ColumnMap,
    FixColumns,
    HeadingColumns,
    ImuColumns,
    ReferenceColumns,
    TimeColumn,
)
from common.simulation.motion import Truth
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Rates, Reading, Timed
from common.simulation.sensor_models import generators
from common.simulation.three_port_boat import three_port_boat
from common.simulation.voyage import Voyage

Row = dict[str, float | None]
Parts = tuple[FixColumns, HeadingColumns, ImuColumns]


def recording_voyage(file: str | Path, map_file: str | Path, seed: int = 1, seconds: float | None = None) -> Voyage:
    """Read a recording; raises WayfixError for missing files or columns and for text where a number belongs."""
    (voyage,) = recording_voyages(file, map_file, (seed,), seconds)
    return voyage


def recording_voyages(
    file: str | Path, map_file: str | Path, seeds: Iterable[int], seconds: float | None = None
) -> list[Voyage]:
    """The same for several seeds: the file is read once, and each seed has its own noise."""
    mapping = read_toml(map_file, ColumnMap, VOYAGE)
    fix, heading, imu, reference = mapping.fix, mapping.heading, mapping.imu, mapping.reference
    assert fix is not None
    assert heading is not None
    assert imu is not None
    assert reference is not None
    skipped: Counter[str] = Counter()
    columns = tuple(dict.fromkeys((*mapping.columns, *reference.columns)))
    rows = _with_time(_rows(Path(file), columns), mapping.time, seconds, skipped)
    truth, plane = _truth(rows, reference, skipped, str(file))
    config = three_port_boat(
        # the compass line carries true - variation, and 0 where the mapping states none
        replace(mapping.boat, variation_deg=mapping.boat.variation_deg or 0.0),
        mapping.facts,
        Rates(gps_hz=fix.rate_hz, compass_hz=heading.rate_hz, imu_hz=imu.rate_hz),
    )
    voyages = []
    for seed in seeds:
        left_out = skipped.copy()
        readings = sorted(_streams(rows, (fix, heading, imu), plane, seed, left_out), key=lambda timed: timed.t_s)
        voyages.append(
            Voyage(
                name=Path(file).stem,
                config=config,
                plane=plane,
                truth=truth,
                readings=tuple(readings),
                skipped=dict(left_out),
            )
        )
    return voyages


def _rows(file: Path, columns: tuple[str, ...]) -> list[Row]:
    """The mapped columns of every row; an empty field (or `nan`) is `None`."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream)
            missing = [name for name in columns if name not in (reader.fieldnames or ())]
            if missing:
                known = ", ".join(reader.fieldnames or ())
                cure = f"correct the mapping; the file has: {known}"
                raise WayfixError(f"has no column {', '.join(missing)}", str(file), cure)
            return [_row(row, columns, f"{file}: line {reader.line_num}") for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise WayfixError(f"cannot be read ({error})", str(file), "give a readable CSV file") from error


def _row(row: dict[str, str], columns: tuple[str, ...], where: str) -> Row:
    return {name: _number(row[name], name, where) for name in columns}


def _factor(scale: float | None) -> float:
    """A voyage takes the columns as they are, where the mapping gives no scale."""
    return 1.0 if scale is None else scale


def _number(text: str | None, column: str, where: str) -> float | None:
    if text is None or not text.strip():
        return None
    try:
        value = float(text)
    except ValueError as error:
        raise WayfixError(f"{column}: {text!r} is not a number", where, "correct the file or the mapping") from error
    return value if math.isfinite(value) else None


def _with_time(
    rows: list[Row], time: TimeColumn, seconds: float | None, skipped: Counter[str]
) -> list[tuple[float, Row]]:
    """(seconds since the first row, row); rows without a time or not later than the one before are left out."""
    timed: list[tuple[float, Row]] = []
    first: float | None = None
    scale = _factor(time.scale)
    for row in rows:
        stamp = row[time.column]
        first = stamp if first is None else first
        t_s = None if stamp is None or first is None else round((stamp - first) * scale, 6)
        if t_s is None or (timed and t_s <= timed[-1][0]):
            skipped["time"] += 1
        elif seconds is None or t_s <= seconds:
            timed.append((t_s, row))
    return timed


def _complete(
    rows: list[tuple[float, Row]], names: tuple[str, ...], what: str, skipped: Counter[str]
) -> Iterator[tuple[float, list[float]]]:
    """The rows that have all of `names`; the others are counted under `what`."""
    for t_s, row in rows:
        values = [value for name in names if (value := row[name]) is not None]
        if len(values) == len(names):
            yield t_s, values
        else:
            skipped[what] += 1


def _truth(
    rows: list[tuple[float, Row]], ref: ReferenceColumns, skipped: Counter[str], file: str
) -> tuple[Truth, LocalPlane]:
    complete = list(_complete(rows, ref.columns, "reference", skipped))
    if len(complete) < 2:
        raise WayfixError("has fewer than two rows with a whole reference", file, "look at [reference] of the mapping")
    plane = LocalPlane(complete[0][1][0], complete[0][1][1])
    places = np.array([plane.to_east_north_m(values[0], values[1]) for _, values in complete])
    columns = np.array([values for _, values in complete])
    heading = np.unwrap(np.radians(columns[:, 2] * ref.heading_scale))
    sin, cos, v_fwd, v_stb = np.sin(heading), np.cos(heading), columns[:, 3], columns[:, 4]
    t_s = np.array([t_s for t_s, _ in complete])
    return (
        Truth(t_s, places[:, 0], places[:, 1], sin * v_fwd + cos * v_stb, cos * v_fwd - sin * v_stb, heading),
        plane,
    )


def _streams(
    rows: list[tuple[float, Row]], parts: Parts, plane: LocalPlane, seed: int, skipped: Counter[str]
) -> Iterator[Timed]:
    draw = generators(seed)
    step_s = median(b[0] - a[0] for a, b in pairwise(rows))
    fix, heading, imu = parts

    def as_fix(values: list[float]) -> Reading:
        east, north = plane.to_east_north_m(*values)
        noise = draw["gps1"].standard_normal(2) * fix.noise_m
        return FixReading(*plane.to_lat_lon_deg(east + float(noise[0]), north + float(noise[1])))

    def as_heading(values: list[float]) -> Reading:
        noise = float(draw["compass1"].standard_normal()) * heading.noise_deg
        return HeadingReading((values[0] * _factor(heading.scale) + noise) % 360.0)

    def as_imu(values: list[float]) -> Reading:
        accel, rate = _factor(imu.accel_scale), _factor(imu.yaw_rate_scale)
        return ImuReading(values[0] * accel, values[1] * accel, values[2] * rate)

    for sensor, what, names, rate_hz, convert in (
        ("gps1", "fix", fix.columns, fix.rate_hz, as_fix),
        ("compass1", "heading", heading.columns, heading.rate_hz, as_heading),
        ("imu1", "imu", imu.columns, imu.rate_hz, as_imu),
    ):
        complete = _complete(rows, names, what, skipped)
        for t_s, values in _sub_sampled(complete, rate_hz, step_s):
            yield Timed(t_s, sensor, convert(values))


def _sub_sampled(
    rows: Iterator[tuple[float, list[float]]], rate_hz: float, step_s: float
) -> Iterator[tuple[float, list[float]]]:
    """The first row of each period; half a row early still counts, so that uneven stamps lose nothing."""
    last = -1
    for t_s, values in rows:
        period = math.floor((t_s + 0.5 * step_s) * rate_hz + 1e-9)
        if period > last:
            last = period
            yield t_s, values
