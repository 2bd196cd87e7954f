"""A peer that sends too much, or nothing, is cut; the others notice nothing of it."""

import asyncio
import json
import os
import signal
import socket
import struct
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
from common.link_messages import FrameRange
from common.units import NS_PER_S
from onboard.link.allow_list import READ, AllowList
from onboard.link.authenticator import Zap
from onboard.link.connections import (
    BYTES_AT_ONCE,
    MESSAGES_AT_ONCE,
    MOST_SILENT,
    TAKES_NOTHING_S,
    UNREAD_BYTES,
    Connection,
    Counts,
)
from onboard.link.router import Router
from onboard.link.server import Limits
from onboard.spool import Batch
from shore.link.link import Link
from tests.link.bench import Bench, on_bench
from tests.link.floods import GREETING, LEASE, PART, PING, Flood, connected, crowd, message, until_cut

BOAT = '[boat]\nid = "a"\n[frames]\nrate_hz = 20\n[[port]]\nname = "g"\npath = "/dev/ttyNONE"\n'
SENSOR = '[[sensor]]\nid = "gps1"\nport = "g"\nrole = "gps"\n'


def port_of(endpoint: str) -> int:
    return int(endpoint.rpartition(":")[2])


def heard_at(t_ns: int) -> Connection:
    """A connection that has brought a message."""
    return Connection("a:1", 0, heard_ns=t_ns)


def received(count: int) -> Counts:
    return Counts(count, 0, is_waiting=False)


def test_a_budget_is_so_much_at_once_and_then_so_much_a_second() -> None:
    peer = heard_at(1)
    assert peer.fault(received(BYTES_AT_ONCE), 1) is None
    peer.heard_ns = NS_PER_S
    assert (
        peer.fault(received(BYTES_AT_ONCE + 70_000), NS_PER_S) == "it sent more than 64 kB/s and half of what it takes"
    )
    station = Connection("b:1", 0)
    for second in range(1, 1000):
        station.heard_ns = second * NS_PER_S
        assert station.fault(received(26_000 * second), second * NS_PER_S) is None


def test_a_station_that_catches_up_may_send_more() -> None:
    """Missing frames come with 1 MB/s, and each 12 kB of them is answered by a lease of 2.7 kB."""
    station = Connection("b:1", 0)
    for second in range(1, 1000):
        station.heard_ns = second * NS_PER_S
        counts = Counts(225_000 * second, 1_000_000 * second, is_waiting=True)
        assert station.fault(counts, second * NS_PER_S) is None


def test_a_message_that_never_ends_is_cut_however_slow_it_is() -> None:
    peer, came, now_ns = heard_at(1), 0, NS_PER_S
    while peer.fault(received(came), now_ns) is None:
        came, now_ns = came + 100, now_ns + NS_PER_S // 20
        assert came < UNREAD_BYTES + 1000
    assert came > UNREAD_BYTES


def test_who_takes_nothing_of_what_waits_for_it_is_cut_and_nobody_is_warned() -> None:
    def faults(acknowledged_bytes: int, *, is_waiting: bool) -> list[str | None]:
        peer = heard_at(1)
        counts = [Counts(0, second * acknowledged_bytes, is_waiting=is_waiting) for second in range(10)]
        return [peer.fault(each, (1 + second) * NS_PER_S) for second, each in enumerate(counts)]

    assert not any(fault is not None for fault in faults(100, is_waiting=True) + faults(0, is_waiting=False))
    assert faults(0, is_waiting=True).index("") == TAKES_NOTHING_S + 1


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


def test_a_message_of_many_parts_is_one_message_that_is_wrong() -> None:
    async def run(bench: Bench) -> None:
        honest, other = await bench.joined(), connected(port_of(bench.endpoint))
        other.sendall(b"\x01\x00" * 20_000 + b"\x00\x00" + message(b"x"))
        for _ in range(100):
            await asyncio.sleep(0.01)
            if bench.server.malformed == 2:
                break
        assert bench.server.malformed == 2
        bench.publish(1)
        await honest.lease()
        assert len(await honest.frames(1)) == 1
        other.close()

    on_bench(run)


def test_frames_that_nobody_has_cost_the_board_few_reads() -> None:
    async def run(bench: Bench) -> None:
        reads, read = 0, bench.spool.read

        def counted(boot_id: str, first: int, last: int, max_bytes: int) -> Batch:
            nonlocal reads
            reads += 1
            return read(boot_id, first, last, max_bytes)

        bench.spool.read = counted  # type: ignore[method-assign]
        client = bench.client()
        for _ in range(10):
            await client.lease(*(FrameRange("cd" * 8, number * 10, number * 10) for number in range(64)))
            await asyncio.sleep(0.03)
        assert 0 < reads < 30  # 100 kB/s are some 25 reads a second

    on_bench(run, Limits(fill_bytes_per_s=100_000))


def test_of_a_crowd_the_connections_of_another_host_stay() -> None:
    async def run(bench: Bench) -> None:
        far = socket.create_connection(("127.0.0.1", port_of(bench.endpoint)), 5)
        peers = crowd(port_of(bench.endpoint), MOST_SILENT + 40)
        await asyncio.sleep(0.3)
        far.sendall(GREETING)
        far.settimeout(5)
        assert len(await asyncio.to_thread(far.recv, 1000)) > 0
        with suppress(TimeoutError):
            far.settimeout(0.2)
            while await asyncio.to_thread(far.recv, 1000):
                pass
            raise AssertionError("the other host's connection was cut")
        for peer in (far, *peers):
            peer.close()

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


def test_a_peer_that_hangs_up_behind_many_messages_does_not_end_the_daemon(board: Board) -> None:
    """libzmq aborts when a connection hangs up while its queue is full and an answer to a PING is due."""
    for messages, pause_s in ((600, 0.001), (1500, 0.002), (1500, 0.004)) * 20:  # each ended it within some 20 times
        peer = connected(board.port)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # it is reset
        peer.sendall(b"\x00\x01x" * messages + PING + b"\x00\x01x" * 5)
        time.sleep(pause_s)
        peer.close()
    link = Link(f"127.0.0.1:{board.port}")
    link.connect(5.0)
    link.close()


FLOODS = {
    "parts": (PART * 8, 1, 100e6),
    "leases": (message(LEASE) * 20, 4, 5e6),
    "bad": (message(b"x" * 1000) * 20, 4, 5e6),
}
"""Data, number of attackers, bytes/s of all together."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", FLOODS)
def test_a_flood_makes_no_frame_old_and_fills_no_memory(board: Board, kind: str) -> None:
    data, count, bytes_per_s = FLOODS[kind]
    link = Link(f"127.0.0.1:{board.port}")
    link.connect(5.0, stream=True)
    with ExitStack() as stack:
        floods = [stack.enter_context(Flood(board.port, data, bytes_per_s / count)) for _ in range(count)]
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
