"""What a hostile client can do to the board's server: it may waste its own time, nobody else's, and no memory."""

import asyncio
import gc
import logging
import random
import socket
import tracemalloc
from contextlib import suppress
from typing import Any

import msgpack
import pytest
import zmq

from common import link_messages as session
from common.codec import encode_frame
from common.errors import CodecError
from common.link_messages import BoundedRun, FrameRange, Lease
from common.versions import LINK_VERSION
from onboard.link.bounded_run import GATHERED_BYTES, InOrder
from onboard.link.client_leases import Pace
from onboard.link.server import COMMANDS_AT_ONCE, NEWS_AT_ONCE, SESSIONS_OF_KEY, Limits
from tests.link.bench import BOOT, PERIOD_NS, Bench, frame_with, on_bench

HUGE = 2**63 - 1
JUNK: tuple[Any, ...] = (
    None, True, -1, 2**64 - 1, 2**60, 1e308, float("nan"), "", "x" * 5000, b"\xff" * 300, [], {}, [[]] * 900,
    ["ab", 0, HUGE], [["ab" * 8, 0, HUGE]] * 64, {"m": 2**60}, "\u202e\n\x1b[31m", msgpack.Timestamp(1, 1),
)  # fmt: skip


def valid_message(draw: random.Random) -> dict[str, Any]:
    name = f"{draw.randrange(64):x}"
    match draw.randrange(8):
        case 0:
            return {"type": "hello", "schema": 1, "link": LINK_VERSION}
        case 1:
            return {"type": "command", "id": draw.randrange(9), "name": "mark", "argument": "x"}
        case 2:
            return {"type": "bye", "session": name}
        case 3:
            return {"type": draw.choice(session.TYPES)}
        case 4 | 5:
            m, period_s = draw.choice((None, 1, 10**7)), draw.choice((None, 1.0))
            run = BoundedRun(m, draw.randrange(3), BOOT, draw.randrange(900), period_s)
            return {"type": "lease", **Lease(name, BOOT, 2**20, 0, 0, (), run).as_fields()}
        case _:
            firsts = draw.choices(range(1000), k=draw.randrange(64))
            spans = draw.choice(((0, 9), (HUGE - 10**6,)))
            missing = tuple(FrameRange(BOOT, first, first + draw.choice(spans)) for first in firsts)
            lease = Lease(name, BOOT, draw.choice((1024, 2**20)), draw.randrange(HUGE), 0, missing)
            return {"type": "lease", "client": "mallory", **lease.as_fields()}


def hostile_message(draw: random.Random) -> list[bytes]:
    """A valid message, one with wrong fields, one with wrong bytes, or noise."""
    message = valid_message(draw)
    way = draw.randrange(5)
    if way == 0:
        return [draw.randbytes(draw.randrange(200)) for _ in range(draw.randrange(4))]
    if way == 1:
        place = message["run"] if isinstance(message.get("run"), dict) and draw.random() < 0.5 else message
        place[draw.choice(list(place))] = draw.choice(JUNK)
    data = bytearray(msgpack.packb(message, use_bin_type=True))
    if draw.random() < 0.02:
        return [b"\xdc\x04\x00" * draw.randrange(1, 5000)]  # lists in lists, each to be of 1,024 values
    if way == 2:
        for _ in range(draw.randrange(1, 6)):
            data[draw.randrange(len(data))] = draw.randrange(256)
    if way == 3:
        at = draw.randrange(len(data))
        data[at : at + draw.randrange(9)] = draw.randbytes(draw.randrange(9)) + b"\x91" * draw.choice((0, 0, 3000))
    return [bytes(data)]


