"""The board's server over a real socket, driven without a daemon around it."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import zmq
import zmq.asyncio

from common import session
from common.codec import decode_frame
from common.errors import WayfixError
from common.messages import SCHEMA_VERSION, Event, Frame, RawLine
from common.units import NS_PER_MS, NS_PER_S
from onboard.server import Server, run_fault

PERIOD_NS = 100 * NS_PER_MS


def frame(seq: int) -> Frame:
    t0_ns = seq * PERIOD_NS
    return Frame(boat_id="b", boot_id="0" * 16, seq=seq, clock_id="c", start_no=1, t0_ns=t0_ns, t1_ns=t0_ns + PERIOD_NS)


class Client:
    """A raw DEALER: sees exactly what is on the wire."""

    def __init__(self, context: "zmq.asyncio.Context", endpoint: str, options: dict[str, int]) -> None:
        self.socket = context.socket(zmq.DEALER)
        for name, value in options.items():
            self.socket.setsockopt(getattr(zmq, name), value)
        self.socket.connect(endpoint)

    async def say(self, kind: str, **fields: Any) -> None:
        await self.socket.send(session.pack(kind, **fields))

    async def hear(self) -> tuple[dict[str, Any], bytes]:
        parts = await asyncio.wait_for(self.socket.recv_multipart(), 5)
        return session.unpack(parts[0]), parts[1] if len(parts) > 1 else b""

    async def expect(self, kind: str) -> dict[str, Any]:
        message, _ = await self.hear()
        assert message["type"] == kind, message
        return message


class Bench:
    """Server and context of one test."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.next_seq = 0
        self.server = Server(lambda: {"next_seq": self.next_seq}, PERIOD_NS, self.events.append, lambda: 0)
        self.endpoint = self.server.bind("tcp://127.0.0.1:*")
        self.context = zmq.asyncio.Context()
        self.clients: list[Client] = []
        self.task = asyncio.create_task(self.server.run())

    def client(self, **options: int) -> Client:
        self.clients.append(Client(self.context, self.endpoint, options))
        return self.clients[-1]

    async def joined(self) -> Client:
        client = self.client()
        await client.say("hello", schema=SCHEMA_VERSION, client="test")
        await client.expect("connected")
        return client

    async def settle(self) -> None:
        """Until the server has read what was sent before: a stranger's refused word comes after it."""
        stranger = self.client()
        await stranger.say("run")
        await stranger.expect("error")
        await asyncio.sleep(0.05)  # sockets are read in turn, not in order of sending

    def publish(self, count: int) -> None:
        for _ in range(count):
            self.server.publish(frame(self.next_seq))
            self.next_seq += 1

    async def close(self) -> None:
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)
        self.server.close()
        for client in self.clients:
            client.socket.close(linger=0)
        self.context.term()


def on_bench(test: Callable[[Bench], Any]) -> None:
    async def run() -> None:
        bench = Bench()
        try:
            await test(bench)
        finally:
            await bench.close()

    asyncio.run(run())


def test_a_continuous_run_has_every_frame_from_next_seq_on() -> None:
    async def run(bench: Bench) -> None:
        bench.publish(3)
        client = bench.client()
        await client.say("hello", schema=SCHEMA_VERSION)
        connected = await client.expect("connected")
        bench.publish(4)  # between hello and run: held, not lost
        await client.say("run")
        await bench.settle()
        bench.publish(2)
        seqs = [decode_frame((await client.hear())[1]).seq for _ in range(6)]
        assert connected["next_seq"] == 3
        assert seqs == [3, 4, 5, 6, 7, 8]

    on_bench(run)


def test_run_m_gives_exactly_m_frames_of_one_period_each_then_end() -> None:
    async def run(bench: Bench) -> None:
        bench.publish(3)
        client = await bench.joined()
        await client.say("run", m=4, period_s=1)
        await bench.settle()
        bench.publish(80)
        frames, ks = [], []
        for _ in range(4):
            message, data = await client.hear()
            frames.append(decode_frame(data))
            ks.append(message["k"])
        end = await client.expect("end")
        assert ks == [1, 2, 3, 4]
        assert [item.t1_ns - item.t0_ns for item in frames] == [NS_PER_S] * 4
        assert all(item.t0_ns % NS_PER_S == 0 for item in frames)
        assert [item.first_seq for item in frames[1:]] == [item.seq + 1 for item in frames[:-1]]
        assert end["sent"] == 4
        await bench.settle()
        assert [item.code for item in bench.events] == ["client-joined", "client-left"]

    on_bench(run)


@pytest.mark.parametrize(
    ("request_fields", "part"),
    [
        ({"m": 0}, "m must be"),
        ({"m": True}, "m must be"),
        ({"m": "many"}, "m must be"),
        ({"m": 5, "period_s": 0.01}, "period_s must be from"),
        ({"m": 5, "period_s": float("nan")}, "period_s must be from"),
        ({"m": 5, "period_s": 0.15}, "multiple"),
        ({"m": 5, "period_s": "1"}, "must be a number"),
    ],
)
def test_a_wrong_run_request_is_refused_with_the_reason(request_fields: dict[str, Any], part: str) -> None:
    fault = run_fault(request_fields, PERIOD_NS)
    assert fault is not None
    assert part in fault


