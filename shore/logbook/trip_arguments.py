"""Trip metadata arguments (name, place, note), the same on every command that writes a log."""

import argparse


def add_trip_arguments(parser: argparse.ArgumentParser) -> None:
    """`--name`, `--place`, `--note`."""
    parser.add_argument("--name", help="what the trip is called, kept in the log")
    parser.add_argument("--place", help="where it was")
    parser.add_argument("--note", help="anything worth knowing about it")
