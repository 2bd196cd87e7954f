"""Reference track (ground truth): read from CSV or GPX, interpolated on the boat clock, never extrapolated."""

import csv
import io
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.errors import WayfixError
from common.geodesy import LocalPlane
from common.units import NS_PER_S
from common.words import counted
from shore.report.gpx_points import GpxPoints
from shore.report.iso_time import iso_utc_ns

Array = NDArray[np.float64]
UtcOffset = Callable[[], int | None]
"""UTC less boat time of the log, ns; `None` = it does not say. Asked when the reference counts in UTC."""

RANGES: Final = {"lat_deg": (-90.0, 90.0), "lon_deg": (-180.0, 180.0), "heading_true_deg": (-360.0, 360.0)}
NAMES: Final = {
    "t_ns": ("t_ns",),
    "utc": ("utc", "time_utc", "utc_time", "time", "timestamp"),
    "t_s": ("t_s",),
    "lat_deg": ("lat_deg", "lat", "latitude"),
    "lon_deg": ("lon_deg", "lon", "longitude"),
    "heading_true_deg": ("heading_true_deg", "heading_deg", "heading"),
}
"""Names that each column may have, the first before the others."""
CURE: Final = "give GPX, or CSV with a time (t_s, t_ns or utc), lat_deg, lon_deg and, if known, heading_true_deg"
LEAST_ROWS: Final = 2
LONGEST_GAP_S: Final = 2.0
"""Longest hole of the reference over which it is interpolated, s: nothing is known in a longer one."""
STEPS_IN_GAP: Final = 3
LONGEST_STEPS_S: Final = 30.0
"""A reference of few rows is interpolated over three of its ordinary steps, up to this."""
_EPOCH_UNITS: Final = ((1e17, 1), (1e14, 1_000), (1e11, 1_000_000), (1e8, NS_PER_S))
"""Smallest number of UTC in each unit (ns, us, ms, s since 1970), and its ns."""


class Place(NamedTuple):
    """The reference at a moment."""

    east_m: float
    north_m: float
    heading_deg: float | None
    """Heading, unwrapped; `None` = the reference has none there."""


class Reference:
    """A reference track on the boat clock."""

    def __init__(self, t_ns: Array, lat_deg: Array, lon_deg: Array, heading_true_deg: Array) -> None:
        """Arrays (n,) with times increasing: whole ns of the boat clock as floats, without an offset.

        A heading that is NaN is not known.
        """
        self.plane = LocalPlane(float(lat_deg[0]), float(lon_deg[0]))
        positions = [self.plane.to_east_north_m(float(a), float(b)) for a, b in zip(lat_deg, lon_deg, strict=True)]
        self.start_ns = float(t_ns[0])
        self._t_s: Array = (t_ns - t_ns[0]) / NS_PER_S
        self.east_m = np.array([position[0] for position in positions])
        self.north_m = np.array([position[1] for position in positions])
        has_heading = np.isfinite(heading_true_deg)
        self._heading_t_s = self._t_s[has_heading]
        self._heading_deg = np.degrees(np.unwrap(np.radians(heading_true_deg[has_heading])))
        self.heading_true_deg = heading_true_deg

    @property
    def t_s(self) -> Array:
        """Time since the reference's first row, s, (n,)."""
        return self._t_s

    def at(self, t_ns: int) -> Place | None:
        """The reference at boat time `t_ns`; `None` outside of it, and in its holes."""
        t_s = (t_ns - self.start_ns) / NS_PER_S
        if not _is_within(t_s, self._t_s):
            return None
        east, north = (float(np.interp(t_s, self._t_s, column)) for column in (self.east_m, self.north_m))
        has_heading = _is_within(t_s, self._heading_t_s)
        heading = float(np.interp(t_s, self._heading_t_s, self._heading_deg)) if has_heading else None
        return Place(east, north, heading)


def read_reference(path: Path, first_t_ns: int, utc_offset: UtcOffset = lambda: None) -> Reference:
    """Read a reference file, CSV or GPX; a column t_s counts from `first_t_ns`. Raises WayfixError."""
    t_ns, *columns = _of_gpx(path, utc_offset) if _is_gpx(path) else _of_csv(path, first_t_ns, utc_offset)
    return Reference(t_ns, *columns)


def _is_within(t_s: float, times_s: Array) -> bool:
    """True between two times that are no hole apart."""
    if not len(times_s) or not times_s[0] <= t_s <= times_s[-1]:
        return False
    after = int(np.searchsorted(times_s, t_s))
    return not after or times_s[after] - times_s[after - 1] <= _longest_gap_s(times_s)


def _longest_gap_s(times_s: Array) -> float:
    steps = STEPS_IN_GAP * float(np.median(np.diff(times_s)))
    return max(LONGEST_GAP_S, min(steps, LONGEST_STEPS_S))


