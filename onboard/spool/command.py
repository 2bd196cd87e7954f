"""`wayfix-onboard spool ls|verify|export`: looks at a spool without touching it, also while the daemon writes."""

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from common import words
from common.atomic_file import check_target
from common.codec import decode_frame
from common.command import number
from common.errors import CodecError, WayfixError
from common.frames_file import FILE_FORMAT, is_frames_file, write_frames_file
from common.messages import Frame
from common.settings import as_dict
from common.units import NS_PER_S
from onboard.spool.segment_format import Header
from onboard.spool.segment_index import Run, Segment, Shelf, header_of, last_seq, recovered, segments_in
from onboard.spool.verify import Examination, Finding, frames_of, is_being_written

DEFAULT_STATE: Final = "/var/lib/wayfix"
_MOST: Final = 2**63 - 1


def add_arguments(commands: Any) -> None:
    """Add the sub-parsers."""
    words = "the frames kept on the board's disk"
    parser: argparse.ArgumentParser = commands.add_parser("spool", help=words, description=f"Look at {words}.")
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    _add(actions, "ls", "one row for each start of the daemon", _ls)
    _add(actions, "verify", "check every byte", _verify)
    export = _add(actions, "export", "frames of one start into a frames file", _export)
    export.add_argument("out", metavar="OUT", type=Path, help="frames file to write; `wayfix import` ashore reads it")
    export.add_argument("--boot", metavar="ID", help="start of the daemon, as `ls` shows it (default: the newest)")
    seq = number(int, 0, _MOST)
    export.add_argument("--from", dest="first", type=seq, default=0, metavar="SEQ", help="first frame")
    export.add_argument("--to", dest="last", type=seq, default=_MOST, metavar="SEQ", help="last frame")
    export.add_argument("--config", type=Path, metavar="BOAT.toml", help="instead of the configuration in the spool")


def _add(actions: Any, name: str, words: str, run: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=words, description=run.__doc__)
    parser.add_argument(
        "--state", type=Path, metavar="DIR", help=f"of the daemon (default: $STATE_DIRECTORY, else {DEFAULT_STATE})"
    )
    parser.add_argument("--json", action="store_true", help="last line of stdout is one JSON object")
    parser.set_defaults(command=run)
    return parser


def _ls(arguments: argparse.Namespace) -> int:
    """One row for each start of the daemon: its frames (numbers; `verify` finds holes), bytes, and time in UTC."""
    directory = _directory(arguments.state, os.environ)
    shelf = _shelf(directory)
    rows = [_row(run, shelf.by_boot[run.boot_id]) for run in shelf.runs]
    if rows:
        _tell("  start  boot                  first       last     frames       MiB  from (UTC)           to (UTC)")
    for row in rows:
        _tell(
            f"{row['start_no']:>7}  {row['boot_id']}  {row['first']:>9}  {row['last']:>9}  {row['frames']:>9}  "
            f"{row['bytes'] / 2**20:>8.1f}  {row['from'] or 'not known':19}  {row['to'] or 'not known'}"
        )
    size = sum(segment.size for segment in shelf.segments)
    written = ", being written" if is_being_written(directory) else ""
    told = f"{words.counted(len(rows), 'start')}, {words.counted(len(shelf.segments), 'segment')}"
    _say(f"{directory}: {told}, {size / 2**20:.1f} MiB{written}")
    _finish(arguments, {"directory": str(directory), "bytes": size, "segments": len(shelf.segments), "starts": rows})
    return 0


def _verify(arguments: argparse.Namespace) -> int:
    """Read everything and name every damaged stretch and every lost frame. Exit code 1 = something is damaged."""
    directory = _directory(arguments.state, os.environ)
    is_live = is_being_written(directory)
    shelf = _shelf(directory)
    frames, size = 0, 0
    found: list[tuple[str, Finding]] = []
    for boot_id, held in shelf.by_boot.items():
        examination = Examination(held, is_live=is_live and held[-1] is shelf.segments[-1])
        examination.run()
        frames += examination.frames
        size += examination.bytes
        found += [(boot_id, finding) for finding in examination.findings]
    for _, finding in found:
        _tell(str(finding))
    is_sound = not any(finding.is_damage for _, finding in found)
    verdict = "nothing is damaged" if is_sound else "DAMAGED"
    told = f"{words.counted(frames, 'frame')} in {words.counted(len(shelf.segments), 'segment')}"
    _say(f"{directory}: {told}, {size / 2**20:.1f} MiB: {verdict}")
    records = [finding.as_record(boot_id) for boot_id, finding in found]
    _finish(arguments, {"directory": str(directory), "frames": frames, "sound": is_sound, "findings": records})
    return 0 if is_sound else 1


