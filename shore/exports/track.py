"""Track segmentation: the rows for every format, the estimates of one filter in order of boat time with the events.

    track = ExportTrack(reader, survey, "fuzzy", order="recorded", every_s=None)
    for item in track.items(): ...              # Row or Mark; nothing of it is kept

`recorded` gives what was published live; `time` runs the filter again over the frames in order of boat time.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import asdict
from heapq import heappop, heappush
from math import hypot, radians, sqrt, tan
from typing import Any, Final, NamedTuple

from common.events import is_of_station
from common.messages import Fix, Frame
from common.units import M_S_PER_KN, NS_PER_S
from shore.exports.first_pass import SHOWN_EACH, Survey
from shore.exports.utc import BoardClock
from shore.logbook.log_reader import LogReader
from shore.logbook.schemas import ESTIMATES, FRAMES
from shore.navigation.estimate import MOST_DOUBT_DEG, MOST_DOUBT_M

ORDERS: Final = ("recorded", "time")
RAW: Final = "raw"
"""Name that stands in place of a filter for the usable fixes of one receiver."""
GAP_NS: Final = 10 * NS_PER_S
"""A new piece of track begins after this time without a row, ns."""
NEAR_NS: Final = 10 * NS_PER_S
"""An event gets the place of a row that is no further away in time than this, ns."""
RESETS: Final = frozenset({"filter-reset", "origin-moved", "board-rebooted"})
"""Codes of the events after which a new piece of track begins."""
VELOCITY: Final = ("v_east_m_s", "v_north_m_s")
"""Names of the velocity in the state."""

Place = tuple[float, float]
Entry = tuple[int, int, int, BoardClock, dict[str, Any]]
"""Sort key and event: number of the clock, boat time (ns), number of the event, the clock, the event."""


class Row(NamedTuple):
    """One place of the boat. Missing is `None`."""

    clock: BoardClock
    t_ns: int
    t_s: float
    """Time of the row, seconds of the log."""
    utc_ns: int | None
    lat_deg: float
    lon_deg: float
    heading_true_deg: float | None
    sog_kn: float | None
    cog_true_deg: float | None
    sigma_east_m: float | None
    sigma_north_m: float | None
    sigma_heading_deg: float | None
    aligned: bool
    """True when the whole estimate is valid; for a raw fix, when the receiver calls it valid."""
    aligned_parts: tuple[str, ...]
    """The parts that are valid: `position`, `heading`."""
    waiting: tuple[str, ...]
    position_from: str | None
    """`fix` or `coasting`; `None` = the log does not say."""
    position_since_ns: int | None
    heading_from: str | None
    fix_quality: int | None
    """Quality of a raw fix in the numbers of GGA."""
    is_first: bool
    """True where a new piece of track begins: at the start, after a gap, or after a reset of the filter or the
    board."""
    record: dict[str, Any] | None
    """The whole estimate; `None` for a raw fix."""
    data: bytes | None
    """The estimate as the bytes in the log; `None` where the log has none."""

    @property
    def stretch(self) -> str:
        """What its piece of track is: `fix`, `coasting`, or `not aligned` where the position is not valid."""
        return (self.position_from or "fix") if "position" in self.aligned_parts else "not aligned"

    @property
    def sigma_m(self) -> float | None:
        """1-sigma of the position, east and north together, m."""
        east_m, north_m = self.sigma_east_m, self.sigma_north_m
        return None if east_m is None or north_m is None else hypot(east_m, north_m)

    @property
    def has_place(self) -> bool:
        """False when the doubt of the position is so large that it is shown as no place."""
        return self.sigma_m is None or self.sigma_m <= MOST_DOUBT_M

    @property
    def covariance_m2(self) -> tuple[float, float, float] | None:
        """Position covariance, m^2: east, east-north, north; `None` for a raw fix, or where not finite or not known."""
        if self.record is None or len(self.record["state"]) < 2:
            return None
        east, cross, north = (self.record["covariance"][index] for index in (0, 1, len(self.record["state"])))
        return None if None in (east, cross, north) or min(east, north) < 0.0 else (east, cross, north)


class Mark(NamedTuple):
    """An event, and where the boat was."""

    t_ns: int
    t_s: float
    utc_ns: int | None
    source: str
    code: str
    level: str
    text: str
    evidence: dict[str, Any]
    place: Place | None
    """Latitude and longitude of the boat, deg; `None` where no row is near in time."""


class _Found(NamedTuple):
    """A row that is still being made."""

    clock: BoardClock
    record: dict[str, Any]
    data: bytes | None = None


class ExportTrack:
    """One filter (or `raw`) of one log; every call of `items` reads the log once."""

    def __init__(self, reader: LogReader, survey: Survey, name: str, order: str, every_s: float | None) -> None:
        self.reader = reader
        self.survey = survey
        self.filter = name
        self.order = order
        self.rows = 0
        """Number of rows that the newest pass has given."""
        self.left_out = 0
        """Number of rows that the newest pass has not given, for their doubt is too large for a place on a map."""
        self.marks = 0
        self.shown: Callable[[float], None] = lambda _t_s: None
        """Called with seconds of the log now and then, for a progress display."""
        self._every_ns = None if every_s is None else max(round(every_s * NS_PER_S), 1)

    @property
    def title(self) -> str:
        """Name of the track for a person."""
        return str(self.survey.trip.get("name") or os.fsencode(self.reader.path.stem).decode(errors="replace"))

    @property
    def gps(self) -> str | None:
        """The receiver of `raw`: the first of the configuration, else (`None`) the first that gives a usable fix."""
        return next((str(table["id"]) for table in self.survey.sensors("gps")), None)

    def items(self) -> Iterator[Row | Mark]:
        """Rows and events in order of boat time; where the board's clock begins again, clock after clock."""
        self.rows = self.marks = self.left_out = 0
        waiting = _Waiting(self._known_events(), self.filter)
        last: Row | None = None
        slot: tuple[int, int] | None = None
        for count, found in enumerate(self._found(waiting)):
            row = _row(found, last)
            if count % SHOWN_EACH == 0:
                self.shown(row.t_s)
            marks, resets = waiting.until(last, row)
            for mark in marks:
                self.marks += 1
                yield mark
            is_first = resets or _is_apart(last, row)
            last = row
            here = (row.clock.number, row.t_ns // self._every_ns) if self._every_ns else None
            if here is None or is_first or here != slot:
                slot = here
                self.rows += 1
                yield row._replace(is_first=True) if is_first else row
        for mark in waiting.until(last, None)[0]:
            self.marks += 1
            yield mark

    def drawn(self) -> Iterator[Row | Mark]:
        """The items for a map: without rows that have no place; a piece of track rests on one thing."""
        last: Row | None = None
        for item in self.items():
            if isinstance(item, Mark):
                yield item
            elif not item.has_place:
                last = None
                self.rows -= 1
                self.left_out += 1
            else:
                is_first = item.is_first or last is None or item.stretch != last.stretch
                yield item._replace(is_first=True) if is_first else item
                last = item

    def frames(self, kind: bytes = b"") -> Iterator[tuple[BoardClock, Frame]]:
        """Frames that can be decoded, in the order of the export, with their clock; at least all with this `kind`."""
        clocks = self.survey.clocks
        if self.order == "time":
            from shore.replay.frames import Frames

            yield from ((clocks.of_frame(item.frame), item.frame) for item in Frames(self.reader, "time"))
            return
        for count, record in enumerate(self.reader.records(FRAMES)):
            if kind not in record.data:  # the name of a list that is not empty: most frames have no fix
                continue
            frame = self.reader.frame(record)
            if frame is None:
                continue
            clock = clocks.of_frame(frame)
            if count % SHOWN_EACH == 0:
                self.shown(clock.seconds(frame.t1_ns))
            yield clock, frame

    def fixes(self) -> Iterator[tuple[BoardClock, Fix]]:
        """Fixes with a position, of all receivers."""
        for clock, frame in self.frames(b"fixes"):
            yield from ((clock, fix) for fix in frame.fixes if fix.lat_deg is not None and fix.lon_deg is not None)

    def _known_events(self) -> Iterator[tuple[BoardClock, dict[str, Any]]]:
        """Events of the log; when the filter runs again, only those that it cannot make itself."""
        for clock, event in self.survey.events:
            if self.order == "recorded" or self.filter == RAW or is_of_station(event["code"]):
                yield clock, event

    def _found(self, waiting: "_Waiting") -> Iterator[_Found]:
        if self.filter == RAW:
            return self._raw()
        return self._again(waiting) if self.order == "time" else self._recorded()

    def _recorded(self) -> Iterator[_Found]:
        clocks = self.survey.clocks
        for record in self.reader.records(f"{ESTIMATES}{self.filter}"):
            estimate = self.reader.content(record)
            if estimate is not None:
                yield _Found(clocks.of_boot(estimate["boot_id"], estimate["t_ns"]), estimate, record.data)

    def _again(self, waiting: "_Waiting") -> Iterator[_Found]:
        from shore.replay.run import Replay

        for step in Replay(self.reader.path, [self.filter], order="time"):
            clock = self.survey.clocks.of_frame(step.frame)
            for event in step.events:
                waiting.add(clock, asdict(event))
            yield from (_Found(clock, record) for record in step.records)

    def _raw(self) -> Iterator[_Found]:
        """Fixes in rising time: one that comes after a newer one, because of the receiver's latency, is left out."""
        sensor = self.gps
        newest: tuple[int, int] | None = None
        for clock, fix in self.fixes():
            sensor = sensor or fix.sensor
            here = clock.number, fix.t_ns
            if fix.sensor == sensor and fix.usable and (newest is None or here > newest):
                newest = here
                yield _Found(
                    clock,
                    {name: getattr(fix, name) for name in ("t_ns", "lat_deg", "lon_deg", "sog_kn", "fix_quality")}
                    | {"cog_true_deg": fix.cog_true_deg, "aligned_parts": ["position"], "position_from": "fix"},
                )


def _row(found: _Found, last: Row | None) -> Row:
    clock, record, data = found
    t_ns, sigma_deg = record["t_ns"], record.get("sigma_heading_deg")
    is_doubtful = sigma_deg is not None and sigma_deg > MOST_DOUBT_DEG  # old logs give a heading all the same
    return Row(
        clock, t_ns, clock.seconds(t_ns), clock.utc_ns(t_ns), record["lat_deg"], record["lon_deg"],
        None if is_doubtful else record.get("heading_true_deg"), record["sog_kn"], _course(record),
        record.get("sigma_east_m"), record.get("sigma_north_m"), sigma_deg,
        record.get("aligned", True), tuple(record["aligned_parts"]), tuple(record.get("waiting", ())),
        record["position_from"], record.get("position_since_ns"), record.get("heading_from"),
        record.get("fix_quality"), last is None, record if "filter" in record else None, data,
    )  # fmt: skip


def _course(record: dict[str, Any]) -> float | None:
    """Course over ground; `None` too where the doubt of the velocity turns it by more than a number may have."""
    names, covariance = record.get("names") or (), record.get("covariance") or ()
    if record["cog_true_deg"] is None or record["sog_kn"] is None or "v_east_m_s" not in names:
        return record["cog_true_deg"]  # type: ignore[no-any-return]
    size = len(names)
    variances = [covariance[place * size - place * (place - 1) // 2] for place in map(names.index, VELOCITY)]
    if None in variances:
        return None
    sigma_m_s = sqrt(max(*variances, 0.0))
    is_known = sigma_m_s <= record["sog_kn"] * M_S_PER_KN * tan(radians(MOST_DOUBT_DEG))
    return record["cog_true_deg"] if is_known else None


def _is_apart(last: Row | None, row: Row) -> bool:
    return last is None or row.clock is not last.clock or not 0 <= row.t_ns - last.t_ns <= GAP_NS


class _Waiting:
    """Events that wait for the rows before and after them."""

    def __init__(self, events: Iterator[tuple[BoardClock, dict[str, Any]]], name: str) -> None:
        self._filter = name
        self._heap: list[Entry] = []
        self._count = 0
        for clock, event in events:
            self.add(clock, event)

    def add(self, clock: BoardClock, event: dict[str, Any]) -> None:
        """Add one event."""
        self._count += 1
        heappush(self._heap, (clock.number, event["t_ns"], self._count, clock, event))

    def until(self, last: Row | None, row: Row | None) -> tuple[list[Mark], bool]:
        """Events up to `row` (`None` = all), each at the nearer of the two rows, and whether one begins a new piece."""
        marks, resets = [], False
        while self._heap and (row is None or self._heap[0][:2] <= (row.clock.number, row.t_ns)):
            *_, clock, event = heappop(self._heap)
            marks.append(_mark(clock, event, last, row))
            resets |= event["code"] in RESETS and event["evidence"].get("filter", self._filter) == self._filter
        return marks, resets


def _mark(clock: BoardClock, event: dict[str, Any], last: Row | None, row: Row | None) -> Mark:
    t_ns = event["t_ns"]
    rows = [each for each in (last, row) if each and each.has_place and each.clock is clock]
    near = [each for each in rows if abs(each.t_ns - t_ns) <= NEAR_NS]
    nearest = min(near, key=lambda each: abs(each.t_ns - t_ns), default=None)
    return Mark(
        t_ns, clock.seconds(t_ns), clock.utc_ns(t_ns), event["source"], event["code"], event["level"], event["text"],
        event["evidence"], None if nearest is None else (nearest.lat_deg, nearest.lon_deg),
    )  # fmt: skip