def _is_gpx(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            head = stream.read(2048)
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give a readable reference file") from error
    return head.lstrip(b"\xef\xbb\xbf \r\n\t")[:1] == b"<"


def _of_gpx(path: Path, utc_offset: UtcOffset) -> tuple[Array, ...]:
    rows: dict[int, tuple[float, float]] = {}
    for point in GpxPoints(path):
        if point.time is None:
            continue
        try:
            rows[iso_utc_ns(point.time)] = float(point.lat or "nan"), float(point.lon or "nan")
        except ValueError as reason:
            raise WayfixError(f"line {point.line}: {point} cannot be ({reason})", str(path), _CORRECT) from reason
    if len(rows) < LEAST_ROWS:
        raise WayfixError(f"has {counted(len(rows), 'point')} with a time, two are the least", str(path), CURE)
    times = sorted(rows)
    places = np.array([rows[utc_ns] for utc_ns in times])
    wrong = ~((np.abs(places[:, 0]) <= 90.0) & (np.abs(places[:, 1]) <= 180.0))
    if np.any(wrong):
        raise WayfixError(f"has a point at {tuple(places[wrong][0].tolist())}", str(path), _CORRECT)
    offset_ns = _offset_ns(path, utc_offset)
    t_ns = np.array([float(utc_ns - offset_ns) for utc_ns in times])
    return t_ns, places[:, 0], places[:, 1], np.full(len(times), np.nan)


_CORRECT: Final = "correct the row or leave it out"


def _of_csv(path: Path, first_t_ns: int, utc_offset: UtcOffset) -> tuple[Array, ...]:
    rows = _rows(path)
    named = {name: next((own for own in owns if own in rows[0][1]), None) for name, owns in NAMES.items()}
    time = next((name for name in ("t_ns", "utc", "t_s") if named[name] is not None), None)
    missing = [name for name in ("lat_deg", "lon_deg") if named[name] is None]
    if time is None or missing:
        names = ", ".join([*([] if time else ["t_s"]), *missing])
        raise WayfixError(f"has no column {names}", str(path), CURE)

    def column(name: str, *, may_be_empty: bool = False) -> Array:
        own = named[name]
        if own is None:
            return np.full(len(rows), np.nan)
        return np.array([_number(row, own, name, (path, line), may_be_empty=may_be_empty) for line, row in rows])

    if time == "utc":
        utc_ns = [_utc_ns(row, named["utc"] or "", path, line) for line, row in rows]
        offset_ns = _offset_ns(path, utc_offset)
        t_ns = np.array([float(each - offset_ns) for each in utc_ns])
    else:
        t_ns = column("t_ns") if time == "t_ns" else first_t_ns + column("t_s") * NS_PER_S
    falls = np.flatnonzero(np.diff(t_ns) <= 0.0)
    if len(falls):
        line = rows[int(falls[0]) + 1][0]
        raise WayfixError(f"line {line}: time does not grow", str(path), "sort the rows by time")
    return t_ns, column("lat_deg"), column("lon_deg"), column("heading_true_deg", may_be_empty=True)


def _offset_ns(path: Path, utc_offset: UtcOffset) -> int:
    offset_ns = utc_offset()
    if offset_ns is None:
        raise WayfixError(
            "counts in UTC, and the log does not know UTC", str(path), "give t_s from the log's first frame"
        )
    return offset_ns


def _rows(path: Path) -> list[tuple[int, dict[str, str | None]]]:
    """(line number, row) of a CSV file, at least two."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
        delimiter = max(",;\t", key=text.partition("\n")[0].count)
        reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True)
        reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
        rows: list[tuple[int, dict[str, str | None]]] = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise WayfixError(f"cannot be read ({error.strerror})", str(path), "give a readable reference file") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise WayfixError(f"is no CSV text ({error})", str(path), CURE) from error
    if len(rows) < LEAST_ROWS:
        raise WayfixError(f"has {counted(len(rows), 'row')}, two are the least", str(path), CURE)
    return rows


def _number(row: dict[str, str | None], own: str, name: str, where: tuple[Path, int], *, may_be_empty: bool) -> float:
    """One field, finite and within its range; NaN for one that may be empty, and is."""
    text = row[own]
    if may_be_empty and not (text or "").strip():
        return float("nan")
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    low, high = RANGES.get(name, (-np.inf, np.inf))
    if not np.isfinite(value) or not low <= value <= high:
        raise WayfixError(f"line {where[1]}: {own} cannot be {text!r}", str(where[0]), _CORRECT)
    return value


def _utc_ns(row: dict[str, str | None], own: str, path: Path, line: int) -> int:
    """UTC of a row: ISO 8601, or a number of s, ms, us or ns since 1970."""
    text = (row[own] or "").strip()
    try:
        return iso_utc_ns(text)
    except ValueError:
        pass
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    for least, unit_ns in _EPOCH_UNITS:
        if value >= least:
            return int(text) * unit_ns if text.isdecimal() else round(value * unit_ns)
    raise WayfixError(f"line {line}: {own} cannot be {text!r}", str(path), "write UTC as 2026-05-12T10:08:00Z")
