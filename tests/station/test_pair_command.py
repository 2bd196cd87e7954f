"""`wayfix pair` against a real board's pairing port, and against boards that are none."""

import argparse
import asyncio
import io
import json
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from common.errors import LinkError, WayfixError
from common.keys import fingerprint, key_text
from common.pairing import Board, framed, plain_code
from onboard.control.key_handlers import KeyRequests
from onboard.control.socket import Control, ask
from onboard.journal import Journal
from onboard.link.allow_list import READ, AllowList
from onboard.link.pairing_port import PairingPort
from shore.link import pair_command
from shore.link.known_boats import Boats

CODE = "7Q2M-0XKD-93ZT"
THIEF = bytes([9]) * 32


def pair(keys: Path, port: int, *more: str) -> int:
    parser = argparse.ArgumentParser()
    pair_command.add_arguments(parser)
    return pair_command.run(parser.parse_args(["127.0.0.1:5760", "--keys", str(keys), "--port", str(port), *more]))


@contextmanager
def board(directory: Path) -> Iterator[AllowList]:
    """A board with control socket in `directory` and state beside it, in a loop of its own."""
    access = AllowList(directory / "state")
    started = threading.Event()
    over: list[Callable[[], object]] = []

    async def serve() -> None:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        over.append(lambda: loop.call_soon_threadsafe(stop.set))
        port = PairingPort(access, "springer", "tcp://127.0.0.1:5760", Journal(lambda _event: None, lambda: 0))
        requests = KeyRequests(access, port, Journal(lambda _event: None, lambda: 0), lambda: None)
        control = Control(directory, requests.handlers(), Journal(lambda _event: None, lambda: 0))
        task = asyncio.create_task(control.run())
        await control.tried.wait()
        started.set()
        await stop.wait()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert started.wait(10)
    try:
        yield access
    finally:
        over[0]()
        thread.join(10)


