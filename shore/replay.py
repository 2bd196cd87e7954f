"""Replay: the recorded frames through the very pipeline that ran live, in order of arrival or of boat time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.messages import Frame
from common.sensors import BoatConfig
from common.settings import convert
from shore.logbook.read import LogReader, read_log
from shore.logbook.schemas import FRAMES, SESSION
from shore.navigation.estimate import Estimate
from shore.navigation.timeline import HORIZON_NS
from shore.pipeline import Pipeline
from shore.smooth import smooth_log


@dataclass(slots=True)
class Replay:
    """What a replay found."""

    config: BoatConfig
    filters: tuple[str, ...]
    order: str = "arrival"
    """`arrival` = as live, every frame when it came; `time` = by boat time, so that late backfill is in its place."""
    frames: list[Frame] = field(default_factory=list)
    """In the order in which they were fed."""
    estimates: list[dict[str, Any]] = field(default_factory=list)
    recorded: int = 0
    """Estimates in the log of the filters that were replayed."""
    equal: int = 0
    """Of these, how many came out the same to the last bit."""
    bad_frames: int = 0
    late_frames: int = 0
    """Frames that came later than the timeline rewinds; fused in order of time only."""
    damage: str | None = None
    """Why the log ends early, if it does."""


class Arrival(NamedTuple):
    """A frame and the configuration of the board that sent it."""

    frame: Frame
    config: BoatConfig


def session_start(reader: LogReader, path: Path) -> dict[str, Any]:
    """The record a live run begins with; raises WayfixError for a log without one."""
    for record in reader.session():
        if record.get("kind") == "start":
            return record
    damage = f": {reader.damage}" if reader.damage else ""
    what = f"has no session record, so its sensors are unknown{damage}"
    raise WayfixError(what, str(path), "give a log of `wayfix connect`")


def config_of(record: dict[str, Any], path: Path) -> BoatConfig | None:
    """The board's configuration in a session record, or None where it has none."""
    if record.get("kind") != "start":
        return None
    return convert(record["connected"]["config"], BoatConfig, f"configuration in {path}", strict=False)


def logged_config(reader: LogReader, path: Path) -> BoatConfig:
    """The board's configuration at the start of the log; raises WayfixError for a log without one."""
    config = config_of(session_start(reader, path), path)
    assert config is not None
    return config


def replay(
    path: Path,
    filters: Sequence[str] | None = None,
    step_s: float | None = None,
    order: str = "arrival",
    progress: Any = None,
) -> Replay:
    """Replay a log. Filters and step default to those of the live run; progress wraps the frames.

    In order of time estimates are made that no live run could have made, so they are not compared with the recorded.
    """
    reader = read_log(path)
    options = session_start(reader, path).get("options", {})
    names = tuple(filters or options.get("filters", ()))
    live_step_s = options.get("step_s")
    step_s = live_step_s if step_s is None else step_s
    result = Replay(logged_config(reader, path), names, order)
    pipeline = Pipeline(result.config, names, step_s)
    arrivals: Iterable[Arrival] = _arrivals(reader, path, result)
    if order == "time":
        arrivals = in_order_of_time(list(arrivals))
    for frame, config in progress(arrivals) if progress else arrivals:
        if config is not result.config:
            # A board that came back with another configuration: the live run began anew there.
            result.config = config
            pipeline = Pipeline(config, names, step_s)
        result.frames.append(frame)
        result.estimates += [estimate.as_record() for estimate in pipeline.push(frame).estimates]
    result.damage = reader.damage
    if step_s == live_step_s and order == "arrival":
        _compare(result, reader)
    return result


def smoothed(path: Path, name: str) -> list[Estimate]:
    """The log's track by filter `name` with every estimate knowing the whole log; frames in order of boat time.

    Raises: WayfixError for a log without configuration or an unknown filter.
    """
    reader = read_log(path)
    counted = Replay(logged_config(reader, path), (name,))
    arrivals = in_order_of_time(list(_arrivals(reader, path, counted)))
    return [
        estimate
        for config, group in groupby(arrivals, key=lambda arrival: arrival.config)
        for estimate in smooth_log(config, (arrival.frame for arrival in group), name)
    ]


def _arrivals(reader: LogReader, path: Path, result: Replay) -> Iterator[Arrival]:
    """The frames of a log in file order; those that are damaged or late are counted in `result`."""
    config = result.config
    newest: Frame | None = None
    for record in reader.records(SESSION, FRAMES):
        if record.topic == SESSION:
            if (changed := config_of(record.json(), path)) not in (None, config):
                config = changed
            continue
        try:
            frame = decode_frame(record.data)
        except CodecError:
            result.bad_frames += 1
            continue
        if newest is None or _is_newer(frame, newest):
            newest = frame
        result.late_frames += frame.clock_id != newest.clock_id or frame.t1_ns < newest.t1_ns - HORIZON_NS
        yield Arrival(frame, config)


def _is_newer(frame: Frame, newest: Frame) -> bool:
    if frame.clock_id == newest.clock_id:
        return frame.t1_ns > newest.t1_ns
    return frame.start_no >= newest.start_no


def in_order_of_time(arrivals: Sequence[Arrival]) -> list[Arrival]:
    """Sorted by boat time; clocks that cannot be compared follow each other in the order of the daemon's starts.

    A start of the daemon has one configuration: the one under which its first frame came.
    """
    first_start: dict[str, int] = {}
    configs: dict[str, BoatConfig] = {}
    for frame, config in arrivals:
        first_start[frame.clock_id] = min(frame.start_no, first_start.get(frame.clock_id, frame.start_no))
        configs.setdefault(frame.boot_id, config)
    clocks = sorted(first_start, key=lambda clock_id: first_start[clock_id])
    places = {clock_id: place for place, clock_id in enumerate(clocks)}
    frames = sorted(
        (frame for frame, _ in arrivals), key=lambda frame: (places[frame.clock_id], frame.t1_ns, frame.seq)
    )
    return [Arrival(frame, configs[frame.boot_id]) for frame in frames]


def _compare(result: Replay, reader: LogReader) -> None:
    """Count recorded estimates that were found again bit for bit (NaN never occurs in a record)."""
    made = {(item["filter"], item["boot_id"], item["seq"]): item for item in result.estimates}
    for record in reader.estimates():
        if record["filter"] in result.filters:
            result.recorded += 1
            result.equal += made.get((record["filter"], record["boot_id"], record["seq"])) == record
