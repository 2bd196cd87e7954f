"""Connections of the link (per-peer rate limit, connection limit): which of them sends too much, and is cut.

libzmq bounds the bytes of a part and the number of whole messages. A message of endless parts is neither, and it is in
memory before anybody sees whose it is. So the kernel is asked: TCP_INFO counts the bytes that came over a connection,
and one beyond its budget is cut, whatever was made of its bytes. That frees what it left. Its client may come back, and
begins with a new budget.

libzmq 4.3 aborts the process when a connection hangs up (EPOLLHUP: a reset, a time-out of TCP, both ways shut) while it
has more messages than the socket's queue takes, and a heartbeat is due (`zmq_assert (!_io_error)`). A peer can do that
on purpose. So libzmq sees no connection hang up: a socket filter of the kernel drops resets, TCP's time-outs are
measured here, and who is cut is cut off from receiving only, which libzmq reads as an end when it has room again.
"""

import logging
import socket
import struct
from array import array
from collections import Counter
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
LOOK_SOON_S: Final = 0.01
"""Interval at which the connections are looked at, s: the second one while somebody comes or is cut, and `ALERT_S`
after it. A flood of 450 MB/s brings 23 MB in 0.05 s, and as empty parts of two bytes these take some 80 MB."""
ALERT_S: Final = 2.0
BYTES_AT_ONCE: Final = 262_144
BYTES_PER_S: Final = 65_536.0
"""Budget of a connection, bytes/s. A station sends ten leases of 2.6 kB a second, and more while it catches up."""
EARNED_BY_TAKING: Final = 0.5
"""Bytes that a connection may send for each one that it takes. The case: missing frames come with 1 MB/s, and each half
window of 12 kB is answered by a lease of 2.6 kB: 0.2."""
UNREAD_BYTES: Final = 131_072
"""Most bytes of a connection without a whole message among them. A part has 16 kB at most, a message one part."""
UNREAD_BYTES_OF_ALL: Final = 524_288
"""The same of all connections together: in memory two bytes on the wire may be a part of 64."""
MESSAGES_AT_ONCE: Final = 100
MESSAGES_PER_S: Final = 100.0
"""Messages of a connection that are read, a second; others are thrown away unread."""
MOST: Final = 256
"""Most connections, if nobody says another number."""
MOST_SILENT: Final = 64
"""Most connections that have not brought a message for `SILENT_S`, or never."""
SILENT_S: Final = 10.0
"""Longest time until a connection brings its first message, s: a handshake over a far radio takes seven round trips."""
TAKES_NOTHING_S: Final = 4.0
"""Longest time in which a peer acknowledges nothing of what waits for it, s."""
_EVENTS: Final = zmq.EVENT_LISTENING | zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED | zmq.EVENT_CLOSED
_TCP_INFO: Final = struct.Struct("=24xI92xQQ8xI")
"""What is read of struct tcp_info (Linux 4.6): segments unacknowledged, bytes acknowledged, received and unsent."""
_SO_ATTACH_FILTER: Final = 26

Cut = Callable[[str, str], None]
"""Called with the address of a connection that was cut, and why."""


def _filter(kept: int) -> "array[int]":
    """A program of classic BPF on segments of TCP: those with RST are dropped, of the others so many bytes are kept.

    The kernel always keeps the header. A row is struct sock_filter: operation, jump if true, jump if false, value.
    """
    load_flags, if_reset, drop, keep = (0x30, 0, 0, 13), (0x45, 0, 1, 0x04), (0x06, 0, 0, 0), (0x06, 0, 0, kept)
    return array("B", b"".join(struct.pack("=HBBI", *row) for row in (load_flags, if_reset, drop, keep)))


_NO_RESET: Final = _filter(0xFFFF_FFFF)
_NO_DATA: Final = _filter(1)


@dataclass(frozen=True, slots=True)
class Counts:
    """What the kernel counts of one connection."""

    received_bytes: int
    acknowledged_bytes: int
    is_waiting: bool
    """True while the peer has not taken all that was sent to it."""


