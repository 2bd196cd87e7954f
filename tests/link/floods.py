"""Hostile peers: hand-made ZMTP on an open board, so that nothing holds them back but the board; libzmq with a key."""

import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Protocol, Self

import zmq

from common import link_messages as session
from common.versions import LINK_VERSION, SCHEMA_VERSION
from shore.link.transport import LinkKeys

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16) + bytes(32)
_READY = b"\x05READY\x0bSocket-Type" + struct.pack(">I", 6) + b"DEALER"
PING: Final = b"\x04\x07\x04PING\x00\x00"
"""A heartbeat that asks for an answer."""
PART = b"\x03" + struct.pack(">Q", 16_000) + bytes(16_000)
"""A part of 16 kB behind which another one comes."""
SMALL_PARTS: Final = b"\x01\x00" * 8_000
"""Empty parts behind which another one comes: two bytes on the wire, and more in memory."""
LEASE = session.pack(
    "lease", session="ab", boot_id="0", window=24_576, received=0, t_ns=0,
    missing=[["ab" * 8, number * 10, number * 10 + 3] for number in range(64)],
)  # fmt: skip
HELLO: Final = session.pack("hello", schema=SCHEMA_VERSION, link=LINK_VERSION)
COMMAND: Final = session.pack("command", id=1, name="status")
MALFORMED: Final = b"x" * 1000
BOMB_PARTS: Final = 2_000
"""Parts of a message of libzmq's, which it holds in memory until it is whole: 32 MB."""
ATTACKER: Final = "127.0.0.2"
"""Source address of attackers; the honest station has another."""


def connected(port: int) -> socket.socket:
    """A connection over which messages may be sent."""
    peer = dialled(port)
    peer.sendall(GREETING)
    peer.recv(64)
    peer.sendall(b"\x04" + bytes([len(_READY)]) + _READY)
    peer.recv(200)
    return peer


def dialled(port: int) -> socket.socket:
    """A TCP connection. Its own port may be one that the board still takes for another connection: then another one."""
    for _ in range(10):
        with suppress(TimeoutError):
            peer = socket.create_connection(("127.0.0.1", port), 0.5, (ATTACKER, 0))
            peer.settimeout(5.0)
            return peer
    raise TimeoutError(f"nobody listens on port {port}")


def message(data: bytes) -> bytes:
    """A message of one part as it is on the wire."""
    return b"\x02" + struct.pack(">Q", len(data)) + data


class Peer(Protocol):
    """One attacker."""

    def step(self) -> int:
        """Send something; how many bytes. Raises OSError when it was cut."""

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Target:
    """Whom it goes against."""

    port: int
    keys: Sequence[LinkKeys] = ()
    """Keys of the attackers; none = an open board."""
    count: int = 1
    bytes_per_s: float | None = None
    """Of all attackers together; None = as fast as it goes."""


