"""`wayfix export`: format conversion of a log into a file of another kind."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple

from common.atomic_file import check_target, whole_file
from common.errors import WayfixError
from common.words import counted
from shore.exports.first_pass import Survey, survey_of
from shore.exports.formats import FORMATS, HEAD, Format, format_of
from shore.exports.table import NAMES
from shore.exports.track import RAW, ExportTrack
from shore.logbook.log_reader import LogReader, late_logs, read_log
from shore.navigation.estimate import MOST_DOUBT_M
from shore.navigation.timeline import HORIZON_S
from shore.terminal import every_end_is_ctrl_c, filters_named, finish, say, tell
from shore.trips.listing import logs_in, newest_first, trip_of

HEAVY: Final = {"kml": 50_000, "geojson": 200_000, "gpx": 200_000}
"""Number of points from which on programs that draw such files become slow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What an export was asked for."""

    log: str
    out: str
    """A file, or a directory for all tables: then it exists, or ends with a slash."""
    to: str
    """Format of the file, a key of `FORMATS`."""
    filter: str | None
    """Filter whose track is written; `None` = the first one of the live run."""
    order: str
    """Order of the rows: `recorded` or `time`."""
    every_s: float | None
    """Interval of the rows, s; `None` = all rows are written."""
    force: bool
    """True when files of our own making may be replaced."""


class Target(NamedTuple):
    """The files to be written."""

    out: Path
    files: dict[str, Path]
    """Table name -> file; without a directory there is one file, and its name is empty."""


def run(arguments: argparse.Namespace) -> int:
    """Write OUT. Exit code 1: there is no place in the log."""
    options = ExportOptions(
        log=_log(arguments.log),
        out=arguments.out,
        to=arguments.to or format_of(arguments.out),
        filter=arguments.filter,
        order=arguments.order,
        every_s=arguments.every,
        force=arguments.force,
    )
    kind = FORMATS[options.to]
    kind.check(options.to)
    reader = read_log(options.log)
    target = _target(options, kind)
    try:
        with every_end_is_ctrl_c():
            summary = _export(options, kind, reader, target)
    except KeyboardInterrupt:
        say(f"stopped; {target.out} was not written")
        return 0
    finish(arguments, summary)
    return 0 if summary["rows"] else 1


def _log(given: str) -> str:
    """The log that is meant: the newest trip of a directory, which is said. Raises WayfixError."""
    if not Path(given).is_dir():
        return given
    late = {path for _, path in late_logs(Path(given))}
    trips = newest_first(trip_of(path, lambda _scan: None) for path in logs_in([Path(given)]) if path not in late)
    newest = next((trip.path for trip in trips if trip.is_log), None)
    if newest is None:
        raise WayfixError("holds no log", given, "give a log, or a directory with logs")
    say(f"{newest}: the newest trip in {given}")
    return str(newest)


def _export(options: ExportOptions, kind: Format, reader: LogReader, target: Target) -> dict[str, Any]:
    """Write, say what was written; the same for `--json`."""
    with _progress("reading") as shown:
        survey = survey_of(reader, shown)
    name = _chosen(options, survey)
    track = ExportTrack(reader, survey, name, options.order, options.every_s)
    total_s = survey.clocks.newest_s
    with _progress("writing", total_s) as track.shown:
        rows = _write(kind, target, track)
    if not rows:
        why = f" ({reader.damage})" if reader.damage else ""
        what = f"holds no {'usable fix' if name == RAW else 'estimate'}{why}"
        say(f"{options.log}: {_left_out(track) or what}; nothing was written")
        return {"out": None, "rows": 0, "events": track.marks}
    _say_what(options, track)
    return _summary(options, track, target)


class _Nothing(Exception):  # noqa: N818 - not an error: leaves no file behind
    """There was no row to write."""


def _write(kind: Format, target: Target, track: ExportTrack) -> int:
    """All files or none; how many rows. Raises WayfixError when they cannot be written."""
    is_new = "" not in target.files and not target.out.exists()
    try:
        if is_new:
            target.out.mkdir()
        with ExitStack() as stack:
            streams: dict[str, BinaryIO] = {
                name: stack.enter_context(whole_file(path)) for name, path in target.files.items()
            }
            _fill(kind, streams, track)
    except _Nothing:
        return 0
    except OSError as error:
        cure = "check space and rights, or name another OUT"
        raise WayfixError(f"cannot be written ({error.strerror})", str(target.out), cure) from error
    finally:
        if is_new:
            with suppress(OSError):  # it holds something when all went well
                target.out.rmdir()
    return track.rows


def _fill(kind: Format, streams: dict[str, BinaryIO], track: ExportTrack) -> None:
    """Write all rows. Raises _Nothing when there was none."""
    if "" in streams:
        kind.writer().write(streams[""], track)
    else:
        kind.writer().write_all(streams, track)
    if not track.rows:
        raise _Nothing


def _target(options: ExportOptions, kind: Format) -> Target:
    """Raises WayfixError when OUT is what is read, or something that must not be replaced."""
    log, out = Path(options.log), Path(options.out)
    if kind.is_table and (options.out.endswith("/") or out.is_dir()):
        files = {name: out / f"{name}.{options.to}" for name in NAMES}
        if not out.exists() and not out.absolute().parent.is_dir():
            raise WayfixError("cannot be made (no such directory above it)", str(out), "choose another OUT")
    else:
        files = {"": out}
        check_target(out, [log], "choose another OUT")
    for path in files.values():
        if path.exists():
            if "" not in files:
                check_target(path, [log], "choose another OUT")
            _check_replaced(path, options, kind)
    return Target(out, files)


def _check_replaced(path: Path, options: ExportOptions, kind: Format) -> None:
    if not options.force:
        raise WayfixError("exists already", str(path), "choose another OUT, or add --force")
    try:
        with path.open("rb") as stream:
            head = stream.read(HEAD)
    except OSError as error:
        raise WayfixError(f"cannot be looked at ({error.strerror})", str(path), "choose another OUT") from error
    if head and not kind.begins(head):
        what = f"exists already and is no {options.to} file of `wayfix export`"
        raise WayfixError(what, str(path), "choose another OUT, or remove it first")


def _chosen(options: ExportOptions, survey: Survey) -> str:
    """The filter. Raises WayfixError for one that cannot be given."""
    live, asked = survey.live_filters, options.filter
    if asked is None:
        if not live and options.order == "recorded":
            say(f"{options.log}: holds no estimates, so these are the GPS fixes as they came")
        return live[0] if live else RAW if options.order == "recorded" else "fuzzy"
    if asked == RAW or (options.order == "recorded" and asked in live):
        return asked
    (name,) = filters_named(asked)[:1]
    if options.order == "recorded":
        has = f"has {', '.join(live)}" if live else "has none"
        raise WayfixError(
            f"no estimates of {name} in {options.log}, which {has}", "--filter", "add --order time to run it"
        )
    return name


def _say_what(options: ExportOptions, track: ExportTrack) -> None:
    """Say what the rows are, and what is missing."""
    survey, clocks = track.survey, track.survey.clocks
    one, many = ("fix", "fixes") if track.filter == RAW else ("estimate", "estimates")
    what = (
        f"{counted(track.rows, one, many)} of {(track.gps or 'the first GPS') if track.filter == RAW else track.filter}"
    )
    how = (
        "as published live"
        if track.order == "recorded"
        else "filtered again in order of boat time: the best track, not what was seen live"
    )
    if track.filter == RAW:
        how = "as they came" if track.order == "recorded" else "in order of boat time"
    tell(f"{options.out}: {what}, {how}; {counted(track.marks, 'event')}")
    if left_out := _left_out(track):
        tell(left_out)
    if survey.late and track.order == "recorded":
        late = counted(survey.late, "frame")
        tell(f"{late} came more than {HORIZON_S:g} s late; --order time puts them in their place")
    if not clocks.know_utc:
        known = "the time of day, but no date" if clocks.has_time_of_day else "no UTC"
        tell(f"the log knows {known}: times are seconds of the log")
    if track.reader.damage:
        say(f"{options.log}: {track.reader.damage}; all that is sound was exported")
    if track.rows > HEAVY.get(options.to, track.rows):
        tell(f"{counted(track.rows, 'point')} make many programs slow; --every 1 gives one a second")


def _left_out(track: ExportTrack) -> str:
    """How many estimates a map does not show; empty = it shows all."""
    doubt = f"the doubt of their position is beyond {MOST_DOUBT_M:g} m"
    are = "is" if track.left_out == 1 else "are"
    return f"{counted(track.left_out, 'estimate')} {are} left out: {doubt}" if track.left_out else ""


def _summary(options: ExportOptions, track: ExportTrack, target: Target) -> dict[str, Any]:
    return {
        "out": options.out,
        "to": options.to,
        "files": {path.name: path.stat().st_size for path in target.files.values()},
        "filter": track.filter,
        "order": track.order,
        "rows": track.rows,
        "left_out": track.left_out,
        "events": track.marks,
        "late": track.survey.late,
        "has_utc": track.survey.clocks.know_utc,
        "damage": track.reader.damage,
    }


@contextmanager
def _progress(what: str, total_s: float | None = None) -> Iterator[Callable[[float], None]]:
    """A line on a terminal's stderr: seconds of the log so far."""
    if not (sys.stderr and sys.stderr.isatty()):
        yield lambda _t_s: None
        return
    from datetime import timedelta

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn(what), BarColumn(), TextColumn("{task.fields[at]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        job = bar.add_task(what, total=total_s, at="")
        yield lambda t_s: bar.update(job, completed=t_s, at=f"{timedelta(seconds=int(t_s))} of the trip")
