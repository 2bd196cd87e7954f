"""The station's end of the link: one DEALER socket (`common.session`, docs/protocol.md); no other file ashore has one.

First form: when the board falls silent the socket is thrown away and the session begun again; frames sent meanwhile are
lost and counted (the spool and leases come with the link's next form).
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import zmq

from common import session
from common.clock import boottime_ns
from common.errors import CodecError, LinkError, WayfixError
from common.messages import SCHEMA_VERSION
from common.units import NS_PER_S

DEFAULT_PORT: Final = 5760
CONNECT_TIMEOUT_S: Final = 5.0
SILENCE_S: Final = 3.0
"""No frame for this long on a running session (and two periods more): the link counts as lost."""
REQUIRED: Final = ("boot_id", "next_seq", "config")
"""What a station cannot do without in `connected`."""
MAX_MESSAGE_BYTES: Final = 2 * 2**20

_ADDRESS = re.compile(r"(?:tcp://)?(?P<host>\[[0-9a-fA-F:.%\w]+\]|[\w.-]+)(?::(?P<port>\d{1,5}))?")


@dataclass(frozen=True, slots=True)
class Received:
    """One message of a running session: a frame's bytes, or the end."""

    frame: bytes | None = None
    k: int = 0
    end: dict[str, Any] | None = None


def endpoint(address: str) -> str:
    """`boat.local`, `10.0.0.1:5760`, `tcp://[::1]:5760` -> ZeroMQ endpoint; raises WayfixError."""
    match = _ADDRESS.fullmatch(address.strip())
    port = int(match["port"] or DEFAULT_PORT) if match else 0
    if match is None or not 1 <= port <= 65535:
        raise WayfixError("not an address", address, "give HOST or HOST:PORT, like 10.0.0.1:5760")
    return f"tcp://{match['host']}:{port}"


class Link:
    """One session with one board. Blocking calls with time-outs; use it from one thread."""

    def __init__(self, address: str, client: str = "station") -> None:
        self.endpoint = endpoint(address)
        self._client = client
        self._context = zmq.Context()
        self._socket: zmq.Socket[bytes] | None = None
        self._run: dict[str, Any] = {}
        self._last_frame_ns = boottime_ns()
        self._silence_s = SILENCE_S

    def connect(
        self, timeout_s: float = CONNECT_TIMEOUT_S, stopped: Callable[[], bool] = lambda: False
    ) -> dict[str, Any]:
        """Say hello, return the `connected` map; raises LinkError when nobody answers in time or the board refuses."""
        self._new_socket()
        self._send("hello", schema=SCHEMA_VERSION, client=self._client)
        deadline_ns = boottime_ns() + int(timeout_s * NS_PER_S)
        while boottime_ns() < deadline_ns and not stopped():
            parts = self._receive_parts(0.1)
            if parts is None:
                continue
            message = session.unpack(parts[0])
            if message["type"] == "connected":
                fault = session.schema_fault(message.get("schema"))
                if fault is not None:
                    raise LinkError(fault, self.endpoint, "install the same version on both sides")
                if missing := [name for name in REQUIRED if name not in message]:
                    cure = "install the same version on both sides"
                    raise LinkError(f"the greeting lacks {', '.join(missing)}", self.endpoint, cure)
                return message
            if message["type"] == "error":
                raise LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))
        cure = "check the address, the Wi-Fi and that wayfix-onboard runs there"
        raise LinkError(f"no answer within {timeout_s:g} s", self.endpoint, cure)

    def run(self, m: int | None = None, period_s: float | None = None) -> None:
        """Ask for m frames of period_s each, or (None) for all frames until the end."""
        self._run = {name: value for name, value in (("m", m), ("period_s", period_s)) if value is not None}
        self._silence_s = SILENCE_S + 2 * (period_s or 0.0)
        self._last_frame_ns = boottime_ns()
        self._send("run", **self._run)

    def receive(self, timeout_s: float) -> Received | None:
        """The next frame or the end; None when nothing came. Raises LinkError when the board refuses the run."""
        parts = self._receive_parts(timeout_s)
        if parts is None:
            return None
        message = session.unpack(parts[0])
        if message["type"] == "frame" and len(parts) == 2:
            self._last_frame_ns = boottime_ns()
            return Received(frame=parts[1], k=int(message.get("k") or 0))
        if message["type"] == "end":
            return Received(end=message)
        if message["type"] == "error":
            raise LinkError(str(message.get("what")), self.endpoint, str(message.get("cure") or ""))
        if message["type"] == "connected":
            return None  # the late answer to an earlier greeting
        raise CodecError(f"unexpected {message['type']} message")

    def silent_s(self) -> float | None:
        """Seconds without a frame once that is too long, else None."""
        age_s = (boottime_ns() - self._last_frame_ns) / NS_PER_S
        return age_s if age_s > self._silence_s else None

    def close(self) -> None:
        """Say goodbye and close; safe to call twice."""
        if self._socket is not None:
            self._send("bye")
            self._socket.close(linger=200)
            self._socket = None
        self._context.term()

    def _new_socket(self) -> None:
        if self._socket is not None:
            self._socket.close(linger=0)
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.IPV6, int("[" in self.endpoint))
        self._socket.setsockopt(zmq.MAXMSGSIZE, MAX_MESSAGE_BYTES)
        self._socket.setsockopt(zmq.CONNECT_TIMEOUT, 1_000)
        self._socket.setsockopt(zmq.RECONNECT_IVL, 200)
        self._socket.setsockopt(zmq.RECONNECT_IVL_MAX, 2_000)
        self._socket.setsockopt(zmq.HEARTBEAT_IVL, session.HEARTBEAT_MS)
        self._socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, session.HEARTBEAT_TIMEOUT_MS)
        try:
            self._socket.connect(self.endpoint)
        except zmq.ZMQError as error:
            cure = "give HOST or HOST:PORT, like 10.0.0.1:5760"
            raise LinkError(f"not an address ({zmq.strerror(error.errno or 0)})", self.endpoint, cure) from error

    def _send(self, kind: str, **fields: Any) -> None:
        assert self._socket is not None
        try:
            self._socket.send(session.pack(kind, **fields), zmq.NOBLOCK)
        except zmq.Again:  # nobody there: `connect` and the silence watch tell it
            return

    def _receive_parts(self, timeout_s: float) -> list[bytes] | None:
        assert self._socket is not None
        if not self._socket.poll(int(timeout_s * 1000)):
            return None
        parts = self._socket.recv_multipart()
        return parts if 1 <= len(parts) <= 2 else None
