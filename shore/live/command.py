"""`wayfix connect` (command line): joins a boat, which is looked for when no address is given."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Final

from common.command import number
from common.errors import LinkError, NoAnswerError, WayfixError
from common.link_messages import MAX_PERIOD_S, MAX_RUN_FRAMES, MIN_PERIOD_S
from common.words import counted
from shore.link.choose_boat import Seeker, add_meeting_arguments, link_to, looker, meet
from shore.logbook.trip_arguments import add_trip_arguments
from shore.settings.arguments import add_filter_arguments, add_settings
from shore.terminal import add_json, finish, say, tell

if TYPE_CHECKING:
    from shore.link.known_boats import Boats
    from shore.live.run import LiveRun, Options
    from shore.live.tally import Tally

WAIT_S: Final = 30.0
"""Time-out of one greeting with --wait, s: over a bad radio it takes long."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix connect`."""
    parser.add_argument(
        "--frames",
        type=number(int, 1, MAX_RUN_FRAMES),
        metavar="M",
        help="receive exactly M frames, then end (the thesis' mode)",
    )
    parser.add_argument(
        "--period",
        type=number(float, MIN_PERIOD_S, MAX_PERIOD_S),
        metavar="SECONDS",
        help="length of a frame with --frames (default 1)",
    )
    add_meeting_arguments(parser)
    parser.add_argument(
        "--wait",
        action="store_true",
        help="wait for a boat that does not answer yet, until Ctrl-C",
    )
    kept = parser.add_mutually_exclusive_group()
    kept.add_argument("--log", metavar="DIR", help="directory of the logs (default: that of the settings, else logs)")
    kept.add_argument("--no-log", dest="log", action="store_const", const="", help="keep no log")
    add_trip_arguments(parser)
    add_settings(parser)
    add_filter_arguments(parser, "those of the settings, else fuzzy")
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run a live session. Exit code 1 = fewer frames than asked for, lost frames, a log that ended before the run."""
    from shore.link.known_boats import Boats

    options = _options(arguments)
    boats = Boats(arguments.keys)
    while True:
        try:
            return _joined(arguments, options, boats)
        except NoAnswerError as error:
            if not arguments.wait:
                raise
            say(f"{error.where + ': ' if error.where else ''}{error.what}; trying again (--wait)")


def _joined(arguments: argparse.Namespace, options: "Options", boats: "Boats") -> int:
    from shore.live.earlier_trips import complete_trips
    from shore.live.run import LiveRun
    from shore.live.stop_flag import StopFlag

    address, boat = meet(arguments, boats)
    link = link_to(address, boat, boats)
    seeker = Seeker(looker(boat, boats)) if boat is not None and arguments.address is None else None
    with StopFlag().on_signals() as stop:
        try:
            live = LiveRun(link, options, stop, say, seeker)
            if boat is not None:
                boats.remember(boat.boat_id, boat.public_key, address)
            tally = live.run()
        except LinkError:
            if stop():  # Ctrl-C while no board had answered yet
                return 0
            raise
        finally:
            link.close()
    if live.log_path is not None:
        complete_trips(live.log_path.parent, say)
    for line in live.account.lines():
        tell(line)
    tell(_log_line(live))
    for hole in tally.holes.sentences():
        tell(f"frames  {hole}")
    counts = {"received": tally.received, "missing": tally.missing, "lost": tally.lost}
    fault = None if live.log_fault is None else str(live.log_fault)
    if fault is not None:
        say(f"the log ended before the run: {fault}; the next `wayfix connect` fetches what it lacks")
    log = str(live.log_path) if live.log_path else None
    finish(arguments, {"frames": counts, "log": log, "log_fault": fault, "trip": live.account.as_record()})
    return _exit_code(tally, options, is_stopped=stop()) or int(fault is not None)


def _log_line(live: "LiveRun") -> str:
    """Where the log is."""
    return "log     none was kept (--log DIR keeps one)" if live.log_path is None else f"log     {live.log_path}"


def _options(arguments: argparse.Namespace) -> "Options":
    from shore.link.link import CONNECT_TIMEOUT_S
    from shore.live.run import Options
    from shore.logbook.session import trip_record
    from shore.settings.station import station_settings

    if arguments.period is not None and arguments.frames is None:
        raise WayfixError("--period needs --frames", cure="give --frames M too, or leave --period out")
    period_s = 1.0 if arguments.frames is not None and arguments.period is None else arguments.period
    settings = station_settings(arguments.settings, arguments.filters, arguments.step, arguments.log)
    directory = Path(settings.log.directory).expanduser() if settings.log.directory else None
    trip = trip_record(arguments.name, arguments.place, arguments.note)
    if trip is not None and directory is None:
        raise WayfixError("a name, place or note is kept in a log", "--name", "give --log DIR too")
    connect_s = WAIT_S if arguments.wait else CONNECT_TIMEOUT_S
    return Options(settings, arguments.frames, period_s, directory, trip, connect_s)


def _exit_code(tally: "Tally", options: "Options", *, is_stopped: bool) -> int:
    if tally.end_reason is not None:
        say(f"the boat ended the session after {counted(tally.received, 'frame')}: {tally.end_reason}")
    if options.frames is not None and tally.received < options.frames and not is_stopped:
        say(f"only {tally.received} of {counted(options.frames, 'frame')} were received")
        return 1
    return int(tally.holes.for_good)
