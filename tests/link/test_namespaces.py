"""The test tool `namespaces` does what its name says, with real packets."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.link.namespaces import DEVICE, MULTICAST, Namespaces, remove_leftovers, what_is_missing

pytestmark = pytest.mark.skipif(what_is_missing() is not None, reason=what_is_missing() or "")

ECHO = """
import socket, sys
with socket.create_server(("0.0.0.0", 7000)) as server:
    print("ready", flush=True)
    while True:
        connection, _ = server.accept()
        with connection:
            while data := connection.recv(65536):
                connection.sendall(data[-10:])
"""
ASK = """
import socket, sys, time
begin = time.monotonic()
try:
    with socket.create_connection((sys.argv[1], 7000), float(sys.argv[2])) as end:
        end.sendall(bytes(int(sys.argv[3])))
        end.shutdown(socket.SHUT_WR)
        while end.recv(65536):
            pass
    print("answered", round(time.monotonic() - begin, 3))
except OSError as error:
    print(type(error).__name__, round(time.monotonic() - begin, 3))
"""


@pytest.fixture
def net() -> Iterator[Namespaces]:
    with Namespaces() as made:
        yield made


@pytest.fixture
def echo(net: Namespaces) -> "subprocess.Popen[str]":
    server = net.popen("board", sys.executable, "-c", ECHO, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    assert server.stdout.readline() == "ready\n"
    return server


def ask(net: Namespaces, timeout_s: float = 10.0, count: int = 1) -> tuple[str, float]:
    """What became of a question, and the seconds it took."""
    done = net.run("shore", sys.executable, "-c", ASK, net.address["board"], str(timeout_s), str(count))
    words = done.stdout.split()
    assert len(words) == 2, done.stderr
    return words[0], float(words[1])


def names() -> str:
    return subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout


def test_they_hear_each_other_and_nobody_else(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    assert ask(net)[0] == "answered"
    assert net.run("shore", "ip", "route", "show", "default").stdout.split()[2] == "10.77.0.1"
    links = net.run("board", "ip", "-brief", "link").stdout
    assert {line.split("@")[0].split()[0] for line in links.splitlines()} == {"lo", DEVICE}


def test_link_down_and_up(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    net.link_down()
    assert ask(net, timeout_s=1)[0] in ("OSError", "TimeoutError")
    assert net.run("shore", "ip", "route", "show", "default").stdout in (
        "",
        "default via 10.77.0.1 dev wf0 linkdown \n",
    )
    net.link_up()
    assert ask(net)[0] == "answered"


def test_silence_tells_nobody(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    net.silence()
    what, seconds = ask(net, timeout_s=0.7)
    assert what == "TimeoutError"
    assert seconds >= 0.7
    net.speak()
    assert ask(net)[0] == "answered"
    net.speak()  # twice is as good as once


def test_only_what_matches_is_dropped(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    net.drop("board", MULTICAST)
    assert ask(net)[0] == "answered"
    net.drop("board", "tcp dport 7000")
    assert ask(net, timeout_s=0.5)[0] == "TimeoutError"


def test_the_rate_is_limited(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    quick = ask(net, count=100_000)[1]
    net.limit(400)
    slow = ask(net, timeout_s=20, count=100_000)[1]
    net.limit(None)
    again = ask(net, count=100_000)[1]
    assert 1.6 < slow < 6  # 2 s and what TCP has to learn first
    assert max(quick, again) < 1


def test_the_address_changes(net: Namespaces, echo: "subprocess.Popen[str]") -> None:
    net.readdress("board", "10.77.0.9")
    assert net.address["board"] == "10.77.0.9"
    assert ask(net)[0] == "answered"
    net.address["board"] = "10.77.0.1"
    assert ask(net, timeout_s=0.5)[0] in ("TimeoutError", "OSError")
    net.address["board"] = "10.77.0.9"
    net.readdress("shore", "10.77.0.20")
    assert ask(net)[0] == "answered"


def test_nothing_is_left_when_a_test_fails() -> None:
    net = Namespaces()
    started = []

    def fail() -> None:
        with net:
            started.append(net.popen("board", "sleep", "600"))
            assert names().count(f"-{os.getpid()}-") >= 2
            net.run("shore", "false", check=True)

    with pytest.raises(subprocess.CalledProcessError):
        fail()
    assert started[0].returncode is not None
    assert net.name["board"] not in names()
    assert net.name["shore"] not in names()


def test_what_a_killed_test_left_is_removed_and_a_living_ones_is_not(net: Namespaces) -> None:
    gone = subprocess.Popen(["true"])
    gone.wait()
    left = f"wayfix-{gone.pid}-0-board"
    subprocess.run(["ip", "netns", "add", left], check=True)
    try:
        remove_leftovers()
        assert left not in names()
    finally:
        if left in names():
            subprocess.run(["ip", "netns", "del", left], check=True)
    assert net.name["board"] in names()


def test_a_set_up_that_fails_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    net = Namespaces()
    monkeypatch.setitem(net.address, "shore", "not an address")
    with pytest.raises(AssertionError), net:
        pass
    assert net.name["board"] not in names()
    assert not Path(f"/run/netns/{net.name['shore']}").exists()
