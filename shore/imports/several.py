"""Several recordings of one trip become one log: clock alignment by UTC, and a k-way merge of their measurements."""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from heapq import merge
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from common.boat_config import BoatConfig, BoatTable, FramesTable, PortTable, SensorTable
from common.codec import encode_frame
from common.errors import WayfixError
from common.framer import Measurement
from common.messages import ClockPair, RawLine
from common.settings import read_toml
from common.units import NS_PER_S
from shore.imports import frames as cut
from shore.imports.job import ImportOptions, Job
from shore.imports.log_maker import LogMaker, Written
from shore.imports.meaning import Doubt, words_of
from shore.imports.part import TripPart
from shore.imports.progress import frames_shown
from shore.imports.reader import digest_of
from shore.imports.recognise import RecordingKind
from shore.imports.run import opened_recording

LONGEST_BREAK_NS: Final = 1800 * NS_PER_S
"""Longest time between the end of a recording and the beginning of the next one of the same trip, ns. Local time is off
by an hour or more: with half an hour here, recordings of up to half an hour cannot hide it."""
TIME_ZONE_NS: Final = 1800 * NS_PER_S
"""Time zones differ by multiples of this, ns."""
NEAR_NS: Final = 60 * NS_PER_S
"""Recorders that were switched on and off together begin and end within this of each other, ns."""
DOUBT_NS: Final = NS_PER_S
"""1-sigma of UTC in the log, ns: the clocks of several recorders agree to about a second."""
KIND: Final = "several recordings"
_SELF_NAMED: Final = (RecordingKind.TABLE, RecordingKind.FRAMES, RecordingKind.LOG)
"""Kinds that say whose they are; of the others nobody knows."""


@dataclass(slots=True)
class JointImport:
    """Several recordings on their way into one log."""

    jobs: Sequence[Job]
    options: ImportOptions
    notes: list[str] = field(default_factory=list)
    brought: dict[int, "Brought"] = field(default_factory=dict)
    """What each job brought, by its place in `jobs`."""

    def record(self) -> dict[str, Any]:
        """Record of the import for the log's `end` record and for the summary."""
        files = [{**job.record(), **self.brought[place].as_record()} for place, job in enumerate(self.jobs)]
        return {"kind": KIND, "files": files, "notes": self.notes}


@dataclass(slots=True)
class Brought:
    """What one recording brings into the log."""

    first_ns: int
    last_ns: int
    names: dict[str, str]
    """The recording's own name of a sensor -> its name in the log."""
    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    """Number of measurements by the sensor's name in the log, and by kind."""

    @property
    def seconds(self) -> float:
        """Span, s."""
        return (self.last_ns - self.first_ns) / NS_PER_S

    def as_record(self) -> dict[str, Any]:
        """The same for JSON."""
        return {
            "from": utc_text(self.first_ns),
            "to": utc_text(self.last_ns),
            "seconds": round(self.seconds, 3),
            "sensors": {name: own for own, name in self.names.items()},
            "measurements": {sensor: dict(sorted(kinds.items())) for sensor, kinds in sorted(self.counts.items())},
        }

    def words(self) -> str:
        """The same for a person."""
        sensors = []
        for own, name in self.names.items():
            counts = ", ".join(f"{kind} {count}" for kind, count in sorted(self.counts[name].items()))
            sensors.append(f"{name} ({counts})" if own == name else f"{name} (its {own}: {counts})")
        return f"{utc_text(self.first_ns)} to {utc_text(self.last_ns)}: {', '.join(sensors)}"


def imported_together(trip: JointImport, out: Path) -> Written:
    """Write the log; raises WayfixError, and leaves nothing behind, when the recordings are not one trip."""
    _refuse_twice(trip.jobs)
    given = None if trip.options.config is None else read_toml(trip.options.config, BoatConfig)
    with ExitStack() as stack:
        parts = [opened_recording(job, stack).part() for job in trip.jobs]
        _check_one_trip(parts)
        names = _named(parts, given, str(trip.options.config))
        tables = [table for each in names for table in each.values()]
        trip.brought = {
            place: Brought(part.first_ns, part.last_ns, {own: table.id for own, table in each.items()})
            for place, (part, each) in enumerate(zip(parts, names, strict=True))
        }
        trip.notes += notes_of(parts, given)
        config = BoatConfig(
            boat=given.boat if given else _boat_of(parts),
            port=(PortTable(name=cut.PORT, path=cut.PORT),),
            sensor=tuple(sorted(tables, key=lambda table: table.role)),
            frames=given.frames if given else FramesTable(),
        )
        digests = [job.digest for job in trip.jobs]
        digest = hashlib.sha256(" ".join(digests).encode()).hexdigest()
        greeting = cut.greeting_of(config, digest, {"kind": KIND, "clock": "utc", "parts": digests})
        clock = cut.RecordingClock("rtc", DOUBT_NS)
        frames = cut.frames_of(merged(parts, trip.brought), config, cut.identity_of(greeting), clock)
        maker = LogMaker(greeting, trip.options.settings, 0)
        shown = frames_shown(map(encode_frame, frames), "importing", None)
        if not maker.write(out, shown, trip.options.trip, lambda: _record(trip, maker.doubts())):
            raise WayfixError("nothing in the recordings could be used", "", "import one of them alone to see why")
        return maker.written


