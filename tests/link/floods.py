"""Hostile peers of an open board: hand-made ZMTP, so that nothing holds them back but the board."""

import select
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import Self

from common import link_messages as session

_GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00NULL" + bytes(16) + bytes(32)
_READY = b"\x05READY\x0bSocket-Type" + struct.pack(">I", 6) + b"DEALER"
PART = b"\x03" + struct.pack(">Q", 16_000) + bytes(16_000)
"""A part of 16 kB behind which another one comes."""
LEASE = session.pack(
    "lease", session="ab", boot_id="0", window=24_576, received=0, t_ns=0,
    missing=[["ab" * 8, number * 10, number * 10 + 3] for number in range(64)],
)  # fmt: skip


def connected(port: int) -> socket.socket:
    """A connection over which messages may be sent."""
    peer = socket.create_connection(("127.0.0.1", port), 5)
    peer.sendall(_GREETING)
    peer.recv(64)
    peer.sendall(b"\x04" + bytes([len(_READY)]) + _READY)
    peer.recv(200)
    return peer


def message(data: bytes) -> bytes:
    """A message of one part as it is on the wire."""
    return b"\x02" + struct.pack(">Q", len(data)) + data


class Flood:
    """Sends the same bytes as fast as it can, and comes back each time it is cut; for use with `with`."""

    def __init__(self, port: int, data: bytes) -> None:
        self.sent = self.cuts = 0
        self._port, self._data = port, data
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join(10)

    def _run(self) -> None:
        while not self._is_over:
            try:
                with connected(self._port) as peer:
                    while not self._is_over:
                        peer.sendall(self._data)
                        self.sent += len(self._data)
            except OSError:
                self.cuts += 1
                time.sleep(0.01)


def crowd(port: int, count: int) -> list[socket.socket]:
    """Connections that say nothing."""
    return [socket.create_connection(("127.0.0.1", port), 5) for _ in range(count)]


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
