"""`wayfix import` (command line): arguments in, and at the end a summary of what was taken and made."""

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

from common.atomic_file import check_target
from common.errors import WayfixError
from common.units import NS_PER_S
from common.words import counted
from shore.imports.guess import proposed
from shore.imports.job import ImportOptions, Job
from shore.imports.log_maker import Written
from shore.imports.recognise import RecordingKind, recognise
from shore.imports.run import imported
from shore.imports.several import JointImport, imported_together
from shore.logbook.session import trip_record
from shore.settings.station import FRAMES_ONLY, StationSettings, station_settings
from shore.terminal import every_end_is_ctrl_c, finish, say, tell

NO_FILTERS: Final = "none"


class Given(NamedTuple):
    """A FILE of the command line."""

    file: Path
    map: Path | None


def run(arguments: argparse.Namespace) -> int:
    """Import one file or several; the exit code. Raises WayfixError."""
    if arguments.guess:
        return _guess(arguments)
    *recordings, out = arguments.recording
    arguments.out = Path(out)
    if not recordings:
        raise WayfixError("is one path, and an import needs two", out, "give FILE and OUT.mcap, the log to write")
    given = [given_as(text) for text in recordings]
    if arguments.map is not None:
        if len(given) > 1 or given[0].map is not None:
            raise WayfixError("is for one FILE", "--map", "write each mapping behind its table, FILE:MAP.toml")
        given = [given[0]._replace(map=arguments.map)]
    _check_out(arguments.out, [path for each in given for path in each if path], count=len(given))
    options = _options(arguments, _settings(arguments))
    jobs = [_job(each, options, is_alone=len(given) == 1) for each in given]
    _check_options(arguments, jobs)
    try:
        with every_end_is_ctrl_c():
            return _one(arguments, jobs[0]) if len(jobs) == 1 else _several(arguments, JointImport(jobs, options))
    except KeyboardInterrupt:
        say(f"stopped; {arguments.out} was not written")
        return 0


def _guess(arguments: argparse.Namespace) -> int:
    """Print a mapping for a table."""
    if len(arguments.recording) > 1 or arguments.map is not None:
        raise WayfixError("is for one table without a mapping", "--guess", "give FILE alone")
    path = Path(arguments.recording[0])
    kind = recognise(path, has_map=True, is_serial=False)
    assert kind is RecordingKind.TABLE
    proposal = proposed(path, time.time())
    sys.stdout.write(proposal.text())
    for question, answers in proposal.questions.values():
        say(f"{path}: {question} Choose in the mapping: {' or '.join(answers)}")
    return 1 if proposal.questions else 0


def given_as(text: str) -> Given:
    """FILE or FILE:MAP.toml; a colon may also be part of either path, and what is there decides."""
    colons = [place for place, letter in enumerate(text) if letter == ":"]
    if os.path.lexists(text) or not text.endswith(".toml") or not colons:
        return Given(Path(text), None)
    place = next((place for place in colons if os.path.lexists(text[:place])), colons[-1])
    return Given(Path(text[:place]), Path(text[place + 1 :]))


def _job(given: Given, options: ImportOptions, *, is_alone: bool) -> Job:
    is_serial = is_alone and options.config is not None
    kind = recognise(given.file, has_map=given.map is not None, is_serial=is_serial, is_alone=is_alone)
    say(f"{given.file}: {kind}")
    # Of several, the configuration names the sensors of all together; what one of them says stays as it is.
    own = replace(options, map=given.map) if is_alone else replace(options, map=given.map, config=None)
    return Job(given.file, own, kind)


def _check_out(out: Path, inputs: Sequence[Path], *, count: int) -> None:
    check_target(out, inputs, "give another OUT")
    if os.path.lexists(out):
        cure = "give another OUT, or remove it first"
        if count > 1 and out.suffix != ".mcap":
            cure = "the last path is OUT.mcap, the log to write: give it behind the recordings"
        raise WayfixError("exists already", str(out), cure)


def _settings(arguments: argparse.Namespace) -> StationSettings:
    if (arguments.filters or "").strip() == NO_FILTERS:
        return FRAMES_ONLY
    return station_settings(arguments.settings, arguments.filters, arguments.step)


def _options(arguments: argparse.Namespace, settings: StationSettings) -> ImportOptions:
    return ImportOptions(
        settings=settings,
        trip=trip_record(arguments.name, arguments.place, arguments.note),
        config=arguments.config,
        port=arguments.port,
        vessel=arguments.vessel,
        lines_per_second=arguments.lines_per_second,
    )