def merged(parts: Sequence[TripPart], brought: dict[int, Brought]) -> Iterator[cut.Placed]:
    """The measurements of all parts in the order in which they came; of each part one is held at a time.

    One that came late in its recording comes late here, too: it is handed on as soon as those before it are.
    """
    streams = [_stream(part, brought[place]) for place, part in enumerate(parts)]
    return (cut.Placed(measurement, 0, 0) for measurement in merge(*streams, key=lambda measurement: measurement.t_ns))


def _stream(part: TripPart, brought: Brought) -> Iterator[Measurement]:
    """Measurements by their names in the log; they are counted."""
    for measurement in part.measurements():
        name = brought.names.get(measurement.sensor)
        if name is None:
            continue
        if not isinstance(measurement, ClockPair | RawLine):  # they repeat a sentence that was counted
            brought.counts[name][cut.count_of(measurement)] += 1
        yield replace(measurement, sensor=name)


def _refuse_twice(jobs: Sequence[Job]) -> None:
    """Refuse the same content twice, under whatever names; a table may be given once more with another mapping."""
    seen: dict[tuple[str, str], Job] = {}
    for job in jobs:
        content = (digest_of(job.source), "" if job.options.map is None else digest_of(job.options.map))
        if content in seen:
            what = f"is the same recording as {seen[content].source}"
            raise WayfixError(what, str(job.source), "give each recording once")
        seen[content] = job


def _check_one_trip(parts: Sequence[TripPart]) -> None:
    """Refuse a break of more than half an hour between what all earlier recordings cover and the next one."""
    in_time = sorted(parts, key=lambda part: part.first_ns)
    latest = in_time[0]
    for part in in_time[1:]:
        break_ns = part.first_ns - latest.last_ns
        if break_ns > LONGEST_BREAK_NS:
            what = (
                f"begins {utc_text(part.first_ns)}, {_long(break_ns)} after {latest.job.source} ended "
                f"({utc_text(latest.last_ns)}), and one trip has no break of more than half an hour"
            )
            cure = "import them as two logs"
            if RecordingKind.TABLE in (part.job.kind, latest.job.kind):
                cure += ", or correct [time] of the mapping if its clock is not UTC"
            raise WayfixError(what, str(part.job.source), cure)
        latest = max(latest, part, key=lambda each: each.last_ns)


def _named(parts: Sequence[TripPart], given: BoatConfig | None, config: str) -> list[dict[str, SensorTable]]:
    """Of each part: its own name of a sensor -> the sensor in the log, numbered by role in the order of the parts.

    given: its sensors of each role, in the order of the file, are those of the parts.
    """
    counts: Counter[str] = Counter()
    named: list[dict[str, SensorTable]] = []
    for part in parts:
        tables: dict[str, SensorTable] = {}
        for table in part.sensors:
            role = table.role
            counts[role] += 1
            if given is None:
                tables[table.id] = replace(table, id=f"{role}{counts[role]}", port=cut.PORT)
                continue
            known = given.with_role(role)
            if counts[role] > len(known):
                what = f"has {len(known)} [[sensor]] with role {role}; {table.id} of {part.job.source} is one more"
                raise WayfixError(what, config, "add a [[sensor]] for it, or leave the FILE out")
            tables[table.id] = replace(known[counts[role] - 1], port=cut.PORT)
        named.append(tables)
    return named


def _boat_of(parts: Sequence[TripPart]) -> BoatTable:
    """The boat of the first recording that says whose it is, else of the first."""
    return next((part.boat for part in parts if part.job.kind in _SELF_NAMED), parts[0].boat)


def _record(trip: JointImport, doubts: Sequence[Doubt]) -> dict[str, Any]:
    """The trip's record, with what its values contradict among the notes."""
    trip.notes += [words_of(doubt, None) for doubt in doubts]
    return trip.record()


def notes_of(parts: Sequence[TripPart], given: BoatConfig | None) -> Iterator[str]:
    """What a person should know of them together."""
    boats = list(dict.fromkeys(part.boat.id for part in parts if part.job.kind in _SELF_NAMED))
    if given is None and len(boats) > 1:
        yield f"the recordings name {len(boats)} boats ({', '.join(boats)}): the log is of {boats[0]}"
    in_time = sorted(parts, key=lambda part: part.first_ns)
    for earlier, part in pairwise(in_time):
        begins_ns, ends_ns = part.first_ns - earlier.first_ns, part.last_ns - earlier.last_ns
        off_ns = round(begins_ns / TIME_ZONE_NS) * TIME_ZONE_NS
        if part.first_ns >= earlier.last_ns:
            if {table.role for table in earlier.sensors} & {table.role for table in part.sensors}:
                cure = "; `cat A B > C` makes one recording of two serial ones"
                yield (
                    f"{part.job.source} goes on after {earlier.job.source} with sensors of other numbers, also where "
                    f"they are the same devices{cure if part.job.kind is RecordingKind.SERIAL else ''}"
                )
        elif off_ns and max(abs(begins_ns - off_ns), abs(ends_ns - off_ns)) <= NEAR_NS:
            yield (
                f"{part.job.source} begins and ends {_long(off_ns)} after {earlier.job.source}: if they were made "
                "together, one of their clocks shows local time, not UTC"
            )


def utc_text(utc_ns: int) -> str:
    """Whole seconds of a UTC, as 2023-11-14T22:13:20Z."""
    return f"{datetime.fromtimestamp(utc_ns // NS_PER_S, UTC):%Y-%m-%dT%H:%M:%SZ}"


def _long(span_ns: int) -> str:
    """2 h 5 min, or days from two on."""
    hours, minutes = divmod(span_ns // (60 * NS_PER_S), 60)
    return f"{hours} h {minutes} min" if hours < 48 else f"{hours // 24} days"