def test_an_end_for_all_says_how_many_were_sent() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        await client.say("run")
        await bench.settle()
        bench.publish(5)
        bench.server.end_all("the daemon stops")
        for _ in range(5):
            await client.expect("frame")
        end = await client.expect("end")
        assert (end["sent"], end["next_seq"], end["reason"]) == (5, 5, "the daemon stops")

    on_bench(run)


def test_malformed_messages_are_counted_and_harm_nobody() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        stranger = bench.client()
        for data in (b"", b"\xff\x00", b"\x81", session.pack("frame"), b"\x93\x01\x02\x03"):
            await stranger.socket.send(data)
        await stranger.socket.send_multipart([b"a", b"b"])
        await client.say("run")
        await bench.settle()
        bench.publish(1)
        await client.expect("frame")
        assert bench.server.malformed == 5

    on_bench(run)


def test_a_well_formed_but_hostile_request_is_refused_and_the_daemon_lives() -> None:
    nested: list[Any] = []
    for _ in range(400):
        nested = [nested]

    async def run(bench: Bench) -> None:
        client = await bench.joined()
        await client.say("run", m=nested)
        assert "m must be a whole number" in (await client.expect("error"))["what"]
        await client.say("run", period_s=nested)
        assert "period_s must be a number" in (await client.expect("error"))["what"]
        await client.say("hello", schema=SCHEMA_VERSION, client="a\nb\x1b[2J")
        await client.expect("connected")
        assert not bench.task.done()

    on_bench(run)


def test_a_frame_that_cannot_be_encoded_is_an_event_and_the_next_one_goes_out() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        await client.say("run")
        await bench.settle()
        bench.server.publish(replace(frame(0), t0_ns=1))  # not whole microseconds
        bench.server.publish(frame(1))
        message, data = await client.hear()
        assert (message["k"], decode_frame(data).seq) == (1, 1)
        assert [item.code for item in bench.events] == ["client-joined", "frame-failed"]

    on_bench(run)


def test_another_schema_is_refused_with_a_sentence() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("hello", schema=SCHEMA_VERSION + 1)
        refusal = await client.expect("error")
        assert "the other side is newer" in refusal["what"]

    on_bench(run)


def test_a_client_that_greets_and_asks_for_nothing_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.server.GREETING_NS", 0)

    async def run(bench: Bench) -> None:
        for _ in range(3):
            await bench.joined()
        bench.publish(1)
        assert bench.server._sessions == {}
        assert [item.code for item in bench.events].count("client-left") == 3

    on_bench(run)


def test_a_second_run_counts_from_one_again() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        await client.say("run")
        await bench.settle()
        bench.publish(3)
        await client.say("run", m=2)
        await bench.settle()
        bench.publish(2)
        ks = [(await client.hear())[0]["k"] for _ in range(5)]
        assert ks == [1, 2, 3, 1, 2]
        assert (await client.expect("end"))["sent"] == 2

    on_bench(run)


def test_a_merged_frame_over_the_limits_ends_the_session_and_not_the_daemon() -> None:
    async def run(bench: Bench) -> None:
        client = await bench.joined()
        await client.say("run", m=2, period_s=1)
        await bench.settle()
        lines = tuple(RawLine(sensor="gps1", t_ns=0, text="x" * 500) for _ in range(1000))
        for seq in range(20):
            bench.server.publish(replace(frame(seq), raw=lines))
        assert "too large" in (await client.expect("end"))["reason"]
        assert bench.server._sessions == {}

    on_bench(run)


def test_run_before_hello_is_refused() -> None:
    async def run(bench: Bench) -> None:
        client = bench.client()
        await client.say("run")
        refusal = await client.expect("error")
        assert refusal["what"] == "no session"

    on_bench(run)


def test_a_client_that_stops_reading_costs_a_bounded_queue_and_is_told_of_its_loss(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("onboard.server.QUEUE_BYTES", 20_000)
    monkeypatch.setattr("onboard.server.SEND_HIGH_WATER_MARK", 1)

    async def run(bench: Bench) -> None:
        client = bench.client(RCVHWM=1, RCVBUF=4096)
        await client.say("hello", schema=SCHEMA_VERSION, client="slow")
        await client.expect("connected")
        await client.say("run")
        await bench.settle()
        for _ in range(100):  # far more than sockets and queue hold together
            bench.publish(200)
            await asyncio.sleep(0)
        (waiting,) = bench.server._sessions.values()
        assert 0 < waiting.queued_bytes <= 20_000
        # What was told already, each time the queue ran empty, counts too.
        told = [item.evidence for item in bench.events if item.code == "frames-dropped"]
        assert waiting.dropped + sum(int(item["count"] or 0) for item in told) > 10_000
        seqs = []
        while waiting.queue:  # the client reads again
            seqs.append(decode_frame((await client.hear())[1]).seq)
            bench.publish(1)
        assert seqs == sorted(set(seqs))
        told = [item.evidence for item in bench.events if item.code == "frames-dropped"]
        assert told
        assert {item["client"] for item in told} == {"slow"}

    on_bench(run)


def test_a_port_in_use_is_one_sentence() -> None:
    async def run(bench: Bench) -> None:
        second = Server(dict, PERIOD_NS, lambda _event: None, lambda: 0)
        with pytest.raises(WayfixError, match="cannot listen there") as caught:
            second.bind(bench.endpoint)
        assert bench.endpoint in str(caught.value)

    on_bench(run)
