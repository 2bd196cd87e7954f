"""`wayfix-onboard`: run the daemon, check a configuration, play a virtual boat, convert a recording."""

import argparse
import asyncio
import json
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

from common.clock import BoatClock
from common.command import number, run_command
from common.errors import WayfixError
from common.sensors import BoatConfig
from onboard.notify import log_handler, notifier, program_name


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code (0 done, 1 the answer is no, 2 wrong input or environment)."""
    arguments = _parser().parse_args(argv)
    _set_up_logging(arguments.verbose)
    return run_command(program_name(os.environ), "onboard", lambda: int(arguments.command(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="wayfix-onboard", description="Wayfix on the boat.")
    parser.add_argument("-v", "--verbose", action="store_true", help="log details too")
    parser.add_argument("--version", action="version", version=f"wayfix {version('wayfix')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    run = commands.add_parser("run", help="poll the sensors and stream frames", description=_run.__doc__)
    run.add_argument("config", help="the board's configuration (deploy/examples/boat.toml explains every key)")
    run.add_argument("--bind", help="listen here instead of [link] bind, like tcp://127.0.0.1:5760")
    run.add_argument(
        "--state", type=Path, metavar="DIR", help="for keys, spool and start counter (default: $STATE_DIRECTORY)"
    )
    run.add_argument("--runtime", type=Path, metavar="DIR", help="for the control socket (default: $RUNTIME_DIRECTORY)")
    run.add_argument("--open", action="store_true", help="no keys: whoever reaches the port reads and commands")
    run.add_argument(
        "--max-clients", type=number(int, 1, 1000), metavar="N", help="instead of [link] max_clients (default 32)"
    )
    run.add_argument(
        "--clock-rate",
        type=number(float, 0.1, 1000.0),
        default=1.0,
        metavar="X",
        help="run X times as fast (ptys only)",
    )
    run.add_argument("--clock-start", type=int, metavar="NS", help="boot time at which the fast clock starts")
    run.add_argument("--until-stdin-closes", action="store_true", help="stop when the parent process is gone")
    run.set_defaults(command=_run)

    check = commands.add_parser("check", help="check a configuration and its ports", description=_check.__doc__)
    check.add_argument("config")
    check.set_defaults(command=_check)

    convert = commands.add_parser("convert", help="a recording into a frames file", description=_convert.__doc__)
    convert.add_argument("recording", metavar="IN", type=Path, help="raw recording of a serial port (NMEA and others)")
    convert.add_argument("out", metavar="OUT", type=Path, help="frames file to write (docs/frames-file.md)")
    convert.add_argument("--config", type=Path, metavar="BOAT.toml", help="whose sensors (default: those found in IN)")
    convert.add_argument("--port", metavar="NAME", help="[[port]] of --config that IN is a recording of")
    convert.add_argument(
        "--lines-per-second",
        type=number(float, 0.001, 100_000.0),
        metavar="X",
        help="pace of a recording without times inside (default: as fast as the baud rate)",
    )
    convert.add_argument("--json", action="store_true", help="the summary once more as the last line of stdout")
    convert.set_defaults(command=_convert)

    virtual = commands.add_parser("virtual", help="a virtual boat on pseudo-terminals", description=_virtual.__doc__)
    from onboard.virtual.command import add_arguments

    add_arguments(virtual)
    virtual.set_defaults(command=_virtual)

    from onboard.control.command import add_arguments as add_control_arguments
    from onboard.spool.command import add_arguments as add_spool_arguments

    add_control_arguments(commands)
    add_spool_arguments(commands)
    return parser


def _run(arguments: argparse.Namespace) -> int:
    """Poll all sensors and stream timestamped frames until SIGTERM or Ctrl-C. One JSON line says when it is ready."""
    from onboard.config import bind_fault, load
    from onboard.daemon import Daemon
    from onboard.link.access import Access

    config = load(arguments.config)
    if arguments.max_clients is not None:
        config = replace(config, link=replace(config.link, max_clients=arguments.max_clients))
    if arguments.clock_rate != 1.0:
        _refuse_fast_clock(config)
    clock = BoatClock(arguments.clock_rate, arguments.clock_start)

    if arguments.bind is not None and (fault := bind_fault(arguments.bind)) is not None:
        raise WayfixError(fault, "--bind", "give tcp://ADDRESS:PORT of this machine with a free port")

    async def run() -> None:
        state = arguments.state or _directory("STATE_DIRECTORY")
        runtime = arguments.runtime or _directory("RUNTIME_DIRECTORY")
        access = None if arguments.open else Access(state)
        daemon = Daemon(config, clock, state, runtime, notifier=notifier(os.environ), access=access)
        if arguments.until_stdin_closes:
            _watch_stdin(lambda: daemon.stop("the parent process is gone"))
        await daemon.run(arguments.bind or config.link.bind, lambda ready: _say(ready=ready))

    asyncio.run(run())
    return 0


def _check(arguments: argparse.Namespace) -> int:
    """Check a configuration file and try every port; exit code 2 when something is wrong."""
    from onboard.config import load
    from onboard.reading.ports import OPEN_ERRORS, open_serial, reason_of

    config = load(arguments.config)
    print(f"{arguments.config}: boat {config.boat.id}, {len(config.port)} ports, {len(config.sensor)} sensors")
    faults = []
    width = max(len(port.path) for port in config.port)
    for port in config.port:
        sensors = ", ".join(sensor.id for sensor in config.sensor if sensor.port == port.name) or "no sensor"
        try:
            open_serial(port).close()
            state = "opens"
        except OPEN_ERRORS as error:
            state = reason_of(error)
            faults.append(f"{port.name} ({port.path}): {state}")
        print(f"  {port.name:12} {port.path:{width}} {port.baud:>7} baud  {sensors}: {state}")
    if faults:
        cure = "check the path, the plug and who else uses the port"
        raise WayfixError("; ".join(faults), str(arguments.config), cure)
    return 0


def _virtual(arguments: argparse.Namespace) -> int:
    """Play a scenario or a recording on pseudo-terminals that behave like the real devices."""
    from onboard.virtual.command import run

    return run(arguments)


def _convert(arguments: argparse.Namespace) -> int:
    """Run the daemon's decoders and framer over a recording, on the time inside its sentences.

    Exit code 1: no line of the recording was of any use.
    """
    from onboard.recorded.convert import convert, words

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        summary = convert(
            arguments.recording,
            arguments.out,
            config_file=arguments.config,
            port=arguments.port,
            lines_per_second=arguments.lines_per_second,
        )
    except KeyboardInterrupt:
        print(f"stopped; {arguments.out} was not written", file=sys.stderr)
        return 0
    print("\n".join(words(summary)))
    if not summary["accepted"]:
        print("no line was accepted: is this a recording of these sensors?", file=sys.stderr)
    if arguments.json:
        _say(**summary)
    return 0 if summary["accepted"] else 1


def _refuse_fast_clock(config: BoatConfig) -> None:
    for port in config.port:
        if not os.path.realpath(port.path).startswith("/dev/pts/"):
            cure = "leave --clock-rate out; it is for virtual boats"
            raise WayfixError(f"--clock-rate needs pseudo-terminals only, {port.name} is none", port.path, cure)


def _directory(variable: str) -> Path | None:
    """The first directory that systemd names in this variable."""
    names = os.environ.get(variable)
    return Path(names.split(":")[0]) if names else None


def _watch_stdin(stop: Callable[[], None]) -> None:
    """Call `stop` in the loop once standard input ends: the parent holds its other end."""
    loop = asyncio.get_running_loop()

    def wait() -> None:
        while os.read(0, 4096):
            pass
        with suppress(RuntimeError):  # the loop is closed already
            loop.call_soon_threadsafe(stop)

    threading.Thread(target=wait, daemon=True).start()


def _say(**line: Any) -> None:
    with suppress(BrokenPipeError):
        print(json.dumps(line), flush=True)


def _set_up_logging(verbose: bool) -> None:
    logging.basicConfig(level=logging.DEBUG if verbose else logging.INFO, handlers=[log_handler(os.environ)])
