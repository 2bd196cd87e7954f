"""The station's end of the link: one DEALER socket (`common.session`, docs/protocol.md); no other file ashore has one.

The link keeps its lease alive while it is asked for messages, and throws its socket away when the board is silent: the
next lease, over whatever connection, carries all the board has to know.
"""

import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from common import session
from common.clock import boottime_ns
from common.errors import CodecError, LinkError, NoAnswerError, WayfixError
from common.messages import SCHEMA_VERSION
from common.offset import ClockOffset
from common.session import BoundedRun, FrameRange, Lease
from common.units import NS_PER_MS, NS_PER_S

DEFAULT_PORT: Final = 5760
CONNECT_TIMEOUT_S: Final = 5.0
WATCHDOG_NS: Final = 1_500 * NS_PER_MS
"""Nothing heard for this long, not even the answer to a lease: the socket is thrown away."""
LONGEST_WATCHDOG_NS: Final = 6_000 * NS_PER_MS
"""Doubled up to this while no socket hears anything: a greeting takes seven round trips, and a far radio needs them."""
LOST_S: Final = 3.0
"""... and after this long a person is told."""
RENEW_NS: Final = int(session.RENEW_S * NS_PER_S)
URGENT_NS: Final = 100 * NS_PER_MS
HELLO_NS: Final = 500 * NS_PER_MS
NO_BOOT: Final = "0"
"""A lease with this is answered by a greeting."""
BROKEN_GREETINGS: Final = 5
"""In a row, five a second: a daemon that was stopped amid a greeting breaks one of them."""
REQUIRED: Final = ("boot_id", "next_seq", "config", "runs")
"""What a station cannot do without in `connected`."""
MAX_MESSAGE_BYTES: Final = 2 * 2**20
_REFUSED: Final = zmq.EVENT_HANDSHAKE_FAILED_AUTH
_BROKEN: Final = zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
_WATCHED: Final = _REFUSED | _BROKEN | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL

_ADDRESS = re.compile(r"(?:tcp://)?(?P<host>\[[0-9a-fA-F:.%\w]+\]|[\w.-]+)(?::(?P<port>\d{1,5}))?")


