"""`wayfix log` (command line): arguments in, tables, sentences and one line of JSON out."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from common.command import printable, sentence_of
from common.errors import WayfixError
from common.words import counted
from shore.logbook.mcap.damage import iso
from shore.logbook.mcap.scan import Scan
from shore.logbook.session import trip_record
from shore.terminal import every_end_is_ctrl_c, finish, say, tell
from shore.trips import tables as screens
from shore.trips.examine import Examination, examine
from shore.trips.listing import date_of, logs_in, newest_first, trip_of
from shore.trips.recover import Rewritten, name_log, recover

STATES_WITHOUT_LOSS: Final = ("whole", "being written")


def run(arguments: argparse.Namespace) -> int:
    """One of the commands; returns the exit code."""
    commands: dict[str, Callable[[argparse.Namespace], int]] = {
        "ls": run_ls,
        "info": run_info,
        "verify": run_verify,
        "recover": run_recover,
        "name": run_name,
        "case": run_case,
    }
    with every_end_is_ctrl_c():
        return commands[arguments.log_command](arguments)


def run_ls(arguments: argparse.Namespace) -> int:
    """One row for each trip, newest first."""
    paths = logs_in(arguments.paths or [Path()])
    with _progress() as shown:
        trips = newest_first(trip_of(path, shown(path.name)) for path in paths)
    screens.show(screens.trips_table(trips, screens.width_of_stdout()))
    finish(arguments, {"trips": [trip.as_record() for trip in trips]})
    return 0


def run_info(arguments: argparse.Namespace) -> int:
    """What a log is and holds."""
    with _progress() as shown:
        result = examine(arguments.log, shown(arguments.log.name))
    screens.show(screens.info_screen(result, with_config=arguments.config))
    finish(arguments, _info(result, with_config=arguments.config))
    return 0


def run_verify(arguments: argparse.Namespace) -> int:
    """Check logs; 0 = all whole, 1 = something is lost or damaged, 2 = something is no log."""
    reports: list[dict[str, Any]] = []
    code = 0
    for path in arguments.logs:
        try:
            with _progress() as shown:
                result = examine(path, shown(path.name), check_index=True)
        except WayfixError as error:
            say(f"wayfix: {sentence_of(error)}")
            reports.append({"log": str(path), "state": "no log", "why": error.what})
            code = 2
            continue
        is_sound = result.state in STATES_WITHOUT_LOSS and not result.reader.losses
        code = max(code, 0 if is_sound else 1)
        reports.append(_report(result))
        screens.show(screens.verify_screen(result))
    finish(arguments, {"logs": reports})
    return code


def run_recover(arguments: argparse.Namespace) -> int:
    """All sound records into a new file."""
    trip = trip_record(arguments.name, arguments.place, arguments.note)
    with _progress() as shown:
        done = recover(arguments.log, arguments.out, trip, _phases(shown))
    result = done.source
    told = (
        f"{done.path}: {counted(done.records, 'record')}, read back and equal to what is sound in {arguments.log.name}"
    )
    tell(printable(told))
    _tell_losses(result)
    finish(arguments, {"log": str(done.path), "records": done.records, "source": _report(result)})
    return 0


def run_name(arguments: argparse.Namespace) -> int:
    """Put a name to a trip."""
    trip = trip_record(arguments.name, arguments.place, arguments.note)
    if trip is None:
        raise WayfixError("nothing to write", str(arguments.log), "give --name, --place or --note")
    with _progress() as shown:
        done: Rewritten = name_log(arguments.log, trip, _phases(shown))
    words = ", ".join(str(value) for key, value in trip.items() if key != "kind")
    tell(printable(f"{arguments.log}: {words}"))
    finish(arguments, {"log": str(arguments.log), "records": done.records, "trip": trip})
    return 0


def run_case(arguments: argparse.Namespace) -> int:
    """Make a regression case of a log."""
    from shore.trips import golden_case as case

    return case.run(arguments)


def _tell_losses(result: Examination) -> None:
    if not result.reader.losses:
        tell("nothing was lost")
    for harm in (*result.reader.losses, *result.reader.flaws):
        tell(str(harm))


def _report(result: Examination) -> dict[str, Any]:
    """`log verify` of one log, for JSON."""
    reader = result.reader
    return {
        "log": str(reader.path),
        "state": result.state,
        "losses": [loss.as_record() for loss in reader.losses],
        "flaws": [flaw.as_record() for flaw in reader.flaws],
        "summary_differs": result.words_differ,
        "chunks": {"sound": result.chunks, "with_checksum": result.checked},
        "records": dict(sorted(result.counts.items())),
        "not_understood": dict(sorted(result.not_understood.items())),
        "frames": {"count": result.census.count, **result.holes._asdict()},
    }


def _info(result: Examination, *, with_config: bool) -> dict[str, Any]:
    """`log info`, for JSON."""
    start = result.starts[-1] if result.starts else {}
    connected = start.get("connected") or {}
    config = connected.get("config") or {}
    trip = result.summary()
    about = {
        "trip": trip,
        "start_utc": date_of(trip["utc_ns"]),
        "end_utc": date_of(result.last_ns if trip.get("end_utc_ns") is None else trip["end_utc_ns"]),
        "sensors": config.get("sensor", []),
        "versions": {"station": start.get("versions"), "board": connected.get("versions")},
        "arithmetic": start.get("arithmetic"),
        "options": start.get("options"),
        "why_no_estimates": None if result.summary().get("filters") else screens.why_no_estimates(result),
        "warnings": [{"utc": iso(log_time_ns), **event} for log_time_ns, event in result.warnings],
    }
    return {**_report(result), **about, **({"config": config} if with_config else {})}


def _phases(shown: Callable[[str], Callable[[Scan], None]]) -> Callable[[str, Scan], None]:
    """The phases of a longer work."""
    bars: dict[str, Callable[[Scan], None]] = {}

    def watch(phase: str, scan: Scan) -> None:
        if phase not in bars:
            bars[phase] = shown(phase)
        bars[phase](scan)

    return watch


@contextmanager
def _progress() -> Iterator[Callable[[str], Callable[[Scan], None]]]:
    """A bar on a terminal's stderr, for one thing after the other: asked for by name, then fed scans."""
    if not (sys.stderr and sys.stderr.isatty()):
        yield lambda _name: lambda _scan: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        job = bar.add_task("", visible=False)

        def begun(name: str) -> Callable[[Scan], None]:
            def watch(scan: Scan) -> None:
                bar.update(job, description=name, total=scan.size, completed=scan.at, visible=True)

            return watch

        yield begun
