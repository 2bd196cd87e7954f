"""The control socket: real ones, asked as the command line asks them, and by others who may not."""

import asyncio
import json
import os
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.keys import fingerprint, key_text
from common.messages import Event
from onboard.control.key_handlers import KeyRequests
from onboard.control.socket import (
    DEFAULT_RUNTIME,
    NAME,
    REQUEST_BYTES,
    Control,
    Handler,
    Lasting,
    ask,
    has_terminal,
    runtime_of,
    text_of,
)
from onboard.journal import Journal
from onboard.link.allow_list import READ, AllowList
from onboard.link.pairing_port import PairingPort
from onboard.main import main

ROOT_ONLY = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
A, B = (key_text(bytes([number]) * 32) for number in (1, 2))


class Bench:
    """A control socket in a loop of its own, so that the test can ask as another process would."""

    def __init__(self, directory: Path, handlers: dict[str, Handler | Lasting] | None = None) -> None:
        self.directory = directory
        self.events: list[Event] = []
        own: dict[str, Handler | Lasting] = {"echo": self.echo, "refuse": self.refuse, "fail": self.fail}
        self.handlers = own if handlers is None else handlers
        self._thread = threading.Thread(target=lambda: asyncio.run(self._run()))
        self._started = threading.Event()

    async def echo(self, fields: dict[str, Any]) -> dict[str, Any]:
        return {"echo": fields}

    async def refuse(self, _fields: dict[str, Any]) -> dict[str, Any]:
        raise WayfixError("no", "here", "ask for something else")

    async def fail(self, _fields: dict[str, Any]) -> dict[str, Any]:
        raise RuntimeError("a bug of ours")

    async def _run(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._over = asyncio.Event()
        control = Control(self.directory, self.handlers, Journal(self.events.append, lambda: 0))
        task = asyncio.create_task(control.run())
        await control.tried.wait()
        self._started.set()
        await self._over.wait()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    def __enter__(self) -> Self:
        self._thread.start()
        assert self._started.wait(10)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._over.set)
        self._thread.join(10)
        assert not self._thread.is_alive()

    def raw(self, sent: bytes) -> list[dict[str, Any]]:
        """All answers to these bytes."""
        with socket.socket(socket.AF_UNIX) as line:
            line.settimeout(5)
            line.connect(str(self.directory / NAME))
            line.sendall(sent)
            line.shutdown(socket.SHUT_WR)
            told = b""
            try:
                while part := line.recv(65_536):
                    told += part
            except ConnectionResetError:  # it closed before it had read all
                pass
        return [json.loads(answer) for answer in told.splitlines()]


