"""Command-line arguments of `wayfix import`, apart from the work: `wayfix --help` must not wait for numpy."""

import argparse
from pathlib import Path
from typing import Final

from common.command import number
from shore.logbook.trip_arguments import add_trip_arguments
from shore.settings.arguments import add_filter_arguments, add_settings
from shore.terminal import add_json

DESCRIPTION: Final = (
    "Make a log of a recording: NMEA and other serial recordings (up to 128 MiB), frames files, gpsd JSON, Signal K "
    "deltas and server logs, GPX tracks, CSV with a mapping (docs/mapping.md). Told by its content. Exit code 1: less "
    "than half of it could be used; the reasons are printed. Several recordings of one trip become one log by their "
    "UTC, with breaks up to half an hour (docs/log-format.md)."
)
EXAMPLE: Final = "Example: wayfix import gps.nmea imu.csv:imu-map.toml trip.mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """FILE, OUT and options."""
    parser.description, parser.epilog = DESCRIPTION, EXAMPLE
    parser.usage = "%(prog)s [options] FILE [FILE ...] OUT.mcap\n       %(prog)s --guess FILE"
    parser.add_argument(
        "recording",
        metavar="FILE",
        nargs="+",
        help="what to import, and last OUT.mcap, the log to write (never over another); FILE:MAP.toml is a table "
        "and its mapping; the sensors of a role are numbered in the order of the FILEs",
    )
    parser.add_argument(
        "--guess", action="store_true", help="propose a mapping for the table FILE: TOML on stdout, nothing is written"
    )
    parser.add_argument(
        "--map", type=Path, metavar="MAP.toml", help="which column of a CSV is what (deploy/examples/*-map.toml)"
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="BOAT.toml",
        help="whose sensors they are (default: those found in FILE); of several FILEs, by role in the order of both",
    )
    parser.add_argument(
        "--vessel", metavar="NAME", help="whose deltas of a Signal K FILE, by context, URN or MMSI (default: its own)"
    )
    parser.add_argument("--port", metavar="NAME", help="[[port]] of --config that a serial FILE is a recording of")
    parser.add_argument(
        "--lines-per-second",
        type=number(float, 0.001, 100_000.0),
        metavar="X",
        help="pace of a recording without times inside (default: as fast as the baud rate; JSON: one a second)",
    )
    add_settings(parser, ": [filter]", boat_is_config=True)
    add_filter_arguments(parser, "those of the settings, else fuzzy", "; none = frames only")
    add_trip_arguments(parser)
    add_json(parser)
