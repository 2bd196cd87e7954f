"""ZeroMQ transport of the station's link: a DEALER with CURVE (docs/protocol.md); no other file ashore has one."""

from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from common import link_messages as session
from common.errors import LinkError
from shore.link.transport import MAX_MESSAGE_BYTES, HandshakeFault, LinkKeys

CONNECT_TIMEOUT_MS: Final = 1_000
"""Time-out of one attempt, ms; the kernel would wait for two minutes where a radio was out of reach for a moment."""
RECONNECT_MS: Final = 200
"""Pause between two attempts, ms: a restarted daemon is met at once, and a stranger breaks five greetings a second."""
GOODBYE_MS: Final = 200
"""Time for the last message to leave, ms."""
_VERDICTS: Final = {
    int(zmq.EVENT_HANDSHAKE_FAILED_AUTH): HandshakeFault.UNKNOWN_KEY,
    int(zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL): HandshakeFault.BROKEN,
    int(zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL): HandshakeFault.MISMATCH,
}


class ZmqTransport:
    """A `Transport` that owns its socket, the monitor of its handshakes and their context."""

    def __init__(self, keys: LinkKeys | None) -> None:
        """keys: None = nothing is encrypted, for an open board."""
        self._keys = keys
        self._context = zmq.Context()
        self._socket: zmq.Socket[bytes] | None = None
        self._monitor: zmq.Socket[bytes] | None = None

    def open(self, endpoint: str) -> None:
        """A new socket in place of the one before; raises LinkError where the endpoint cannot be one."""
        self._close_socket(linger_ms=0)
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.IMMEDIATE, 1),  # nothing is queued for a board that is not there: an old lease is of no use
            (zmq.IPV6, int("[" in endpoint)),
            (zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES),
            # libzmq aborts when a connection hangs up while its queue is full; the window says how much may wait.
            (zmq.RCVHWM, 0),
            (zmq.CONNECT_TIMEOUT, CONNECT_TIMEOUT_MS),
            (zmq.RECONNECT_IVL, RECONNECT_MS),
            (zmq.HEARTBEAT_IVL, session.HEARTBEAT_MS),
            (zmq.HEARTBEAT_TIMEOUT, session.HEARTBEAT_TIMEOUT_MS),
        ):
            self._socket.setsockopt(option, value)
        if self._keys is not None:
            self._socket.setsockopt(zmq.CURVE_SERVERKEY, self._keys.boat)
            self._socket.setsockopt(zmq.CURVE_PUBLICKEY, self._keys.public)
            self._socket.setsockopt(zmq.CURVE_SECRETKEY, self._keys.secret)
        self._monitor = self._socket.get_monitor_socket(sum(_VERDICTS))
        try:
            self._socket.connect(endpoint)
        except zmq.ZMQError as error:
            cure = "give HOST or HOST:PORT, like 10.0.0.1:5760"
            raise LinkError(f"not an address ({zmq.strerror(error.errno or 0)})", endpoint, cure) from error

    def send(self, message: bytes) -> bool:
        """Send without waiting; False = no board is there, or it does not read."""
        assert self._socket is not None
        try:
            self._socket.send(message, zmq.NOBLOCK)
        except zmq.Again:
            return False
        return True

    def receive(self, timeout_s: float) -> list[bytes] | None:
        """The parts of the next message."""
        assert self._socket is not None
        return self._socket.recv_multipart() if self._socket.poll(int(timeout_s * 1000)) else None

    def verdict(self) -> HandshakeFault | None:
        """How the next handshake over this socket failed."""
        assert self._monitor is not None
        if not self._monitor.poll(0):
            return None
        return _VERDICTS[int(parse_monitor_message(self._monitor.recv_multipart())["event"])]

    def close(self) -> None:
        """Close socket and context."""
        self._close_socket(linger_ms=GOODBYE_MS)
        self._context.term()

    def _close_socket(self, linger_ms: int) -> None:
        if self._socket is not None:
            self._socket.disable_monitor()
            if self._monitor is not None:
                self._monitor.close(linger=0)
            self._socket.close(linger=linger_ms)
            self._socket = self._monitor = None