@dataclass(slots=True)
class Connection:
    """One TCP connection."""

    address: str
    accepted_ns: int
    heard_ns: int | None = None
    """When the newest whole message of it was read."""
    pace: Pace = field(default_factory=lambda: Pace(MESSAGES_AT_ONCE, MESSAGES_PER_S))
    unread_bytes: int = 0
    """Bytes that came since a whole message was read, as far as the last look knows."""
    _received_bytes: int = 0
    _acknowledged_bytes: int = 0
    _taken_ns: int = 0
    """When the peer had taken something, or had nothing to take."""
    _budget_bytes: float = BYTES_AT_ONCE
    _looked_ns: int = 0

    @property
    def host(self) -> str:
        """The peer's host without its port."""
        return self.address.rpartition(":")[0]

    @property
    def quiet_since_ns(self) -> int:
        """When it was heard last; before it was heard, when it came."""
        return self.accepted_ns if self.heard_ns is None else self.heard_ns

    def fault(self, counts: Counts, now_ns: int) -> str | None:
        """Why it is to be cut by what the kernel counts now; empty = nobody need know of it, `None` = it is not."""
        came_bytes = counts.received_bytes - self._received_bytes
        looked_ns = self._looked_ns or self.accepted_ns
        taken_bytes = counts.acknowledged_bytes - self._acknowledged_bytes
        earned_bytes = (now_ns - looked_ns) / NS_PER_S * BYTES_PER_S + taken_bytes * EARNED_BY_TAKING
        self._budget_bytes = min(BYTES_AT_ONCE, self._budget_bytes + earned_bytes) - came_bytes
        was_read = self.heard_ns is not None and self.heard_ns >= looked_ns
        self.unread_bytes = 0 if was_read else self.unread_bytes + came_bytes
        if not counts.is_waiting or taken_bytes or not self._taken_ns:
            self._taken_ns = now_ns
        self._received_bytes, self._acknowledged_bytes = counts.received_bytes, counts.acknowledged_bytes
        self._looked_ns = now_ns
        if self._budget_bytes < 0.0:
            return f"it sent more than {BYTES_PER_S / 1024:.0f} kB/s and half of what it takes"
        if self.unread_bytes > UNREAD_BYTES:
            return f"it sent a message of more than {UNREAD_BYTES // 1024} kB"
        if self.heard_ns is None and now_ns - self.accepted_ns > SILENT_S * NS_PER_S:
            return f"it said nothing for {SILENT_S:.0f} s"
        return "" if now_ns - self._taken_ns > TAKES_NOTHING_S * NS_PER_S else None


