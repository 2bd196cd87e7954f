"""`wayfix-onboard` (command line): run the daemon, check a configuration, play a virtual boat, convert a recording."""

import argparse
import logging
import os
from collections.abc import Sequence
from importlib.metadata import version

from common.command import Parser, run_command
from onboard.notify import log_handler, program_name


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code (0 done, 1 the answer is no, 2 wrong input or environment)."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(level=logging.DEBUG if arguments.verbose else logging.INFO, handlers=[log_handler(os.environ)])
    return run_command(program_name(os.environ), "onboard", lambda: int(arguments.command(arguments)))


def _parser() -> argparse.ArgumentParser:
    """Every command brings its own arguments; what is heavy it imports when it is run."""
    from onboard import check, listen, run
    from onboard.control import command as control
    from onboard.recorded import command as convert
    from onboard.spool import command as spool
    from onboard.virtual import command as virtual

    parser = Parser(prog="wayfix-onboard", description="Wayfix on the boat.")
    parser.add_argument("-v", "--verbose", action="store_true", help="log details too")
    parser.add_argument("--version", action="version", version=f"wayfix {version('wayfix')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for module in (run, check, listen, convert, virtual, control, spool):
        module.add_arguments(commands)
    return parser
