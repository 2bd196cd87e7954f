"""The board's pairing port over real TCP: who gets on the list, and who does not."""

import asyncio
import socket
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from common import pairing
from common.errors import LinkError, WayfixError
from common.keys import fingerprint, key_text, raw_key
from common.messages import Event
from common.pairing import Station, framed, plain_code
from onboard.journal import Journal
from onboard.link.allow_list import COMMAND, READ, AllowList
from onboard.link.pairing_port import Opened, PairingPort, Request, place_of

KEY = bytes([7]) * 32
ANY = Request(port=0)


class Bench:
    """A pairing port beside a link on loopback."""

    def __init__(self, directory: Path, boat_id: str = "springer") -> None:
        self.access = AllowList(directory)
        self.events: list[Event] = []
        self.port = PairingPort(self.access, boat_id, "tcp://127.0.0.1:5760", Journal(self.events.append, lambda: 0))

    @property
    def codes(self) -> list[str]:
        return [event.code for event in self.events]

    async def outcome(self) -> tuple[bool, str]:
        return await asyncio.wait_for(self.port.outcome(), 10)


class Client:
    """A station on a bare connection."""

    def __init__(self, opened: Opened, code: str | None = None, key: bytes = KEY) -> None:
        self.port = opened.port
        self.station = Station(plain_code(code or opened.code), key, nonce=b"n" * 32)

    async def connect(self) -> "Client":
        self.reader, self.writer = await asyncio.open_connection("127.0.0.1", self.port)
        return self

    async def say(self, message: bytes) -> None:
        self.writer.write(framed(message))
        await self.writer.drain()

    async def hear(self) -> bytes:
        """The next message; empty when the board closed."""
        try:
            size = int.from_bytes(await asyncio.wait_for(self.reader.readexactly(2), 5), "big")
            return await asyncio.wait_for(self.reader.readexactly(size), 5)
        except (asyncio.IncompleteReadError, ConnectionError):
            return b""

    async def pair(self) -> bool:
        await self.connect()
        await self.say(self.station.hello)
        proof = await asyncio.to_thread(self.station.receive, await self.hear())
        await self.say(proof or b"")
        last = await self.hear()
        if last:
            self.station.receive(last)
        self.writer.close()
        return self.station.proved


def on_bench(directory: Path, play: Callable[[Bench], Awaitable[Any]]) -> Bench:
    async def run() -> Bench:
        bench = Bench(directory)
        await play(bench)
        bench.port.close("the test is over")
        return bench

    return asyncio.run(run())


@pytest.mark.parametrize(("request_", "name", "rights"), [
    (ANY, "station-1", READ), (Request(0, command=True, name="bridge laptop"), "bridge laptop", COMMAND),
])  # fmt: skip
def test_a_station_is_put_on_the_list(tmp_path: Path, request_: Request, name: str, rights: frozenset[str]) -> None:
    async def play(bench: Bench) -> None:
        opened = await bench.port.open(request_)
        client = Client(opened, opened.code.lower().replace("-", " "))
        assert await client.pair()
        assert client.station.board_key == raw_key(bench.access.public_key.decode())
        assert client.station.boat_id == "springer"
        paired, text = await bench.outcome()
        assert paired
        assert text.startswith(f"paired with {name}, key {fingerprint(key_text(KEY))}")
        with pytest.raises(ConnectionRefusedError):
            await Client(opened).connect()

    bench = on_bench(tmp_path, play)
    assert [(entry.key, entry.name, entry.rights) for entry in AllowList(tmp_path).entries] == [
        (key_text(KEY), name, rights)
    ]
    assert bench.codes == ["pairing-open", "pairing-done"]
    assert opened_code_is_nowhere(bench)


def opened_code_is_nowhere(bench: Bench) -> bool:
    """Events go to every client and into logs: no code in them."""
    return not any("code" in event.evidence for event in bench.events)


