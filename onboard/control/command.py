"""`wayfix-onboard pair|keys|revoke|status|raw|reload|reopen|mark`: the command-line client of the running daemon."""

import argparse
import json
import os
import signal
import sys
import time
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path
from typing import Any

from common.boat_status import status_lines
from common.command import number
from common.visible_lines import VisibleLines
from common.words import counted
from onboard.control.socket import ask, asked, runtime_of

ANSWER_S = 15.0
RAW_S = 0.5
"""Time between two looks at a port, s."""


def add_arguments(commands: Any) -> None:
    """Add the sub-parsers."""
    pair = _add(commands, "pair", "let one more station connect", _pair)
    pair.add_argument("--command", dest="may_command", action="store_true", help="it may command too, not only read")
    pair.add_argument("--name", help="its name on the allow list (default: the one it has, or station-1, ...)")
    pair.add_argument("--port", type=number(int, 0, 65_535), metavar="N", help="default: the link's port + 1; 0 = any")
    _add(commands, "keys", "the stations that may connect", _keys)
    revoke = _add(commands, "revoke", "a station may not connect any more", _revoke)
    revoke.add_argument("name", metavar="NAME|KEY", help="as `keys` shows it")
    _add(commands, "status", "how the running daemon and its sensors are", _status)
    raw = _add(commands, "raw", "show what comes on a sensor's port", _raw)
    raw.add_argument("sensor", help="its id, like gps1")
    _add(commands, "reload", "read the allow list again", _reload)
    reopen = _add(commands, "reopen", "open a sensor's port anew", _reopen)
    reopen.add_argument("sensor", help="its id, like gps1")
    mark = _add(commands, "mark", "put a remark into the log", _mark)
    mark.add_argument("text")


def _add(commands: Any, name: str, words: str, run: Callable[[argparse.Namespace], int]) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(name, help=words, description=run.__doc__)
    parser.add_argument("--runtime", type=Path, metavar="DIR", help="of the daemon (default: /run/wayfix)")
    parser.add_argument("--json", action="store_true", help="last line of stdout is one JSON object")
    parser.set_defaults(command=run)
    return parser


def _pair(arguments: argparse.Namespace) -> int:
    """Print a code that `wayfix pair` ashore asks for, and wait until it is used. Exit code 1 = it was not."""
    where = runtime_of(arguments.runtime, os.environ)
    wanted = {"command": arguments.may_command, "name": arguments.name, "port": arguments.port}
    for ending in (signal.SIGTERM, signal.SIGHUP):  # a closed terminal calls it off too
        signal.signal(ending, signal.default_int_handler)
    opened = ask(where, "pair", ANSWER_S, **wanted)
    try:
        # Asked before the code is shown: from here on the code ends with this program.
        with asked(where, "pair-outcome", opened["seconds"] + ANSWER_S) as answer:
            _tell(opened["code"])
            port, seconds = opened["port"], opened["seconds"]
            _say(f"ashore, within {seconds} s: wayfix pair ADDRESS (port {port}), then type this code")
            outcome = answer()
    except KeyboardInterrupt:
        ask(where, "pair-close", ANSWER_S)
        _say("called off: the code is worth nothing")
        return 1
    _say(str(outcome["text"]))
    _finish(arguments, outcome)
    return 0 if outcome["paired"] else 1


def _keys(arguments: argparse.Namespace) -> int:
    """The stations that may connect, and the board's own key. Exit code 1 = the list has faults."""
    told = _ask(arguments, "keys")
    width = max((len(entry["name"]) for entry in told["keys"]), default=0)
    for entry in told["keys"]:
        _tell(f"{entry['name']:{width}}  {','.join(entry['rights']):12}  {entry['fingerprint']}  {entry['key']}")
    if not told["keys"]:
        _say("no station may connect; pair one: wayfix-onboard pair")
    _say(f"this board: {told['own']['fingerprint']}  {told['own']['key']}")
    for fault in told["faults"]:
        _say(f"allow list: {fault}")
    _finish(arguments, told)
    return 1 if told["faults"] else 0


def _revoke(arguments: argparse.Namespace) -> int:
    """Take a station off the allow list; its session ends at once. Exit code 1 = it is not on the list."""
    told = _ask(arguments, "revoke", name=arguments.name)
    _say(f"{arguments.name} may not connect any more" if told["revoked"] else f"{arguments.name} is not on the list")
    _finish(arguments, told)
    return 0 if told["revoked"] else 1


def _status(arguments: argparse.Namespace) -> int:
    """How the running daemon is: a table of the sensors with reason, rate and age; clients, spool."""
    told = _ask(arguments, "status")
    for line in status_lines(told):
        _tell(line)
    _finish(arguments, told)
    return 0


def _raw(arguments: argparse.Namespace) -> int:
    """Show the lines of a sensor's port as the daemon reads them, control characters made visible, until Ctrl-C."""
    lines, place = VisibleLines(_tell), ""
    while True:
        told = _ask(arguments, "raw", sensor=arguments.sensor, place=place)
        place = str(told["place"])
        lines.feed(b64decode(told["data"]))
        time.sleep(RAW_S)


def _reload(arguments: argparse.Namespace) -> int:
    """Read the allow list again, as SIGHUP does under systemd. Exit code 1 = it has faults."""
    told = _ask(arguments, "reload")
    for fault in told["faults"]:
        _say(f"allow list: {fault}")
    _say(f"{counted(told['keys'], 'station')} may connect")
    _finish(arguments, told)
    return 1 if told["faults"] else 0


def _reopen(arguments: argparse.Namespace) -> int:
    """Close and open the port of a sensor."""
    return _simple(arguments, "reopen", sensor=arguments.sensor)


def _mark(arguments: argparse.Namespace) -> int:
    """Put a remark into the frames, and so into every log of them."""
    return _simple(arguments, "mark", text=arguments.text)


def _simple(arguments: argparse.Namespace, do: str, **fields: Any) -> int:
    told = _ask(arguments, do, **fields)
    if told.get("text"):
        _say(str(told["text"]))
    _finish(arguments, told)
    return 0


def _ask(arguments: argparse.Namespace, do: str, **fields: Any) -> dict[str, Any]:
    return ask(runtime_of(arguments.runtime, os.environ), do, ANSWER_S, **fields)


def _finish(arguments: argparse.Namespace, told: dict[str, Any]) -> None:
    if arguments.json:
        _tell(json.dumps(told))


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


def _tell(line: str) -> None:
    """Print data on stdout, at once: a script waits for it."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