@dataclass(frozen=True, slots=True)
class LinkKeys:
    """CURVE keys in Z85: the station's own pair and the boat's public key."""

    public: bytes
    secret: bytes
    boat: bytes


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
    """The board greets anew: its daemon was restarted."""
    gone: list[FrameRange] | None = None
    """Frames that the board does not hold any more."""


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
    ) -> None:
        """keys: None = an open board; window: bytes of frames on their way at once."""
        self.endpoint = endpoint(address)
        self.wants: Callable[[], Wants] = Wants
        """Asked for each lease."""
        self.is_urgent = False
        """A lease is worth sending before its time: a hole was found."""
        self.offset = ClockOffset()
        """Of the board's clock to ours, for display."""
        self._client = client
        self._keys = keys
        self._window = window
        self._session = secrets.token_hex(8)
        self._context = zmq.Context()
        self._socket: zmq.Socket[bytes] | None = None
        self._monitor: zmq.Socket[bytes] | None = None
        self._boot_id = NO_BOOT
        self._received_bytes = 0
        self._told_bytes = 0
        self._renewed_ns = 0
        self._broken_greetings = 0
        self.refusal: str | None = None
        """Why nobody let us in, since the board was heard last."""
        self._watchdog_ns = WATCHDOG_NS
        self._opened_ns = self._heard_ns = boottime_ns()

    def connect(
        self,
        timeout_s: float = CONNECT_TIMEOUT_S,
        stopped: Callable[[], bool] = lambda: False,
        *,
        stream: bool = False,
    ) -> dict[str, Any]:
        """Say hello, return the `connected` map; raises LinkError when nobody answers in time or the board refuses.

        stream: frames come from the greeting on, none is made between.
        """
        self._new_socket()
        deadline_ns = boottime_ns() + int(timeout_s * NS_PER_S)
        hello_ns = 0
        while (now_ns := boottime_ns()) < deadline_ns and not stopped():
            if now_ns - hello_ns > HELLO_NS and self._say_hello(now_ns, stream=stream):
                hello_ns = now_ns
            parts = self._receive_parts(0.05)
            self._raise_if_refused()
            if parts is None:
                continue
            message = session.unpack(parts[0], MAX_MESSAGE_BYTES)
            if message["type"] == "connected":
                return self._greeted(message)
            if message["type"] == "error":
                raise LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))
        cure = "check the address, the Wi-Fi and that wayfix-onboard runs there"
        if self._keys is not None:
            cure += "; if the boat's keys were made anew, pair again (wayfix pair)"
        raise NoAnswerError(f"no answer within {timeout_s:g} s", self.endpoint, cure)

    def command(self, name: str, argument: str = "", timeout_s: float = CONNECT_TIMEOUT_S) -> str:
        """Ask the board to do something, after `connect`: its answer in words. Raises LinkError."""
        number = secrets.randbits(31) + 1
        self._send("command", id=number, name=name, argument=argument)
        deadline_ns = boottime_ns() + int(timeout_s * NS_PER_S)
        while boottime_ns() < deadline_ns:
            self._raise_if_refused()
            parts = self._receive_parts(0.05)
            message = {} if parts is None else session.unpack(parts[0], MAX_MESSAGE_BYTES)
            if message.get("type") == "done" and message.get("id") == number:
                return str(message.get("text"))
            if message.get("type") == "error":
                raise LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))
        cure = "look whether it was done (wayfix boat status), then ask again"
        raise LinkError(f"no answer within {timeout_s:g} s", self.endpoint, cure)

    def receive(self, timeout_s: float) -> Received | None:
        """The next message, the lease renewed when it is due; None when nothing came.

        Raises LinkError when the board itself refuses; whoever else is found at its address cannot end a session.
        """
        now_ns = boottime_ns()
        due_ns = self._renew_if_due(now_ns)
        parts = self._receive_parts(min(timeout_s, max(0.0, (due_ns - now_ns) / NS_PER_S)))
        if parts is None:
            self._watch()
            return None
        self._heard()
        message = session.unpack(parts[0], MAX_MESSAGE_BYTES)
        kind = message["type"]
        if kind == "frame" and len(parts) == 2:
            self._received_bytes += len(parts[1])
            return Received(frame=parts[1])
        if kind == "alive":
            return self._alive(message)
        if kind == "end":
            self._send("bye", session=self._session)  # a board that stops waits for it
            return Received(end=message)
        if kind == "connected":
            return Received(connected=self._greeted(message))
        if kind == "error":
            raise LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))
        raise CodecError(f"unexpected {kind} message")

    def move_to(self, address: str) -> None:
        """The boat has another address now; the session goes on there. Raises WayfixError."""
        self.endpoint = endpoint(address)
        self._new_socket()

    def silent_s(self) -> float | None:
        """Seconds without a word from the board once that is too long, else None."""
        age_s = (boottime_ns() - self._heard_ns) / NS_PER_S
        return age_s if age_s > LOST_S else None

    def close(self) -> None:
        """Say goodbye and close; safe to call twice."""
        if self._socket is not None:
            self._send("bye", session=self._session)
            self._close_socket(linger_ms=200)
        self._context.term()

    def _greeted(self, message: dict[str, Any]) -> dict[str, Any]:
        fault = session.version_fault(message)
        if fault is not None:
            raise LinkError(fault, self.endpoint)
        if missing := [name for name in REQUIRED if name not in message]:
            cure = "install the same version on both sides"
            raise LinkError(f"the greeting lacks {', '.join(missing)}", self.endpoint, cure)
        if self._boot_id != str(message["boot_id"]):
            self.offset = ClockOffset()
        self._boot_id = str(message["boot_id"])
        self._heard()
        return message

    def _heard(self) -> None:
        self._heard_ns = boottime_ns()
        self._broken_greetings = 0
        self._watchdog_ns = WATCHDOG_NS
        self.refusal = None

    def _watch(self) -> None:
        """Is the socket still good? Asked when nothing waits in it: it may be we who did not look for so long."""
        try:
            self._raise_if_refused()
        except LinkError as error:  # another box has the boat's address for a while, or somebody plays the boat
            self.refusal = error.what
        if boottime_ns() - max(self._heard_ns, self._opened_ns) > self._watchdog_ns:
            if self._heard_ns < self._opened_ns:
                self._watchdog_ns = min(2 * self._watchdog_ns, LONGEST_WATCHDOG_NS)
            self._new_socket()

    def _alive(self, message: dict[str, Any]) -> Received | None:
        match message:
            case {"echo_ns": int(echo_ns), "rx_ns": int(rx_ns), "tx_ns": int(tx_ns)}:
                self.offset.add(echo_ns, rx_ns, tx_ns, self._heard_ns)
        gone = session.frame_ranges(message.get("gone") or [])
        return Received(gone=gone) if gone else None

    def _say_hello(self, now_ns: int, *, stream: bool) -> bool:
        versions = {"schema": SCHEMA_VERSION, "link": session.LINK_VERSION, "client": self._client}
        if not stream:
            return self._send("hello", **versions, session=self._session)
        lease = Lease(self._session, NO_BOOT, self._window, self._received_bytes, now_ns)
        return self._send("lease", **versions, **lease.as_fields())

    def _renew_if_due(self, now_ns: int) -> int:
        """Returns when the next lease is due."""
        wait_ns = URGENT_NS if self.is_urgent else RENEW_NS
        half_window = self._received_bytes - self._told_bytes >= self._window // 2
        if now_ns < self._renewed_ns + wait_ns and not half_window:
            return self._renewed_ns + wait_ns
        wants = self.wants()
        lease = Lease(
            self._session, self._boot_id, self._window, self._received_bytes, now_ns, wants.missing, wants.run
        )
        if self._send("lease", client=self._client, **lease.as_fields()):
            self._renewed_ns, self._told_bytes, self.is_urgent = now_ns, self._received_bytes, False
            return now_ns + RENEW_NS
        return now_ns + URGENT_NS

    def _new_socket(self) -> None:
        self._close_socket(linger_ms=0)
        self._socket = self._context.socket(zmq.DEALER)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.IMMEDIATE, 1),  # nothing is queued for a board that is not there: an old lease is of no use
            (zmq.IPV6, int("[" in self.endpoint)),
            (zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES),
            (zmq.CONNECT_TIMEOUT, 1_000),
            (zmq.RECONNECT_IVL, 200),
            (zmq.HEARTBEAT_IVL, session.HEARTBEAT_MS),
            (zmq.HEARTBEAT_TIMEOUT, session.HEARTBEAT_TIMEOUT_MS),
        ):
            self._socket.setsockopt(option, value)
        if self._keys is not None:
            self._socket.setsockopt(zmq.CURVE_SERVERKEY, self._keys.boat)
            self._socket.setsockopt(zmq.CURVE_PUBLICKEY, self._keys.public)
            self._socket.setsockopt(zmq.CURVE_SECRETKEY, self._keys.secret)
        self._monitor = self._socket.get_monitor_socket(_WATCHED)
        self._opened_ns, self._renewed_ns = boottime_ns(), 0
        try:
            self._socket.connect(self.endpoint)
        except zmq.ZMQError as error:
            cure = "give HOST or HOST:PORT, like 10.0.0.1:5760"
            raise LinkError(f"not an address ({zmq.strerror(error.errno or 0)})", self.endpoint, cure) from error

    def _close_socket(self, linger_ms: int) -> None:
        if self._socket is not None:
            self._socket.disable_monitor()
            if self._monitor is not None:
                self._monitor.close(linger=0)
            self._socket.close(linger=linger_ms)
            self._socket = self._monitor = None

    def _raise_if_refused(self) -> None:
        assert self._monitor is not None
        while self._monitor.poll(0):
            kind = parse_monitor_message(self._monitor.recv_multipart())["event"]
            if kind == _REFUSED:
                cure = "pair: wayfix-onboard pair on the board, then wayfix pair here"
                raise LinkError("the boat does not know this station's key", self.endpoint, cure)
            self._broken_greetings += kind == _BROKEN
            if kind == _BROKEN and self._broken_greetings < BROKEN_GREETINGS:
                continue
            if self._keys is None:
                cure = "pair with it (wayfix pair), or start the daemon with --open"
                raise LinkError("the boat wants a key and this station gave none", self.endpoint, cure)
            cure = "is it a Wayfix daemon with keys? if its keys were made anew, pair again (wayfix pair)"
            raise LinkError("the boat did not take our greeting", self.endpoint, cure)

    def _send(self, kind: str, **fields: Any) -> bool:
        assert self._socket is not None
        try:
            self._socket.send(session.pack(kind, **fields), zmq.NOBLOCK)
        except zmq.Again:  # nobody there: `connect` and the watchdog tell it
            return False
        return True

    def _receive_parts(self, timeout_s: float) -> list[bytes] | None:
        assert self._socket is not None
        if not self._socket.poll(int(timeout_s * 1000)):
            return None
        parts = self._socket.recv_multipart()
        return parts if 1 <= len(parts) <= 2 else None
