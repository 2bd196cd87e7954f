"""A station and a board as a newcomer joins them: pair once, then connect without an address; strangers get nothing."""

import json
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from common.codec import decode_frame
from shore.logbook.log_reader import read_log
from tests.system.harness import Process, command
from tests.system.outages import config_of

pytestmark = pytest.mark.slow

FIND_S = 10.0
"""Twice what is asked (5 s)."""


@contextmanager
def board(directory: Path, *arguments: str | Path) -> Iterator[Process]:
    """A daemon with keys."""
    places = ("--state", directory / "state", "--runtime", directory / "run")
    process = Process("wayfix-onboard", "run", config_of(directory), *places, *arguments)
    try:
        process.ready()
        yield process
    finally:
        process.end()


def address_of(process: Process) -> str:
    return str(process.ready()["bind"]).removeprefix("tcp://")


def paired(directory: Path, process: Process, keys: Path, *rights: str) -> None:
    """Both commands, as two people type them."""
    asking = Process("wayfix-onboard", "pair", "--runtime", directory / "run", "--port", "0", "--json", *rights)
    try:
        code = asking.wait_for(lambda me: next((line for line in me.out if line.count("-") == 2), None))
        port = asking.wait_for(lambda me: next((line for line in me.err if "port" in line), None))
        number = "".join(filter(str.isdigit, port.split("port")[1].split()[0].strip(",;:.")))
        done = command("wayfix", "pair", address_of(process), "--code", code, "--port", number, "--keys", keys)
        assert done.returncode == 0, done.stderr
        assert asking.finish() == 0, asking.err
    finally:
        asking.end()


def test_paired_once_the_boat_is_found_and_others_are_refused(tmp_path: Path) -> None:
    keys, stranger = tmp_path / "keys", tmp_path / "stranger"
    logged = ("connect", "--frames", "5", "--period", "0.1")
    frames = (*logged, "--no-log")
    with board(tmp_path) as running:
        place = address_of(running)
        paired(tmp_path, running, keys)
        found = command("wayfix", *logged, "--keys", keys, "--log", tmp_path / "log")
        assert found.returncode == 0, found.stderr
        assert f"b is at {place} (last address of b)" in found.stderr
        assert "OPEN" not in found.stderr

        nobody = command("wayfix", *frames, "--keys", stranger)
        assert (nobody.returncode, nobody.stderr.count("\n")) == (2, 1), nobody.stderr
        assert "this station is paired with no boat" in nobody.stderr

        revoked = command("wayfix-onboard", "revoke", "station-1", "--runtime", tmp_path / "run")
        assert revoked.returncode == 0, revoked.stderr
        refused = command("wayfix", *frames, place, "--keys", keys)
        assert refused.returncode == 2
        assert "the boat does not know this station's key" in refused.stderr.splitlines()[-1]
    gone = command("wayfix", *frames, "--keys", keys, seconds=FIND_S)
    assert gone.returncode == 2
    assert "no boat was found within 5 s" in gone.stderr.splitlines()[-1]
    assert place in gone.stderr


def test_a_station_with_the_right_commands_the_boat_and_one_without_is_refused(tmp_path: Path) -> None:
    reader, commander = tmp_path / "reader", tmp_path / "commander"
    with board(tmp_path) as running:
        paired(tmp_path, running, reader)
        paired(tmp_path, running, commander, "--command", "--name", "bridge")
        ashore = Process("wayfix", "connect", "--log", tmp_path / "log", "--keys", reader)
        try:
            ashore.wait_for_words(" missing | round trip ", 20.0)
            refused = command("wayfix", "boat", "mark", "buoy 7", "--keys", reader)
            assert refused.returncode == 2
            assert "may read, not command" in refused.stderr.splitlines()[-1]
            marked = command("wayfix", "boat", "mark", "buoy 7", "--keys", commander)
            assert (marked.returncode, marked.stderr.splitlines()[-1]) == (0, "marked")
            opened = command("wayfix", "boat", "reopen", "compass1", "--keys", commander)
            assert opened.returncode == 0, opened.stderr
            unknown = command("wayfix", "boat", "reopen", "gps9", "--keys", commander)
            assert unknown.returncode == 2
            assert "there is no sensor 'gps9'" in unknown.stderr.splitlines()[-1]
            read = command("wayfix", "boat", "status", "--keys", reader)
            assert re.search(r"^compass1 +(silent|missing|delivering) ", read.stdout, re.MULTILINE)
            status = command("wayfix", "boat", "status", "--keys", commander, "--json")
            assert json.loads(status.stdout.splitlines()[-1])["boat_id"] == "b"
            # However long the commands took: the run ends when it has seen what they did.
            ashore.wait_for(lambda me: sum("asked by bridge" in line for line in me.err) >= 2, 20.0)
            ashore.send(signal.SIGINT)
            assert ashore.finish(20.0) == 0, ashore.err
        finally:
            ashore.end()
    (path,) = (tmp_path / "log").glob("*.mcap")
    codes = [item.code for data in read_log(path).frames() for item in decode_frame(data).events]
    assert [codes.count(code) for code in ("mark", "command-refused")] == [1, 1]
    assert codes.count("command-done") == 3
    assert any("mark: buoy 7 (by bridge)" in line for line in ashore.err)
