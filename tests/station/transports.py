"""A transport without a socket: it keeps what the link does, and has a clock that goes on only while the link waits."""

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final

from common import link_messages as session
from common.units import NS_PER_S
from common.versions import LINK_VERSION, SCHEMA_VERSION
from shore.link.transport import HandshakeFault

GREETING: Final = {
    "schema": SCHEMA_VERSION, "link": LINK_VERSION, "boot_id": "b0", "next_seq": 0, "runs": [], "config": {},
}  # fmt: skip


def nobody(_message: dict[str, Any]) -> list[list[bytes]]:
    """A board that does not answer."""
    return []


def board(message: dict[str, Any]) -> list[list[bytes]]:
    """One that greets, and answers each lease."""
    if message["type"] == "hello" or message.get("boot_id") == "0":
        return [[session.pack("connected", **GREETING)]]
    if message["type"] == "lease":
        return [[session.pack("alive", echo_ns=message["t_ns"], rx_ns=5, tx_ns=6, next_seq=0, gone=[])]]
    return []


class FakeTransport:
    """A `Transport`; times are seconds since it was made."""

    def __init__(self, answer: Callable[[dict[str, Any]], Iterable[list[bytes]]] = nobody) -> None:
        self.answer = answer
        self.is_there = True
        """A board takes messages."""
        self.opened: list[tuple[float, str]] = []
        self.sent: list[tuple[float, dict[str, Any]]] = []
        self.inbox: deque[list[bytes]] = deque()
        self.verdicts: deque[HandshakeFault] = deque()
        self.is_closed = False
        self._begin_ns = self.t_ns = 10**12

    @property
    def t_s(self) -> float:
        return (self.t_ns - self._begin_ns) / NS_PER_S

    def now_ns(self) -> int:
        """The clock for a link."""
        return self.t_ns

    def go_on(self, seconds: float) -> None:
        self.t_ns += round(seconds * NS_PER_S)

    def open(self, endpoint: str) -> None:
        self.opened.append((self.t_s, endpoint))
        self.inbox.clear()

    def send(self, message: bytes) -> bool:
        if self.is_there:
            self.sent.append((self.t_s, session.unpack(message)))
            self.inbox.extend(self.answer(self.sent[-1][1]))
        return self.is_there

    def receive(self, timeout_s: float) -> list[bytes] | None:
        if self.inbox:
            return self.inbox.popleft()
        self.go_on(timeout_s)
        return None

    def verdict(self) -> HandshakeFault | None:
        return self.verdicts.popleft() if self.verdicts else None

    def close(self) -> None:
        self.is_closed = True
