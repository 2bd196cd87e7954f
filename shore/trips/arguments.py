"""Command-line arguments of `wayfix log`, apart from the logbook itself: `wayfix --help` must not wait for mcap."""

import argparse
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from shore.logbook.trip_arguments import add_trip_arguments
from shore.terminal import add_json

LS: Final = (
    "List trips, newest first: from the end of each log, so it is quick; only logs that were cut are read whole."
)
INFO: Final = "What a log is and holds: trip, boat, sensors, filters, events, versions, damage."
VERIFY: Final = (
    "Check every chunk of logs: what is lost is named in time and bytes, and which frames never came over the link. "
    "Exit code 0 whole, 1 damaged or cut, 2 no log."
)
RECOVER: Final = (
    "Write all sound records of a log into a new file with an index, byte for byte, and compare what was written with "
    "the source. The source stays as it is."
)
NAME: Final = "Put a name, place or note to a trip afterwards. The log is replaced when the new one was read back."
CASE: Final = "Make a regression case of a log: its frames, and what a replay of them gives (tests/golden)."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The commands of the logbook; each sets `log_command`."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    listing = commands.add_parser("ls", help="one line for each trip", description=LS)
    listing.add_argument(
        "paths", nargs="*", type=Path, metavar="DIR|LOG", help="directories and logs (default: the working directory)"
    )
    _finish(listing, "ls")

    info = commands.add_parser("info", help="what a log is and holds", description=INFO)
    _add_log(info)
    info.add_argument("--config", action="store_true", help="the whole configuration of the boat too")
    _finish(info, "info")

    verify = commands.add_parser("verify", help="is it whole, and if not, what is lost", description=VERIFY)
    verify.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    _finish(verify, "verify")

    recover = commands.add_parser("recover", help="all sound records into a new file", description=RECOVER)
    _add_log(recover)
    recover.add_argument(
        "out", nargs="?", type=Path, metavar="OUT", help="a new file (default NAME-recovered.mcap beside it)"
    )
    add_trip_arguments(recover)
    _finish(recover, "recover")

    name = commands.add_parser("name", help="put a name to a trip", description=NAME)
    _add_log(name)
    add_trip_arguments(name)
    _finish(name, "name")

    if find_spec("shore.trips.golden_case") is not None:
        from shore.trips.golden_case import add_arguments as add_case

        case = commands.add_parser("case", help="make a regression case of it", description=CASE)
        add_case(case)
        case.set_defaults(log_command="case")


def _add_log(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG", help="a log, closed or not")


def _finish(parser: argparse.ArgumentParser, name: str) -> None:
    add_json(parser)
    parser.set_defaults(log_command=name)
