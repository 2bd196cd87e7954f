"""Rows and columns of the tables, the same for CSV and Parquet: units in the names, every number as it is stored."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import fields
from itertools import chain
from operator import attrgetter
from typing import Any, Final, Protocol

from common.messages import Fix, Frame, Heading
from shore.exports.track import ExportTrack, Mark, Row
from shore.exports.utc import BoardClock

Values = Sequence[Any]
TIMES: Final = ("t_s", "utc", "t_ns")
"""Time columns: seconds of the log, UTC (ns), and nanoseconds on the boat clock."""
ESTIMATES: Final = (
    "lat_deg", "lon_deg", "heading_true_deg", "sog_kn", "cog_true_deg",
    "sigma_east_m", "sigma_north_m", "sigma_heading_deg", "aligned", "aligned_parts", "waiting",
    "position_from", "position_since_ns", "heading_from",
)  # fmt: skip
"""Columns of an estimate; those of the state follow under their own names.

Place, heading and course are empty where their doubt is too large for a number; the state is there whatever its doubt.
"""
EVENTS: Final = (*TIMES, "level", "source", "code", "text", "evidence", "lat_deg", "lon_deg")
FIXES: Final = (*TIMES, *(field.name for field in fields(Fix) if field.name not in ("t_ns", "utc_ns")), "usable")
HEADINGS: Final = (*TIMES, *(field.name for field in fields(Heading) if field.name != "t_ns"))
_of_fix: Final = attrgetter(*FIXES[len(TIMES) :])
_of_heading: Final = attrgetter(*HEADINGS[len(TIMES) :])
IMU: Final = (*TIMES, "sensor", "accel_fwd_m_s2", "accel_stb_m_s2", "yaw_rate_deg_s")


class Sheet(Protocol):
    """One table on its way to a file."""

    def add(self, rows: Iterable[Values]) -> None:
        """Add some more rows. Raises OSError."""

    def finish(self) -> None:
        """End the table after its last row. Raises OSError."""


Begin = Callable[[str, tuple[str, ...]], Sheet]
"""Called with the name and columns of a table; returns where its rows go."""
NAMES: Final = ("estimates", "events", "fixes", "headings", "imu")


def fill(track: ExportTrack, begin: Begin) -> None:
    """Write the estimates alone."""
    _fill_estimates(track, begin, None).finish()


def fill_all(track: ExportTrack, begin: Begin) -> None:
    """Write all tables of `NAMES`."""
    events = begin("events", EVENTS)
    sheets = [_fill_estimates(track, begin, events), events]
    brought = [begin("fixes", FIXES), begin("headings", HEADINGS), begin("imu", IMU)]
    for clock, frame in track.frames():
        for sheet, rows in zip(brought, _measured(clock, frame), strict=True):
            if rows:
                sheet.add(rows)
    for sheet in (*sheets, *brought):
        sheet.finish()


def _fill_estimates(track: ExportTrack, begin: Begin, events: Sheet | None) -> Sheet:
    rows = _only_rows(track.items(), events)
    first = next(rows, None)
    names = tuple(first.record["names"]) if first is not None and first.record is not None else ()
    sheet = begin("estimates", (*TIMES, *ESTIMATES, *names))
    sheet.add(_estimate(row, names) for row in chain(() if first is None else (first,), rows))
    return sheet


def _only_rows(items: Iterable[Row | Mark], events: Sheet | None) -> Iterator[Row]:
    for item in items:
        if isinstance(item, Row):
            yield item
        elif events is not None:
            events.add([_event(item)])


def _estimate(row: Row, names: tuple[str, ...]) -> Values:
    place = (row.lat_deg, row.lon_deg) if row.has_place else (None, None)
    values = [
        row.t_s, row.utc_ns, row.t_ns, *place, row.heading_true_deg, row.sog_kn, row.cog_true_deg,
        row.sigma_east_m, row.sigma_north_m, row.sigma_heading_deg, row.aligned, ", ".join(row.aligned_parts),
        ", ".join(row.waiting), row.position_from, row.position_since_ns, row.heading_from,
    ]  # fmt: skip
    if row.record is None:
        return values
    if tuple(row.record["names"]) == names:
        return [*values, *row.record["state"]]
    state = dict(zip(row.record["names"], row.record["state"], strict=True))  # the board came back with other sensors
    return [*values, *(state.get(name) for name in names)]


def _event(mark: Mark) -> Values:
    lat_deg, lon_deg = mark.place or (None, None)
    evidence = json.dumps(mark.evidence) if mark.evidence else None
    return [
        mark.t_s, mark.utc_ns, mark.t_ns, mark.level, mark.source, mark.code, mark.text, evidence, lat_deg, lon_deg,
    ]  # fmt: skip


def _measured(clock: BoardClock, frame: Frame) -> tuple[list[Values], list[Values], list[Values]]:
    """Rows of fixes, headings and IMU samples."""

    def times(t_ns: int) -> tuple[float, int | None, int]:
        return clock.seconds(t_ns), clock.utc_ns(t_ns), t_ns

    samples = (
        (block.sensor, sample)
        for block in frame.imu
        for sample in zip(
            block.sample_t_ns, block.accel_fwd_m_s2, block.accel_stb_m_s2, block.yaw_rate_deg_s, strict=True
        )
    )
    return (
        [[*times(fix.t_ns), *_of_fix(fix)] for fix in frame.fixes],
        [[*times(heading.t_ns), *_of_heading(heading)] for heading in frame.headings],
        [[*times(t_ns), sensor, *values] for sensor, (t_ns, *values) in samples],
    )
