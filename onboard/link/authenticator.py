"""Authenticator of the link (ZAP): the handler that libzmq asks at each handshake, and the test that it is asked."""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

import zmq
from zmq.utils.monitor import recv_monitor_message

from common.clock import boottime_ns
from common.errors import WayfixError
from common.keys import KEY_BYTES, key_text, new_keys
from common.units import NS_PER_S
from onboard.link.allow_list import AllowList

log = logging.getLogger(__name__)

ZAP_ENDPOINT: Final = "inproc://zeromq.zap.01"
SELF_TEST_S: Final = 3.0
"""Longest wait for the self-test, s; it takes some 10 ms."""
TOLD_EACH_S: Final = 60.0
"""Least time between two events of a refusal, s: a station that is not on the list tries again for ever."""
_AT_ONCE: Final = 16
"""Requests answered in one turn of the loop."""
_PAUSE_S: Final = 0.01
"""Pause after such a turn, s: a flood of handshakes gets no more of the loop."""
_HANDSHAKES: Final = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH


class Zap:
    """The authenticator of all CURVE sockets of one context (RFC 27), in the daemon's own loop.

    A User-Id that it grants is the public key in Z85. It exists from construction to `close`: a handshake in between
    waits for `run`, and is refused when nothing runs.
    """

    def __init__(
        self,
        context: "zmq.Context[zmq.Socket[bytes]]",
        allow_list: AllowList,
        refused: Callable[[str], None] | None = None,
    ) -> None:
        """Refused: gets the public key of a stranger, at most once a minute."""
        self._context = context
        self._allow_list = allow_list
        self._tell = refused
        self._told_ns: int | None = None
        self._stranger: str | None = None
        """Key of the self-test, until the handler has refused it."""
        self.refused = 0
        self._socket = context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(ZAP_ENDPOINT)

    async def run(self) -> None:
        """Answer until cancelled."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket.fileno(), self._answer_all)
        try:
            self._answer_all()
            await asyncio.Event().wait()
        finally:
            loop.remove_reader(self._socket.fileno())

    def close(self) -> None:
        """Close the socket; do it after those that it guards."""
        self._socket.close()

    async def self_test(self) -> None:
        """A stranger must be refused, by us; call it before the real socket is bound. Raises WayfixError.

        libzmq admits everybody when it finds no handler, so this is tried and not believed.
        """
        strange, own = new_keys(), new_keys()
        self._stranger = strange.public.decode()
        server, client = self._context.socket(zmq.ROUTER), self._context.socket(zmq.DEALER)
        monitor = server.get_monitor_socket(_HANDSHAKES)
        try:
            server.setsockopt_string(zmq.ZAP_DOMAIN, "self-test")
            server.setsockopt(zmq.CURVE_SERVER, 1)
            server.setsockopt(zmq.CURVE_SECRETKEY, own.secret)
            client.setsockopt(zmq.CURVE_SERVERKEY, own.public)
            client.setsockopt(zmq.CURVE_PUBLICKEY, strange.public)
            client.setsockopt(zmq.CURVE_SECRETKEY, strange.secret)
            server.bind("tcp://127.0.0.1:*")
            client.connect(server.getsockopt_string(zmq.LAST_ENDPOINT))
            client.send(b"?", zmq.NOBLOCK)
            verdict = await _verdict(server, monitor)
        except zmq.ZMQError as error:
            verdict = f"it could not be tried ({zmq.strerror(error.errno or 0)})"
        finally:
            server.disable_monitor()
            monitor.close(linger=0)
            client.close(linger=0)
            server.close(linger=0)
        if verdict is None and self._stranger is not None:
            verdict = "something else than the allow list refused it"
        self._stranger = None
        if verdict is not None:
            cure = "report this; the daemon does not listen like this (--open listens without keys)"
            raise WayfixError(f"a stranger's key is not refused: {verdict}", "self-test of the keys", cure)

    def _answer_all(self) -> None:
        """The descriptor tells of a change once: read until nothing is left, or come back."""
        if self._socket.closed:
            return
        for _ in range(_AT_ONCE):
            try:
                request = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._socket.send_multipart(self._answer(request))
        asyncio.get_running_loop().call_later(_PAUSE_S, self._answer_all)

    def _answer(self, request: list[bytes]) -> list[bytes]:
        """(version, id, domain, address, identity, mechanism, key) -> (version, id, status, text, user, metadata)."""
        number = request[1] if len(request) > 1 else b""
        user = ""
        try:
            if len(request) == 7 and request[0] == b"1.0" and request[5] == b"CURVE" and len(request[6]) == KEY_BYTES:
                user = key_text(request[6])
                if self._allow_list.rights_of(user) is not None:
                    return [b"1.0", number, b"200", b"OK", user.encode(), b""]
            self._refuse(user)
        except Exception:  # whatever went wrong, nobody is let in
            log.exception("handshake not answered")
            return [b"1.0", number, b"500", b"internal error", b"", b""]
        return [b"1.0", number, b"400", b"not on the allow list", b"", b""]

    def _refuse(self, user: str) -> None:
        if user == self._stranger:
            self._stranger = None
            return
        self.refused += 1
        now_ns = boottime_ns()
        if self._tell is not None and (self._told_ns is None or now_ns - self._told_ns >= TOLD_EACH_S * NS_PER_S):
            self._told_ns = now_ns
            self._tell(user)


async def _verdict(server: "zmq.Socket[bytes]", monitor: "zmq.Socket[bytes]") -> str | None:
    """None when the server's handshake was refused by an authenticator; else what happened instead."""
    deadline_ns = boottime_ns() + int(SELF_TEST_S * NS_PER_S)
    while boottime_ns() < deadline_ns:
        if server.poll(0):
            return "its message was received"
        if monitor.poll(0):
            happened = recv_monitor_message(monitor)
            if happened["event"] == zmq.EVENT_HANDSHAKE_FAILED_AUTH and happened["value"] == 400:
                return None
            return f"event {int(happened['event'])}, {happened['value']}"
        await asyncio.sleep(0.002)
    return f"no answer within {SELF_TEST_S:g} s"
