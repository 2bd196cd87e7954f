"""`wayfix boat`, remote commands: ask the running daemon of a boat.

`status` and `raw` need the right to read, the others the right `command` of the station's key.
"""

import argparse
import json
import sys
import time
from base64 import b64decode
from typing import TYPE_CHECKING, Any, Final

from common.boat_status import status_lines
from common.visible_lines import VisibleLines
from shore.link.choose_boat import add_meeting_arguments, link_to, meet
from shore.terminal import add_json, finish, say, tell

if TYPE_CHECKING:
    from shore.link.link import Link

RAW_S: Final = 0.6
"""Time between two looks at a port, s: the board answers two commands a second."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix boat`."""
    actions = parser.add_subparsers(required=True, metavar="ACTION", dest="action")
    _add(actions, "status", "how the daemon is: its sensors, clients, spool")
    raw = _add(actions, "raw", "show what comes on a sensor's port, until Ctrl-C")
    raw.add_argument("argument", metavar="SENSOR", help="its id, like gps1")
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
        if arguments.action == "raw":
            return _show_raw(link, arguments.argument)
        text = link.command(arguments.action, getattr(arguments, "argument", ""))
    finally:
        link.close()
    if arguments.action != "status":
        say(text)
        finish(arguments, {"text": text})
        return 0
    told = json.loads(text)
    for line in status_lines(told):
        tell(line)
    finish(arguments, told)
    return 0


def _show_raw(link: "Link", sensor: str) -> int:
    """The lines of a sensor's port as they come, for ever."""
    lines, place = VisibleLines(_tell_now), ""
    while True:
        told = json.loads(link.command("raw", f"{sensor} {place}"))
        place = str(told["place"])
        lines.feed(b64decode(told["data"]))
        time.sleep(RAW_S)


def _tell_now(line: str) -> None:
    tell(line)
    sys.stdout.flush()
