"""Replay: the recorded frames through the very pipeline that ran live, in file order."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.messages import Frame
from common.sensors import BoatConfig
from common.settings import convert
from shore.logbook.read import LogReader, read_log
from shore.logbook.schemas import FRAMES, SESSION
from shore.pipeline import Pipeline


@dataclass(slots=True)
class Replay:
    """What a replay found."""

    config: BoatConfig
    filters: tuple[str, ...]
    frames: list[Frame] = field(default_factory=list)
    estimates: list[dict[str, Any]] = field(default_factory=list)
    recorded: int = 0
    """Estimates in the log of the filters that were replayed."""
    equal: int = 0
    """Of these, how many came out the same to the last bit."""
    bad_frames: int = 0
    damage: str | None = None
    """Why the log ends early, if it does."""


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
    path: Path, filters: Sequence[str] | None = None, step_s: float | None = None, progress: Any = None
) -> Replay:
    """Replay a log. Filters and step default to those of the live run; progress wraps the records."""
    reader = read_log(path)
    options = session_start(reader, path).get("options", {})
    config = logged_config(reader, path)
    names = tuple(filters or options.get("filters", ()))
    live_step_s = options.get("step_s")
    step_s = live_step_s if step_s is None else step_s
    result = Replay(config, names)
    pipeline = Pipeline(config, names, step_s)
    records = reader.records(SESSION, FRAMES)
    for record in progress(records) if progress else records:
        if record.topic == SESSION:
            # A board that came back with another configuration: the live run began anew there.
            if (changed := config_of(record.json(), path)) not in (None, result.config):
                result.config = changed
                pipeline = Pipeline(changed, names, step_s)
            continue
        try:
            frame = decode_frame(record.data)
        except CodecError:
            result.bad_frames += 1
            continue
        result.frames.append(frame)
        result.estimates += [estimate.as_record() for estimate in pipeline.push(frame).estimates]
    result.damage = reader.damage
    if step_s == live_step_s:
        _compare(result, reader)
    return result


def _compare(result: Replay, reader: LogReader) -> None:
    """Count recorded estimates that were found again bit for bit (NaN never occurs in a record)."""
    made = {(item["filter"], item["boot_id"], item["seq"]): item for item in result.estimates}
    for record in reader.estimates():
        if record["filter"] in result.filters:
            result.recorded += 1
            result.equal += made.get((record["filter"], record["boot_id"], record["seq"])) == record