def test_pairing_again_keeps_the_name_and_changes_the_rights(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        for request in (Request(0, command=True, name="laptop"), ANY):
            assert await Client(await bench.port.open(request)).pair()

    on_bench(tmp_path, play)
    assert [(entry.name, entry.rights) for entry in AllowList(tmp_path).entries] == [("laptop", READ)]


def test_a_wrong_code_burns_it(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        opened = await bench.port.open(ANY)
        assert not await Client(opened, "0000-0000-0000").pair()
        assert await bench.outcome() == (False, "a wrong code was given")
        with pytest.raises(ConnectionRefusedError):
            await Client(opened).connect()

    bench = on_bench(tmp_path, play)
    assert bench.codes == ["pairing-open", "pairing-failed"]
    assert AllowList(tmp_path).entries == []


def test_a_second_client_burns_the_code_of_the_first(tmp_path: Path) -> None:
    faults: list[object] = []

    async def play(bench: Bench) -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _loop, context: faults.append(context))
        opened = await bench.port.open(ANY)
        first, second = await Client(opened).connect(), Client(opened)
        await first.say(first.station.hello)
        answer = await first.hear()
        await second.connect()
        assert await bench.outcome() == (False, "a second client came")
        first.station.receive(answer)
        assert await first.hear() == b""  # at once, not when the board is tired of waiting
        assert await second.hear() == b""
        assert not first.station.proved
        for client in (first, second):
            client.writer.close()

    on_bench(tmp_path, play)
    assert AllowList(tmp_path).entries == []
    assert faults == []  # nothing of it in the daemon's log


@pytest.mark.parametrize(
    "sent", [b"", b"\0", b"\0\0", b"\xff\xff", b"GET / HTTP/1.0\r\n\r\n", framed(b"junk"), framed(b"\x80")]
)
def test_whatever_else_comes_burns_the_code(tmp_path: Path, sent: bytes) -> None:
    async def play(bench: Bench) -> None:
        opened = await bench.port.open(ANY)
        client = await Client(opened).connect()
        client.writer.write(sent)
        client.writer.write_eof()
        assert not (await bench.outcome())[0]
        assert await client.hear() == b""
        client.writer.close()

    on_bench(tmp_path, play)
    assert AllowList(tmp_path).entries == []


def test_a_client_that_says_nothing_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.link.pairing_port.MESSAGE_S", 0.1)

    async def play(bench: Bench) -> None:
        client = await Client(await bench.port.open(ANY)).connect()
        assert await bench.outcome() == (False, "the client said nothing for 0.1 s")
        assert await client.hear() == b""
        client.writer.close()

    on_bench(tmp_path, play)


def test_the_port_closes_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pairing, "OPEN_S", 0.3)

    async def play(bench: Bench) -> None:
        opened = await bench.port.open(ANY)
        client = await Client(opened).connect()
        await client.say(client.station.hello)
        proof = await asyncio.to_thread(client.station.receive, await client.hear())
        assert await bench.outcome() == (False, "its 0.3 s are over")
        client.writer.write(framed(proof or b""))
        assert await client.hear() == b""
        client.writer.close()
        with pytest.raises(ConnectionRefusedError):
            await Client(opened).connect()

    on_bench(tmp_path, play)
    assert AllowList(tmp_path).entries == []


