"""The board's allow list, and real CURVE sockets that are let in or refused by it."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.keys import KeyPair, key_text, new_keys
from onboard.link.allow_list import COMMAND, READ, AllowList
from onboard.link.authenticator import Zap

A, B, C = (key_text(bytes([number]) * 32) for number in (1, 2, 3))


def access_with(directory: Path, text: str) -> AllowList:
    directory.mkdir(mode=0o700, exist_ok=True)
    file = directory / "allowed-keys"
    file.write_text(text, encoding="utf-8", errors="surrogateescape")
    file.chmod(0o600)
    return AllowList(directory)


def test_the_list_is_kept(tmp_path: Path) -> None:
    access = AllowList(tmp_path)
    assert access.rights_of(A) is None
    assert access.rights_of(None) is None
    access.add(A, "laptop", READ)
    access.add(B, "bridge", COMMAND)
    access.add(A, "laptop 2", COMMAND)
    for known in (access, AllowList(tmp_path)):
        assert [(entry.key, entry.name, entry.rights) for entry in known.entries] == [
            (B, "bridge", COMMAND), (A, "laptop 2", COMMAND),
        ]  # fmt: skip
        assert known.faults == []
    assert access.file.stat().st_mode & 0o777 == 0o600
    assert access.remove("bridge") is True
    assert access.remove("bridge") is False
    assert access.remove(A) is True
    assert AllowList(tmp_path).entries == []
    assert AllowList(tmp_path).public_key == access.public_key


def test_no_directory_no_keys() -> None:
    with pytest.raises(WayfixError, match="--open"):
        AllowList(None)


def test_damage_is_named_and_lets_nobody_in(tmp_path: Path) -> None:
    access = access_with(tmp_path, f"{A} read ok\n{B} write thief\n{C[:-1]} read cut\n{C} read,command \udc80\n{C}\n")
    assert [entry.name for entry in access.entries] == ["ok"]
    assert len(access.faults) == 4
    assert access.rights_of(B) is access.rights_of(C) is None
    access.add(C, "new", READ)  # what is damaged stays for its owner to look at
    assert access.file.read_text(encoding="utf-8", errors="surrogateescape").count("thief") == 1
    assert [entry.name for entry in AllowList(tmp_path).entries] == ["ok", "new"]


@pytest.mark.parametrize("rights", [("read,command", "read"), ("read", "read,command")])
def test_a_key_that_stands_there_twice_has_the_fewer_rights(tmp_path: Path, rights: tuple[str, str]) -> None:
    access = access_with(tmp_path, f"{A} {rights[0]} one\n{A} {rights[1]} two\n")
    assert access.rights_of(A) == READ
    assert len(access.faults) == 1


def test_a_list_that_cannot_be_trusted_lets_nobody_in(tmp_path: Path) -> None:
    access = access_with(tmp_path, f"{A} read one\n")
    assert access.rights_of(A) == READ
    for mode in (0o620, 0o602, 0o666):
        access.file.chmod(mode)
        assert "no station may connect" in access.reload()[0]
        assert access.rights_of(A) is None
        with pytest.raises(WayfixError):
            access.add(B, "two", READ)
        assert access.rights_of(B) is None
    access.file.chmod(0o644)
    assert access.reload() == []
    access.file.write_bytes(b"x" * 300_000)
    assert "longer than" in access.reload()[0]
    access.file.unlink()
    access.file.mkdir()
    assert "no station may connect" in access.reload()[0]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_list_of_another_user_lets_nobody_in(tmp_path: Path) -> None:
    access = access_with(tmp_path, f"{A} read one\n")
    os.chown(access.file, 65534, -1)
    assert "belongs to user number 65534" in access.reload()[0]
    assert access.rights_of(A) is None


def test_a_key_is_refused_though_the_list_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    access = access_with(tmp_path, f"{A} read one\n{B} read two\n")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("onboard.link.allow_list.write_own", full)
        with pytest.raises(WayfixError, match="refused from now on"):
            access.remove("one")
        with pytest.raises(WayfixError, match="cannot be kept"):
            access.add(C, "three", READ)
    assert access.rights_of(A) is None
    assert access.reload() == []
    assert access.rights_of(A) is None  # though its line is still there
    assert access.rights_of(C) is None
    access.add(A, "one again", READ)
    assert access.rights_of(A) == READ


def test_names(tmp_path: Path) -> None:
    access = AllowList(tmp_path)
    access.add(A, access.name_for(A), READ)
    access.add(B, access.name_for(B), READ)
    assert [entry.name for entry in access.entries] == ["station-1", "station-2"]
    assert access.name_for(B) == "station-2"
    access.remove("station-1")
    assert access.name_for(C) == "station-1"
    for name in ("station-2", "", "a\nb", "x" * 65, A):
        with pytest.raises(WayfixError):
            access.add(C, name, READ)
    for key, rights in ((C[:-1], READ), (C, frozenset({"command"})), (C, frozenset({"fly"}))):
        with pytest.raises(WayfixError):
            access.add(key, "name", rights)
    assert [entry.key for entry in access.entries] == [B]


@given(text=st.text(alphabet=st.characters(exclude_categories=["Cs"]), max_size=300), good=st.integers(0, 3))
def test_whatever_stands_in_the_list_only_sound_lines_count(
    tmp_path_factory: pytest.TempPathFactory, text: str, good: int
) -> None:
    lines = [f"{key} read name{number}" for number, key in enumerate((A, B, C)[:good])]
    access = access_with(tmp_path_factory.mktemp("list"), "\n".join([*lines, text]))
    assert {entry.key for entry in access.entries} == {A, B, C} & set((A, B, C)[:good])


# The authenticator.


class Bench:
    """A guarded ROUTER and clients in contexts of their own."""

    def __init__(self, access: AllowList, guarded: bool = True) -> None:
        self.access = access
        self.strangers: list[str] = []
        self.context = zmq.Context()
        self.elsewhere = zmq.Context()
        self.zap = Zap(self.context if guarded else self.elsewhere, access, self.strangers.append)
        self.zap._context = self.context
        self.server = self.context.socket(zmq.ROUTER)
        self.server.setsockopt_string(zmq.ZAP_DOMAIN, "wayfix")
        self.server.setsockopt(zmq.CURVE_SERVER, 1)
        self.server.setsockopt(zmq.CURVE_SECRETKEY, access.secret_key)
        self.endpoint = ""
        self.outside = zmq.Context()
        self.clients: list[zmq.Socket[bytes]] = []
        self.task: asyncio.Task[None] | None = None

    async def start(self) -> None:
        self.task = asyncio.create_task(self.zap.run())
        await self.zap.self_test()
        self.server.bind("tcp://127.0.0.1:*")
        self.endpoint = self.server.getsockopt_string(zmq.LAST_ENDPOINT)

    def client(self, keys: KeyPair | None, server_key: bytes | None = None) -> "zmq.Socket[bytes]":
        client = self.outside.socket(zmq.DEALER)
        client.setsockopt(zmq.LINGER, 0)
        if keys is not None:
            client.setsockopt(zmq.CURVE_SERVERKEY, server_key or self.access.public_key)
            client.setsockopt(zmq.CURVE_PUBLICKEY, keys.public)
            client.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
        client.connect(self.endpoint)
        client.send(b"hello")
        self.clients.append(client)
        return client

    async def received(self, timeout_s: float) -> str | None:
        """User-Id of the next message; None when nothing comes."""
        for _ in range(int(timeout_s / 0.005)):
            if self.server.poll(0):
                parts = self.server.recv_multipart(copy=False)
                self.server.send_multipart([parts[0].bytes, b"welcome"])
                return str(parts[-1].get("User-Id"))
            await asyncio.sleep(0.005)
        return None

    async def stop(self) -> None:
        if self.task is not None:
            self.task.cancel()
            await asyncio.gather(self.task, return_exceptions=True)
        for client in self.clients:
            client.close()
        self.server.close(linger=0)
        self.zap.close()
        for context in (self.context, self.elsewhere, self.outside):
            context.term()


def on_bench(access: AllowList, play: Callable[[Bench], Awaitable[None]], guarded: bool = True) -> None:
    async def run() -> None:
        bench = Bench(access, guarded)
        try:
            await play(bench)
        finally:
            await bench.stop()

    asyncio.run(run())


def test_a_listed_key_is_let_in_and_named(tmp_path: Path) -> None:
    keys = new_keys()

    async def play(bench: Bench) -> None:
        await bench.start()
        bench.access.add(keys.public.decode(), "laptop", READ)
        client = bench.client(keys)
        assert await bench.received(5) == keys.public.decode()
        assert client.poll(5_000)
        assert client.recv() == b"welcome"
        assert bench.access.rights_of(keys.public.decode()) == READ
        assert bench.strangers == []

    on_bench(AllowList(tmp_path), play)


def test_strangers_get_not_one_byte_of_data(tmp_path: Path) -> None:
    allowed, stranger = new_keys(), new_keys()

    async def play(bench: Bench) -> None:
        await bench.start()
        bench.access.add(allowed.public.decode(), "laptop", READ)
        borrowed = KeyPair(allowed.public, stranger.secret)  # a listed public key without its secret
        clients = [
            bench.client(None),
            bench.client(stranger),
            bench.client(borrowed),
            bench.client(allowed, server_key=stranger.public),  # a board that is not ours
        ]
        assert await bench.received(0.7) is None
        assert not any(client.poll(0) for client in clients)
        bench.client(new_keys())
        assert await bench.received(0.2) is None
        assert bench.strangers == [stranger.public.decode()]  # the others of this minute are only counted
        assert bench.zap.refused == 2
        bench.client(allowed)
        assert await bench.received(5) == allowed.public.decode()

    on_bench(AllowList(tmp_path), play)


def test_a_revoked_key_has_no_rights_though_its_connection_stays(tmp_path: Path) -> None:
    keys = new_keys()

    async def play(bench: Bench) -> None:
        await bench.start()
        bench.access.add(keys.public.decode(), "laptop", COMMAND)
        client = bench.client(keys)
        assert await bench.received(5)
        bench.access.remove("laptop")
        client.send(b"again")
        user_id = await bench.received(5)
        assert user_id == keys.public.decode()  # libzmq asks at the handshake only
        assert bench.access.rights_of(user_id) is None

    on_bench(AllowList(tmp_path), play)


def test_the_self_test_fails_when_the_handler_does_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.link.authenticator.SELF_TEST_S", 0.3)

    async def play(bench: Bench) -> None:
        with pytest.raises(WayfixError, match=r"not refused: no answer within 0\.3 s"):
            await bench.zap.self_test()
        # ... and nobody gets in: the handler is there and does not answer.
        bench.server.bind("tcp://127.0.0.1:*")
        bench.endpoint = bench.server.getsockopt_string(zmq.LAST_ENDPOINT)
        bench.client(new_keys())
        assert await bench.received(0.3) is None

    on_bench(AllowList(tmp_path), play)


def test_the_self_test_fails_when_there_is_no_handler(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        with pytest.raises(WayfixError, match=r"not refused: (its message was received|event 4096)"):
            await bench.zap.self_test()

    on_bench(AllowList(tmp_path), play, guarded=False)


def test_the_self_test_fails_when_everybody_is_let_in(tmp_path: Path) -> None:
    class Generous(AllowList):
        def rights_of(self, _user_id: str | None) -> frozenset[str] | None:
            return READ

    async def play(bench: Bench) -> None:
        with pytest.raises(WayfixError, match="is not refused"):
            await bench.start()

    on_bench(Generous(tmp_path), play)


def test_the_self_test_fails_when_another_handler_refuses(tmp_path: Path) -> None:
    """Somebody else's no is not ours: it may say yes to the next one."""

    async def play(bench: Bench) -> None:
        other = bench.context.socket(zmq.REP)
        other.bind("inproc://zeromq.zap.01")

        async def refuse() -> None:
            while True:
                await asyncio.sleep(0.002)
                if other.poll(0):
                    request = other.recv_multipart()
                    other.send_multipart([b"1.0", request[1], b"400", b"no", b"", b""])

        task = asyncio.create_task(refuse())
        try:
            with pytest.raises(WayfixError, match="something else than the allow list"):
                await bench.zap.self_test()
        finally:
            task.cancel()
            other.close(linger=0)

    on_bench(AllowList(tmp_path), play, guarded=False)


