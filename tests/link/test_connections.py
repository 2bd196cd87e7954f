"""A peer that sends too much, or nothing, is cut; the others notice nothing of it."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import zmq

from common.clock import boottime_ns
from common.codec import decode_frame
from common.keys import new_keys
from common.units import NS_PER_S
from onboard.link.allow_list import READ, AllowList
from onboard.link.authenticator import Zap
from onboard.link.connections import BYTES_AT_ONCE, MESSAGES_AT_ONCE, MOST_SILENT, Connection
from onboard.link.router import Router
from shore.link.link import Link
from tests.link.bench import Bench, on_bench
from tests.link.floods import LEASE, PART, Flood, connected, crowd, message, until_cut

BOAT = '[boat]\nid = "a"\n[frames]\nrate_hz = 20\n[[port]]\nname = "g"\npath = "/dev/ttyNONE"\n'
SENSOR = '[[sensor]]\nid = "gps1"\nport = "g"\nrole = "gps"\n'


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


def test_a_budget_is_so_much_at_once_and_then_so_much_a_second() -> None:
    peer = Connection("a:1", 0)
    assert peer.is_within(BYTES_AT_ONCE, 1)
    assert not peer.is_within(BYTES_AT_ONCE + 70_000, NS_PER_S)
    station = Connection("b:1", 0)
    assert all(station.is_within(26_000 * second, second * NS_PER_S) for second in range(1, 1000))


def test_an_encrypted_station_is_not_taken_for_silent() -> None:
    """libzmq does not name the connection of its messages: the bytes of its leases are enough."""
    station, stranger = Connection("a:1", 0), Connection("b:1", 0)
    assert station.is_within(2_000, NS_PER_S)
    assert stranger.is_within(600, NS_PER_S)
    assert (station.has_spoken, stranger.has_spoken) == (True, False)


def test_a_message_of_endless_parts_is_cut_and_the_others_go_on() -> None:
    async def run(bench: Bench) -> None:
        honest = await bench.joined()
        bomb = connected(port_of(bench.endpoint))
        cut = asyncio.ensure_future(asyncio.to_thread(until_cut, bomb, PART))
        for _ in range(20):
            bench.publish(1)
            await honest.lease()
            assert [item.seq for item in await honest.frames(1)] == [bench.next_seq - 1]
            await asyncio.sleep(0.02)
        bomb_lasted_s = await cut
        bomb.close()
        assert bomb_lasted_s < 2.0

    on_bench(run)


def test_messages_beyond_the_pace_are_thrown_away_unread() -> None:
    async def run(bench: Bench) -> None:
        honest, other = await bench.joined(), connected(port_of(bench.endpoint))
        other.sendall(message(b"not a message") * 500)
        for _ in range(10):
            bench.publish(1)
            await honest.lease()
            await honest.frames(1)
            await asyncio.sleep(0.02)
        assert MESSAGES_AT_ONCE <= bench.server.malformed < MESSAGES_AT_ONCE + 100
        other.close()

    on_bench(run)


def test_of_a_crowd_that_says_nothing_few_stay() -> None:
    async def run(bench: Bench) -> None:
        peers = crowd(port_of(bench.endpoint), MOST_SILENT + 40)
        honest = await bench.joined()
        await asyncio.sleep(0.3)
        for peer in peers:
            peer.setblocking(False)
        gone = 0
        for peer in peers:
            try:
                gone += peer.recv(100) == b"" or peer.recv(100) == b""  # behind the greeting of ZMTP
            except BlockingIOError:
                continue
            finally:
                peer.close()
        assert gone >= 40
        bench.publish(1)
        await honest.lease()
        assert len(await honest.frames(1)) == 1

    on_bench(run)


def test_the_connection_of_a_removed_key_is_cut_and_the_others_come_back(tmp_path: Path) -> None:
    allowed, keys = AllowList(tmp_path), {name: new_keys() for name in ("laptop", "bridge")}
    for name, pair in keys.items():
        allowed.add(pair.public.decode(), name, READ)

    async def run() -> None:
        context, heard = zmq.Context(), set[str | None]()
        zap = Zap(context, allowed)
        answering = asyncio.create_task(zap.run())
        router = Router(context, allowed.secret_key)
        endpoint = router.bind("tcp://127.0.0.1:*")
        router.start(lambda _id, key, _parts: heard.add(key))
        outside = zmq.Context()
        clients = []
        for pair in keys.values():
            client = outside.socket(zmq.DEALER)
            client.setsockopt(zmq.LINGER, 0)
            client.setsockopt(zmq.CURVE_SERVERKEY, allowed.public_key)
            client.setsockopt(zmq.CURVE_PUBLICKEY, pair.public)
            client.setsockopt(zmq.CURVE_SECRETKEY, pair.secret)
            client.connect(endpoint)
            clients.append(client)

        async def hears(*names: str) -> bool:
            heard.clear()
            for _ in range(100):
                for client in clients:
                    with suppress(zmq.Again):
                        client.send(b"hello", zmq.NOBLOCK)
                await asyncio.sleep(0.05)
                if heard >= {keys[name].public.decode() for name in names}:
                    return True
            return False

        try:
            assert await hears("laptop", "bridge")
            allowed.remove("laptop")
            router.cut_unless(lambda key: allowed.rights_of(key) is not None)
            await asyncio.sleep(0.1)
            assert await hears("bridge")
            assert keys["laptop"].public.decode() not in heard
        finally:
            for client in clients:
                client.close()
            router.close()
            answering.cancel()
            await asyncio.gather(answering, return_exceptions=True)
            zap.close()
            outside.term()
            context.term()

    asyncio.run(run())


class Board:
    """A real daemon on an open link."""

    def __init__(self, directory: Path) -> None:
        (directory / "boat.toml").write_text(BOAT + SENSOR)
        self.said = directory / "said"
        program = Path(sys.executable).with_name("wayfix-onboard")
        command: list[str | Path] = [
            program,
            "run",
            "--open",
            "--bind",
            "tcp://127.0.0.1:*",
            "--state",
            directory / "state",
        ]
        command += ["--state", directory / "state", "--runtime", directory / "run", directory / "boat.toml"]
        with self.said.open("w") as said:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True)
        assert self.process.stdout is not None
        self.port = port_of(json.loads(self.process.stdout.readline())["ready"]["bind"])

    def rss_mb(self) -> float:
        pages = int(Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    made = Board(tmp_path)
    yield made
    made.process.send_signal(signal.SIGTERM)
    made.process.wait(10)
    assert made.process.stdout is not None
    made.process.stdout.close()


def watched(board: Board, link: Link, seconds: float) -> tuple[float, float]:
    """The longest time without a newer frame, s, and the most memory of the daemon, MB."""
    end_s, newest_ns, oldest_s, most_mb = time.monotonic() + seconds, boottime_ns(), 0.0, 0.0
    while time.monotonic() < end_s:
        received = link.receive(0.05)
        if received is not None and received.frame is not None:
            newest_ns = max(newest_ns, decode_frame(received.frame).t1_ns)
        oldest_s = max(oldest_s, (boottime_ns() - newest_ns) / NS_PER_S)
        most_mb = max(most_mb, board.rss_mb())
    return oldest_s, most_mb


FLOODS = {"parts": (PART * 8, 1), "leases": (message(LEASE) * 20, 4), "bad": (message(b"x" * 1000) * 20, 4)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FLOODS)
def test_a_flood_makes_no_frame_old_and_fills_no_memory(board: Board, kind: str) -> None:
    data, count = FLOODS[kind]
    link = Link(f"127.0.0.1:{board.port}")
    link.connect(5.0, stream=True)
    with ExitStack() as stack:
        floods = [stack.enter_context(Flood(board.port, data)) for _ in range(count)]
        oldest_s, most_mb = watched(board, link, 6.0)
    link.close()
    sent_mb = sum(flood.sent for flood in floods) / 1e6
    print(f"\n  flood of {kind}: {sent_mb:.0f} MB; newest frame {oldest_s:.2f} s old; {most_mb:.0f} MB in memory")
    assert all(flood.cuts for flood in floods)
    assert oldest_s < 3.0
    assert most_mb < 128.0, "the unit's MemoryMax"
    assert len(board.said.read_text().splitlines()) < 20


@pytest.mark.slow
def test_a_station_joins_beside_1500_connections_that_say_nothing(board: Board) -> None:
    peers = crowd(board.port, 400)
    begun_s = time.monotonic()
    link = Link(f"127.0.0.1:{board.port}")
    for _ in range(11):
        peers += crowd(board.port, 100)
        for peer in peers[:100]:
            peer.close()
        del peers[:100]
    link.connect(10.0, stream=True)
    joined_s = time.monotonic() - begun_s
    assert joined_s < 10.0
    assert watched(board, link, 1.0)[0] < 3.0
    link.close()
    for peer in peers:
        peer.close()
    print(f"\n  joined after {joined_s:.2f} s beside 1,500 connections")
    assert len(board.said.read_text().splitlines()) < 20