def test_a_new_code_burns_the_one_before(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        first = await bench.port.open(ANY)
        waiting = asyncio.create_task(bench.outcome())
        await asyncio.sleep(0.01)
        second = await bench.port.open(ANY)
        assert await waiting == (False, "another code was asked for")
        assert first.code != second.code
        old = Client(second, first.code)
        assert not await old.pair()

    on_bench(tmp_path, play)
    assert AllowList(tmp_path).entries == []


def test_a_man_in_the_middle_that_swaps_keys_gets_on_no_list(tmp_path: Path) -> None:
    """He relays both ways and puts his own key wherever one stands."""
    thief = bytes([9]) * 32

    async def play(bench: Bench) -> None:
        opened = await bench.port.open(ANY)
        board_key = raw_key(bench.access.public_key.decode())
        assert board_key is not None

        async def relay(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            there, back = await asyncio.open_connection("127.0.0.1", opened.port)

            async def carry(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
                while data := await source.read(4096):
                    sink.write(data.replace(KEY, thief).replace(board_key, thief))
                sink.close()

            await asyncio.gather(carry(reader, back), carry(there, writer))

        middle = await asyncio.start_server(relay, "127.0.0.1", 0)
        victim = Client(Opened(opened.code, middle.sockets[0].getsockname()[1]))
        assert not await victim.pair()
        assert (await bench.outcome())[0] is False
        assert victim.station.board_key == b""
        middle.close()
        await middle.wait_closed()

    on_bench(tmp_path, play)
    assert AllowList(tmp_path).entries == []


def test_when_the_list_cannot_be_written_nobody_is_told_yes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("onboard.link.allow_list.write_own", full)

    async def play(bench: Bench) -> None:
        assert not await Client(await bench.port.open(ANY)).pair()
        paired, text = await bench.outcome()
        assert not paired
        assert "No space left on device" in text

    assert on_bench(tmp_path, play).access.entries == []


def test_the_loop_goes_on_while_the_code_is_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """scrypt runs beside the loop: as long as it is held the loop turns."""
    import threading

    held, turns = threading.Event(), 0

    def slow(code: str, salt: bytes) -> bytes:
        assert held.wait(10)
        return pairing.stretch(code, salt)

    def board(*arguments: Any, **named: Any) -> pairing.Board:
        return made(*arguments, **named, stretch=slow)

    made = pairing.Board
    monkeypatch.setattr(pairing, "Board", board)

    async def play(bench: Bench) -> None:
        nonlocal turns
        pairing_ = asyncio.create_task(Client(await bench.port.open(ANY)).pair())
        for _ in range(200):
            await asyncio.sleep(0.001)
            turns += 1
        assert not pairing_.done()
        held.set()
        assert await pairing_

    on_bench(tmp_path, play)
    assert turns == 200


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:

        async def play(bench: Bench) -> None:
            with pytest.raises(WayfixError, match="cannot be opened"):
                await bench.port.open(Request(taken.getsockname()[1]))
            assert (await bench.outcome())[0] is False
            assert await Client(await bench.port.open(ANY)).pair()

        on_bench(tmp_path, play)


@pytest.mark.parametrize("name", ["", "a\nb", "x" * 65])
def test_a_name_that_cannot_be_kept_is_refused_at_once(tmp_path: Path, name: str) -> None:
    async def play(bench: Bench) -> None:
        with pytest.raises(WayfixError, match="a name must be"):
            await bench.port.open(Request(0, name=name))
        bench.port._boat_id = name
        with pytest.raises(WayfixError, match=r"\[boat\] id"):
            await bench.port.open(ANY)

    assert on_bench(tmp_path, play).codes == []


def test_the_port_beside_the_link() -> None:
    assert place_of("tcp://0.0.0.0:5760") == ("0.0.0.0", 5761)
    assert place_of("tcp://*:5760") == ("0.0.0.0", 5761)
    assert place_of("tcp://[::]:5760") == (None, 5761)
    assert place_of("tcp://[fe80::1%eth0]:1") == ("fe80::1%eth0", 2)
    for endpoint in ("ipc:///tmp/x", "tcp://a", "inproc://x"):
        with pytest.raises(WayfixError):
            place_of(endpoint)


def test_no_pairing_was_asked_for(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        assert await bench.outcome() == (False, "no pairing was asked for")
        bench.port.close("nothing is open")

    assert on_bench(tmp_path, play).codes == []


def test_the_station_refuses_a_board_that_does_not_know_the_code(tmp_path: Path) -> None:
    async def play(bench: Bench) -> None:
        opened = await bench.port.open(ANY)
        client = await Client(opened).connect()
        await client.say(client.station.hello)
        client.station.receive(await client.hear())
        with pytest.raises(LinkError, match="does not know the code"):
            client.station.receive(b"\x81\xa5proof\xc4\x20" + bytes(32))
        client.writer.close()
        await bench.outcome()

    on_bench(tmp_path, play)
