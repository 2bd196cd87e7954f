"""A station: pairs with the daemon when it has no key yet, says hello, prints the answer."""

import json
from pathlib import Path

from common.pairing import plain_code
from onboard.control.socket import ask
from shore.link.known_boats import Boats
from shore.link.link import Link
from shore.link.pairing import pair

ADDRESS = "127.0.0.1:5760"

boats = Boats(Path("/var/lib/probe"))
if not boats.all():
    opened = ask(Path("/run/wayfix"), "pair")
    pair("127.0.0.1", opened["port"], plain_code(opened["code"]), boats, ADDRESS)
link = Link(ADDRESS, client="probe", keys=boats.link_keys(boats.all()[0]))
print(json.dumps(link.connect(2.0)))
link.close()
