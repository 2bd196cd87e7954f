"""The board's end of the link: one ROUTER socket, one session for each client (`common.session`, docs/protocol.md).

First form: no leases, no backfill, no keys. Frames wait in a bounded queue for each client; a slow continuous client
loses the oldest and is told so by an event, a slow bounded client (`run m`) is ended rather than given a gap.
"""

import asyncio
import logging
import reprlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, cast

import zmq
import zmq.asyncio

from common import session
from common.clock import boottime_ns
from common.codec import encode_frame
from common.errors import CodecError, WayfixError
from common.events import event
from common.framer import merge
from common.messages import SCHEMA_VERSION, Event, Frame
from common.units import NS_PER_S

log = logging.getLogger(__name__)

MAX_CLIENTS: Final = 32
QUEUE_BYTES: Final = 4 * 2**20
"""About half a minute of the heaviest load; the spool takes over in the link's next form."""
GREETING_NS: Final = 10 * NS_PER_S
"""A client that said hello and asks for nothing for so long is forgotten: nothing is ever sent to it, so no send would
fail when it is gone."""
SEND_HIGH_WATER_MARK: Final = 64
SEND_BUFFER_BYTES: Final = 32_768
"""Small, so that what waits for a slow client waits in our queue and not, unseen, in the kernel's."""
LINGER_MS: Final = 500


@dataclass(slots=True)
class Session:
    """What one client asked for and what it has been sent."""

    client: str
    greeted_ns: int
    """Boottime of the last hello."""
    running: bool = False
    frames_left: int | None = None
    """None = continuous."""
    period_ns: int = 0
    """0 = the board's own frames."""
    sent: int = 0
    dropped: int = 0
    period_start_ns: int | None = None
    gathered: list[Frame] = field(default_factory=list)
    held: deque[bytes] = field(default_factory=deque)
    """Frames since `hello`: a continuous run starts with them, so that nothing is missing after `next_seq`."""
    queue: deque[list[bytes]] = field(default_factory=deque)
    held_bytes: int = 0
    queued_bytes: int = 0
    ending: bool = False
    """`end` is queued: forget the session when it is out."""


