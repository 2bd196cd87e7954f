"""A DHCP server that forgot: the station's address changes, the boat's address changes. Nobody touches anything."""

import signal
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from onboard.link.allow_list import READ, AllowList
from shore.link.known_boats import Boats
from tests.link.namespaces import Namespaces, Side, what_is_missing
from tests.system.harness import Process
from tests.system.outages import FRAME_HZ, check_whole, config_of

WHY_NOT = what_is_missing()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(WHY_NOT is not None, reason=str(WHY_NOT))]

RESTORED_S = 60.0
PAUSE_S = 3.0
LOST_IS_SAID = 5
"""Status lines after which a silence has been told."""


def is_live(line: str) -> bool:
    return "| round trip" in line and "LINK LOST" not in line


@pytest.mark.parametrize(("side", "address"), [("shore", "10.77.0.9"), ("board", "10.77.0.5")])
def test_a_new_address_costs_no_frame(tmp_path: Path, side: Side, address: str) -> None:
    keys, log = Boats(tmp_path / "keys"), tmp_path / "log"
    AllowList(tmp_path / "state").add(keys.public_key.decode(), "station", READ)
    places = ("--bind", "tcp://0.0.0.0:5760", "--state", tmp_path / "state", "--runtime", tmp_path / "run")
    with Namespaces() as net, ExitStack() as stack:
        board = Process("wayfix-onboard", "run", config_of(tmp_path), *places, inside=net.line("board"))
        stack.callback(board.end)
        keys.remember("b", board.ready()["public_key"].encode(), net.address["board"])
        connect = ("wayfix", "connect", "--keys", keys.directory, "--log", log)
        ashore = Process(*connect, inside=net.line("shore"))
        stack.callback(ashore.end)
        ashore.wait_for_words("| round trip")
        joined_s = time.monotonic()
        time.sleep(PAUSE_S)
        net.readdress(side, address)
        began_s, said = time.monotonic(), len(ashore.err)
        ashore.wait_for(lambda me: len(me.err) > said + LOST_IS_SAID and is_live(me.err[-1]), RESTORED_S)
        print(f"\n  {side} has another address: live again after {time.monotonic() - began_s:.1f} s")
        time.sleep(PAUSE_S)
        ashore.wait_for(lambda me: is_live(me.err[-1]) and " 0 missing" in me.err[-1])
        joined_s = time.monotonic() - joined_s
        ashore.send(signal.SIGINT)
        assert ashore.finish() == 0, ashore.err
        (found,) = keys.all()
        assert found.address == net.address["board"]
    assert check_whole(log) >= FRAME_HZ * (joined_s - 1)
