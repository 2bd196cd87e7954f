"""The station's link: over a transport without a socket, and over ZeroMQ against a board that is played here."""

import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
import zmq

from common import link_messages as session
from common.clock import boottime_ns
from common.errors import LinkError
from common.keys import new_keys
from common.link_messages import FrameRange
from common.units import NS_PER_S
from shore.link.link import Link, Wants
from shore.link.transport import HandshakeFault, LinkKeys
from tests.station.transports import GREETING, FakeTransport, board, nobody

KEYS = LinkKeys(b"own", b"secret", b"boat")


def link_over(transport: FakeTransport, keys: LinkKeys | None = None, window: int = session.WINDOW_BYTES) -> Link:
    return Link("10.0.0.1", keys=keys, window=window, transport=transport, now_ns=transport.now_ns)


def listen(link: Link, transport: FakeTransport, seconds: float) -> None:
    """Take what comes for so long."""
    end_s = transport.t_s + seconds
    while transport.t_s < end_s:
        link.receive(0.05)


def sent(transport: FakeTransport, kind: str) -> list[tuple[float, dict[str, Any]]]:
    return [(t_s, message) for t_s, message in transport.sent if message["type"] == kind]


# Over a transport without a socket.


def test_hello_is_said_twice_a_second_until_somebody_answers() -> None:
    transport = FakeTransport()
    with pytest.raises(LinkError, match="no answer within 2 s"):
        link_over(transport).connect(2.0)
    assert [t_s for t_s, _ in sent(transport, "hello")] == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=0.001)
    assert transport.opened == [(0.0, "tcp://10.0.0.1:5760")]


def test_a_hello_that_nobody_takes_is_said_as_soon_as_somebody_is_there() -> None:
    transport = FakeTransport(board)
    transport.is_there = False
    looks = iter(range(1000))

    def stopped() -> bool:
        transport.is_there = next(looks) >= 5
        return False

    assert link_over(transport).connect(2.0, stopped) == {"type": "connected", **GREETING}
    assert [t_s for t_s, _ in sent(transport, "hello")] == pytest.approx([0.25], abs=0.06)


@pytest.mark.parametrize(
    ("verdict", "keys", "words"),
    [
        (HandshakeFault.UNKNOWN_KEY, KEYS, "the boat does not know this station's key"),
        (HandshakeFault.MISMATCH, KEYS, "the boat did not take our greeting"),
        (HandshakeFault.MISMATCH, None, "the boat wants a key and this station gave none"),
    ],
)
def test_a_refusal_ends_a_greeting_and_not_a_session(
    verdict: HandshakeFault, keys: LinkKeys | None, words: str
) -> None:
    transport = FakeTransport()
    transport.verdicts.append(verdict)
    with pytest.raises(LinkError, match=words):
        link_over(transport, keys).connect()
    transport = FakeTransport(board)
    link = link_over(transport, keys)
    link.connect()
    listen(link, transport, 1.0)
    transport.answer = nobody
    transport.verdicts.append(verdict)
    listen(link, transport, 20.0)
    assert link.refusal == words
    transport.answer = board
    listen(link, transport, 1.0)
    assert link.refusal is None
    assert link.silent_s() < 0.3


def test_a_session_leases_at_once_then_four_times_a_second_and_sooner_when_asked() -> None:
    transport = FakeTransport(board)
    link = link_over(transport)
    asked = [FrameRange("b0", 3, 4)]
    link.connect(wants=lambda: Wants(missing=tuple(asked)))
    listen(link, transport, 1.05)
    leases = sent(transport, "lease")
    assert [t_s for t_s, _ in leases] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0], abs=0.001)
    assert {(message["boot_id"], *message["missing"][0]) for _, message in leases} == {("b0", "b0", 3, 4)}
    asked[:] = [FrameRange("b0", 7, 7)]
    link.ask_soon()
    listen(link, transport, 0.5)
    times_s = [t_s for t_s, _ in sent(transport, "lease")][4:]
    assert times_s == pytest.approx([1.0, 1.1, 1.35], abs=0.06)
    assert sent(transport, "lease")[-1][1]["missing"] == [["b0", 7, 7]]


def test_a_caller_who_waits_long_does_not_make_a_lease_late() -> None:
    transport = FakeTransport(board)
    link = link_over(transport)
    link.connect()
    transport.answer = nobody
    for _ in range(5):
        link.receive(60.0)
    times_s = [t_s for t_s, _ in sent(transport, "lease")]
    assert [later - first for first, later in pairwise(times_s)] == pytest.approx([0.25] * (len(times_s) - 1))


def test_half_a_window_that_has_come_is_leased_at_once() -> None:
    transport = FakeTransport(board)
    link = link_over(transport, window=4096)
    link.connect()
    listen(link, transport, 0.05)
    assert len(sent(transport, "lease")) == 1
    transport.inbox.extend([[session.pack("frame", boot_id="b0", seq=seq), b"x" * 1100] for seq in range(2)])
    for _ in range(3):
        link.receive(0.0)
    assert [message["received"] for _, message in sent(transport, "lease")] == [0, 2200]


