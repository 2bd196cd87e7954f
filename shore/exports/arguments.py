"""Command-line arguments of `wayfix export`."""

import argparse
from typing import Final

from common.command import number
from shore.exports.formats import FORMATS, Format

ORDERS: Final = ("recorded", "time")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix export`; `shore.exports.command` takes them."""
    logs = "a log of `wayfix connect`, `import` or `replay --record`, or a directory: its newest trip"
    parser.add_argument("log", metavar="LOG", help=logs)
    parser.add_argument("out", metavar="OUT", help="new file; csv and parquet: or a directory (DIR/) for all tables")
    parser.add_argument(
        "--to",
        choices=FORMATS,
        metavar="FORMAT",
        help=f"{', '.join(f'{name}{_remark(kind)}' for name, kind in FORMATS.items())} (default: as OUT ends)",
    )
    parser.add_argument(
        "--filter",
        metavar="NAME",
        help="whose estimates (default: the live run's first); raw = the first GPS as it came",
    )
    parser.add_argument(
        "--order",
        choices=ORDERS,
        default="recorded",
        help="recorded: as published live (default); time: filtered again in order of boat time, the best track",
    )
    parser.add_argument(
        "--every", type=number(float, 0.001, 86_400.0), metavar="SECONDS", help="one row in so many (default: all)"
    )
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace OUT when it is of ours and of the same kind (parquet: anybody's)",
    )
    parser.add_argument("--json", action="store_true", help="last line of stdout is one JSON object")


def _remark(kind: Format) -> str:
    """What a person has to know before choosing it."""
    if kind.extra is not None:
        return f" (extra {kind.extra})"
    return f" (for {kind.used_by})" if kind.used_by is not None else ""
