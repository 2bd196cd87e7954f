"""`wayfix` (command line): connect to a boat, replay a log, run the demo, the laboratory."""

import argparse
import logging
import os
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from common.command import Parser, number, run_command
from common.errors import WayfixError
from common.words import counted
from shore.exports.arguments import add_arguments as add_export_arguments
from shore.imports.arguments import add_arguments as add_import_arguments
from shore.lab.arguments import add_arguments as add_lab_arguments
from shore.link.boat_command import add_arguments as add_boat_arguments
from shore.link.pair_command import add_arguments as add_pair_arguments
from shore.live.command import add_arguments as add_connect_arguments
from shore.replay.command import add_arguments as add_replay_arguments
from shore.settings.command import add_arguments as add_settings_arguments
from shore.terminal import add_json, filters_named, finish, say
from shore.trips.arguments import add_arguments as add_log_arguments

# Five-by-five matrices get slower, and timings jump, when a linear algebra library starts threads for them.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

DEMO_FILTERS = "fuzzy,fuzzy-thesis,ukf,kf"


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code (0 done, 1 the answer is no, 2 wrong input or environment)."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="wayfix: %(message)s")
    return run_command("wayfix", "shore", lambda: int(arguments.command(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="wayfix", description="Wayfix ashore.")
    parser.add_argument("--version", action="version", version=f"wayfix {version('wayfix')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add(commands, "connect", "receive, filter and log a boat's frames", add_connect_arguments, _connect)
    _add(commands, "replay", "run a log through the filters again", add_replay_arguments, _replay)
    _add(commands, "log", "trips: list, look, check, mend, name", add_log_arguments, _log)
    _add(commands, "import", "make a log of a recording", add_import_arguments, _import)
    _add(commands, "export", "a log as CSV, GPX, KML, GeoJSON, NMEA, MCAP, Parquet, PNG", add_export_arguments, _export)
    _add_demo(commands)
    _add(commands, "lab", "scenarios x filters x runs", add_lab_arguments, _lab)
    _add(commands, "boat", "ask a boat's daemon: status, reopen, mark", add_boat_arguments, _boat)
    _add(commands, "pair", "learn a boat's key, once", add_pair_arguments, _pair)
    _add(commands, "settings", "what wayfix.toml sets, and the defaults", add_settings_arguments, _settings)
    return parser


def _add(commands: Any, name: str, words: str, add_arguments: Callable[[Any], None], run: Callable[[Any], int]) -> None:
    """A command whose arguments and work stand in modules of their own; the work is imported when it is wanted."""
    parser = commands.add_parser(name, help=words, description=run.__doc__)
    add_arguments(parser)
    parser.set_defaults(command=run)


def _add_demo(commands: Any) -> None:
    demo = commands.add_parser("demo", help="a whole boat on this machine", description=_demo.__doc__)
    demo.add_argument(
        "--scenario", default="5.3", help="one of `wayfix-onboard virtual --list` (default 5.3: noise grows at 300 s)"
    )
    demo.add_argument("--boat", type=Path, metavar="TOML", help="a boat's file: each of its sensors speaks")
    demo.add_argument("--recording", type=Path, metavar="CSV", help="play this recording instead of a scenario")
    demo.add_argument("--map", type=Path, metavar="TOML", help="columns of the recording (deploy/examples)")
    demo.add_argument("--seed", type=number(int, 0, 2**63), default=1, help="seed of all noise (default 1)")
    demo.add_argument(
        "--seconds", type=number(float, 1.0, 1e6), metavar="N", help="boat seconds to play (default: the whole mission)"
    )
    demo.add_argument(
        "--speed", type=number(float, 0.1, 100.0), default=8.0, metavar="X", help="boat seconds per second (default 8)"
    )
    demo.add_argument("--headless", action="store_true", help="no status line each second")
    demo.add_argument("--log", type=Path, metavar="DIR", help="where log and picture go (default: a new temporary one)")
    demo.add_argument(
        "--filters", default=DEMO_FILTERS, help=f"comma-separated, the first leads (default {DEMO_FILTERS})"
    )
    add_json(demo)
    demo.set_defaults(command=_demo)


def _connect(arguments: argparse.Namespace) -> int:
    """Join a boat, filter and log its frames until Ctrl-C, or M frames. Exit code 1 = fewer than M."""
    from shore.live.command import run

    return run(arguments)


def _demo(arguments: argparse.Namespace) -> int:
    """Start a virtual boat and the daemon, run the station on them, print a table and save a picture."""
    from shore.demo import Demo, DemoOptions
    from shore.report.score import score_table

    if (arguments.recording is None) != (arguments.map is None):
        raise WayfixError("--recording and --map go together", cure="give both (deploy/examples/blueboat-map.toml)")
    if arguments.recording is not None and arguments.boat is not None:
        raise WayfixError("belongs to a scenario", "--boat", "leave out the recording")
    options = DemoOptions(
        scenario=arguments.scenario,
        seed=arguments.seed,
        speed=arguments.speed,
        seconds=arguments.seconds,
        filters=filters_named(arguments.filters),
        log_dir=arguments.log,
        boat=arguments.boat,
        recording=arguments.recording,
        mapping=arguments.map,
        headless=arguments.headless,
    )
    summary = Demo(options, say).run()
    if summary is None:
        say("stopped before the first frame")
        return 0
    counts = summary["frames"]
    if "position_rms_m" not in summary:
        print(f"stopped after {counted(counts['received'], 'frame')}, {counts['lost']} lost")
        print(f"log     {summary['log']}")
        finish(arguments, summary)
        return 0
    print(f"frames: {counts['sent']} sent, {counts['received']} received, {counts['lost']} lost")
    print(score_table(summary))
    print(f"log     {summary['log']}")
    if "picture" in summary:
        print(f"picture {summary['picture']}")
    finish(arguments, summary)
    return 0 if counts["lost"] == 0 else 1


def _replay(arguments: argparse.Namespace) -> int:
    """Feed a log's frames to the filters again; compare with the recorded estimates and a reference.

    Where the arithmetic is that of the log (numpy, BLAS kernel, processor, C library), every bit must be equal;
    elsewhere estimates are compared within 1e-9. The exit code is 1 when they or the events differ.
    """
    from shore.replay.command import run

    return run(arguments)


def _log(arguments: argparse.Namespace) -> int:
    """The trips of a logbook. Cut and damaged logs are read; those being written are left alone."""
    from shore.trips.command import run

    return run(arguments)


def _import(arguments: argparse.Namespace) -> int:
    """Make a log of a recording: serial ones, CSV with a mapping, gpsd JSON, Signal K, GPX; told by its content."""
    from shore.imports.command import run

    return run(arguments)


def _export(arguments: argparse.Namespace) -> int:
    """Write the track of a log, with its events, for other programs."""
    from shore.exports.command import run

    return run(arguments)


def _pair(arguments: argparse.Namespace) -> int:
    """Pair with a boat by the code that `wayfix-onboard pair` shows on it."""
    from shore.link.pair_command import run

    return run(arguments)


def _boat(arguments: argparse.Namespace) -> int:
    """Ask a boat's daemon for something; it is an event in every log. Needs the right `command` (docs/security.md)."""
    from shore.link.boat_command import run

    return run(arguments)


def _settings(arguments: argparse.Namespace) -> int:
    """The station's settings as a wayfix.toml holds them, each with its source: default, file, command line."""
    from shore.settings.command import run

    return run(arguments)


def _lab(arguments: argparse.Namespace) -> int:
    """Simulated scenarios x filters x runs, beside the thesis' published tables and the bound of the possible."""
    from shore.lab.command import run

    return run(arguments)


if __name__ == "__main__":
    raise SystemExit(main())
