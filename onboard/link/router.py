"""Message router (ZeroMQ ROUTER) of the board: one socket, read in the daemon's loop; a send never waits."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

import zmq

from common import link_messages as session
from common.clock import boottime_ns
from common.errors import WayfixError
from onboard.link.client_leases import Pace
from onboard.link.connections import MESSAGES_AT_ONCE, MESSAGES_PER_S, MOST, Connections, Cut

log = logging.getLogger(__name__)

SEND_HIGH_WATER_MARK: Final = 64
SEND_BUFFER_BYTES: Final = 32_768
"""Size of the kernel's send buffer, bytes: small, so that data for a slow client waits in the spool, where it is
seen."""
RECEIVE_HIGH_WATER_MARK: Final = 64
LINGER_MS: Final = 500
RECEIVE_BUFFER_BYTES: Final = 16_384
"""Size of the kernel's receive buffer, bytes: no client has much to say, and a flood is slower with it."""
BACKLOG: Final = 512
MOST_PARTS: Final = 3
"""Parts of a message that are kept, the routing id the first of them: none has two more."""
TURN_NS: Final = 4_000_000
"""Longest time of one turn of the loop, ns, whatever its messages cost."""
PAUSE_S: Final = 0.01
"""Pause after a full turn, s (rate limit): a flood gets a third of the board's time, and ports and frames the rest."""
MESSAGES_AT_ONCE_OF_KEY: Final = 4 * MESSAGES_AT_ONCE
MESSAGES_PER_S_OF_KEY: Final = 4 * MESSAGES_PER_S
"""Messages of one key that are read, a second, over all its connections."""
ZAP_DOMAIN: Final = "wayfix"

Receive = Callable[[bytes, str | None, list[bytes]], None]
"""Called with each message: routing id, public key of the sender (None on an open board), parts."""


