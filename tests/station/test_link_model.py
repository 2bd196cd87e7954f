"""The board's server and the station's ledger over a wire that is slow, is cut and forgets: every frame comes once.

No socket and no clock of the machine but the server's own; the wire is a list.
"""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable
from typing import Any, cast

import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

from common import link_messages as session
from common.boat_config import SpoolTable
from common.codec import decode_frame
from common.framer import Identity
from common.link_messages import BoundedRun, Lease
from common.messages import Event, Frame
from common.units import NS_PER_MS
from onboard.journal import Journal
from onboard.link.router import Receive, Router
from onboard.link.server import Server
from onboard.spool import Spool
from shore.link.frame_ledger import Ledger
from tests.strategies import numbered_frame

PERIOD_NS = 100 * NS_PER_MS
WINDOW = 2048


class Wire:
    """Stands for the ROUTER: what is sent waits here until it is delivered; a cut loses it."""

    def __init__(self) -> None:
        self.connection = b"c0"
        self.waiting: deque[list[bytes]] = deque()
        self.room = 1000

    def start(self, receive: Receive) -> None:
        self.receive = receive

    def send(self, routing_id: bytes, parts: list[bytes]) -> int | None:
        if routing_id != self.connection:
            return int(zmq.EHOSTUNREACH)
        if len(self.waiting) >= self.room:
            return int(zmq.EAGAIN)
        self.waiting.append(parts)
        return None

    def cut(self) -> None:
        self.connection = b"c%d" % (int(self.connection[1:]) + 1)
        self.waiting.clear()


class Station:
    """A client of the smallest kind: ledger and lease."""

    def __init__(self, wire: Wire, boot_id: str) -> None:
        self.wire = wire
        self.ledger = Ledger()
        self.ledger.greet(boot_id, 0, [])
        self.boot_id = boot_id
        self.received = 0
        self.came: list[tuple[str, int]] = []
        self.most_on_the_way = 0
        self.run: BoundedRun | None = None
        self.ks: list[int] = []
        self.frames: list[Frame] = []
        self.end: dict[str, Any] | None = None

    def lease(self) -> None:
        missing = () if self.run else self.ledger.missing()
        lease = Lease("a1", self.boot_id, WINDOW, self.received, 0, missing, self.run)
        self.wire.receive(self.wire.connection, None, [session.pack("lease", **lease.as_fields())])

    def read(self, count: int) -> None:
        on_the_way = sum(len(parts[1]) for parts in self.wire.waiting if len(parts) == 2)
        self.most_on_the_way = max(self.most_on_the_way, on_the_way)
        for _ in range(min(count, len(self.wire.waiting))):
            self.take(self.wire.waiting.popleft())

    def take(self, parts: list[bytes]) -> None:
        message = session.unpack(parts[0], 10**6)
        if message["type"] == "frame":
            self.received += len(parts[1])
            frame = decode_frame(parts[1])
            self.frames.append(frame)
            if self.run is not None:
                self.ks.append(message["k"])
                self.run = BoundedRun(self.run.m, message["k"], frame.boot_id, frame.seq + 1, self.run.period_s)
            elif self.ledger.take(frame.boot_id, frame.seq, frame.seq):
                self.came.append((frame.boot_id, frame.seq))
        elif message["type"] == "alive":
            for item in session.frame_ranges(message["gone"]):
                self.ledger.is_gone(item)
        elif message["type"] == "end":
            self.end = message


class Board:
    """A server on the wire, frames on demand."""

    def __init__(self, wire: Wire) -> None:
        self.identity = Identity("b", "ab" * 8, "c", 1)
        self.events: list[Event] = []
        journal = Journal(self.events.append, lambda: 0)
        self.spool = Spool(None, self.identity, SpoolTable(), journal)
        self.server = Server(
            cast("Router", wire), self.spool, connected=dict, frame_period_ns=PERIOD_NS,
            journal=journal, rights=lambda _key: frozenset({"read"}),
        )  # fmt: skip
        self.seq = 0

    def make(self, count: int) -> None:
        for _ in range(count):
            self.server.publish(numbered_frame(self.seq, period_ns=PERIOD_NS, boot_id=self.identity.boot_id))
            self.seq += 1


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0.0005)


