"""Access control list of the link: the board's own key, its stations, and the handler of libzmq's handshakes (ZAP).

The list is `allowed-keys` in the state directory, one line for each station: `KEY RIGHTS NAME`, rights `read` or
`read,command` (`common.key_list`). A doubtful line lets no station in.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import zmq
from zmq.utils.monitor import recv_monitor_message

from common.clock import boottime_ns
from common.errors import WayfixError
from common.key_list import Entry, entries_of, name_fault, with_entry, without
from common.keys import KEY_BYTES, TRUSTED, key_text, new_keys, own_keys, raw_key, read_own, write_own
from common.units import NS_PER_S

log = logging.getLogger(__name__)

READ: Final = frozenset({"read"})
COMMAND: Final = frozenset({"read", "command"})
RIGHTS: Final = {"read": READ, "read,command": COMMAND}
LIST_LIMIT_BYTES: Final = 262_144
_HEADER: Final = "# Stations that may connect: KEY RIGHTS NAME (docs/security.md)\n"


@dataclass(frozen=True, slots=True)
class Allowed:
    """One station of the list."""

    key: str
    """Public key of the station, 40 characters of Z85."""
    name: str
    rights: frozenset[str]


class Access:
    """The board's key and its list of stations. `rights_of` never waits; the other methods work on the disk."""

    def __init__(self, state_dir: Path | None) -> None:
        """Raises WayfixError when there is no key of our own that can be trusted."""
        if state_dir is None:
            cure = "give --state DIR, or --open on a network that you trust"
            raise WayfixError("keys need a directory to be kept in", "--state", cure)
        keys = own_keys(state_dir / "secret-key")
        self.public_key = keys.public
        self.secret_key = keys.secret
        self.file = state_dir / "allowed-keys"
        self._lock = threading.Lock()
        self._allowed: dict[str, Allowed] = {}
        self._revoked: set[str] = set()
        """Keys that are refused, though they are still in the file because it could not be written."""
        self.faults = self.reload()
        """What was wrong with the list when it was last read."""

    @property
    def entries(self) -> list[Allowed]:
        """The stations in the order of the list."""
        return list(self._allowed.values())

    def rights_of(self, user_id: str | None) -> frozenset[str] | None:
        """What the station with this public key (Z85) may do; None = it is not on the list."""
        allowed = self._allowed.get(user_id or "")
        return None if allowed is None else allowed.rights

    def reload(self) -> list[str]:
        """Read the list again: what is wrong with it, one sentence each. One that cannot be read lets no station in."""
        with self._lock:
            allowed: dict[str, Allowed] = {}
            try:
                entries, faults = _parse(self._text())
            except (OSError, WayfixError) as error:
                entries, faults = [], [f"{_reason(error)}: no station may connect"]
            for entry in entries:
                rights = RIGHTS[entry.word]
                if entry.key in allowed:  # the less is granted
                    rights &= allowed[entry.key].rights
                    faults.append(f"{entry.name}: this key stands there twice, the fewer rights count")
                if entry.key not in self._revoked:
                    allowed[entry.key] = Allowed(entry.key, entry.name, rights)
            self._allowed, self.faults = allowed, faults
            return faults

    def add(self, key: str, name: str, rights: frozenset[str]) -> None:
        """Put a station on the list, or change its line. Raises WayfixError, and then nothing has changed."""
        word = next((word for word, granted in RIGHTS.items() if granted == rights), None)
        if word is None or raw_key(key) is None:
            raise WayfixError("not a key, or no such rights", name, "rights are read or read,command")
        if (fault := name_fault(name)) is not None:
            raise WayfixError(fault, name, "give another --name")
        with self._lock:
            if any(item.name == name and item.key != key for item in self._allowed.values()):
                raise WayfixError("another station has this name", name, "give another --name, or revoke it first")
            try:
                text = self._text() or _HEADER
                write_own(self.file, _bytes(with_entry(text, Entry(key, word, name))))
            except OSError as error:
                cure = "check the disk and the rights of the state directory"
                raise WayfixError(f"the key cannot be kept ({error.strerror})", str(self.file), cure) from error
            self._revoked.discard(key)
            others = {other: item for other, item in self._allowed.items() if other != key}
            self._allowed = {**others, key: Allowed(key, name, rights)}

    def remove(self, name_or_key: str) -> bool:
        """Take a station off the list; False = it is not on it.

        Raises WayfixError when the list cannot be written: then the key is refused all the same, but only for this run.
        """
        with self._lock:
            keys = [item.key for item in self._allowed.values() if name_or_key in (item.key, item.name)]
            if not keys:
                return False
            self._allowed = {key: item for key, item in self._allowed.items() if key not in keys}
            try:
                write_own(self.file, _bytes(without(self._text(), keys)))
            except (OSError, WayfixError) as error:
                self._revoked.update(keys)
                what = f"the key is refused from now on, but the list still has it ({_reason(error)})"
                cure = "remove its line before the daemon starts again"
                raise WayfixError(what, str(self.file), cure) from error
            return True

    def name_for(self, key: str) -> str:
        """The name that a key has, else a free one: station-1, station-2, ..."""
        if key in self._allowed:
            return self._allowed[key].name
        taken = {item.name for item in self._allowed.values()}
        return next(name for name in (f"station-{number}" for number in range(1, len(taken) + 2)) if name not in taken)

    def _text(self) -> str:
        """The list's text, empty without a file. Raises OSError, WayfixError."""
        try:
            data = read_own(self.file, TRUSTED, LIST_LIMIT_BYTES)
        except FileNotFoundError:
            return ""
        return data.decode("utf-8", "surrogateescape")