class Server:
    """Answers clients and hands every frame on; `connected` supplies the greeting's fields."""

    def __init__(
        self,
        connected: Callable[[], dict[str, Any]],
        frame_period_ns: int,
        on_event: Callable[[Event], None],
        now_ns: Callable[[], int],
    ) -> None:
        self._connected = connected
        self._frame_period_ns = frame_period_ns
        self._on_event = on_event
        self._now_ns = now_ns
        self._sessions: dict[bytes, Session] = {}
        self.malformed = 0
        self._next_seq = 0
        self._context = zmq.asyncio.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.ROUTER_MANDATORY, 1)
        self._socket.setsockopt(zmq.SNDHWM, SEND_HIGH_WATER_MARK)
        self._socket.setsockopt(zmq.SNDBUF, SEND_BUFFER_BYTES)
        self._socket.setsockopt(zmq.MAXMSGSIZE, session.MAX_HEADER_BYTES)
        self._socket.setsockopt(zmq.HEARTBEAT_IVL, session.HEARTBEAT_MS)
        self._socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, session.HEARTBEAT_TIMEOUT_MS)
        self._socket.setsockopt(zmq.HEARTBEAT_TTL, session.HEARTBEAT_TIMEOUT_MS)

    @property
    def clients(self) -> int:
        """Sessions at this moment."""
        return len(self._sessions)

    def bind(self, address: str) -> str:
        """Bind and return the endpoint in full (port `*` = any free one); raises WayfixError."""
        self._socket.setsockopt(zmq.IPV6, int("[" in address))
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            cure = "give tcp://ADDRESS:PORT of this machine with a free port ([link] bind, or --bind)"
            raise WayfixError(f"cannot listen there ({zmq.strerror(error.errno or 0)})", address, cure) from error
        return str(self._socket.getsockopt_string(zmq.LAST_ENDPOINT))

    async def run(self) -> None:
        """Answer clients until cancelled."""
        while True:
            parts = await self._socket.recv_multipart()
            identity = parts[0]
            try:
                self._answer(identity, session.unpack(parts[1] if len(parts) == 2 else b""))
            except Exception as error:  # whatever a stranger sends, the daemon lives
                self.malformed += 1
                level = logging.DEBUG if isinstance(error, CodecError) else logging.ERROR
                log.log(level, "malformed message from %s: %s", identity.hex(), type(error).__name__)

    def publish(self, frame: Frame) -> None:
        """Hand one new frame to every running session and push out what waits."""
        self._next_seq = frame.seq + 1
        try:
            encoded = encode_frame(frame) if self._sessions else b""
        except CodecError as error:
            self._on_event(event("frame-failed", self._now_ns(), "daemon", seq=frame.seq, reason=error.what[:200]))
            return
        for identity, client in list(self._sessions.items()):
            if not client.running:
                _hold(client, encoded)
                if boottime_ns() - client.greeted_ns > GREETING_NS:
                    self._forget(identity, "it greeted and asked for nothing")
                continue
            if not client.ending:
                if client.period_ns == 0:
                    self._enqueue(client, encoded)
                elif (merged := self._gather(client, frame)) is not None:
                    self._enqueue_merged(client, merged)
            self._push(identity, client)

    def end_all(self, reason: str) -> None:
        """Queue `end` for every session: the daemon stops."""
        for identity, client in list(self._sessions.items()):
            self._end(client, reason)
            self._push(identity, client)

    async def drain(self, deadline_s: float) -> None:
        """Give slow clients a moment to take what waits for them."""
        steps = 20
        for _ in range(steps):
            if not self._sessions:
                return
            await asyncio.sleep(deadline_s / steps)
            for identity, client in list(self._sessions.items()):
                self._push(identity, client)

    def close(self) -> None:
        """Close the socket; what is on its way has half a second."""
        self._socket.close(linger=LINGER_MS)
        self._context.term()

    def _answer(self, identity: bytes, message: dict[str, Any]) -> None:
        kind = message["type"]
        client = self._sessions.get(identity)
        if kind == "hello":
            self._hello(identity, message)
        elif kind == "bye":
            self._forget(identity, "it said goodbye")
        elif client is None:
            self._reply(identity, session.pack("error", what="no session", cure="send hello first"))
        elif kind == "run" and not client.ending:
            self._run(identity, client, message)

    def _hello(self, identity: bytes, message: dict[str, Any]) -> None:
        fault = session.schema_fault(message.get("schema"))
        if fault is not None:
            self._reply(identity, session.pack("error", what=fault, cure="install the same version on both sides"))
            return
        if identity not in self._sessions:
            if len(self._sessions) >= MAX_CLIENTS:
                cure = "close another station"
                self._reply(identity, session.pack("error", what=f"{MAX_CLIENTS} clients are connected", cure=cure))
                return
            name = "".join(filter(str.isprintable, str(message.get("client", ""))))[:32] or identity.hex()
            self._sessions[identity] = Session(name, boottime_ns())
            self._on_event(event("client-joined", self._now_ns(), "link", client=name))
        self._sessions[identity].greeted_ns = boottime_ns()
        self._reply(identity, session.pack("connected", schema=SCHEMA_VERSION, **self._connected()))

    def _run(self, identity: bytes, client: Session, message: dict[str, Any]) -> None:
        fault = run_fault(message, self._frame_period_ns)
        if fault is not None:
            self._reply(identity, session.pack("error", what=fault, cure="correct the request and send run again"))
            return
        client.frames_left = message.get("m")
        period_s = message.get("period_s")
        period_ns = round(period_s * NS_PER_S) if period_s is not None else 0
        client.period_ns = 0 if period_ns == self._frame_period_ns else period_ns
        client.running = True
        client.sent, client.period_start_ns = 0, None
        client.gathered.clear()
        held, client.held = client.held, deque()
        client.held_bytes = 0
        if client.frames_left is None and client.period_ns == 0:
            for data in held:
                self._enqueue(client, data)
            self._push(identity, client)

    def _gather(self, client: Session, frame: Frame) -> Frame | None:
        """Merge the board's frames to the session's period, on the absolute grid of that period."""
        if client.period_start_ns is None:
            if frame.t0_ns % client.period_ns:
                return None
            client.period_start_ns = frame.t0_ns
        client.gathered.append(frame)
        if frame.t1_ns < client.period_start_ns + client.period_ns:
            return None
        merged = merge(client.gathered)
        client.gathered.clear()
        client.period_start_ns = frame.t1_ns
        return merged

    def _enqueue(self, client: Session, data: bytes) -> None:
        client.sent += 1
        client.queue.append([session.pack("frame", k=client.sent), data])
        client.queued_bytes += len(data)
        if client.frames_left is not None:
            client.frames_left -= 1
            if client.frames_left == 0:
                self._end(client, "all frames sent")
            elif client.queued_bytes > QUEUE_BYTES:
                self._end(client, "the client reads too slowly")
            return
        while client.queued_bytes > QUEUE_BYTES:
            client.queued_bytes -= len(client.queue.popleft()[-1])
            client.dropped += 1

    def _enqueue_merged(self, client: Session, frame: Frame) -> None:
        """A long period of many sensors may pass the limits of one frame; the client is told, the daemon lives."""
        try:
            self._enqueue(client, encode_frame(frame))
        except CodecError as error:
            self._end(client, f"a frame of this period is too large ({error.what}); ask for a shorter one")

    def _end(self, client: Session, reason: str) -> None:
        if not client.ending:
            client.ending = True
            end = session.pack("end", sent=client.sent, next_seq=self._next_seq, reason=reason)
            client.queue.append([end])

    def _push(self, identity: bytes, client: Session) -> None:
        """Send as much of the queue as the socket takes now."""
        while client.queue:
            parts = client.queue[0]
            failure = self._send(identity, parts)
            if failure == zmq.EAGAIN:
                return
            if failure is not None:
                self._forget(identity, "the connection broke")
                return
            client.queue.popleft()
            if len(parts) > 1:
                client.queued_bytes -= len(parts[-1])
        self._tell_dropped(client)
        if client.ending:
            self._forget(identity, "its session ended")

    def _tell_dropped(self, client: Session) -> None:
        """One event when the queue is empty again: how many frames a slow client missed."""
        if client.dropped:
            lost, client.dropped = client.dropped, 0
            self._on_event(event("frames-dropped", self._now_ns(), "link", count=lost, client=client.client))

    def _reply(self, identity: bytes, header: bytes) -> None:
        if self._send(identity, [header]) not in (None, zmq.EAGAIN):
            self._forget(identity, "the connection broke")

    def _send(self, identity: bytes, parts: list[bytes]) -> int | None:
        """None = taken; else the error number. Completes at once: NOBLOCK."""
        future = cast("asyncio.Future[None]", self._socket.send_multipart([identity, *parts], flags=zmq.NOBLOCK))
        error = future.exception()
        return error.errno if isinstance(error, zmq.ZMQError) else None

    def _forget(self, identity: bytes, reason: str) -> None:
        client = self._sessions.pop(identity, None)
        if client is not None:
            self._tell_dropped(client)
            self._on_event(event("client-left", self._now_ns(), "link", client=client.client, reason=reason))