class Raw:
    """Hand-made: sends the same bytes for ever, and comes back each time it is cut."""

    def __init__(self, port: int, data: bytes, first: bytes = b"") -> None:
        """First: what it sends at first over each connection."""
        self._port, self._data, self._first = port, data, first
        self._peer: socket.socket | None = None

    def step(self) -> int:
        try:
            if self._peer is None:
                self._peer = connected(self._port)
                self._peer.sendall(self._first)
                self._peer.settimeout(0.2)
            if self._peer in select.select([self._peer], [], [], 0)[0] and not self._peer.recv(65_536):
                raise ConnectionError
            self._peer.sendall(self._data)
        except OSError:
            self.close()
            time.sleep(0.01)
            raise
        return len(self._data)

    def close(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None


class WithKey:
    """A DEALER of libzmq with a key."""

    def __init__(self, target: Target, number: int, parts: Sequence[bytes]) -> None:
        keys = target.keys[number % len(target.keys)]
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._dealer = self._context.socket(zmq.DEALER)
        for option in (zmq.LINGER, zmq.IMMEDIATE):
            self._dealer.setsockopt(option, int(option == zmq.IMMEDIATE))
        self._dealer.setsockopt(zmq.SNDHWM, 1 if len(parts) > 1 else 20)
        self._dealer.setsockopt(zmq.SNDTIMEO, 200)
        self._dealer.setsockopt(zmq.RECONNECT_IVL, 5)
        self._dealer.curve_serverkey = keys.boat
        self._dealer.curve_publickey, self._dealer.curve_secretkey = keys.public, keys.secret
        self._dealer.connect(f"tcp://{ATTACKER}:0;127.0.0.1:{target.port}")
        self._parts, self._bytes = parts, sum(map(len, parts))

    def step(self) -> int:
        while self._dealer.poll(0):
            self._dealer.recv_multipart()
        try:
            self._dealer.send_multipart(self._parts, copy=False)
        except zmq.Again as error:
            raise ConnectionError from error
        return self._bytes

    def close(self) -> None:
        self._context.destroy(linger=0)


class Silent:
    """A connection that says `words` and then nothing; it comes back when it is cut."""

    def __init__(self, port: int, words: bytes, *, is_whole: bool = False) -> None:
        self._port, self._words, self._is_whole = port, words, is_whole
        self._peer: socket.socket | None = None

    def step(self) -> int:
        if self._peer is None:
            self._peer = connected(self._port) if self._is_whole else dialled(self._port)
            self._peer.sendall(self._words)
            self._peer.setblocking(False)
            return len(self._words)
        with suppress(BlockingIOError):
            if not self._peer.recv(4096):
                self.close()
        return 0

    def close(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None


def _of(target: Target, number: int, raw: bytes, parts: Sequence[bytes], first: bytes = b"") -> Peer:
    return WithKey(target, number, parts) if target.keys else Raw(target.port, raw, first)


def nobody(target: Target, number: int) -> Peer:
    raise ValueError(target, number)


def parts(target: Target, number: int) -> Peer:
    return _of(target, number, PART * 8, [PART[9:]] * BOMB_PARTS)


def small_parts(target: Target, number: int) -> Peer:
    return _of(target, number, SMALL_PARTS * 8, [b""] * 200_000)


def slow_parts(target: Target, number: int) -> Peer:
    """A whole message, and then one that never ends, slower than the board's limit."""
    return Paced(_of(target, number, PART, [], message(HELLO)), 50_000.0)


def leases(target: Target, number: int) -> Peer:
    return _of(target, number, message(LEASE) * 20, [LEASE])


def hellos(target: Target, number: int) -> Peer:
    return _of(target, number, message(HELLO) * 20, [HELLO])


def bad(target: Target, number: int) -> Peer:
    return _of(target, number, message(MALFORMED) * 20, [MALFORMED])


def commands(target: Target, number: int) -> Peer:
    return _of(target, number, message(COMMAND) * 20, [COMMAND])


def idle(target: Target, _number: int) -> Peer:
    return Silent(target.port, b"")


def half_open(target: Target, _number: int) -> Peer:
    return Silent(target.port, GREETING[:11])


def greeters(target: Target, _number: int) -> Peer:
    """They say one word and are silent then."""
    return Silent(target.port, message(HELLO), is_whole=True)


class Paced:
    """A peer that is no faster than so many bytes a second."""

    def __init__(self, peer: Peer, bytes_per_s: float) -> None:
        self._peer, self._bytes_per_s = peer, bytes_per_s
        self._begun_s, self._sent = time.monotonic(), 0

    def step(self) -> int:
        if self._sent > (time.monotonic() - self._begun_s) * self._bytes_per_s:
            return 0
        sent = self._peer.step()
        self._sent += sent
        return sent

    def close(self) -> None:
        self._peer.close()


def attack(peer_of: Callable[[Target, int], Peer], target: Target, over: Any, sent: Any) -> None:
    """All attackers in this process, in threads of their own when they are few, until `over` is set."""
    few = target.count <= 32
    peers = [peer_of(target, number) for number in range(target.count)]
    if few and target.bytes_per_s is not None:
        peers = [Paced(peer, target.bytes_per_s / target.count) for peer in peers]
    groups = [[peer] for peer in peers] if few else [peers]
    threads = [threading.Thread(target=_attack, args=(group, over, sent), daemon=True) for group in groups]
    for thread in threads:
        thread.start()
    over.wait()
    for thread in threads:
        thread.join(10)
    for peer in peers:
        peer.close()


def _attack(peers: Sequence[Peer], over: Any, sent: Any) -> None:
    while not over.is_set():
        did = 0
        for peer in peers:
            with suppress(OSError):
                did += peer.step()
        with sent.get_lock():
            sent.value += did
        if not did:
            time.sleep(0.005)


class Flood:
    """Sends the same bytes, and comes back each time it is cut; for use with `with`."""

    def __init__(self, port: int, data: bytes, bytes_per_s: float) -> None:
        self.sent = self.cuts = 0
        self._peer = Paced(Raw(port, data), bytes_per_s)
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join(10)
        self._peer.close()

    def _run(self) -> None:
        while not self._is_over:
            try:
                sent = self._peer.step()
            except OSError:
                self.cuts += 1
            else:
                self.sent += sent
                time.sleep(0.0 if sent else 0.001)


def crowd(port: int, count: int) -> list[socket.socket]:
    """Connections that say nothing."""
    return [dialled(port) for _ in range(count)]


def until_cut(peer: socket.socket, data: bytes, seconds: float = 5.0) -> float:
    """How long it takes until the other side ends the connection over which `data` is sent without pause, s."""
    begun_s = time.monotonic()
    peer.settimeout(0.1)
    while time.monotonic() - begun_s < seconds:
        try:
            with suppress(TimeoutError):  # its buffer is full: it may have ended all the same
                peer.sendall(data)
            with suppress(TimeoutError):
                if peer in select.select([peer], [], [], 0)[0] and not peer.recv(1000):
                    return time.monotonic() - begun_s
        except OSError:
            return time.monotonic() - begun_s
    raise AssertionError(f"it was not cut within {seconds:g} s")
