"""Logs as a live run writes them, without a link: for replay, smoother and comparison."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from common.boat_config import BoatConfig
from common.codec import encode_frame
from common.messages import Frame
from shore.logbook.log_reader import LogRecord, read_log
from shore.logbook.log_writer import new_log
from shore.logbook.session import start_record
from shore.pipeline import Pipeline
from shore.replay.comparison import Counts
from shore.replay.run import Replay
from tests.navigate.voyages import BOAT

UTC_NS = 1_795_000_000_000_000_000
FILTERS = ("ukf",)
OTHER = replace(BOAT, sensor=BOAT.sensor[:2])


def without_none(value: Any) -> Any:
    """As on the wire: what is missing is absent."""
    if isinstance(value, dict):
        return {key: without_none(each) for key, each in value.items() if each is not None}
    return [without_none(each) for each in value] if isinstance(value, tuple) else value


def session(config: BoatConfig = BOAT) -> dict[str, Any]:
    return start_record({"config": without_none(asdict(config))}, {"filters": list(FILTERS)}, UTC_NS)


def log_of(
    directory: Path, frames: Sequence[Frame], changes: dict[int, BoatConfig] | None = None, *, synced: bool = False
) -> Path:
    """What a live run would have written; `changes`: before the frame of that number the board has a new file."""
    writer = new_log(directory, "springer", UTC_NS)
    writer.write_session(session(), UTC_NS)
    pipeline = Pipeline(BOAT, FILTERS)
    for number, frame in enumerate(frames):
        if changes and number in changes:
            writer.write_session(session(changes[number]), UTC_NS)
            pipeline = Pipeline(changes[number], FILTERS)
        writer.write_frame(encode_frame(frame), frame, UTC_NS + number)
        output = pipeline.push(frame)
        for estimate in output.estimates:
            writer.write_estimate(estimate.as_record(), UTC_NS + number)
        for happening in (*frame.events, *output.events):
            writer.write_event(happening, UTC_NS + number)
        if synced and number % 10 == 9:
            writer.sync()
    writer.close()
    return writer.path


class Done:
    """A replay to its end, with all that it made."""

    def __init__(self, path: Path, order: str = "arrival", filters: Sequence[str] | None = None) -> None:
        self.run = Replay(path, filters, order=order)
        played = list(self.run)
        self.frames = [each.frame for each in played]
        self.configs = [each.start.config for each in played]
        self.estimates = [record for each in played for record in each.records]

    def counts(self) -> Counts:
        assert self.run.comparison is not None
        return self.run.comparison.estimates


def all_equal(done: Done, count: int) -> bool:
    """Every estimate and every event."""
    events = done.run.comparison.events if done.run.comparison else None
    assert events is not None
    assert events.recorded > 0
    assert done.run.comparison is not None
    assert done.run.comparison.first is None
    counts = done.counts()
    return counts.equal == counts.recorded == counts.made == count and not counts.differs and not events.differs


def with_backfill(frames: list[Frame]) -> list[Frame]:
    """Ten seconds of the link are lost and come after it has returned."""
    return [*frames[:100], *frames[200:250], *frames[100:200], *frames[250:]]


def starts(frames: list[Frame]) -> list[Frame]:
    """Three starts of the daemon, the last one after a reboot: its clock begins again."""
    back_ns = frames[200].t0_ns - 1_000_000_000
    named = []
    for frame in frames:
        if frame.seq < 100:
            named.append(frame)
        elif frame.seq < 200:
            named.append(replace(frame, boot_id="b2", start_no=2, seq=frame.seq - 100))
        else:
            t0_ns, t1_ns = frame.t0_ns - back_ns, frame.t1_ns - back_ns
            shifted: dict[str, Any] = {
                kind: tuple(replace(item, t_ns=item.t_ns - back_ns) for item in getattr(frame, kind))
                for kind in ("fixes", "headings", "imu")
            }
            named.append(replace(frame, boot_id="b3", clock_id="c2", start_no=3, t0_ns=t0_ns, t1_ns=t1_ns, **shifted))
    return named


def rewritten(log: Path, path: Path, change: Callable[[LogRecord, int], bytes | None]) -> Path:
    """A copy in which `change` gives each record's bytes by its number in its topic; `None` leaves it out."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="test")
        channels: dict[str, int] = {}
        seen: Counter[str] = Counter()
        for record in read_log(log).records():
            data = change(record, seen[record.topic])
            seen[record.topic] += 1
            if data is not None:
                if record.topic not in channels:
                    channels[record.topic] = writer.register_channel(record.topic, "", 0)
                writer.add_message(channels[record.topic], record.log_time_ns, data, record.publish_time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path
