"""Command-line arguments of `wayfix lab`, apart from the laboratory itself: `wayfix --help` must not wait for numpy."""

import argparse
import os
from pathlib import Path
from typing import Final

from common.command import number

PROFILES: Final = ("stated", "compat")
DEFAULT_FILTERS: Final = "kf,ukf,fuzzy-thesis,fuzzy,oracle"
RUN: Final = "Run filters over many simulated runs of scenarios; the same noise for all filters of a call."
THESIS: Final = "Make all tables and figures of chapters 4 and 5 again: one HTML page, and the same as JSON beside it."
DEFAULT_RUNS: Final = 200
LEAST_RUNS: Final = 2
MOST_RUNS: Final = 10_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The three commands of the laboratory; each sets `lab`."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    listing = commands.add_parser(
        "list", help="scenarios and filters", description="List the scenarios and the filters."
    )
    listing.set_defaults(lab="list")

    running = commands.add_parser("run", help="scenarios x filters x runs", description=RUN)
    running.add_argument("scenario", nargs="+", help="names of `wayfix lab list`")
    running.add_argument("--filters", default=DEFAULT_FILTERS, help=f"comma-separated (default {DEFAULT_FILTERS})")
    running.add_argument(
        "--profile",
        choices=PROFILES,
        default="stated",
        help="stated: what the tables say, random start; compat: what explains the published figures (default stated)",
    )
    _add_common(running)
    running.add_argument(
        "--json",
        action="store_true",
        help="stdout is one JSON object a line, one for each scenario; tables go to stderr; ci95 is [low, high], "
        "ratio_to_oracle is taken with the method that reference names",
    )
    running.add_argument("--plots", type=directory, metavar="DIR", help="write pictures into this directory")
    running.set_defaults(lab="run")

    thesis = commands.add_parser("thesis", help="chapters 4 and 5 on one page", description=THESIS)
    thesis.add_argument("--out", type=directory, default=Path("thesis-out"), metavar="DIR", help="default thesis-out")
    _add_common(thesis)
    thesis.set_defaults(lab="thesis")


def _add_common(parser: argparse.ArgumentParser) -> None:
    workers = default_workers()
    runs = number(int, LEAST_RUNS, MOST_RUNS)
    parser.add_argument("--runs", type=runs, default=DEFAULT_RUNS, metavar="N", help=f"default {DEFAULT_RUNS}")
    parser.add_argument("--seed", type=number(int, 0, 2**63), default=1, metavar="S", help="of all noise (default 1)")
    parser.add_argument(
        "--workers",
        type=number(int, 1, 256),
        default=workers,
        metavar="W",
        help=f"processes; figures do not depend on it (default {workers}, one a core)",
    )


def directory(text: str) -> Path:
    """An argparse type: a path that is not empty, which would be the working directory."""
    if not text.strip():
        raise argparse.ArgumentTypeError("must be a directory, got an empty name")
    return Path(text)


def default_workers() -> int:
    """One for each core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
