"""The station's session with one board: handshake, lease renewal, reconnect, commands (docs/protocol.md).

The link keeps its lease alive while it is asked for messages, and replaces its connection when the board is silent: the
next lease, over whatever connection, carries all the board has to know. Three parts: `machine` decides (states and
time-outs, its head has the theory), `transport` carries bytes, and `Link` puts messages between the two.
"""

import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from common import link_messages as session
from common.clock import boottime_ns
from common.clock_offset import ClockOffset
from common.errors import CodecError, LinkError, NoAnswerError, WayfixError
from common.link_messages import BoundedRun, FrameRange, Lease
from common.units import NS_PER_S
from common.versions import LINK_VERSION, SCHEMA_VERSION, version_fault
from shore.link.session_state import RETRY_NS, LinkMachine, LinkState
from shore.link.transport import MAX_MESSAGE_BYTES, HandshakeFault, LinkKeys, Transport
from shore.link.zmq_transport import ZmqTransport

DEFAULT_PORT: Final = 5760
CONNECT_TIMEOUT_S: Final = 5.0
"""Time-out of a greeting, s, for a person at the terminal; `wayfix connect --wait` gives a bad radio longer."""
LOOK_S: Final = 0.05
"""Interval of the checks for a refusal or Ctrl-C, s, which end a greeting or a command early."""
NO_BOOT: Final = "0"
"""The `boot_id` of a lease that the board answers with a greeting."""
_ADDRESS = re.compile(r"(?:tcp://)?(?P<host>\[[0-9a-fA-F:.%\w]+\]|[\w.-]+)(?::(?P<port>\d{1,5}))?")


@dataclass(frozen=True, slots=True)
class Wants:
    """What the next lease asks for: missing frames beside the newest ones, or a bounded run."""

    missing: tuple[FrameRange, ...] = ()
    run: BoundedRun | None = None


@dataclass(frozen=True, slots=True)
class Received:
    """One message of a running session; all but one of the fields are None."""

    frame: bytes | None = None
    end: dict[str, Any] | None = None
    connected: dict[str, Any] | None = None
    """The board's new greeting after a restart of its daemon."""
    gone: list[FrameRange] | None = None
    """Ranges of frames that the board does not hold any more."""


def endpoint(address: str) -> str:
    """`boat.local`, `10.0.0.1:5760`, `tcp://[::1]:5760` -> ZeroMQ endpoint; raises WayfixError."""
    match = _ADDRESS.fullmatch(address.strip())
    port = int(match["port"] or DEFAULT_PORT) if match else 0
    if match is None or not 1 <= port <= 65535:
        raise WayfixError("not an address", address, "give HOST or HOST:PORT, like 10.0.0.1:5760")
    return f"tcp://{match['host']}:{port}"