def test_while_nothing_is_heard_each_connection_has_longer() -> None:
    """A greeting takes some seven round trips: over a far radio a fixed limit would end each of them, for ever."""
    transport = FakeTransport(board)
    link = link_over(transport)
    link.connect()
    transport.answer = nobody
    listen(link, transport, 30.0)
    times_s = [t_s for t_s, _ in transport.opened]
    assert [later - first for first, later in pairwise(times_s)] == pytest.approx([1.5, 1.5, 3, 6, 6, 6], abs=0.2)
    transport.answer = board
    listen(link, transport, 1.0)
    heard_s = transport.t_s
    transport.answer = nobody
    listen(link, transport, 2.0)
    assert transport.opened[-1][0] - heard_s == pytest.approx(1.5, abs=0.3)


def test_the_session_goes_on_at_another_address() -> None:
    transport = FakeTransport(board)
    link = link_over(transport)
    link.connect()
    link.move_to("[fe80::1]:77")
    listen(link, transport, 0.2)
    assert transport.opened[1][1] == link.endpoint == "tcp://[fe80::1]:77"
    assert len({message["session"] for _, message in transport.sent}) == 1


def test_goodbye_is_said_once_and_only_where_there_was_a_session() -> None:
    unused, used = FakeTransport(board), FakeTransport(board)
    link = link_over(used)
    link.connect()
    link.close()
    link.close()
    link_over(unused).close()
    assert [len(sent(transport, "bye")) for transport in (used, unused)] == [1, 0]
    assert used.is_closed
    assert unused.is_closed


# Over ZeroMQ.


class Board:
    """A ROUTER that greets a station and sends what the test says."""

    def __init__(self) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.ROUTER)
        self.port = self.socket.bind_to_random_port("tcp://127.0.0.1")
        self.station = b""

    def greet(self) -> None:
        assert self.socket.poll(5000)
        self.station = self.socket.recv_multipart()[0]
        self.send(session.pack("connected", **GREETING))

    def send(self, *parts: bytes) -> None:
        self.socket.send_multipart([self.station, *parts])

    def close(self) -> None:
        self.socket.close(linger=0)
        self.context.term()


@dataclass
class Clock:
    """The machine's, or so many seconds ahead of it."""

    ahead_s: float = 0.0

    def __call__(self) -> int:
        return boottime_ns() + round(self.ahead_s * NS_PER_S)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def played() -> Iterator[Board]:
    the_board = Board()
    yield the_board
    the_board.close()


@pytest.fixture
def joined(played: Board, clock: Clock) -> Iterator[Link]:
    """A session with the board that is played."""
    link = Link(f"127.0.0.1:{played.port}", now_ns=clock)
    greeting = threading.Thread(target=played.greet)
    greeting.start()
    try:
        try:
            link.connect()
        finally:
            greeting.join()  # one thread at a time has the board's socket
        yield link
    finally:
        link.close()


def test_a_station_that_did_not_look_for_long_reads_what_came_meanwhile(
    joined: Link, played: Board, clock: Clock
) -> None:
    """A slow disk, a busy machine: the board's last words are in the socket that must not be thrown away for that."""
    played.send(session.pack("frame", boot_id="b0", seq=0), b"the frame")
    played.send(session.pack("end", sent=1, reason="the daemon stops", boot_id="b0", next_seq=1))
    clock.ahead_s = 10.0
    first, second = joined.receive(2.0), joined.receive(2.0)
    assert first is not None
    assert first.frame == b"the frame"
    assert second is not None
    assert second.end is not None


def test_a_board_that_is_silent_loses_its_socket(joined: Link, played: Board, clock: Clock) -> None:
    clock.ahead_s = 10.0
    assert joined.receive(0.1) is None
    routing_ids = {played.station}
    deadline_ns = boottime_ns() + 5 * NS_PER_S
    while routing_ids == {played.station} and boottime_ns() < deadline_ns:
        assert joined.receive(0.05) is None  # the lease goes out over a new socket
        while played.socket.poll(0):
            routing_ids.add(played.socket.recv_multipart()[0])
    assert len(routing_ids) == 2


def closing(listener: socket.socket, times: int) -> None:
    for _ in range(times):
        connection, _ = listener.accept()
        connection.recv(64)
        connection.close()
    listener.close()


@pytest.mark.parametrize(("times", "words"), [(50, "did not take our greeting"), (1, "no answer within")])
def test_only_greetings_that_break_again_and_again_are_a_fault(times: int, words: str) -> None:
    """A daemon that is stopped amid a greeting breaks one; the station must still be there when it is back."""
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    threading.Thread(target=closing, args=(listener, times), daemon=True).start()
    own, boat = new_keys(), new_keys()
    link = Link(f"127.0.0.1:{port}", keys=LinkKeys(own.public, own.secret, boat.public))
    try:
        with pytest.raises(LinkError, match=words):
            link.connect(3.0)
    finally:
        link.close()


def test_a_stranger_who_breaks_our_greetings_in_a_running_session_does_not_end_it(joined: Link) -> None:
    stranger = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=closing, args=(stranger, 50), daemon=True).start()
    joined.move_to(f"127.0.0.1:{stranger.getsockname()[1]}")
    deadline_ns = boottime_ns() + 10 * NS_PER_S
    while joined.refusal is None and boottime_ns() < deadline_ns:
        assert joined.receive(0.1) is None
    assert joined.refusal == "the boat wants a key and this station gave none"
