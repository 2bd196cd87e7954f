"""`wayfix import` (command line): arguments in, and at the end a summary of what was taken and made."""

import argparse
import os
from datetime import UTC, datetime
from typing import Any, Final

from common.atomic_file import check_target
from common.errors import WayfixError
from common.units import NS_PER_S
from shore.imports.log_maker import Written
from shore.imports.recognise import RecordingKind, recognise
from shore.imports.run import ImportOptions, Job, imported
from shore.logbook.session import trip_record
from shore.settings.station import FRAMES_ONLY, StationSettings, station_settings
from shore.terminal import every_end_is_ctrl_c, finish, say, tell

NO_FILTERS: Final = "none"


def run(arguments: argparse.Namespace) -> int:
    """Import a file; the exit code. Raises WayfixError."""
    check_target(arguments.out, [path for path in (arguments.recording, arguments.map) if path], "give another OUT")
    if os.path.lexists(arguments.out):
        raise WayfixError("exists already", str(arguments.out), "give another OUT, or remove it first")
    settings = _settings(arguments)
    kind = recognise(arguments.recording, has_map=arguments.map is not None, is_serial=arguments.config is not None)
    _check_options(arguments, kind)
    say(f"{arguments.recording}: {kind}")
    job = Job(arguments.recording, arguments.out, _options(arguments, settings), kind)
    try:
        with every_end_is_ctrl_c():
            done, written = imported(job)
    except KeyboardInterrupt:
        say(f"stopped; {job.out} was not written")
        return 0
    finish(arguments, _told(job, written, is_written=done))
    return 0 if done else 1


def _settings(arguments: argparse.Namespace) -> StationSettings:
    if (arguments.filters or "").strip() == NO_FILTERS:
        return FRAMES_ONLY
    return station_settings(arguments.settings, arguments.filters, arguments.step)


def _options(arguments: argparse.Namespace, settings: StationSettings) -> ImportOptions:
    return ImportOptions(
        settings=settings,
        trip=trip_record(arguments.name, arguments.place, arguments.note),
        map=arguments.map,
        config=arguments.config,
        port=arguments.port,
        vessel=arguments.vessel,
        lines_per_second=arguments.lines_per_second,
    )


def _check_options(arguments: argparse.Namespace, kind: RecordingKind) -> None:
    serial = kind in (RecordingKind.SERIAL, RecordingKind.SIGNALK_LOG)
    if kind is RecordingKind.FRAMES and (arguments.config or arguments.lines_per_second):
        raise WayfixError(
            "is a frames file: sensors and times stand in it", str(arguments.recording), "give no options"
        )
    if arguments.port is not None and (not serial or arguments.config is None):
        cure = "give --config BOAT.toml too" if serial else "leave it out"
        raise WayfixError("names a port of a configuration, for serial recordings", "--port", cure)
    if arguments.vessel is not None and kind not in (RecordingKind.SIGNALK, RecordingKind.SIGNALK_LOG):
        raise WayfixError("names a vessel of Signal K deltas", "--vessel", "leave it out")
    if arguments.lines_per_second is not None and kind is RecordingKind.TABLE:
        raise WayfixError("is for recordings without times", "--lines-per-second", "the mapping says where the time is")


def _told(job: Job, written: Written, *, is_written: bool) -> dict[str, Any]:
    """Say what was taken and made; the same for `--json`."""
    for account in job.accounts:
        for line in account.words():
            tell(line)
    for note in job.notes:
        say(note)
    began = None if written.utc_ns is None else datetime.fromtimestamp(written.utc_ns // NS_PER_S, UTC).isoformat()
    summary = {
        **job.record(),
        "out": str(job.out) if is_written else None,
        "frames": written.frames,
        "bad_frames": written.bad,
        "seconds": round(written.seconds, 3),
        "utc": began,
        "measurements": dict(sorted(written.measurements.items())),
        "usable_fixes": written.usable_fixes,
        "estimates": dict(written.estimates),
        "aligned": written.aligned,
        "events": dict(sorted(written.events.items())),
    }
    if is_written:
        held = ", ".join(f"{name} {count}" for name, count in sorted(written.measurements.items()))
        tell(f"{job.out}: {written.frames} frames, {written.seconds:.1f} s from {began or 'an unknown date'}: {held}")
        if filters := job.options.settings.filter.names:
            tell(f"estimates of {', '.join(filters)}: {written.estimates.total()}; aligned {written.aligned}")
    else:
        say(f"{job.source}: nothing in it could be used, {job.out} was not written")
    return summary