def test_an_error_in_the_handler_lets_nobody_in(tmp_path: Path) -> None:
    class Broken(AllowList):
        def rights_of(self, _user_id: str | None) -> frozenset[str] | None:
            raise RuntimeError("a bug of ours")

    async def play(bench: Bench) -> None:
        with pytest.raises(WayfixError, match="event 16384, 500"):
            await bench.start()
        bench.server.bind("tcp://127.0.0.1:*")
        bench.endpoint = bench.server.getsockopt_string(zmq.LAST_ENDPOINT)
        bench.client(new_keys())
        assert await bench.received(0.3) is None
        assert bench.task is not None
        assert not bench.task.done()

    on_bench(Broken(tmp_path), play)


@given(request=st.lists(st.binary(max_size=40), max_size=9))
def test_no_malformed_request_is_granted(tmp_path_factory: pytest.TempPathFactory, request: list[bytes]) -> None:
    context = zmq.Context()
    zap = Zap(context, AllowList(tmp_path_factory.mktemp("zap")))
    try:
        assert zap._answer(request)[2] == b"400"
    finally:
        zap.close()
        context.term()


def test_requests_of_other_mechanisms_are_refused(tmp_path: Path) -> None:
    access = AllowList(tmp_path)
    raw = bytes([1]) * 32
    access.add(key_text(raw), "laptop", READ)
    context = zmq.Context()
    zap = Zap(context, access)
    good = [b"1.0", b"7", b"wayfix", b"10.0.0.2", b"", b"CURVE", raw]
    try:
        assert zap._answer(good) == [b"1.0", b"7", b"200", b"OK", key_text(raw).encode(), b""]
        for place, part in ((0, b"2.0"), (5, b"NULL"), (5, b"PLAIN"), (6, raw[:-1]), (6, raw + b"\0"), (6, bytes(32))):
            bad = [*good[:place], part, *good[place + 1 :]]
            assert zap._answer(bad)[2] == b"400"
        assert zap._answer([*good, b""])[2] == b"400"
    finally:
        zap.close()
        context.term()
