"""`wayfix pair`: learn a boat's key by the code that `wayfix-onboard pair` shows on it."""

import argparse
import re
import sys
from pathlib import Path

from common.command import number
from common.errors import WayfixError
from shore.terminal import add_json, finish, say, tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `wayfix pair`."""
    parser.add_argument("address", help="HOST or HOST:PORT of the boat's link, like 10.0.0.1:5760")
    parser.add_argument("--code", help="instead of being asked for it (case, dashes and O for 0 do not matter)")
    parser.add_argument(
        "--port", type=number(int, 1, 65_535), metavar="N", help="of the pairing (default: the link's port + 1)"
    )
    parser.add_argument("--keys", type=Path, metavar="DIR", help="where keys are kept (default ~/.config/wayfix)")
    add_json(parser)


def run(arguments: argparse.Namespace) -> int:
    """Pair with one boat."""
    from common.keys import fingerprint
    from common.pairing import plain_code
    from shore.link.known_boats import Boats
    from shore.link.link import endpoint
    from shore.link.pairing import pair

    match = re.fullmatch(r"tcp://(?P<host>.+):(?P<port>\d+)", endpoint(arguments.address))
    assert match is not None
    host, link_port = match["host"].strip("[]"), int(match["port"])
    port = arguments.port or link_port + 1
    if port > 65_535:
        raise WayfixError("no port is left for the pairing", arguments.address, "give --port N, as on the board")
    code = plain_code(arguments.code if arguments.code is not None else _asked())
    boats = Boats(arguments.keys)
    # A list that cannot be read is reported before the code is used up.
    former = {boat.boat_id: boat.public_key for boat in boats.all()}
    boat = pair(host, port, code, boats, f"{match['host']}:{link_port}")
    shown = fingerprint(boat.public_key.decode("ascii"))
    tell(f"{boat.boat_id}  {shown}")
    if former.get(boat.boat_id, boat.public_key) != boat.public_key:
        say(f"the former key of {boat.boat_id} was replaced")
    own = fingerprint(boats.public_key.decode("ascii"))
    say(f"paired with {boat.boat_id}; the board knows this station by {own}")
    summary = {"boat_id": boat.boat_id, "fingerprint": shown, "key": boat.public_key.decode("ascii"), "own": own}
    finish(arguments, {**summary, "address": boat.address})
    return 0


def _asked() -> str:
    """The code as typed; it is worth nothing in two minutes, so it may be seen."""
    sys.stderr.write("code shown by `wayfix-onboard pair` on the board: ")
    sys.stderr.flush()
    line = sys.stdin.readline() if sys.stdin is not None else ""
    if not line:
        raise WayfixError("no code was given", "--code", "type the code that the board shows")
    return line