def played(play: Callable[[Wire, Board, Station], Awaitable[None]]) -> tuple[Wire, Board, Station]:
    async def run() -> tuple[Wire, Board, Station]:
        wire = Wire()
        board = Board(wire)
        station = Station(wire, board.identity.boot_id)
        serving = asyncio.create_task(board.server.run())
        await asyncio.sleep(0)
        try:
            await play(wire, board, station)
        finally:
            serving.cancel()
            await asyncio.gather(serving, return_exceptions=True)
        return wire, board, station

    return asyncio.run(run())


async def until_quiet(station: Station, is_done: Callable[[], bool]) -> None:
    for _ in range(400):
        station.lease()
        await settle()
        station.read(10**6)
        if is_done():
            return
    raise AssertionError("it never ends")


STEPS = st.lists(
    st.one_of(
        st.tuples(st.just("make"), st.integers(1, 30)),
        st.tuples(st.just("lease"), st.just(0)),
        st.tuples(st.just("read"), st.integers(1, 20)),
        st.tuples(st.just("cut"), st.just(0)),
        st.tuples(st.just("room"), st.integers(0, 5)),
        st.tuples(st.just("wait"), st.just(0)),
    ),
    max_size=30,
)


async def happens(what: str, number: int, wire: Wire, board: Board, station: Station) -> None:
    """One of STEPS."""
    match what:
        case "make":
            board.make(number)
        case "lease" if station.end is None:
            station.lease()
        case "read":
            station.read(number)
        case "cut":
            wire.cut()
        case "room":
            wire.room = number
        case _:
            await settle()


@settings(max_examples=60, deadline=None)
@given(STEPS)
def test_every_frame_comes_once_whatever_the_wire_does(steps: list[tuple[str, int]]) -> None:
    async def play(wire: Wire, board: Board, station: Station) -> None:
        board.make(1)
        for what, number in steps:
            await happens(what, number, wire, board, station)
        wire.room = 1000
        board.make(1)
        station.ledger.exists(board.identity.boot_id, board.seq)
        await until_quiet(station, lambda: station.ledger.missing_count == 0)

    _, board, station = played(play)
    assert sorted(seq for _, seq in station.came) == list(range(board.seq))
    size = len(board.spool.newest()[1])  # type: ignore[index]
    assert station.most_on_the_way <= WINDOW + size


@settings(max_examples=40, deadline=None)
@given(STEPS, st.sampled_from([None, 0.1, 0.3]))
def test_a_bounded_run_has_exactly_m_frames_in_order(steps: list[tuple[str, int]], period_s: float | None) -> None:
    async def play(wire: Wire, board: Board, station: Station) -> None:
        station.run = BoundedRun(7, 0, station.boot_id, 0, period_s)
        station.lease()
        for what, number in steps:
            await happens(what, number, wire, board, station)
        wire.room = 1000
        board.make(25)
        if station.end is None:
            await until_quiet(station, lambda: station.end is not None)

    _, _, station = played(play)
    assert station.end is not None
    assert station.end["reason"] == "all frames sent"
    assert station.ks == list(range(1, 8))
    firsts = [frame.first for frame in station.frames]
    assert firsts[0] == 0
    assert firsts[1:] == [frame.seq + 1 for frame in station.frames[:-1]]


def test_the_newest_frame_overtakes_what_is_missing() -> None:
    async def play(wire: Wire, board: Board, station: Station) -> None:
        station.lease()
        board.make(1)
        station.read(10)
        wire.cut()
        board.make(200)
        station.lease()
        await settle()
        assert wire.waiting
        station.read(10)
        assert station.came[-1][1] == 200
        assert station.ledger.missing_count == 199

    played(play)


@pytest.mark.parametrize("held", [False, True])
def test_frames_the_board_does_not_hold_are_told_and_not_asked_for_again(*, held: bool) -> None:
    async def play(_wire: Wire, board: Board, station: Station) -> None:
        board.make(3)
        boot_id = board.identity.boot_id if held else "cd" * 8
        station.ledger.greet(board.identity.boot_id, 3, [])
        if not held:
            station.ledger.take(boot_id, 0, 0)
            station.ledger.take(boot_id, 5, 5)
        await until_quiet(station, lambda: station.ledger.missing_count == 0)
        assert station.ledger.gone_count == (0 if held else 4)

    played(play)
