"""`wayfix-onboard run` (service entry point): the daemon, from its arguments to its end."""

import argparse
import asyncio
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.boat_config import BoatConfig
from common.clock import BoatClock
from common.command import number, say_json
from common.errors import WayfixError
from onboard.notify import notifier


def add_arguments(commands: Any) -> None:
    """Add the sub-parser."""
    parser = commands.add_parser("run", help="poll the sensors and stream frames", description=_run.__doc__)
    parser.add_argument("config", help="the board's configuration (deploy/examples/boat.toml explains every key)")
    parser.add_argument("--bind", help="listen here instead of [link] bind, like tcp://127.0.0.1:5760")
    parser.add_argument(
        "--state", type=Path, metavar="DIR", help="for keys, spool and start counter (default: $STATE_DIRECTORY)"
    )
    parser.add_argument(
        "--runtime", type=Path, metavar="DIR", help="for the control socket (default: $RUNTIME_DIRECTORY)"
    )
    parser.add_argument("--open", action="store_true", help="no keys: whoever reaches the port reads and commands")
    parser.add_argument(
        "--max-clients", type=number(int, 1, 1000), metavar="N", help="instead of [link] max_clients (default 32)"
    )
    parser.add_argument(
        "--clock-rate",
        type=number(float, 0.1, 1000.0),
        default=1.0,
        metavar="X",
        help="run X times as fast (ptys only)",
    )
    parser.add_argument("--clock-start", type=int, metavar="NS", help="boot time at which the fast clock starts")
    parser.add_argument("--until-stdin-closes", action="store_true", help="stop when the parent process is gone")
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    """Poll all sensors and stream timestamped frames until SIGTERM or Ctrl-C. One JSON line says when it is ready."""
    from onboard.config import bind_fault, load
    from onboard.daemon import Daemon
    from onboard.link.allow_list import AllowList

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
        allow_list = None if arguments.open else AllowList(state)
        daemon = Daemon(config, clock, state, runtime, notifier=notifier(os.environ), allow_list=allow_list)
        if arguments.until_stdin_closes:
            _watch_stdin(lambda: daemon.stop("the parent process is gone"))
        await daemon.run(arguments.bind or config.link.bind, lambda ready: say_json(ready=ready))

    asyncio.run(run())
    return 0


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