def _check_options(arguments: argparse.Namespace, jobs: Sequence[Job]) -> None:
    if arguments.vessel is not None and not any(
        job.kind in (RecordingKind.SIGNALK, RecordingKind.SIGNALK_LOG) for job in jobs
    ):
        raise WayfixError("names a vessel of Signal K deltas", "--vessel", "leave it out")
    if len(jobs) == 1:
        _check_alone(arguments, jobs[0])
    elif arguments.port is not None:
        raise WayfixError("is for one FILE", "--port", "leave it out: --config names the sensors of several by role")
    elif arguments.lines_per_second is not None:
        cure = "leave it out: several are put together by their UTC"
        raise WayfixError("is for one recording without times", "--lines-per-second", cure)


def _check_alone(arguments: argparse.Namespace, job: Job) -> None:
    serial = job.kind in (RecordingKind.SERIAL, RecordingKind.SIGNALK_LOG)
    if job.kind is RecordingKind.FRAMES and (arguments.config or arguments.lines_per_second):
        raise WayfixError("is a frames file: sensors and times stand in it", str(job.source), "give no options")
    if arguments.port is not None and (not serial or arguments.config is None):
        cure = "give --config BOAT.toml too" if serial else "leave it out"
        raise WayfixError("names a port of a configuration, for serial recordings", "--port", cure)
    if arguments.lines_per_second is not None and job.kind is RecordingKind.TABLE:
        raise WayfixError("is for recordings without times", "--lines-per-second", "the mapping says where the time is")


def _one(arguments: argparse.Namespace, job: Job) -> int:
    """One recording: exit code 1 when less than half of it was used."""
    done, written = imported(job, arguments.out)
    _tell_accounts(job)
    summary = {**job.record(), **_made(written, arguments.out if done else None)}
    if done:
        _tell_log(arguments.out, written, job.options.settings.filter.names)
    else:
        say(f"{job.source}: nothing in it could be used, {arguments.out} was not written")
    too_little = [words for account in job.accounts if (words := account.too_little()) is not None]
    for words in too_little:
        say(f"{job.source}: {words}")
    finish(arguments, summary)
    return 0 if done and not too_little else 1


def _several(arguments: argparse.Namespace, trip: JointImport) -> int:
    written = imported_together(trip, arguments.out)
    for place, job in enumerate(trip.jobs):
        tell(f"{job.source}: {trip.brought[place].words()}")
        _tell_accounts(job)
    for note in trip.notes:
        say(note)
    _tell_log(arguments.out, written, trip.options.settings.filter.names)
    finish(arguments, {**trip.record(), **_made(written, arguments.out)})
    return 0


def _tell_accounts(job: Job) -> None:
    for account in job.accounts:
        for line in account.words():
            tell(line)
    for note in job.notes:
        say(note)


def _tell_log(out: Path, written: Written, filters: Sequence[str]) -> None:
    held = ", ".join(f"{name} {count}" for name, count in sorted(written.measurements.items()))
    began = _began(written) or "an unknown date"
    tell(f"{out}: {counted(written.frames, 'frame')}, {written.seconds:.1f} s from {began}: {held}")
    if filters:
        valid = f"position valid in {written.aligned['position']}, heading in {written.aligned['heading']}"
        tell(f"estimates of {', '.join(filters)}: {written.estimates.total()}; {valid}")
        if (why := written.why_not_aligned()) is not None:
            say(f"no {'heading' if written.aligned['position'] else 'estimate'} is valid: {why}")


def _began(written: Written) -> str | None:
    return None if written.utc_ns is None else datetime.fromtimestamp(written.utc_ns // NS_PER_S, UTC).isoformat()


def _made(written: Written, out: Path | None) -> dict[str, Any]:
    """What was made, for `--json`; out: `None` = no log."""
    return {
        "out": None if out is None else str(out),
        "frames": written.frames,
        "bad_frames": written.bad,
        "seconds": round(written.seconds, 3),
        "utc": _began(written),
        "measurements": dict(sorted(written.measurements.items())),
        "usable_fixes": written.usable_fixes,
        "estimates": dict(written.estimates),
        "aligned": written.aligned["whole"],
        "aligned_parts": {part: written.aligned[part] for part in ("position", "heading")},
        "why_not_aligned": written.why_not_aligned(),
        "events": dict(sorted(written.events.items())),
    }
