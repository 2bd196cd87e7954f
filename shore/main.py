"""`wayfix`: connect to a boat, replay a log, run the demo, the laboratory."""

import argparse
import json
import logging
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from common.command import number, run_command
from common.errors import LinkError, WayfixError
from common.session import MAX_PERIOD_S, MAX_RUN_FRAMES, MIN_PERIOD_S
from shore.lab.arguments import add_arguments

# Five-by-five matrices get slower, and timings jump, when a linear algebra library starts threads for them.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

DEFAULT_FILTERS = "fuzzy"
DEMO_FILTERS = "fuzzy,fuzzy-thesis,ukf,kf"


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code (0 done, 1 the answer is no, 2 wrong input or environment)."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(level=logging.WARNING, format="wayfix: %(message)s")
    return run_command("wayfix", "shore", lambda: int(arguments.command(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="wayfix", description="Wayfix ashore.")
    parser.add_argument("--version", action="version", version=f"wayfix {version('wayfix')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_connect(commands)
    _add_replay(commands)
    _add_demo(commands)
    lab = commands.add_parser("lab", help="scenarios x filters x runs", description=_lab.__doc__)
    add_arguments(lab)
    lab.set_defaults(command=_lab)
    return parser


def _add_connect(commands: Any) -> None:
    connect = commands.add_parser(
        "connect", help="receive, filter and log a boat's frames", description=_connect.__doc__
    )
    connect.add_argument("address", help="HOST or HOST:PORT of the boat, like 10.0.0.1:5760")
    connect.add_argument(
        "--frames",
        type=number(int, 1, MAX_RUN_FRAMES),
        metavar="M",
        help="receive exactly M frames, then end (the thesis' mode)",
    )
    connect.add_argument(
        "--period",
        type=number(float, MIN_PERIOD_S, MAX_PERIOD_S),
        metavar="SECONDS",
        help="length of a frame with --frames (default 1)",
    )
    connect.add_argument("--log", type=Path, metavar="DIR", help="write a log into this directory")
    _add_filter_arguments(connect, DEFAULT_FILTERS)
    _add_json(connect)
    connect.set_defaults(command=_connect)


def _add_replay(commands: Any) -> None:
    replay = commands.add_parser("replay", help="run a log through the filters again", description=_replay.__doc__)
    replay.add_argument("log", type=Path, help="a log of `wayfix connect` or `wayfix demo`")
    replay.add_argument(
        "--reference", type=Path, metavar="FILE", help="CSV t_s,lat_deg,lon_deg,heading_true_deg[,t_ns]"
    )
    replay.add_argument(
        "--order",
        choices=("arrival", "time"),
        default="arrival",
        help="arrival: as live (default); time: by the boat's clock, late frames in their place, the best track",
    )
    replay.add_argument(
        "--smooth",
        type=Path,
        metavar="OUT.csv",
        help="write the first filter's smoothed track: every estimate knows the whole log",
    )
    _add_filter_arguments(replay, None)
    _add_json(replay)
    replay.set_defaults(command=_replay)


def _add_demo(commands: Any) -> None:
    demo = commands.add_parser("demo", help="a whole boat on this machine", description=_demo.__doc__)
    demo.add_argument("--scenario", default="5.3", help="one of `wayfix lab list` (default 5.3: noise grows at 300 s)")
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
    _add_json(demo)
    demo.set_defaults(command=_demo)


def _connect(arguments: argparse.Namespace) -> int:
    """Join a boat, filter and log its frames until Ctrl-C, the board's end, or M frames. Exit code 1 = fewer than M."""
    from shore.link import Link
    from shore.live import LiveRun, Options, StopFlag

    if arguments.period is not None and arguments.frames is None:
        raise WayfixError("--period needs --frames", cure="give --frames M too, or leave --period out")
    period_s = 1.0 if arguments.frames is not None and arguments.period is None else arguments.period
    filters = _filters(arguments.filters)
    options = Options(filters, arguments.frames, period_s, arguments.step, arguments.log)
    link = Link(arguments.address)
    with StopFlag().on_signals() as stop:
        try:
            live = LiveRun(link, options, stop, _say)
            tally = live.run()
        except LinkError:
            if stop():  # Ctrl-C while nobody had answered yet
                return 0
            raise
        finally:
            link.close()
    counts = {"received": tally.received, "missing": tally.missing}
    _finish(arguments, {"frames": counts, "log": str(live.log_path) if live.log_path else None})
    if tally.end_reason is not None:
        _say(f"the boat ended the session after {tally.sent} frames: {tally.end_reason}")
    if options.frames is not None and tally.received < options.frames and not stop():
        _say(f"only {tally.received} of {options.frames} frames were received")
        return 1
    return 0


def _replay(arguments: argparse.Namespace) -> int:
    """Feed a log's frames to the filters again; compare with the recorded estimates and a reference."""
    from shore.navigation.timeline import HORIZON_S
    from shore.replay import replay, smoothed
    from shore.score import score_of, score_table
    from shore.smooth import check_target, write_track

    filters = _filters(arguments.filters) if arguments.filters else None
    progress = _progress if sys.stderr and sys.stderr.isatty() else None
    if arguments.smooth:
        check_target(arguments.smooth, [path for path in (arguments.log, arguments.reference) if path])
    result = replay(arguments.log, filters, arguments.step, arguments.order, progress)
    if not result.frames:
        damage = f" ({result.damage})" if result.damage else ""
        raise WayfixError(f"holds no frame{damage}", str(arguments.log), "give a log with frames in it")
    summary: dict[str, Any] = {
        "order": result.order,
        "frames": {"read": len(result.frames), "bad": result.bad_frames, "late": result.late_frames},
        "estimates": {"made": len(result.estimates), "recorded": result.recorded, "equal": result.equal},
    }
    print(f"{arguments.log}: {len(result.frames)} frames, filters {', '.join(result.filters)}")
    if result.order == "time":
        print("in order of boat time, late frames in their place: the best track, not what was seen live")
    elif result.late_frames:
        print(f"{result.late_frames} frames came more than {HORIZON_S:g} s late; --order time puts them in their place")
    if arguments.step is not None and not result.recorded:
        print("estimates are not compared with the recorded ones: the step is another")
    if result.recorded:
        print(f"estimates equal to the recorded ones: {result.equal} of {result.recorded}")
    if result.damage:
        _say(f"{arguments.log}: {result.damage}; everything before the damage was replayed")
    estimates = result.estimates
    if arguments.smooth:
        track = smoothed(arguments.log, result.filters[0])
        write_track(arguments.smooth, track)
        summary["smoothed"] = {"estimates": len(track), "file": str(arguments.smooth)}
        print(f"{len(track)} smoothed estimates of {result.filters[0]} in {arguments.smooth}")
        estimates = [*estimates, *(estimate.as_record() for estimate in track)]
    if arguments.reference:
        scores = score_of(arguments.reference, result.config, result.frames, estimates).summary()
        summary.update(scores)
        print(score_table(scores))
    _finish(arguments, summary)
    return 0


def _demo(arguments: argparse.Namespace) -> int:
    """Start a virtual boat and the daemon, run the station on them, print a table and save a picture."""
    from shore.demo import Demo, DemoOptions
    from shore.score import score_table

    if (arguments.recording is None) != (arguments.map is None):
        raise WayfixError("--recording and --map go together", cure="give both (deploy/examples/blueboat-map.toml)")
    options = DemoOptions(
        scenario=arguments.scenario,
        seed=arguments.seed,
        speed=arguments.speed,
        seconds=arguments.seconds,
        filters=_filters(arguments.filters),
        log_dir=arguments.log,
        recording=arguments.recording,
        mapping=arguments.map,
        headless=arguments.headless,
    )
    summary = Demo(options, _say).run()
    if summary is None:
        _say("stopped before the first frame")
        return 0
    counts = summary["frames"]
    if "position_rms_m" not in summary:
        print(f"stopped after {counts['received']} frames, {counts['lost']} lost")
        print(f"log     {summary['log']}")
        _finish(arguments, summary)
        return 0
    print(f"frames: {counts['sent']} sent, {counts['received']} received, {counts['lost']} lost")
    print(score_table(summary))
    print(f"log     {summary['log']}")
    if "picture" in summary:
        print(f"picture {summary['picture']}")
    _finish(arguments, summary)
    return 0 if counts["lost"] == 0 else 1


def _lab(arguments: argparse.Namespace) -> int:
    """Simulated scenarios x filters x runs, beside the thesis' published tables and the bound of the possible."""
    from shore.lab.command import run

    return run(arguments)


def _add_filter_arguments(parser: argparse.ArgumentParser, default: str | None) -> None:
    shown = default or "those of the live run"
    parser.add_argument("--filters", default=default, help=f"comma-separated, the first leads (default {shown})")
    parser.add_argument(
        "--step",
        type=number(float, 0.05, 60.0),
        metavar="SECONDS",
        help="synchronous steps (the thesis' Fig. 3.14), 0.05 to 60",
    )


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="last line of stdout is one JSON object")


def _filters(text: str) -> tuple[str, ...]:
    """`a,b,c` -> names, checked before anything is started."""
    from shore.navigation.filters import REGISTRY

    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    for name in names or ("",):
        if name not in REGISTRY:
            raise WayfixError(f"unknown filter {name!r}", "--filters", f"use one or more of {', '.join(REGISTRY)}")
    return names


def _finish(arguments: argparse.Namespace, summary: dict[str, Any]) -> None:
    if arguments.json:
        print(json.dumps(summary), flush=True)


def _say(line: str) -> None:
    """One line for the person; a terminal that is gone or full never ends a run."""
    with suppress(OSError, ValueError):
        print(line, file=sys.stderr, flush=True)


def _progress(frames: Any) -> Any:
    from rich.console import Console
    from rich.progress import track

    return track(frames, description="replaying", console=Console(stderr=True), total=None)


if __name__ == "__main__":
    raise SystemExit(main())
