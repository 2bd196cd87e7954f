"""`wayfix boat`, remote commands: ask the running daemon of a boat. The station's key needs the right `command`."""

import argparse
import json
from typing import Any

from common.command import flat
from shore.link.choose_boat import add_meeting_arguments, link_to, meet
from shore.terminal import add_json, finish, say, tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix boat`."""
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    _add(actions, "status", "how the daemon is: sensors, clients, spool")
    reopen = _add(actions, "reopen", "open the port of a sensor anew")
    reopen.add_argument("argument", metavar="SENSOR", help="its id, like gps1")
    mark = _add(actions, "mark", "put a remark into the frames, and so into every log of them")
    mark.add_argument("argument", metavar="TEXT", help="1 to 200 characters")
    for action in actions.choices.values():
        add_meeting_arguments(action)
        add_json(action)


def _add(actions: Any, name: str, words: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(
        name, help=words, description=f"{words[0].upper()}{words[1:]}."
    )
    return parser


def run(arguments: argparse.Namespace) -> int:
    """Ask the board, and print what it answers."""
    from shore.link.known_boats import Boats

    boats = Boats(arguments.keys)
    address, boat = meet(arguments, boats)
    link = link_to(address, boat, boats)
    try:
        link.connect()
        text = link.command(arguments.action, getattr(arguments, "argument", ""))
    finally:
        link.close()
    if arguments.action != "status":
        say(text)
        finish(arguments, {"text": text})
        return 0
    told = json.loads(text)
    for name, value in flat(told):
        tell(f"{name}: {value}")
    finish(arguments, told)
    return 0
