"""Transport interface of the station's link: what a connection to a board must promise, whatever carries it.

`Link` decides when a connection is opened, replaced and closed; a transport only does it. Boats are reached by
`shore.link.zmq_transport`; tests hand in one without a socket. No call waits but `receive`, and a transport keeps
nothing outside itself, so one thread may hold many.
"""

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, Protocol

MAX_MESSAGE_BYTES: Final = 2 * 2**20
"""Most bytes of one message part; a larger one is not received."""


@dataclass(frozen=True, slots=True)
class LinkKeys:
    """CURVE keys in Z85: the station's own pair and the boat's public key."""

    public: bytes
    secret: bytes
    boat: bytes


class HandshakeFault(Enum):
    """How a handshake failed, as the handshake monitor says it."""

    UNKNOWN_KEY = auto()
    """The other end knows no such key."""
    BROKEN = auto()
    """It was cut short without a reason: by a daemon that stops, or by an end that speaks otherwise."""
    MISMATCH = auto()
    """The other end speaks another protocol, or one of the two wants keys and the other has none."""


class Transport(Protocol):
    """One connection at a time to one endpoint."""

    def open(self, endpoint: str) -> None:
        """Connect in the background, over a new connection in place of the one before; raises LinkError.

        Endpoint: as `shore.link.link.endpoint` gives it. What was on its way over the connection before is lost.
        """

    def send(self, message: bytes) -> bool:
        """Hand over a message of one part without waiting; False = no board is there to take it."""

    def receive(self, timeout_s: float) -> list[bytes] | None:
        """The parts of the next message; None = none came within `timeout_s`."""

    def verdict(self) -> HandshakeFault | None:
        """How the next handshake over this connection failed, each failure once; None = no other has."""

    def close(self) -> None:
        """Give what was sent last a moment to leave, and end; safe to call twice."""