def _hold(client: Session, data: bytes) -> None:
    client.held.append(data)
    client.held_bytes += len(data)
    while client.held_bytes > QUEUE_BYTES:
        client.held_bytes -= len(client.held.popleft())
        client.dropped += 1


def run_fault(message: dict[str, Any], frame_period_ns: int) -> str | None:
    """Why a `run` request cannot be granted, or None."""
    m, period_s = message.get("m"), message.get("period_s")
    if m is not None and (isinstance(m, bool) or not isinstance(m, int) or not 1 <= m <= session.MAX_RUN_FRAMES):
        return f"m must be a whole number from 1 to {session.MAX_RUN_FRAMES}, got {reprlib.repr(m)}"
    if period_s is None:
        return None
    if isinstance(period_s, bool) or not isinstance(period_s, int | float):
        return f"period_s must be a number, got {reprlib.repr(period_s)}"
    if not session.MIN_PERIOD_S <= period_s <= session.MAX_PERIOD_S:
        return f"period_s must be from {session.MIN_PERIOD_S:g} to {session.MAX_PERIOD_S:g} s, got {period_s:g}"
    if round(period_s * NS_PER_S) % frame_period_ns:
        return f"period_s must be a multiple of the board's frame period, {frame_period_ns / NS_PER_S:g} s"
    return None
