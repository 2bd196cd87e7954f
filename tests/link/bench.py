"""A server of the board over a real socket, without a daemon around it, and raw clients of it."""

import asyncio
from collections.abc import Callable
from typing import Any

import zmq
import zmq.asyncio

from common import link_messages as session
from common.boat_config import SpoolTable
from common.codec import decode_frame
from common.errors import WayfixError
from common.framer import Identity
from common.link_messages import BoundedRun, FrameRange, Lease
from common.messages import Event, Fix, Frame, RawLine
from common.units import NS_PER_MS
from onboard.journal import Journal
from onboard.link.router import Router
from onboard.link.server import Limits, Server
from onboard.spool import Spool
from tests.strategies import numbered_frame

PERIOD_NS = 100 * NS_PER_MS
BOOT = "ab" * 8


def frame_with(seq: int, texts: int = 0, *, has_fix: bool = False) -> Frame:
    """A frame with so many long lines in it."""
    t0_ns = seq * PERIOD_NS
    fixes = [Fix(sensor="gps1", t_ns=t0_ns, lat_deg=50.8, lon_deg=-1.3)] if has_fix else []
    lines = [RawLine(sensor="gps1", t_ns=t0_ns, text="$" + "x" * 400)] * texts
    return numbered_frame(seq, *fixes, *lines, period_ns=PERIOD_NS, boot_id=BOOT)


class Client:
    """A raw DEALER: sees exactly what is on the wire."""

    def __init__(self, context: "zmq.asyncio.Context", endpoint: str, name: str) -> None:
        self.name = name
        self.socket = context.socket(zmq.DEALER)
        self.socket.connect(endpoint)
        self.received = 0
        self.window = session.WINDOW_BYTES

    async def say(self, kind: str, **fields: Any) -> None:
        await self.socket.send(session.pack(kind, **fields))

    async def lease(self, *missing: FrameRange, run: BoundedRun | None = None, boot_id: str = BOOT) -> None:
        lease = Lease(self.name, boot_id, self.window, self.received, 5, missing, run)
        await self.say("lease", client=f"test {self.name}", **lease.as_fields())

    async def hear(self) -> tuple[dict[str, Any], bytes]:
        parts = await asyncio.wait_for(self.socket.recv_multipart(), 5)
        data = parts[1] if len(parts) > 1 else b""
        self.received += len(data)
        return session.unpack(parts[0], 2**20), data

    async def expect(self, kind: str) -> dict[str, Any]:
        message, _ = await self.hear()
        assert message["type"] == kind, message
        return message

    async def frames(self, count: int) -> list[Frame]:
        found: list[Frame] = []
        while len(found) < count:
            message, data = await self.hear()
            if message["type"] == "frame":
                found.append(decode_frame(data))
        return found

    async def is_quiet(self) -> bool:
        return not await self.socket.poll(100)


class Bench:
    """Server and context of one test."""

    def __init__(self, limits: Limits) -> None:
        self.events: list[Event] = []
        self.next_seq = 0
        self.rights: frozenset[str] | None = frozenset({"read", "command"})
        self.asked: list[tuple[str, str]] = []
        self._zmq: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        journal = Journal(self.events.append, lambda: 0)
        self.spool = Spool(None, Identity("b", BOOT, "c", 1), SpoolTable(), journal)
        self.server = Server(
            Router(self._zmq, None),
            self.spool,
            connected=lambda: {"boot_id": BOOT, "next_seq": self.next_seq},
            frame_period_ns=PERIOD_NS,
            journal=journal,
            rights=lambda _key: self.rights,
            command=self._command,
            limits=limits,
        )
        self.endpoint = self.server.bind("tcp://127.0.0.1:*")
        self.context = zmq.asyncio.Context()
        self.clients: list[Client] = []
        self.task = asyncio.create_task(self.server.run())
        self.publish(1)

    async def _command(self, name: str, argument: str, _who: str) -> str:
        self.asked.append((name, argument))
        if name != "mark":
            raise WayfixError(f"no command {name}", "", "use mark")
        return "marked"

    def client(self) -> Client:
        self.clients.append(Client(self.context, self.endpoint, f"{len(self.clients):x}"))
        return self.clients[-1]

    async def joined(self) -> Client:
        client = self.client()
        await client.lease()
        await client.expect("alive")
        return client

    def publish(self, count: int, texts: int = 0, fixes: tuple[int, ...] = ()) -> None:
        for _ in range(count):
            self.server.publish(frame_with(self.next_seq, texts, has_fix=self.next_seq in fixes))
            self.next_seq += 1

    async def close(self) -> None:
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)
        self.server.close()
        self._zmq.term()
        for client in self.clients:
            client.socket.close(linger=0)
        self.context.term()


def on_bench(test: Callable[[Bench], Any], limits: Limits = Limits()) -> None:  # noqa: B008 - frozen
    async def run() -> None:
        bench = Bench(limits)
        try:
            await test(bench)
        finally:
            await bench.close()

    asyncio.run(run())