def _parse(text: str) -> tuple[list[Entry], list[str]]:
    return entries_of(text, lambda word: None if word in RIGHTS else "has rights that are not read or read,command")


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")


def _reason(error: OSError | WayfixError) -> str:
    return error.what if isinstance(error, WayfixError) else str(error.strerror)


ZAP_ENDPOINT: Final = "inproc://zeromq.zap.01"
SELF_TEST_S: Final = 3.0
"""Time-out of the self-test, s; it takes some 10 ms."""
TOLD_EACH_S: Final = 60.0
"""Interval of the reports of refusals, s, at least: a station that is not on the list tries again for ever."""
_AT_ONCE: Final = 64
"""Number of requests that are answered in one turn of the loop."""
_HANDSHAKES: Final = zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_AUTH


class Zap:
    """The authenticator of all CURVE sockets of one context (RFC 27), in the daemon's own loop.

    A User-Id that it grants is the public key in Z85. It exists from construction to `close`: a handshake in between
    waits for `run`, and is refused when nothing runs.
    """

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", access: Access, refused: Callable[[str], None] | None = None
    ) -> None:
        """refused: called with the public key of a stranger, at most once a minute."""
        self._context = context
        self._access = access
        self._tell = refused
        self._told_ns: int | None = None
        self._stranger: str | None = None
        """Key of the self-test, until the handler has refused it."""
        self.refused = 0
        self._socket = context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.bind(ZAP_ENDPOINT)

    async def run(self) -> None:
        """Answer handshakes until cancelled."""
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

        libzmq admits every client when it finds no handler, so this is tried and not believed.
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
        """The descriptor signals a change once: read until nothing is left, or come back."""
        if self._socket.closed:
            return
        for _ in range(_AT_ONCE):
            try:
                request = self._socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            self._socket.send_multipart(self._answer(request))
        asyncio.get_running_loop().call_soon(self._answer_all)

    def _answer(self, request: list[bytes]) -> list[bytes]:
        """(version, id, domain, address, identity, mechanism, key) -> (version, id, status, text, user, metadata)."""
        number = request[1] if len(request) > 1 else b""
        user = ""
        try:
            if len(request) == 7 and request[0] == b"1.0" and request[5] == b"CURVE" and len(request[6]) == KEY_BYTES:
                user = key_text(request[6])
                if self._access.rights_of(user) is not None:
                    return [b"1.0", number, b"200", b"OK", user.encode(), b""]
            self._refuse(user)
        except Exception:  # whatever went wrong, no client is let in
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