def test_both_sides_keep_the_others_key(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with board(tmp_path) as access:
        opened = ask(tmp_path, "pair", port=0, name="laptop")
        assert pair(tmp_path / "keys", opened["port"], "--code", opened["code"].lower(), "--json") == 0
        assert ask(tmp_path, "pair-outcome")["paired"]
        boats = Boats(tmp_path / "keys")
        (boat,) = boats.all()
        assert (boat.boat_id, boat.public_key, boat.address) == ("springer", access.public_key, "127.0.0.1:5760")
        assert access.rights_of(boats.public_key.decode()) == READ
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == f"springer  {fingerprint(access.public_key.decode())}"
    assert json.loads(out.splitlines()[-1])["key"] == access.public_key.decode()
    assert fingerprint(boats.public_key.decode()) in err


def test_the_commands_of_both_sides_together(tmp_path: Path) -> None:
    """`wayfix-onboard pair` prints the code, its user types it into `wayfix pair`, both end well."""
    with board(tmp_path) as access:
        program = "import sys; from onboard.main import main; sys.exit(main(sys.argv[1:]))"
        line = [sys.executable, "-c", program, "pair", "--command", "--port", "0", "--runtime", str(tmp_path)]
        with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as aboard:
            assert aboard.stdout is not None
            assert aboard.stderr is not None
            code, told = aboard.stdout.readline(), aboard.stderr.readline()
            port = int(told.split("(port ")[1].split(")")[0])
            assert pair(tmp_path / "keys", port, "--code", code) == 0
            assert "paired with station-1" in aboard.stderr.readline()
            assert aboard.wait(10) == 0
        assert [entry.rights for entry in access.entries] == [frozenset({"read", "command"})]


def test_a_wrong_code_leaves_no_key_anywhere(tmp_path: Path) -> None:
    with board(tmp_path) as access:
        opened = ask(tmp_path, "pair", port=0)
        with pytest.raises(LinkError, match="a wrong code, one that is over"):
            pair(tmp_path / "keys", opened["port"], "--code", "0000-0000-0000")
        assert not ask(tmp_path, "pair-outcome")["paired"]
        with pytest.raises(LinkError, match="no pairing there"):
            pair(tmp_path / "keys", opened["port"], "--code", opened["code"])
        assert access.entries == []
        assert AllowList(tmp_path / "state").entries == []
    assert Boats(tmp_path / "keys").all() == []


def test_a_code_with_a_slip_is_told_before_anything_is_sent(tmp_path: Path) -> None:
    with board(tmp_path):
        opened = ask(tmp_path, "pair", port=0)
        with pytest.raises(WayfixError, match="nothing was sent yet"):
            pair(tmp_path / "keys", opened["port"], "--code", opened["code"][:-1])
        assert pair(tmp_path / "keys", opened["port"], "--code", opened["code"]) == 0


def test_the_code_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with board(tmp_path):
        opened = ask(tmp_path, "pair", port=0)
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{opened['code']}\n"))
        assert pair(tmp_path / "keys", opened["port"]) == 0
    out, err = capsys.readouterr()
    assert err.startswith("code shown by `wayfix-onboard pair` on the board: ")
    assert "code shown" not in out
    with pytest.raises(WayfixError, match="no code was given"):
        pair(tmp_path / "keys", 9)


def test_a_boat_that_is_paired_again_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    keys = tmp_path / "keys"
    Boats(keys).remember("springer", key_text(THIEF).encode(), "old")
    with board(tmp_path) as access:
        opened = ask(tmp_path, "pair", port=0)
        assert pair(keys, opened["port"], "--code", opened["code"]) == 0
        assert [boat.public_key for boat in Boats(keys).all()] == [access.public_key]
    assert "the former key of springer was replaced" in capsys.readouterr().err


@contextmanager
def false_board(code: str, *, keeps_proof: bytes | None = None, junk: bytes | None = None) -> Iterator[int]:
    """Somebody who answers on the port: with another code, a given last message, or junk."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        line, _ = server.accept()
        with line:
            line.settimeout(5)
            hello = line.recv(4096)[2:]
            if junk is not None:
                line.sendall(junk)
                return
            machine = Board(plain_code(code), THIEF, "springer", nonce=b"N" * 32, opened_ns=0)
            line.sendall(framed(machine.receive(hello, 1) or b""))
            proof = line.recv(4096)[2:]
            if keeps_proof is not None:
                line.sendall(framed(keeps_proof or proof))
                line.recv(1)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield server.getsockname()[1]
    finally:
        thread.join(10)
        server.close()


def test_a_board_that_does_not_know_the_code_is_not_kept(tmp_path: Path) -> None:
    for last in (b"", b"\x81\xa5proof\xc4\x20" + bytes(32)):  # our own proof sent back, and a guess
        with false_board(CODE, keeps_proof=last) as port, pytest.raises(LinkError, match="does not know the code"):
            pair(tmp_path, port, "--code", CODE)
        assert Boats(tmp_path).all() == []


@pytest.mark.parametrize(
    "junk", [b"", b"\0", b"\0\0", b"\xff\xff", b"HTTP/1.0 400", framed(b"\x80"), framed(b"x" * 1024)]
)
def test_whatever_else_answers_is_refused(tmp_path: Path, junk: bytes) -> None:
    with false_board(CODE, junk=junk) as port, pytest.raises(LinkError):
        pair(tmp_path, port, "--code", CODE)
    assert Boats(tmp_path).all() == []


def test_a_list_that_cannot_be_read_does_not_cost_the_code(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    boats = Boats(keys)
    boats.remember("x", key_text(THIEF).encode())
    boats.file.chmod(0o666)
    with board(tmp_path):
        opened = ask(tmp_path, "pair", port=0)
        with pytest.raises(WayfixError, match="others have rights"):
            pair(keys, opened["port"], "--code", opened["code"])
        boats.file.chmod(0o600)
        assert pair(keys, opened["port"], "--code", opened["code"]) == 0


def test_the_last_port_has_none_beside_it(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    pair_command.add_arguments(parser)
    arguments = parser.parse_args(["10.0.0.1:65535", "--code", CODE, "--keys", str(tmp_path)])
    with pytest.raises(WayfixError, match="no port is left"):
        pair_command.run(arguments)
