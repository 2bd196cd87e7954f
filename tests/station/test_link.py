"""The station's socket against a board that is played here: what a stalled station and a broken greeting do to it."""

import socket
import threading
from collections.abc import Iterator
from itertools import pairwise

import pytest
import zmq

from common import session
from common.clock import boottime_ns
from common.errors import LinkError
from common.keys import new_keys
from common.messages import SCHEMA_VERSION
from common.units import NS_PER_S
from shore.link import link as link_module
from shore.link.link import Link, LinkKeys

GREETING = {"schema": SCHEMA_VERSION, "link": session.LINK_VERSION, "boot_id": "b0", "next_seq": 0, "runs": []}


class Board:
    """A ROUTER that greets whoever says hello and sends what it is told."""

    def __init__(self) -> None:
        self.context = zmq.Context()
        self.socket = self.context.socket(zmq.ROUTER)
        self.port = self.socket.bind_to_random_port("tcp://127.0.0.1")
        self.station = b""

    def greet(self) -> None:
        assert self.socket.poll(5000)
        self.station = self.socket.recv_multipart()[0]
        self.send(session.pack("connected", **GREETING, config={}))

    def send(self, *parts: bytes) -> None:
        self.socket.send_multipart([self.station, *parts])

    def close(self) -> None:
        self.socket.close(linger=0)
        self.context.term()


@pytest.fixture
def board() -> Iterator[Board]:
    played = Board()
    yield played
    played.close()


def test_a_station_that_did_not_look_for_long_reads_what_came_meanwhile(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow disk, a busy machine: the board's last words are in the socket that must not be thrown away for that."""
    link = Link(f"127.0.0.1:{board.port}")
    try:
        greeting = threading.Thread(target=board.greet)
        greeting.start()
        link.connect()
        greeting.join()
        board.send(session.pack("frame", boot_id="b0", seq=0), b"the frame")
        board.send(session.pack("end", sent=1, reason="the daemon stops", boot_id="b0", next_seq=1))
        monkeypatch.setattr(link_module, "boottime_ns", lambda: boottime_ns() + 10 * NS_PER_S)
        first, second = link.receive(2.0), link.receive(2.0)
        assert first is not None
        assert first.frame == b"the frame"
        assert second is not None
        assert second.end is not None
    finally:
        link.close()


def test_a_board_that_is_silent_loses_its_socket(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    link = Link(f"127.0.0.1:{board.port}")
    try:
        greeting = threading.Thread(target=board.greet)
        greeting.start()
        link.connect()
        greeting.join()
        monkeypatch.setattr(link_module, "boottime_ns", lambda: boottime_ns() + 10 * NS_PER_S)
        assert link.receive(0.1) is None
        routing_ids = {board.station}
        deadline_ns = boottime_ns() + 5 * NS_PER_S
        while routing_ids == {board.station} and boottime_ns() < deadline_ns:
            assert link.receive(0.05) is None  # the lease goes out over a new socket
            while board.socket.poll(0):
                routing_ids.add(board.socket.recv_multipart()[0])
        assert len(routing_ids) == 2
    finally:
        link.close()


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


def test_while_nothing_is_heard_each_socket_has_longer(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    """A greeting takes some seven round trips: over a far radio a fixed limit would end each of them, for ever."""
    link = Link(f"127.0.0.1:{board.port}")
    try:
        greeting = threading.Thread(target=board.greet)
        greeting.start()
        link.connect()
        greeting.join()
        board.close()
        opened: list[float] = []
        ahead_ns = 0
        monkeypatch.setattr(link_module, "boottime_ns", lambda: boottime_ns() + ahead_ns)

        def renewed(each: Link) -> None:
            opened.append(ahead_ns / NS_PER_S)
            each._opened_ns = boottime_ns() + ahead_ns

        monkeypatch.setattr(Link, "_new_socket", renewed)
        while ahead_ns < 40 * NS_PER_S:
            assert link.receive(0.0) is None
            ahead_ns += NS_PER_S // 4
        assert opened[0] == pytest.approx(1.5, abs=0.3)
        assert [later - first for first, later in pairwise(opened)][:4] == pytest.approx([1.5, 3.0, 6.0, 6.0], abs=0.5)
    finally:
        link.close()


def test_whoever_breaks_our_greetings_in_a_running_session_does_not_end_it(board: Board) -> None:
    link = Link(f"127.0.0.1:{board.port}")
    try:
        greeting = threading.Thread(target=board.greet)
        greeting.start()
        link.connect()
        greeting.join()
        stranger = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=closing, args=(stranger, 50), daemon=True).start()
        link.move_to(f"127.0.0.1:{stranger.getsockname()[1]}")
        deadline_ns = boottime_ns() + 10 * NS_PER_S
        while link.refusal is None and boottime_ns() < deadline_ns:
            assert link.receive(0.1) is None
        assert link.refusal == "the boat wants a key and this station gave none"
    finally:
        link.close()