@pytest.mark.parametrize("count", [4_000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_random_and_mutated_messages_harm_nobody(count: int, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    draw = random.Random(7)
    kept: list[int] = []

    async def run(bench: Bench) -> None:
        honest = await bench.joined()
        for number in range(count):
            bench.server._receive(b"\0m%d" % (number % 3), "mallory", hostile_message(draw))
            if number % 100 == 0:  # its lease is not to run out meanwhile
                bench.events.clear()
                bench.publish(1)
                await honest.lease()
                assert [item.seq for item in await honest.frames(1)] == [bench.next_seq - 1]
            if number in (count // 4, count - 1):
                await asyncio.sleep(0.05)
                gc.collect()
                kept.append(tracemalloc.get_traced_memory()[0])
        assert bench.server.malformed > count // 5
        assert bench.server.clients <= SESSIONS_OF_KEY + 1

    tracemalloc.start()
    try:
        on_bench(run)
    finally:
        tracemalloc.stop()
    assert caplog.records == []  # every fault was foreseen: none is an error of ours
    print(
        f"\n  hostile: {count} messages, memory {kept[0] // 1000} kB after a quarter, {kept[1] // 1000} kB at the end"
    )
    assert kept[1] - kept[0] < 300_000


def test_the_same_over_a_real_socket() -> None:
    draw = random.Random(8)

    async def run(bench: Bench) -> None:
        honest = bench.client()
        honest.name = "abcdef"  # without keys whoever knows a session's name may end it
        await honest.lease()
        await honest.expect("alive")
        hostile = bench.client()
        for number in range(1000):
            await hostile.socket.send_multipart(hostile_message(draw) or [b""])
            while await hostile.socket.poll(0):
                await hostile.socket.recv_multipart()
            if number % 50 == 0:
                bench.publish(1)
                await honest.lease()
                assert [item.seq for item in await honest.frames(1)] == [bench.next_seq - 1]

    on_bench(run)


def test_one_key_has_four_places_and_leaves_the_others() -> None:
    async def run(bench: Bench) -> None:
        for number in range(1000):
            lease = Lease(f"{number:x}", BOOT, 2**20, 0, 0)
            bench.server._receive(b"\0a", "A" * 40, [session.pack("lease", **lease.as_fields())])
        assert bench.server.clients == SESSIONS_OF_KEY
        bench.server._receive(b"\0b", "B" * 40, [session.pack("lease", **Lease("1", BOOT, 2**20, 0, 0).as_fields())])
        assert bench.server.clients == SESSIONS_OF_KEY + 1

    on_bench(run, Limits(clients=6))


def test_who_comes_and_goes_fills_no_frame_with_events() -> None:
    async def run(bench: Bench) -> None:
        for number in range(2000):
            name = f"{number:x}"
            bench.server._receive(b"\0a", None, [session.pack("lease", **Lease(name, BOOT, 2**20, 0, 0).as_fields())])
            bench.server._receive(b"\0a", None, [session.pack("bye", session=name)])
            bench.server._receive(b"\0a", None, [session.pack("command", id=1, name="mark", argument="x" * 300)])
        await asyncio.sleep(0)
        assert bench.server.clients == 0
        assert NEWS_AT_ONCE <= len(bench.events) < NEWS_AT_ONCE + 20
        assert COMMANDS_AT_ONCE <= len(bench.asked) < COMMANDS_AT_ONCE + 20

    on_bench(run)


@pytest.mark.parametrize("given", ["x" * 4000, ["x"] * 1000, 7, "\x1b[31m\n", None])
def test_a_clients_name_is_short_and_printable(given: Any) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("lease", **{**Lease("a", BOOT, 4096, 0, 0).as_fields(), "client": given})
        await client.expect("alive")
        name = bench.events[-1].evidence["client"]
        assert isinstance(name, str)
        assert 1 <= len(name) <= 32
        assert name.isprintable()

    on_bench(run)


@pytest.mark.parametrize(
    ("fields", "part"),
    [
        ({"id": [1]}, "id must be"),
        ({"id": "9" * 4000}, "id must be"),
        ({"id": 2**64 - 1}, "id must be"),
        ({"id": 1, "argument": [[]]}, "argument must be"),
    ],
)
def test_a_malformed_command_is_named(fields: dict[str, Any], part: str, caplog: pytest.LogCaptureFixture) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("command", name="mark", **fields)
        assert (await client.expect("error"))["what"].startswith(part)
        assert bench.asked == []

    on_bench(run)
    assert caplog.records == []


@pytest.mark.parametrize("field", ["k", "m", "seq"])
def test_a_run_beyond_all_numbers_is_refused_or_waits(field: str) -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        asked = {"m": 5, "k": 0, "boot_id": BOOT, "seq": 0, field: 2**60}
        await client.say("lease", **{**Lease("a", BOOT, 4096, 0, 0).as_fields(), "run": asked})
        message, _ = await client.hear()
        assert message["type"] == ("alive" if field == "seq" else "error")
        bench.publish(3)
        assert await client.is_quiet()

    on_bench(run)


def test_a_client_that_lies_and_never_reads_costs_no_memory_and_no_frame_of_others() -> None:
    """It says that it received everything, asks for all there is each millisecond, and leaves its socket unread."""

    async def run(bench: Bench) -> None:
        bench.publish(300, texts=4)
        honest = await bench.joined()
        honest.window = session.MAX_WINDOW
        liar = bench.client()
        liar.socket.setsockopt(zmq.RCVHWM, 1)
        everything = tuple(FrameRange(BOOT, 0, HUGE) for _ in range(session.MAX_MISSING))
        seen = bench.next_seq
        for number in range(1500):
            lease = Lease("f", BOOT, session.MAX_WINDOW, number * 10**9, 0, everything)
            with suppress(zmq.Again):  # it is cut before long, and its socket comes back only when it is read
                await liar.socket.send(session.pack("lease", **lease.as_fields()), zmq.NOBLOCK)
            await asyncio.sleep(0.001)
            if number % 25 == 0:
                bench.publish(1, texts=4)
                await honest.lease()
                assert [item.seq for item in await honest.frames(1)] == [seen]
                seen += 1

    on_bench(run)


def test_what_is_gathered_for_one_merged_frame_is_bounded() -> None:
    place = InOrder(BoundedRun(None, 0, BOOT, 0, 60.0), PERIOD_NS)
    data = encode_frame(frame_with(0, texts=60))
    most = GATHERED_BYTES // len(data)
    for seq in range(most):
        place.take(encode_frame(frame_with(seq, texts=60)))
    with pytest.raises(CodecError, match="bytes"):
        place.take(encode_frame(frame_with(most, texts=60)))


def test_a_run_whose_frames_get_too_large_ends_with_a_sentence_and_the_others_go_on() -> None:
    async def run(bench: Bench) -> None:
        honest = await bench.joined()
        client = bench.client()
        client.window = session.MAX_WINDOW
        await client.lease(run=BoundedRun(None, 0, BOOT, 0, 60.0))
        await client.expect("alive")
        for _ in range(620):
            bench.publish(1, texts=10)
            await asyncio.sleep(0)
        end = await client.expect("end")
        assert end["reason"].startswith("a frame of this period is too large")
        while not await honest.is_quiet():
            await honest.hear()
        await honest.lease()
        await honest.expect("alive")

    on_bench(run, Limits(fill_bytes_per_s=10**8))


def test_a_pace_gives_so_many_at_once_and_then_so_many_a_second() -> None:
    pace = Pace(3, 2.0)
    assert [pace.allows(10**18) for _ in range(5)] == [True, True, True, False, False]
    assert [pace.allows(10**18 + half * 500_000_000) for half in (1, 1, 2, 3)] == [True, False, True, True]
    assert [pace.allows(10**18 + 10**12) for _ in range(4)] == [True, True, True, False]


def zmtp(data: bytes) -> bytes:
    """A message of one part on the wire."""
    return b"\x02" + len(data).to_bytes(8) + data


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
READY = b"\x05READY" + b"\x0bSocket-Type" + (6).to_bytes(4) + b"DEALER"


async def read(raw: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += (part := await asyncio.get_running_loop().sock_recv(raw, size - len(data)))
        assert part
    return data


@pytest.mark.slow
def test_who_keeps_asking_and_never_reads_is_cut_off() -> None:
    """A socket without libzmq behind it: nothing at its own end closes it, and each lease is a sign of life."""

    async def run(bench: Bench) -> None:
        bench.publish(2000, texts=4)
        loop = asyncio.get_running_loop()
        with socket.socket() as raw:
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            raw.setblocking(False)
            host, port = bench.endpoint.removeprefix("tcp://").split(":")
            await loop.sock_connect(raw, (host, int(port)))
            # libzmq may drop a connection whose first command came together with its greeting.
            await loop.sock_sendall(raw, GREETING)
            await read(raw, len(GREETING))
            await loop.sock_sendall(raw, b"\x04" + bytes([len(READY)]) + READY)
            await read(raw, (await read(raw, 2))[1])
            everything = (FrameRange(BOOT, 0, HUGE),)
            with suppress(ConnectionResetError, BrokenPipeError):
                for number in range(160):
                    lease = Lease("f", BOOT, session.MAX_WINDOW, number * 10**9, 0, everything)
                    await loop.sock_sendall(raw, zmtp(session.pack("lease", **lease.as_fields())))
                    await asyncio.sleep(0.05)
            # What is on its way comes still, and then the end: the board has closed it.
            with suppress(ConnectionResetError):
                async with asyncio.timeout(10.0):
                    while await loop.sock_recv(raw, 65_536):
                        pass
        assert bench.server.malformed == 0
        assert bench.server.clients == 1

    on_bench(run)