class Router:
    """Owns socket and context."""

    def __init__(
        self,
        context: zmq.Context[zmq.Socket[bytes]],
        secret_key: bytes | None,
        cut: Cut = lambda _address, _reason: None,
        most: int = MOST,
    ) -> None:
        """secret_key: Z85; None = an open link, which encrypts nothing and asks for no key.

        cut: is called for each connection that is cut because of what it sends; most: of so many connections.
        """
        self._open = secret_key is None
        self._socket = context.socket(zmq.ROUTER)
        for option, value in (
            (zmq.ROUTER_MANDATORY, 1),
            (zmq.SNDHWM, SEND_HIGH_WATER_MARK),
            (zmq.RCVHWM, RECEIVE_HIGH_WATER_MARK),
            (zmq.SNDBUF, SEND_BUFFER_BYTES),
            (zmq.RCVBUF, RECEIVE_BUFFER_BYTES),
            (zmq.BACKLOG, BACKLOG),
            (zmq.MAXMSGSIZE, session.MAX_HEADER_BYTES),
            (zmq.HEARTBEAT_IVL, session.HEARTBEAT_MS),
            (zmq.HEARTBEAT_TIMEOUT, session.HEARTBEAT_TIMEOUT_MS),
            (zmq.HEARTBEAT_TTL, session.HEARTBEAT_TIMEOUT_MS),
            (zmq.HANDSHAKE_IVL, session.HEARTBEAT_TIMEOUT_MS),
        ):
            self._socket.setsockopt(option, value)
        if secret_key is not None:
            self._socket.setsockopt_string(zmq.ZAP_DOMAIN, ZAP_DOMAIN)
            self._socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without an authenticator no client is let in
            self._socket.setsockopt(zmq.CURVE_SERVER, 1)
            self._socket.setsockopt(zmq.CURVE_SECRETKEY, secret_key)
        self._connections = Connections(self._socket, cut, most)
        self._paces: dict[str, Pace] = {}
        """Rate limit of each key's messages."""
        self.unread = 0
        """Number of messages that were thrown away because their sender had sent too many."""
        self._receive: Receive | None = None
        self._parts: list[zmq.Frame] = []
        """Parts of the message that is being read."""
        self._scheduled = False

    def bind(self, address: str) -> str:
        """Bind and return the endpoint in full (port `*` = any free one); raises WayfixError."""
        self._socket.setsockopt(zmq.IPV6, int("[" in address))
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            cure = "give tcp://ADDRESS:PORT of this machine with a free port ([link] bind, or --bind)"
            raise WayfixError(f"cannot listen there ({zmq.strerror(error.errno or 0)})", address, cure) from error
        self._connections.look(boottime_ns())
        return str(self._socket.getsockopt_string(zmq.LAST_ENDPOINT))

    def start(self, receive: Receive) -> None:
        """Hand every message to `receive` from now on; call in the running loop."""
        self._receive = receive
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._socket.fileno(), self._schedule)
        self._schedule()
        self._look()

    def cut_unless(self, may_stay: Callable[[str], bool]) -> None:
        """Cut every connection when a key that was heard may not stay; those of the others come back at once."""
        gone = [key for key in self._paces if not may_stay(key)]
        for key in gone:
            del self._paces[key]
        if gone:
            self._connections.cut_all()

    def send(self, routing_id: bytes, parts: list[bytes]) -> int | None:
        """None = taken; else the error number: EAGAIN = its queue is full, others = the connection is gone."""
        try:
            self._socket.send_multipart([routing_id, *parts], zmq.NOBLOCK)
        except zmq.ZMQError as error:
            return error.errno or zmq.EAGAIN
        finally:
            # The descriptor signals a change once: a send may have swallowed the signal for a message.
            if (
                self._receive is not None
                and not self._scheduled
                and int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN
            ):
                self._schedule()
        return None

    def close(self) -> None:
        """What is on its way has half a second."""
        if self._receive is not None:
            self._loop.remove_reader(self._socket.fileno())
            self._receive = None
        self._connections.close()
        self._socket.close(linger=LINGER_MS)

    def _look(self) -> None:
        if self._receive is None:
            return
        self._loop.call_later(self._connections.look(boottime_ns()), self._look)

    def _schedule(self, delay_s: float = 0.0) -> None:
        if not self._scheduled:
            self._scheduled = True
            self._loop.call_later(delay_s, self._read)

    def _read(self) -> None:
        self._scheduled = False
        if self._receive is None:
            return
        begun_ns = now_ns = boottime_ns()
        while now_ns - begun_ns <= TURN_NS:
            try:
                part = self._socket.recv(zmq.NOBLOCK, copy=False)
            except zmq.Again:
                return
            now_ns = boottime_ns()
            if len(self._parts) < MOST_PARTS:
                self._parts.append(part)
            if not part.more:
                parts, self._parts = self._parts, []
                self._take(parts, now_ns)
                now_ns = boottime_ns()
        self._schedule(PAUSE_S)

    def _take(self, parts: list[zmq.Frame], now_ns: int) -> None:
        if self._open:
            user_id = None
        else:  # the key is the connection's, as the authenticator let it in; no client can set it
            try:
                user_id = str(parts[-1].get("User-Id"))
            except zmq.ZMQError:
                return
        if self._may_speak(parts[-1], user_id, now_ns):
            assert self._receive is not None
            self._receive(parts[0].bytes, user_id, [part.bytes for part in parts[1:]])
        else:
            self.unread += 1

    def _may_speak(self, part: zmq.Frame, user_id: str | None, now_ns: int) -> bool:
        connection = self._connections.of(int(part.get(zmq.SRCFD)), now_ns)
        if connection is not None and not connection.pace.allows(now_ns):
            return False
        if user_id is None:
            return True
        pace = self._paces.setdefault(user_id, Pace(MESSAGES_AT_ONCE_OF_KEY, MESSAGES_PER_S_OF_KEY))
        return pace.allows(now_ns)
