"""`wayfix-onboard virtual`: play a scenario or a recording through pseudo-terminals that a daemon can open.

Playing NMEA recordings (`player`) needs no numpy: a board can do it. Voyages need it.
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from common.clock import BoatClock
from common.command import number
from common.errors import WayfixError
from common.units import NS_PER_MS
from common.words import how_to_install
from onboard.virtual.boat import LEAD_NS, VirtualBoat
from onboard.virtual.config_file import config_text, is_ours
from onboard.virtual.console import Console
from onboard.virtual.sent_file import SentFile
from onboard.virtual.source import Source

LINGER_S = 0.2
"""Wait before ports are closed at the end, s: hanging up throws away what the reader has not fetched yet."""


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser("virtual", help="a virtual boat on pseudo-terminals", description=_virtual.__doc__)
    _add_what_is_played(parser)
    _add_simulated(parser)
    _add_recorded(parser)
    _add_run(parser)
    parser.set_defaults(command=_virtual)


def _add_what_is_played(parser: argparse.ArgumentParser) -> None:
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--scenario", metavar="NAME", help="simulated scenario, see --list (default 5.3)")
    source.add_argument("--recording", metavar="CSV", type=Path, help="play a column recording; needs --map")
    source.add_argument(
        "--nmea",
        metavar="FILE",
        type=Path,
        action="append",
        help="play a raw recording of a serial port as it was; give it again for more ports",
    )
    source.add_argument("--list", action="store_true", help="list scenarios, quirks and faults, and stop")


def _add_simulated(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--boat",
        metavar="TOML",
        type=Path,
        help="a boat's file: a port for each [[port]], and each [[sensor]] speaks (default: receiver, compass, IMU)",
    )
    parser.add_argument(
        "--quirk",
        metavar="SENSOR:NAME",
        action="append",
        default=[],
        help="a habit of one device, see --list; give it again for more",
    )
    parser.add_argument(
        "--inject",
        metavar="FAULT",
        action="append",
        default=[],
        help="break a sensor: 'compass1 step 30 deg at 120 s for 60 s', see --list; give it again for more",
    )
    parser.add_argument("--seed", type=int, default=1, help="of all simulated noise (default 1)")


def _add_recorded(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--map", metavar="TOML", type=Path, help="which column of the recording is what")
    parser.add_argument(
        "--baud",
        type=number(int, 300, 4_000_000),
        help="of the ports of --nmea (default: the lowest from 4800 that carries the recording)",
    )
    parser.add_argument(
        "--lines-per-second",
        type=number(float, 0.001, 100_000.0),
        metavar="X",
        help="pace of an --nmea recording without times inside (default: as fast as --baud goes)",
    )
    parser.add_argument(
        "--longest-gap",
        type=number(float, 0.1, 1e6),
        metavar="S",
        help="shorten gaps of an --nmea recording to so many seconds",
    )


def _add_run(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, help="play only the beginning")
    parser.add_argument(
        "--dir", type=Path, help="where ports, boat.toml, truth.csv, sent.jsonl go (default: a new one)"
    )
    parser.add_argument("--bind", default="tcp://127.0.0.1:5760", help="[link] bind of the written boat.toml")
    parser.add_argument("--clock-rate", type=float, default=1.0, help="boat seconds in a real second")
    parser.add_argument("--clock-start", type=int, metavar="NS", help="boot time at which boat and real clock agree")
    parser.add_argument("--hold", action="store_true", help="when ready, wait for a line on stdin")
    parser.add_argument("--until-stdin-closes", action="store_true", help="stop when stdin ends")
    parser.add_argument("--exit-at-end", action="store_true", help="do not keep the ports open after the last byte")


def _virtual(args: argparse.Namespace) -> int:
    """Play a scenario or a recording on pseudo-terminals that behave like the real devices."""
    if args.list:
        return _list()
    for option, value in (("--clock-rate", args.clock_rate), ("--seconds", args.seconds)):
        if value is not None and not 0 < value < math.inf:
            raise WayfixError(f"must be > 0, got {value:g}", option)
    if args.seed < 0:
        raise WayfixError(f"must be >= 0, got {args.seed}", "--seed")
    with Console(watch_stdin=args.hold or args.until_stdin_closes) as console:
        source = _source(args)
        directory = _directory(args.dir)
        try:
            boat = VirtualBoat(directory, BoatClock(args.clock_rate, args.clock_start), tuple(source.bauds))
            try:
                _play(args, source, boat, directory, console)
            finally:
                boat.close()
        except BrokenPipeError:
            raise  # stdout, not the disk
        except OSError as error:
            cure = "give a --dir on a disk with room that may be written"
            raise WayfixError(f"cannot be used ({error.strerror})", str(directory), cure) from error
    return 0


def _list() -> int:
    _need_numpy()
    from common.simulation.fault_text import KINDS
    from common.simulation.quirks import QUIRKS
    from common.simulation.scenarios import WORLDS

    width = max(map(len, (*WORLDS, *QUIRKS, *KINDS)))
    for name, world in WORLDS.items():
        sys.stdout.write(f"{name:<{width}}  {world.text}\n")
    for name, quirk in QUIRKS.items():
        sys.stdout.write(f"{name:<{width}}  quirk of a {quirk.role}: {quirk.text}\n")
    for name, kind in KINDS.items():
        sys.stdout.write(f"{name:<{width}}  fault of {', '.join(kind.roles)}: {kind.text}\n")
    return 0


def _need_numpy() -> None:
    try:
        import numpy  # noqa: F401, ICN001 - only to say in one sentence that it is missing
    except ModuleNotFoundError as error:
        raise WayfixError("numpy is missing", "wayfix-onboard virtual", how_to_install("shore")) from error


def _source(args: argparse.Namespace) -> Source:
    """What the options ask for."""
    if args.map is not None and args.recording is None:
        raise WayfixError("belongs to a recording", "--map", "add --recording CSV")
    is_recorded = args.nmea is not None or args.recording is not None
    for option, given in (("--boat", args.boat), ("--quirk", args.quirk)):
        if given and is_recorded:
            raise WayfixError("belongs to a scenario", option, "leave out the recording")
    if args.nmea is not None:
        if args.inject:
            cure = "import the recording, then `wayfix replay LOG --inject ...`"
            raise WayfixError("needs readings, a raw recording holds lines", "--inject", cure)
        from onboard.virtual.player import Player

        return Player(
            args.nmea,
            baud=args.baud,
            lines_per_second=args.lines_per_second,
            longest_gap_s=args.longest_gap,
            seconds=args.seconds,
        )
    for option in ("baud", "lines_per_second", "longest_gap"):
        if getattr(args, option) is not None:
            raise WayfixError("belongs to a raw recording", f"--{option.replace('_', '-')}", "add --nmea FILE")
    return _voyage_source(args)


def _voyage_source(args: argparse.Namespace) -> Source:
    _need_numpy()
    from common.simulation.column_recording import recording_voyage
    from common.simulation.faults import with_faults
    from common.simulation.quirks import with_quirks
    from common.simulation.scenarios import find_world, scenario_voyage
    from common.simulation.voyage import boat_voyage
    from onboard.virtual.boat_file import virtual_boat
    from onboard.virtual.voyage import VoyageSource

    if args.recording is None:
        scenario = args.scenario or "5.3"
        if args.boat is None:
            voyage = scenario_voyage(scenario, args.seed, args.seconds)
        else:
            voyage = boat_voyage(find_world(scenario), virtual_boat(args.boat), args.seed, args.seconds)
        source = VoyageSource(with_quirks(with_faults(voyage, args.inject, args.seed), args.quirk))
        for overload in source.overloads():
            sys.stderr.write(f"{overload}\n")
        return source
    if args.map is None:
        raise WayfixError("a recording needs to be told what its columns are", "--recording", "add --map MAP.toml")
    voyage = recording_voyage(args.recording, args.map, args.seed, args.seconds)
    if voyage.skipped:
        what = ", ".join(f"{name} {count}" for name, count in voyage.skipped.items())
        sys.stderr.write(f"rows left out (a field is empty, or the time does not grow): {what}\n")
    return VoyageSource(with_faults(voyage, args.inject, args.seed))


def _directory(wanted: Path | None) -> Path:
    if wanted is None:
        return Path(tempfile.mkdtemp(prefix="wayfix-virtual-"))
    try:
        wanted.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WayfixError(f"cannot be made ({error.strerror})", str(wanted), "give another --dir") from error
    return wanted.resolve()


def _refuse_foreign(paths: Iterable[Path]) -> None:
    """Refuse to overwrite files that no virtual boat wrote; what an earlier virtual boat left is overwritten."""
    for path in paths:
        if not path.is_symlink() and path.exists() and not is_ours(path):  # another user's port may not be looked at
            raise WayfixError("exists already and is not a virtual boat's", str(path), "give another --dir")


def _play(args: argparse.Namespace, source: Source, boat: VirtualBoat, directory: Path, console: Console) -> None:
    """Announce the ports, start, send, report the end, and stay until asked to go."""
    ports = {name: str(directory / name) for name in source.bauds}
    config_file, sent_file = directory / "boat.toml", directory / "sent.jsonl"
    _refuse_foreign((config_file, *map(Path, ports.values())))
    config_file.write_text(config_text(source.head(), source.config(ports, args.bind)), encoding="utf-8")
    sent = SentFile(sent_file, *source.counted)
    files = {"config": str(config_file), "sent": str(sent_file)}
    _say({"ready": {**files, "ports": ports, **source.ready(directory)}})
    try:
        if args.hold and not _held(console, args):
            return
        start_ns = _start(boat, source, sent.note)
        source.started(directory, start_ns)
        _say({"started": {"t_ns": start_ns}})
        if not _send(boat, console, args):
            return
        _say({"done": {"sent": sent.counts, "dropped_bytes": boat.dropped_bytes, **source.done(sent.counts)}})
        if args.exit_at_end:
            console.wait(LINGER_S)
            return
        while not _told_to_go(console, args):
            _obey(boat, console.wait(None))
    finally:
        sent.close()


def _held(console: Console, args: argparse.Namespace) -> bool:
    """Wait for the start signal; False = stop instead."""
    while not console.wait(None):
        if _told_to_go(console, args):
            return False
        if console.stdin_ended:
            sys.stderr.write("stdin ended before the start signal; the virtual boat stops\n")
            return False
    return True


def _start(boat: VirtualBoat, source: Source, note: Any) -> int:
    """Fix t = 0 half a boat second from now, on a whole millisecond, and load the ports; returns t = 0."""
    start_ns = -(-(boat.clock.now_ns() + LEAD_NS) // NS_PER_MS) * NS_PER_MS
    boat.start(source.lines(start_ns, boat.clock.rate), source.bauds, note)
    return start_ns


def _send(boat: VirtualBoat, console: Console, args: argparse.Namespace) -> bool:
    """Send until the last byte is out; False = asked to stop before."""
    while (pause_s := boat.advance()) is not None:
        _obey(boat, console.wait(pause_s))
        if _told_to_go(console, args):
            return False
    return True


def _told_to_go(console: Console, args: argparse.Namespace) -> bool:
    if console.stdin_ended and args.until_stdin_closes and not console.stopping:
        sys.stderr.write("the parent is gone; the virtual boat stops\n")
        return True
    return console.stopping


def _obey(boat: VirtualBoat, lines: list[str]) -> None:
    """Faults on request, one a line: `unplug PORT`, `replug PORT`, `silence PORT`, `speak PORT`."""
    for line in lines:
        verb, _, port = line.partition(" ")
        if port not in boat.ports or verb not in ("unplug", "replug", "silence", "speak"):
            sys.stderr.write(f"not understood: {line!r}; say unplug, replug, silence or speak and a port\n")
        elif verb == "unplug":
            boat.unplug(port)
        elif verb == "replug":
            boat.replug(port)
        else:
            boat.silence(port, verb == "silence")


def _say(line: dict[str, Any]) -> None:
    """One JSON object on stdout, at once: a parent process waits for it."""
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()