class Link:
    """One session with one board. Blocking calls with time-outs; use it from one thread."""

    def __init__(
        self,
        address: str,
        client: str = "station",
        keys: LinkKeys | None = None,
        window: int = session.WINDOW_BYTES,
        *,
        transport: Transport | None = None,
        now_ns: Callable[[], int] = boottime_ns,
    ) -> None:
        """keys: None = an open board; window: bytes of frames on their way at once; transport: None = ZeroMQ.

        now_ns: the clock of all time-outs, and of the offset to the board's clock.
        """
        self.endpoint = endpoint(address)
        self.offset = ClockOffset()
        """Offset of the board's clock to ours, for display only."""
        self._client = client
        self._has_keys = keys is not None
        self._window = window
        self._session = secrets.token_hex(8)
        self._transport = ZmqTransport(keys) if transport is None else transport
        self._now_ns = now_ns
        self._machine = LinkMachine(now_ns(), window)
        self._boot_id = NO_BOOT
        self._wants: Callable[[], Wants] = Wants
        self._is_stream = False

    @property
    def refusal(self) -> str | None:
        """Why our handshake is refused, since the board was heard last; None = it is not."""
        return None if self._machine.verdict is None else self._error_of(self._machine.verdict).what

    def connect(
        self,
        timeout_s: float = CONNECT_TIMEOUT_S,
        stopped: Callable[[], bool] = lambda: False,
        *,
        stream: bool = False,
        wants: Callable[[], Wants] = Wants,
    ) -> dict[str, Any]:
        """Say hello, return the `connected` map; raises LinkError when no board answers in time or the board refuses.

        stream: frames come from the greeting on, none is made between; wants: asked for each lease of the session.
        """
        self._is_stream, self._wants = stream, wants
        self._machine.connect(self._now_ns())
        self._transport.open(self.endpoint)
        deadline_ns = self._now_ns() + int(timeout_s * NS_PER_S)
        while (now_ns := self._now_ns()) < deadline_ns and not stopped():
            self._ask_if_due(now_ns)
            parts = self._receive_parts(LOOK_S)
            if (refused := self._refused()) is not None:
                raise refused
            message = {} if parts is None else session.unpack(parts[0], MAX_MESSAGE_BYTES)
            if message.get("type") == "connected":
                return self._greeted(message)
            if message.get("type") == "error":
                raise self._error_in(message)
        cure = "check the address, the Wi-Fi and that wayfix-onboard runs there"
        if self._has_keys:
            cure += "; if the boat's keys were made anew, pair again (wayfix pair)"
        raise NoAnswerError(f"no answer within {timeout_s:g} s", self.endpoint, cure)

    def command(self, name: str, argument: str = "", timeout_s: float = CONNECT_TIMEOUT_S) -> str:
        """Ask the board to do something, after `connect`: its answer in words. Raises LinkError."""
        number = secrets.randbits(31) + 1
        self._send("command", id=number, name=name, argument=argument)
        deadline_ns = self._now_ns() + int(timeout_s * NS_PER_S)
        while self._now_ns() < deadline_ns:
            if (refused := self._refused()) is not None:
                raise refused
            parts = self._receive_parts(LOOK_S)
            message = {} if parts is None else session.unpack(parts[0], MAX_MESSAGE_BYTES)
            if message.get("type") == "done" and message.get("id") == number:
                return str(message.get("text"))
            if message.get("type") == "error":
                raise self._error_in(message)
        cure = "look whether it was done (wayfix boat status), then ask again"
        raise LinkError(f"no answer within {timeout_s:g} s", self.endpoint, cure)

    def receive(self, timeout_s: float) -> Received | None:
        """The next message, the lease renewed when it is due; None when nothing came.

        Raises LinkError when the board itself refuses; another box that is found at its address cannot end a session.
        """
        now_ns = self._now_ns()
        due_ns = self._ask_if_due(now_ns)
        parts = self._receive_parts(min(timeout_s, max(0.0, (due_ns - now_ns) / NS_PER_S)))
        if parts is None:
            self._watch()
            return None
        self._machine.heard(self._now_ns())
        message = session.unpack(parts[0], MAX_MESSAGE_BYTES)
        kind = message["type"]
        if kind == "frame" and len(parts) == 2:
            self._machine.received_bytes += len(parts[1])
            return Received(frame=parts[1])
        if kind == "alive":
            return self._alive(message)
        if kind == "end":
            session.check_end(message)
            self._send("bye", session=self._session)  # a board that stops waits for it
            return Received(end=message)
        if kind == "connected":
            return Received(connected=self._greeted(message))
        if kind == "error":
            raise self._error_in(message)
        raise CodecError(f"unexpected {kind} message")

    def ask_soon(self) -> None:
        """A lease is worth sending before its time: a hole was found."""
        self._machine.ask_soon()

    def move_to(self, address: str) -> None:
        """The boat has another address now; the session goes on there. Raises WayfixError."""
        self.endpoint = endpoint(address)
        self._machine.move(self._now_ns())
        self._transport.open(self.endpoint)

    def silent_s(self) -> float:
        """Seconds without a word from the board."""
        return self._machine.silent_ns(self._now_ns()) / NS_PER_S

    def close(self) -> None:
        """Say goodbye and close; safe to call twice."""
        if self._machine.is_open:
            self._send("bye", session=self._session)
        self._machine.close()
        self._transport.close()

    def _greeted(self, message: dict[str, Any]) -> dict[str, Any]:
        fault = version_fault(message)
        if fault is not None:
            raise LinkError(fault, self.endpoint)
        try:
            session.check_greeting(message)
        except CodecError as error:
            cure = "install the same version on both sides"
            raise LinkError(f"the greeting cannot be used: {error.what}", self.endpoint, cure) from error
        if self._boot_id != str(message["boot_id"]):
            self.offset = ClockOffset()
        self._boot_id = str(message["boot_id"])
        self._machine.heard(self._now_ns())
        return message

    def _watch(self) -> None:
        """Is the connection still good? Asked when nothing waits in it."""
        self._refused()
        if self._machine.watch(self._now_ns()):
            self._transport.open(self.endpoint)

    def _alive(self, message: dict[str, Any]) -> Received | None:
        match message:
            case {"echo_ns": int(echo_ns), "rx_ns": int(rx_ns), "tx_ns": int(tx_ns)}:
                self.offset.add(echo_ns, rx_ns, tx_ns, self._machine.heard_ns)
        gone = session.frame_ranges(message.get("gone") or [])
        return Received(gone=gone) if gone else None

    def _ask_if_due(self, now_ns: int) -> int:
        """Say hello or renew the lease; returns when that is due next."""
        due_ns = self._machine.due_ns(now_ns)
        if due_ns > now_ns:
            return due_ns
        if not (self._say_hello(now_ns) if self._machine.state is LinkState.GREETING else self._renew(now_ns)):
            return now_ns + RETRY_NS
        self._machine.asked(now_ns)
        return self._machine.due_ns(now_ns)

    def _say_hello(self, now_ns: int) -> bool:
        versions = {"schema": SCHEMA_VERSION, "link": LINK_VERSION, "client": self._client}
        if not self._is_stream:
            return self._send("hello", **versions, session=self._session)
        lease = Lease(self._session, NO_BOOT, self._window, self._machine.received_bytes, now_ns)
        return self._send("lease", **versions, **lease.as_fields())

    def _renew(self, now_ns: int) -> bool:
        wants, received = self._wants(), self._machine.received_bytes
        lease = Lease(self._session, self._boot_id, self._window, received, now_ns, wants.missing, wants.run)
        return self._send("lease", client=self._client, **lease.as_fields())

    def _refused(self) -> LinkError | None:
        """Why the box at the board's address refuses our handshake, if there is news of it."""
        while (verdict := self._transport.verdict()) is not None:
            if self._machine.judge(verdict):
                return self._error_of(verdict)
        return None

    def _error_of(self, verdict: HandshakeFault) -> LinkError:
        if verdict is HandshakeFault.UNKNOWN_KEY:
            cure = "pair: wayfix-onboard pair on the board, then wayfix pair here"
            return LinkError("the boat does not know this station's key", self.endpoint, cure)
        if not self._has_keys:
            cure = "pair with it (wayfix pair), or start the daemon with --open"
            return LinkError("the boat wants a key and this station gave none", self.endpoint, cure)
        cure = "is it a Wayfix daemon with keys? if its keys were made anew, pair again (wayfix pair)"
        return LinkError("the boat did not take our greeting", self.endpoint, cure)

    def _error_in(self, message: dict[str, Any]) -> LinkError:
        """What an `error` message says."""
        return LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))

    def _send(self, kind: str, **fields: Any) -> bool:
        """Send without waiting; False = no board is there, which `connect` and the watchdog notice."""
        return self._transport.send(session.pack(kind, **fields))

    def _receive_parts(self, timeout_s: float) -> list[bytes] | None:
        parts = self._transport.receive(timeout_s)
        return parts if parts is not None and 1 <= len(parts) <= 2 else None