def _export(arguments: argparse.Namespace) -> int:
    """Frames of one start, byte for byte, into a frames file. Exit code 1 = some of those asked for are not there."""
    directory = _directory(arguments.state, os.environ)
    shelf = _shelf(directory)
    run = _chosen(shelf.runs, arguments.boot, directory)
    held = shelf.by_boot[run.boot_id]
    out: Path = arguments.out
    check_target(out, [segment.path for segment in held], "give another OUT")
    if os.path.lexists(out) and not is_frames_file(out):
        raise WayfixError("exists already and is no frames file", str(out), "give another OUT")
    first, last = max(run.first_seq, arguments.first), min(run.next_seq - 1, arguments.last)
    if first > last:
        raise WayfixError(
            f"start {run.boot_id} has no such frames", str(directory), f"it has {run.first_seq} to {run.next_seq - 1}"
        )
    counted = Counted(frames_of(held, first, last))
    greeting = _greeting(run, _header(held, directory), arguments.config)
    write_frames_file(out, greeting, counted)
    missing = last - first + 1 - counted.frames
    _say(
        f"{out}: {words.counted(counted.frames, 'frame')} of start {run.boot_id}"
        + (f", {missing} are lost" if missing else "")
    )
    _finish(arguments, {"out": str(out), "boot_id": run.boot_id, "frames": counted.frames, "missing": missing})
    return 1 if missing else 0


@dataclass
class Counted:
    """The bytes of frames, and how many there were."""

    items: Iterator[tuple[int, bytes]]
    frames: int = 0

    def __iter__(self) -> Iterator[bytes]:
        for _, data in self.items:
            self.frames += 1
            yield data


def _directory(state: Path | None, environment: Mapping[str, str]) -> Path:
    """The spool of a state directory. Raises WayfixError when there is none."""
    parent = state or Path((environment.get("STATE_DIRECTORY") or DEFAULT_STATE).split(":")[0])
    directory = parent / "spool"
    if not directory.is_dir():
        raise WayfixError("there is no spool here", str(directory), "give the daemon's --state directory")
    return directory


def _shelf(directory: Path) -> Shelf:
    return recovered(segments_in(directory))[0]


def _chosen(runs: Sequence[Run], boot_id: str | None, directory: Path) -> Run:
    if not runs:
        raise WayfixError("holds no frame", str(directory), "give the daemon's --state directory")
    if boot_id is None:
        return runs[-1]
    chosen = [run for run in runs if run.boot_id.startswith(boot_id)]
    if len(chosen) != 1:
        cure = "`wayfix-onboard spool ls` shows all"
        raise WayfixError(f"holds {len(chosen) or 'no'} starts {boot_id}", str(directory), cure)
    return chosen[0]


def _row(run: Run, held: list[Segment]) -> dict[str, Any]:
    first = _decoded(next(frames_of(held), None))
    ends = [segment for segment in held if last_seq(segment) == run.next_seq - 1]
    last = _decoded(next(frames_of(ends, run.next_seq - 1), None))
    # All frames of a start are on one clock: one that knows the time tells it for the other.
    known = [frame.utc_ns - frame.t0_ns for frame in (last, first) if frame is not None and frame.utc_ns is not None]
    return {
        "start_no": run.start_no,
        "boot_id": run.boot_id,
        "first": run.first_seq,
        "last": run.next_seq - 1,
        "frames": run.next_seq - run.first_seq,
        "bytes": sum(segment.size for segment in held),
        "from": _utc(None if first is None else first.t0_ns, known),
        "to": _utc(None if last is None else last.t1_ns, known),
    }


def _decoded(item: tuple[int, bytes] | None) -> Frame | None:
    try:
        return None if item is None else decode_frame(item[1])
    except CodecError:
        return None


def _utc(t_ns: int | None, offsets_ns: list[int]) -> str | None:
    if t_ns is None or not offsets_ns:
        return None
    return datetime.fromtimestamp((t_ns + offsets_ns[0]) // NS_PER_S, UTC).strftime("%Y-%m-%dT%H:%M:%S")


def _header(held: Sequence[Segment], directory: Path) -> Header:
    for segment in reversed(held):
        head = header_of(segment.path)
        if head is not None:
            return head
    raise WayfixError("no header of this start is sound", str(directory), "`wayfix-onboard spool verify` says more")


def _greeting(run: Run, head: Header, config_file: Path | None) -> dict[str, Any]:
    """The fields of `connected`, as the daemon would have sent them."""
    config = head.about.get("config")
    if config_file is not None:
        from onboard.config import load

        config = as_dict(load(str(config_file)))
    if not isinstance(config, Mapping):
        raise WayfixError("the spool does not hold the boat's configuration", run.boot_id, "add --config BOAT.toml")
    identity = head.identity
    sensors = [{"id": sensor["id"], "state": "missing", "reason": ""} for sensor in config.get("sensor", ())]
    return {
        "boat_id": identity.boat_id,
        "boot_id": identity.boot_id,
        "clock_id": identity.clock_id,
        "start_no": identity.start_no,
        "next_seq": run.next_seq,
        "clock_rate": 1.0,
        "config": config,
        "versions": head.about.get("versions", {}),
        "sensors": sensors,
        "file": {"format": FILE_FORMAT, "clock": "boat"},
    }


def _tell(line: str) -> None:
    sys.stdout.write(f"{line}\n")


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")


def _finish(arguments: argparse.Namespace, summary: dict[str, Any]) -> None:
    if arguments.json:
        _tell(json.dumps(summary))