class Connections:
    """All connections of one ZeroMQ socket that listens; call `look` as often as it asks for it."""

    def __init__(self, listening: "zmq.Socket[bytes]", cut: Cut, most: int) -> None:
        """Call it before the socket is bound. most: so many connections, others are cut."""
        self._socket = listening
        self._cut = cut
        self._most = most
        self._monitor = listening.get_monitor_socket(_EVENTS)
        self._connections: dict[int, Connection] = {}
        """Connections that are open, by descriptor. That belongs to libzmq: it is asked, and never closed here."""
        self._alert_ns = 0
        """Until when somebody who came or was cut is a reason to look often."""

    def of(self, descriptor: int, now_ns: int) -> Connection | None:
        """The connection over which a whole message came."""
        if descriptor not in self._connections:
            self._read_monitor(now_ns)
        connection = self._connections.get(descriptor)
        if connection is not None:
            connection.heard_ns = now_ns
        return connection

    def look(self, now_ns: int) -> float:
        """Learn who came and went; cut who sends or holds too much, and of a crowd who says least.

        Returns when to look again, s from now.
        """
        self._read_monitor(now_ns)
        for descriptor, connection in list(self._connections.items()):
            counts = _counts_of(descriptor, connection.address)
            if counts is None:
                del self._connections[descriptor]
            elif (fault := connection.fault(counts, now_ns)) is not None:
                self._cut_off(descriptor, fault)
                self._alert_ns = now_ns + round(ALERT_S * NS_PER_S)
        self._bound_unread()
        is_silent_ns = now_ns - round(SILENT_S * NS_PER_S)
        silent = {
            descriptor: each
            for descriptor, each in self._connections.items()
            if each.heard_ns is None or each.heard_ns < is_silent_ns
        }
        self._thin_out(silent, MOST_SILENT, f"more than {MOST_SILENT} connections say nothing")
        self._thin_out(self._connections, self._most, f"more than {self._most} connections")
        return LOOK_SOON_S if now_ns < self._alert_ns else LOOK_S

    def cut_all(self) -> None:
        """Cut everybody: who may connect comes back at once."""
        for descriptor in list(self._connections):
            self._cut_off(descriptor, "")

    def close(self) -> None:
        """Stop watching; call it before the socket is closed."""
        self._socket.disable_monitor()
        self._monitor.close(linger=0)

    def _bound_unread(self) -> None:
        total = sum(each.unread_bytes for each in self._connections.values())
        while total > UNREAD_BYTES_OF_ALL:
            descriptor, worst = max(self._connections.items(), key=lambda item: item[1].unread_bytes)
            total -= worst.unread_bytes
            self._cut_off(descriptor, "it sends a long message while others do, too")

    def _thin_out(self, crowd: dict[int, Connection], most: int, reason: str) -> None:
        """Of a crowd with too many, cut those of the host that has most of them, the longest unheard first."""
        of_host = Counter(each.host for each in crowd.values())
        oldest_first = sorted(crowd, key=lambda descriptor: crowd[descriptor].quiet_since_ns)
        for _ in range(len(crowd) - most):
            host = of_host.most_common(1)[0][0]
            descriptor = next(each for each in oldest_first if crowd[each].host == host)
            oldest_first.remove(descriptor)
            of_host[host] -= 1
            self._cut_off(descriptor, reason)

    def _read_monitor(self, now_ns: int) -> None:
        while True:
            try:
                happened = parse_monitor_message(self._monitor.recv_multipart(zmq.NOBLOCK))
            except zmq.Again:
                return
            descriptor = int(happened["value"])
            if happened["event"] == zmq.EVENT_LISTENING:
                with _borrowed(descriptor) as listener:
                    if listener is not None:
                        _attach(listener, _NO_RESET)  # each connection of it inherits the filter
            elif happened["event"] == zmq.EVENT_ACCEPTED:
                if (address := _address_of(descriptor)) is not None:
                    self._connections[descriptor] = Connection(address, now_ns)
                    self._alert_ns = now_ns + round(ALERT_S * NS_PER_S)
            else:
                self._connections.pop(descriptor, None)

    def _cut_off(self, descriptor: int, reason: str) -> None:
        connection = self._connections.pop(descriptor)
        with _borrowed(descriptor) as borrowed:
            if borrowed is not None and _peer_of(borrowed) == connection.address:
                _attach(borrowed, _NO_DATA)
                borrowed.shutdown(socket.SHUT_RD)
                if reason:
                    self._cut(connection.address, reason)


def _attach(filtered: socket.socket, program: "array[int]") -> None:
    """Have the kernel filter what comes over a socket; raises OSError."""
    program_address, size = program.buffer_info()
    filtered.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, struct.pack("HP", size // 8, program_address))


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


def _counts_of(descriptor: int, address: str) -> Counts | None:
    """What the kernel counts of the connection to `address`, zeros where it does not; `None` = it is gone."""
    with _borrowed(descriptor) as borrowed:
        if borrowed is None or _peer_of(borrowed) != address:
            return None
        told = borrowed.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _TCP_INFO.size)
        if len(told) < _TCP_INFO.size:
            return Counts(0, 0, is_waiting=False)
        unacknowledged, acknowledged_bytes, received_bytes, unsent_bytes = _TCP_INFO.unpack(told)
        return Counts(received_bytes, acknowledged_bytes, is_waiting=bool(unacknowledged or unsent_bytes))
    return None
