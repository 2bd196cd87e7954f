"""Log statistics: one pass over a log gathers everything that `wayfix log` shows of it."""

from ast import literal_eval
from collections import Counter, deque
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from mcap.records import Metadata

from common.messages import Fix
from shore.logbook.foxglove import event_of
from shore.logbook.holes import Holes
from shore.logbook.log_reader import LogReader
from shore.logbook.mcap.scan import Scan
from shore.logbook.mcap.walk import Item
from shore.logbook.missing_frames import Census, light_frame
from shore.logbook.record_checks import content_of
from shore.logbook.schemas import ESTIMATES, EVENTS, FRAMES, SESSION, TRIP
from shore.logbook.summary import KEPT, TripSummary
from shore.logbook.why_none import WhyNone

LAST_WARNINGS: Final = 10
_NOT_UNDERSTOOD: Final = (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError)
"""Exceptions that a record of another writer on a topic of ours may cause."""


@dataclass
class Examination:
    """What a log holds and what it lost."""

    reader: LogReader
    counts: Counter[str] = field(default_factory=Counter)
    """Number of records of each topic."""
    sizes: Counter[str] = field(default_factory=Counter)
    """Bytes of the records of each topic, unpacked."""
    not_understood: Counter[str] = field(default_factory=Counter)
    """Number of sound records of each topic that do not have the form their topic promises."""
    starts: list[dict[str, Any]] = field(default_factory=list)
    sessions: list[dict[str, Any]] = field(default_factory=list)
    """All other session records: trip, end, summary, operator, recovered."""
    warnings: deque[tuple[int, dict[str, Any]]] = field(default_factory=lambda: deque(maxlen=LAST_WARNINGS))
    """The last events of level warning or error, each with its log time (ns)."""
    census: Census = field(default_factory=Census)
    trip: TripSummary = field(default_factory=TripSummary)
    why_none: WhyNone = field(default_factory=WhyNone)
    fixes_area: tuple[float, float, float, float] | None = None
    """Southern, northern, western and eastern limit of the usable fixes, deg."""
    first_ns: int | None = None
    last_ns: int | None = None
    """Log time of the last record, ns; `first_ns` is that of the first."""
    chunks: int = 0
    checked: int = 0
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)

    @property
    def state(self) -> str:
        """State of the log in a word or two."""
        reader = self.reader
        if reader.is_being_written:
            return "being written"
        if reader.is_cut:
            return "cut"
        return "damaged" if reader.losses or reader.flaws or self.words_differ else "whole"

    @property
    def holes(self) -> Holes:
        """Frames that are not here."""
        summary = self.last("summary")
        written = summary.get("frames") if summary else None
        lost: int | None = 0
        if self.reader.losses:
            lost = max(0, written - self.census.count) if isinstance(written, int) else None
        return self.census.holes(lost, is_being_written=self.reader.is_being_written)

    @property
    def words_differ(self) -> bool:
        """True when the trip's metadata, which has no checksum, differs from the records."""
        metadata = self.metadata.get(TRIP)
        if metadata is None or self.reader.losses:
            return False
        summaries = [as_metadata(each) for each in self._told()]
        return bool(summaries) and metadata not in summaries

    def _told(self) -> list[dict[str, Any]]:
        """Summaries that the log itself holds, in their order."""
        told = [each if each.get("kind") == "summary" else each.get("summary") for each in self.sessions]
        return [each for each in told if isinstance(each, dict)]

    def last(self, kind: str) -> dict[str, Any] | None:
        """The newest session record of this kind."""
        return next((record for record in reversed(self.sessions) if record.get("kind") == kind), None)

    def summary(self) -> dict[str, Any]:
        """The trip: as the log was written, or else as its sound records tell it; with the last name it was given."""
        computed = self.trip.as_record()
        if computed["utc_ns"] is None:
            computed["utc_ns"] = self.first_ns
        told = self._told()
        words = {name: computed[name] for name in KEPT if computed[name]}
        return {**(told[-1] if told else {"kind": "summary", **computed}), **words}

    def take(self, topic: str, data: bytes, log_time_ns: int) -> None:
        """Take one record."""
        self.counts[topic] += 1
        self.sizes[topic] += len(data)
        self.first_ns = log_time_ns if self.first_ns is None else self.first_ns
        self.last_ns = log_time_ns
        try:
            self._understand(topic, data, log_time_ns)
        except _NOT_UNDERSTOOD:
            self.not_understood[topic] += 1

    def _understand(self, topic: str, data: bytes, log_time_ns: int) -> None:
        if topic == FRAMES:
            frame = light_frame(data)
            self.census.frame(frame)
            self.trip.frame(frame)
            self.why_none.frame(frame)
            self._widen(frame.fixes)
        elif topic.startswith(ESTIMATES):
            self.trip.estimate(content_of(topic, data))
        elif topic == EVENTS:
            event = event_of(content_of(topic, data))
            self.trip.event(event["level"])
            if event["level"] in ("warning", "error"):
                self.warnings.append((log_time_ns, event))
        elif topic == SESSION:
            self._session(content_of(topic, data), log_time_ns)

    def _widen(self, fixes: Iterable[Fix]) -> None:
        for fix in fixes:
            if fix.usable and fix.lat_deg is not None and fix.lon_deg is not None:
                south, north, west, east = self.fixes_area or (fix.lat_deg, fix.lat_deg, fix.lon_deg, fix.lon_deg)
                south, north = min(south, fix.lat_deg), max(north, fix.lat_deg)
                self.fixes_area = south, north, min(west, fix.lon_deg), max(east, fix.lon_deg)

    def _session(self, record: dict[str, Any], log_time_ns: int) -> None:
        if record.get("kind") != "start":
            self.sessions.append(record)
            self.trip.session(record, log_time_ns)
            self.census.ended(record)
            return
        self.starts.append(record)
        self.trip.session(record, log_time_ns)
        connected, options = record.get("connected") or {}, record.get("options") or {}
        if options.get("frames") is None and isinstance(connected.get("next_seq"), int):
            self.census.expect(str(connected.get("boot_id")), connected["next_seq"])


def examine(
    path: Path,
    progress: Callable[[Scan], None],
    tap: Callable[[Item, Scan], None] | None = None,
    *,
    check_index: bool = False,
) -> Examination:
    """Read a whole log. tap: gets each item too. Raises WayfixError when it is no log, or the disk fails."""
    reader = LogReader(path)
    result = Examination(reader)
    scans: list[Scan] = []
    losses = 0

    def watch(scan: Scan) -> None:
        scans[:] = [scan]
        progress(scan)

    with closing(reader.items(watch, check_index=check_index)) as items:
        for item in items:
            if len(scans[0].losses) != losses:
                losses = len(scans[0].losses)
                result.census.file_lost_something()
            if tap is not None:
                tap(item, scans[0])
            if isinstance(item, tuple):
                channel, _, log_time_ns, _, data = item
                if channel is not None:
                    result.take(channel.topic, data, log_time_ns)
            elif isinstance(item, Metadata):
                result.metadata[item.name] = item.metadata
    result.chunks, result.checked = scans[0].chunks, scans[0].checked
    return result


def as_metadata(summary: dict[str, Any]) -> dict[str, str]:
    """A summary as its MCAP metadata record holds it: words only."""
    return {name: str(value) for name, value in summary.items() if value is not None}


def from_metadata(metadata: dict[str, str]) -> dict[str, Any]:
    """The summary again; words that are none of ours stay words."""
    return {name: value if name in (*KEPT, "boat", "kind") else _value(value) for name, value in metadata.items()}


def _value(text: str) -> Any:
    try:
        return literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return text
