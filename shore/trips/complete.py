"""Log completion (backfill): frames that came after the end of a trip go into its log, behind a `completed` record."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from shore.logbook.greetings import COMPLETED, GREETED
from shore.logbook.log_reader import LogReader
from shore.logbook.mcap.scan import Scan
from shore.logbook.missing_frames import WORDS
from shore.logbook.schemas import EVENTS, FIXES, FRAMES
from shore.trips.examine import Examination
from shore.trips.recover import Added, Whole, check_source, rewrite, whole_of

_CURE = "`wayfix log verify` says what is wrong with it"


def complete(trip: Path, late: Path) -> int:
    """Put the frames of the log `late` into the log `trip`, and remove `late`; returns how many were new there.

    A trip that was cut (its station died) gets its end by this. Safe to do again after a power cut at any moment.
    Raises WayfixError; both logs are as before then.
    """
    if not trip.exists():
        raise WayfixError("there is no such log any more", str(trip), "keep both")
    check_source(trip)
    new: set[int] = set()

    def added(result: Examination) -> Added:
        if result.state not in ("whole", "cut") or _lost_records(result.reader):
            raise WayfixError(f"is {result.state}", str(trip), _CURE)
        reader, boat_id = LogReader(late), result.trip.as_record()["boat"]
        for number, record in _records(reader):
            if record.topic == FRAMES:
                try:
                    frame = decode_frame(record.data)
                except CodecError as error:
                    what = f"holds a frame that is not understood ({error.what})"
                    raise WayfixError(what, str(late), _CURE) from error
                if boat_id not in (None, frame.boat_id):
                    raise WayfixError(f"holds a frame of another boat ({frame.boat_id})", str(late), "keep both")
                if not result.census.holds(frame):
                    new.add(number)
                    result.census.frame(frame)
                    result.trip.frame(frame)
        if _lost_records(reader):
            raise WayfixError("is damaged", str(late), _CURE)
        completed = _completed(late)
        result.trip.session(completed, 0)
        summary = {"kind": "summary", **result.trip.as_record()}
        return Added([completed], lambda: _new(late, new), [summary], summary)

    rewrite(trip, trip.resolve(), added, lambda _step, _scan: None, "free some space; both logs are as they were")
    late.unlink(missing_ok=True)
    return len(new)


def _lost_records(reader: LogReader) -> bool:
    """True when a log that was read lost more than its end."""
    return len(reader.losses) > int(reader.is_cut)


def _records(late: LogReader) -> Iterator[tuple[int, Whole]]:
    """The records of a log with their numbers."""
    scans: list[Scan] = []
    with closing(late.items(lambda scan: scans.append(scan) if not scans else None)) as items:
        for number, item in enumerate(item for item in items if isinstance(item, tuple)):
            yield number, whole_of(item, scans[0].schemas)


def _completed(late: Path) -> dict[str, Any]:
    """What a trip holds where it goes on: from which log; where known, the board's starts, and what it has not."""
    known: dict[str, Any] = {}
    for record in LogReader(late).session():
        if record["kind"] == "end":
            known |= {name: record[name] for name in WORDS if name in record}
        elif record["kind"] == GREETED and "starts" in record:
            known["starts"] = record["starts"]
    return {"kind": COMPLETED, "from": late.name, **known}


def _new(late: Path, new: set[int]) -> Iterator[Whole]:
    """New frames, and what belongs to each: its fixes once more, and its events."""
    is_new = False
    for number, record in _records(LogReader(late)):
        if record.topic == FRAMES:
            is_new = number in new
        if is_new and (record.topic in (FRAMES, EVENTS) or record.topic.startswith(FIXES)):
            yield record