def test_questions_and_answers(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        assert ask(tmp_path, "echo", name="gps1", port=7) == {"echo": {"name": "gps1", "port": 7}}
        with pytest.raises(WayfixError) as caught:
            ask(tmp_path, "refuse")
        assert str(caught.value) == "here: no; ask for something else"
        with pytest.raises(WayfixError, match="there are echo, fail, refuse"):
            ask(tmp_path, "fly")
        with pytest.raises(WayfixError, match="the daemon failed at it"):
            ask(tmp_path, "fail")
        answers = bench.raw(b'{"do": "echo", "a": 1}\n{"do": "echo", "a": 2}\n')
        assert [answer["echo"]["a"] for answer in answers] == [1, 2]
    assert not (tmp_path / NAME).exists()
    assert bench.events == []


def test_only_its_owner_reaches_the_socket(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with Bench(tmp_path / "run"):
            assert stat.S_IMODE((tmp_path / "run" / NAME).stat().st_mode) == 0o600
            assert stat.S_IMODE((tmp_path / "run").stat().st_mode) == 0o700
    finally:
        os.umask(before)


ASK_AS = """
import os, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from common.errors import WayfixError
from onboard.control.socket import ask
os.setgid(65534); os.setuid(65534)
try:
    print(ask(Path(sys.argv[2]), "echo"))
except WayfixError as error:
    print("refused:", error)
"""


@ROOT_ONLY
@pytest.mark.parametrize("mode", [0o600, 0o666])
def test_another_user_is_refused_whatever_the_mode_of_the_file(tmp_path: Path, mode: int) -> None:
    directory = Path("/tmp") / f"wayfix-control-{os.getpid()}"  # pytest's own directories are closed to others
    directory.mkdir(mode=0o755)
    asked: list[object] = []

    async def echo(fields: dict[str, Any]) -> dict[str, Any]:
        asked.append(fields)
        return {}

    try:
        with Bench(directory, {"echo": echo}):
            (directory / NAME).chmod(mode)
            line = [sys.executable, "-c", ASK_AS, str(Path(__file__).parents[2]), str(directory)]
            done = subprocess.run(line, capture_output=True, text=True, timeout=20, check=False)
    finally:
        directory.rmdir()
    assert done.stdout.startswith("refused:"), done
    assert ("not permitted" if mode == 0o600 else "gave no answer") in done.stdout
    assert "sudo" in done.stdout
    assert asked == []


@pytest.mark.parametrize(
    "sent",
    [
        b"\n",
        b"x\n",
        b"[]\n",
        b"7\n",
        b"null\n",
        b"\xff\xfe\n",
        b'{"do": 7}\n',
        b'{"dont": "echo"}\n',
        b"[" * 4000 + b"\n",
    ],
)
def test_garbage_is_refused_and_the_connection_goes_on(tmp_path: Path, sent: bytes) -> None:
    with Bench(tmp_path) as bench:
        answers = bench.raw(sent + b'{"do": "echo"}\n')
    assert [answer["ok"] for answer in answers] == [False, True]


def test_a_request_that_is_too_long_is_refused(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        fits = json.dumps({"do": "echo", "x": "y" * (REQUEST_BYTES - 30)}).encode() + b"\n"
        assert bench.raw(fits)[0]["ok"]
        for sent in (b"x" * 5_000 + b"\n", b"x" * 200_000):
            answers = bench.raw(sent) or [{"ok": False, "what": "at most 4096 bytes"}]  # reset before it was read
            (answer,) = answers
            assert not answer["ok"]
            assert "at most 4096 bytes" in answer["what"]
        assert ask(tmp_path, "echo") == {"echo": {}}


def test_any_bytes_leave_the_socket_alive(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:

        @given(sent=st.binary(max_size=300))
        def throw(sent: bytes) -> None:
            assert all(set(answer) >= {"ok"} for answer in bench.raw(sent))

        throw()
        assert ask(tmp_path, "echo") == {"echo": {}}


def test_of_a_crowd_that_asks_nothing_the_oldest_go(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        crowd = [socket.socket(socket.AF_UNIX) for _ in range(20)]
        for line in crowd:
            line.connect(str(tmp_path / NAME))
            line.settimeout(5)
        assert [line.recv(1) for line in crowd[:4]] == [b""] * 4
        assert bench.raw(b'{"do": "echo"}\n') == [{"ok": True, "echo": {}}]
        for line in crowd:
            line.close()


def test_what_a_killed_daemon_left_behind_is_replaced(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(tmp_path / NAME))
    with Bench(tmp_path):
        assert ask(tmp_path, "echo") == {"echo": {}}


def test_a_second_daemon_leaves_the_first_ones_socket_alone(tmp_path: Path) -> None:
    with Bench(tmp_path) as first:
        with Bench(tmp_path) as second:
            assert [event.code for event in second.events] == ["control-unusable"]
            assert "another daemon answers there" in second.events[0].text
        assert ask(tmp_path, "echo") == {"echo": {}}
    assert first.events == []


def test_a_place_that_cannot_be_used_is_an_event(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / NAME).write_text("not a socket", encoding="ascii")
    for directory in (tmp_path / "file", tmp_path / "taken", tmp_path / ("long" * 30)):
        with Bench(directory) as bench:
            assert [event.code for event in bench.events] == ["control-unusable"], directory
    assert (tmp_path / "taken" / NAME).read_text(encoding="ascii") == "not a socket"


def test_no_daemon_no_answer(tmp_path: Path) -> None:
    with pytest.raises(WayfixError, match=r"no daemon answers there; start it, or give .* --runtime"):
        ask(tmp_path, "status")
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(tmp_path / NAME))
        deaf.listen()
        with pytest.raises(WayfixError, match=r"did not answer within 0\.1 s"):
            ask(tmp_path, "status", 0.1)


def test_where_the_socket_is_looked_for() -> None:
    assert runtime_of(Path("/x"), {"RUNTIME_DIRECTORY": "/y"}) == Path("/x")
    assert runtime_of(None, {"RUNTIME_DIRECTORY": "/y:/z"}) == Path("/y")
    assert runtime_of(None, {}) == DEFAULT_RUNTIME


def test_texts_of_a_request() -> None:
    assert text_of({"name": "x"}, "name") == "x"
    for fields in ({}, {"name": ""}, {"name": 7}, {"name": "x" * 257}):
        with pytest.raises(WayfixError, match="name must be a text"):
            text_of(fields, "name")


TERMINAL = """
import sys
sys.path.insert(0, sys.argv[1])
from onboard.control.socket import has_terminal
if sys.argv[2] == "with":
    import fcntl, termios
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
sys.exit(7 if has_terminal() else 8)
"""


def test_a_terminal_decides_what_a_hangup_means() -> None:
    """A new session has none, as under systemd, until it takes one."""
    master, slave = os.openpty()
    line = [sys.executable, "-c", TERMINAL, str(Path(__file__).parents[2])]
    for word, code in (("with", 7), ("without", 8)):
        done = subprocess.run([*line, word], stdin=slave, start_new_session=True, timeout=20, check=False)
        assert done.returncode == code
    os.close(slave)
    os.close(master)
    assert has_terminal() in (True, False)


class KeyBench(Bench):
    """Keys through the socket, as `wayfix-onboard pair|keys|revoke|reload` ask."""

    def __init__(self, directory: Path) -> None:
        self.access = AllowList(directory / "state")
        self.changes = 0
        super().__init__(directory, {})
        port = PairingPort(self.access, "springer", "tcp://127.0.0.1:5760", Journal(self.events.append, lambda: 0))
        requests = KeyRequests(self.access, port, Journal(self.events.append, lambda: 0), self._changed)
        self.handlers.update(requests.handlers())

    def _changed(self) -> None:
        self.changes += 1


@pytest.fixture
def command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    def run(*line: str) -> tuple[int, str, str]:
        code = main([*line, "--runtime", str(tmp_path)])
        told = capsys.readouterr()
        return code, told.out, told.err

    return run


def test_keys_are_listed_and_revoked(tmp_path: Path, command: Callable[..., tuple[int, str, str]]) -> None:
    with KeyBench(tmp_path) as bench:
        code, out, err = command("keys")
        assert (code, out) == (0, "")
        assert "no station may connect" in err
        assert fingerprint(bench.access.public_key.decode()) in err
        bench.access.add(A, "laptop", READ)
        bench.access.add(B, "bridge", READ)
        code, out, _ = command("keys", "--json")
        assert (code, out.splitlines()[0].split()) == (0, ["laptop", "read", fingerprint(A), A])
        assert [entry["name"] for entry in json.loads(out.splitlines()[-1])["keys"]] == ["laptop", "bridge"]

        assert command("revoke", "laptop")[0] == 0
        assert command("revoke", "laptop")[::2] == (1, "laptop is not on the list\n")
        assert command("revoke", B)[0] == 0
        assert bench.access.entries == []
        assert bench.changes == 3
    assert [event.code for event in bench.events] == ["key-revoked", "key-revoked"]


def test_an_edited_list_is_read_again(tmp_path: Path, command: Callable[..., tuple[int, str, str]]) -> None:
    with KeyBench(tmp_path) as bench:
        bench.access.add(A, "laptop", READ)
        with bench.access.file.open("a", encoding="utf-8") as file:
            file.write(f"{B} read,command bridge\nnonsense\n")
        code, _, err = command("reload")
        assert code == 1
        assert "line 4 is not KEY WORD NAME" in err
        assert command("keys")[0] == 1
        assert [entry.name for entry in bench.access.entries] == ["laptop", "bridge"]
    assert [event.code for event in bench.events] == ["keys-damaged", "keys-read"]


def test_pairing_that_is_not_used_is_told(
    tmp_path: Path, command: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("common.pairing.OPEN_S", 0.2)
    with KeyBench(tmp_path):
        code, out, err = command("pair", "--port", "0")
    assert (code, len(out)) == (1, 15)
    assert "its 0.2 s are over" in err


@pytest.mark.parametrize("fields", [{"port": "x"}, {"port": -1}, {"port": True}, {"command": 1}, {"name": 7}])
def test_a_pairing_that_cannot_be_is_refused(tmp_path: Path, fields: dict[str, Any]) -> None:
    with KeyBench(tmp_path), pytest.raises(WayfixError):
        ask(tmp_path, "pair", **{"port": 0, **fields})


def test_a_pairing_is_called_off(tmp_path: Path) -> None:
    with KeyBench(tmp_path) as bench:
        opened = ask(tmp_path, "pair", port=0)
        ask(tmp_path, "pair-close")
        assert ask(tmp_path, "pair-outcome") == {"paired": False, "text": "it was called off"}
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", opened["port"]), 5)
    assert [event.code for event in bench.events] == ["pairing-open", "pairing-failed"]


def test_a_code_ends_with_the_program_that_showed_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.control.socket.GONE_S", 0.02)
    with KeyBench(tmp_path) as bench:
        ask(tmp_path, "pair", port=0)
        with socket.socket(socket.AF_UNIX) as line:
            line.connect(str(tmp_path / NAME))
            line.sendall(b'{"do": "pair-outcome"}\n')
            line.shutdown(socket.SHUT_WR)
            time.sleep(0.1)
            assert [event.code for event in bench.events] == ["pairing-open"]
        told = ask(tmp_path, "pair-outcome")
    assert told == {"paired": False, "text": "it was called off"}
    assert [event.code for event in bench.events] == ["pairing-open", "pairing-failed"]


def test_without_a_daemon_the_commands_say_so(command: Callable[..., tuple[int, str, str]]) -> None:
    for line in (("pair",), ("keys",), ("revoke", "x"), ("status",), ("reload",), ("reopen", "gps1"), ("mark", "x")):
        code, out, err = command(*line)
        assert (code, out, err.count("\n")) == (2, "", 1)
        assert "no daemon answers there" in err
