"""Connections of the link (per-peer rate limit, connection limit): which of them sends too much, and is cut.

libzmq bounds the bytes of a part and the number of whole messages. A message of endless parts is neither, and it is in
memory before anybody sees whose it is. So the kernel is asked: TCP_INFO counts the bytes that came over a connection,
and a connection beyond its budget is shut down, whatever was made of its bytes. That frees what it left. Its client may
come back, and begins with a new budget.
"""

import logging
import socket
import struct
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from common.units import NS_PER_S
from onboard.link.client_leases import Pace

if TYPE_CHECKING:
    from collections.abc import Iterator

log = logging.getLogger(__name__)

LOOK_S: Final = 0.05
"""Interval at which the connections are looked at, s. A flood of 450 MB/s leaves 23 MB in memory until then."""
BYTES_AT_ONCE: Final = 262_144
BYTES_PER_S: Final = 65_536.0
"""Budget of a connection, bytes/s. A station sends up to ten leases of 2.6 kB a second."""
MESSAGES_AT_ONCE: Final = 60
MESSAGES_PER_S: Final = 40.0
"""Messages of a connection that are read, a second; others are thrown away unread."""
MOST_SILENT: Final = 64
"""Most connections that have not brought a message; beyond it the oldest of them is cut."""
SPEAKS_BYTES: Final = 1024
"""Bytes by which a connection has spoken, too: more than a handshake, which libzmq ends after 4 s. Of an encrypted
message libzmq does not say over which connection it came."""
SILENT_S: Final = 10.0
"""Longest time until a connection brings its first message, s: a handshake over a far radio takes seven round trips."""
_EVENTS: Final = zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED
_TCP_INFO_BYTES: Final = 192
_RECEIVED_AT: Final = 128
"""Offset of tcpi_bytes_received in struct tcp_info (Linux 4.1 and later)."""

Cut = Callable[[str, str], None]
"""Called with the address of a connection that was cut, and why."""


@dataclass(slots=True)
class Connection:
    """One TCP connection."""

    address: str
    accepted_ns: int
    has_spoken: bool = False
    """True once a whole message came over it, or more bytes than a handshake has."""
    pace: Pace = field(default_factory=lambda: Pace(MESSAGES_AT_ONCE, MESSAGES_PER_S))
    received_bytes: int = 0
    budget_bytes: float = BYTES_AT_ONCE
    looked_ns: int = 0

    def is_within(self, received_bytes: int, now_ns: int) -> bool:
        """Whether the bytes that came so far are within the budget (token bucket)."""
        elapsed_s = (now_ns - (self.looked_ns or self.accepted_ns)) / NS_PER_S
        self.budget_bytes = min(BYTES_AT_ONCE, self.budget_bytes + elapsed_s * BYTES_PER_S)
        self.budget_bytes -= received_bytes - self.received_bytes
        self.received_bytes, self.looked_ns = received_bytes, now_ns
        self.has_spoken = self.has_spoken or received_bytes >= SPEAKS_BYTES
        return self.budget_bytes >= 0.0


class Connections:
    """All connections of one ZeroMQ socket that listens; call `look` every `LOOK_S`."""

    def __init__(self, listening: "zmq.Socket[bytes]", cut: Cut) -> None:
        """Call it before the socket is bound."""
        self._socket = listening
        self._cut = cut
        self._monitor = listening.get_monitor_socket(_EVENTS)
        self._connections: dict[int, Connection] = {}
        """Connections that are open, by descriptor. That belongs to libzmq: it is asked, and never closed here."""

    def of(self, descriptor: int, now_ns: int) -> Connection | None:
        """The connection over which a message came; it has spoken now."""
        if descriptor not in self._connections:
            self._read_monitor(now_ns)
        connection = self._connections.get(descriptor)
        if connection is not None:
            connection.has_spoken = True
        return connection

    def look(self, now_ns: int) -> None:
        """Learn who came and went; cut who sends too much, and who says nothing for too long."""
        self._read_monitor(now_ns)
        for descriptor, connection in list(self._connections.items()):
            received = _received_bytes(descriptor, connection.address)
            if received is None:
                del self._connections[descriptor]
            elif not connection.is_within(received, now_ns):
                self._shut(descriptor, f"it sent more than {BYTES_PER_S / 1024:.0f} kB/s")
            elif not connection.has_spoken and now_ns - connection.accepted_ns > SILENT_S * NS_PER_S:
                self._shut(descriptor, f"it said nothing for {SILENT_S:.0f} s")
        silent = [descriptor for descriptor, each in self._connections.items() if not each.has_spoken]
        for descriptor in silent[: max(0, len(silent) - MOST_SILENT)]:
            self._shut(descriptor, f"more than {MOST_SILENT} connections say nothing")

    def cut_all(self) -> None:
        """Cut everybody: who may connect comes back at once."""
        for descriptor in list(self._connections):
            self._shut(descriptor, None)

    def close(self) -> None:
        """Stop watching; call it before the socket is closed."""
        self._socket.disable_monitor()
        self._monitor.close(linger=0)

    def _read_monitor(self, now_ns: int) -> None:
        while True:
            try:
                happened = parse_monitor_message(self._monitor.recv_multipart(zmq.NOBLOCK))
            except zmq.Again:
                return
            descriptor = int(happened["value"])
            if happened["event"] == zmq.EVENT_ACCEPTED:
                if (address := _address_of(descriptor)) is not None:
                    self._connections[descriptor] = Connection(address, now_ns)
            else:
                self._connections.pop(descriptor, None)

    def _shut(self, descriptor: int, reason: str | None) -> None:
        connection = self._connections.pop(descriptor)
        with _borrowed(descriptor) as borrowed:
            if borrowed is not None and _peer_of(borrowed) == connection.address:
                borrowed.shutdown(socket.SHUT_RDWR)
                if reason is not None:
                    self._cut(connection.address, reason)


@contextmanager
def _borrowed(descriptor: int) -> "Iterator[socket.socket | None]":
    """A descriptor of libzmq's as a socket, which stays open; `None` where it is gone.

    A fault of a socket that is no more ends the block.
    """
    try:
        borrowed = socket.socket(fileno=descriptor)
    except OSError:
        yield None
        return
    try:
        yield borrowed
    except OSError as error:
        log.debug("connection %d: %s", descriptor, error)
    finally:
        borrowed.detach()


def _peer_of(connection: socket.socket) -> str | None:
    try:
        host, port, *_ = connection.getpeername()
    except (OSError, ValueError):
        return None
    return f"{host}:{port}"


def _address_of(descriptor: int) -> str | None:
    with _borrowed(descriptor) as borrowed:
        return None if borrowed is None else _peer_of(borrowed)


def _received_bytes(descriptor: int, address: str) -> int | None:
    """Bytes that came over the connection to `address`, 0 = the kernel does not count; `None` = it is gone."""
    with _borrowed(descriptor) as borrowed:
        if borrowed is None or _peer_of(borrowed) != address:
            return None
        told = borrowed.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO_BYTES)
        return 0 if len(told) < _RECEIVED_AT + 8 else int(struct.unpack_from("<Q", told, _RECEIVED_AT)[0])
    return None
