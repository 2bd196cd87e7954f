"""Event multiplexing (select): waits for stdin's lines, its end, and signals that ask the boat to stop."""

import contextlib
import os
import select
import signal
import socket
from types import TracebackType
from typing import Self


class Console:
    """A context that turns SIGTERM, SIGINT and SIGHUP into `stopping` and stdin (if watched) into lines."""

    def __init__(self, watch_stdin: bool) -> None:
        self.stopping = False
        self.stdin_ended = False
        self._watched = [0] if watch_stdin else []
        self._pending = b""
        self._wake, self._signalled = socket.socketpair()

    def __enter__(self) -> Self:
        for end in (self._wake, self._signalled):
            end.setblocking(False)
        # The interpreter writes a byte there when a signal comes, which ends the waiting at once.
        self._old_fd = signal.set_wakeup_fd(self._signalled.fileno())
        self._old = {
            number: signal.signal(number, self._stop) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
        }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._old_fd)
        self._wake.close()
        self._signalled.close()

    def _stop(self, number: int, frame: object) -> None:
        del number, frame
        self.stopping = True

    def wait(self, seconds: float | None) -> list[str]:
        """Sleep that long (`None` = until something happens), or less; the lines that came in on stdin."""
        # select, because poll and epoll round to whole milliseconds: 16 ms of boat time at rate 16.
        ready, _, _ = select.select([self._wake.fileno(), *self._watched], [], [], seconds)
        if self._wake.fileno() in ready:
            with contextlib.suppress(BlockingIOError):
                self._wake.recv(64)
        return self._lines() if 0 in ready else []

    def _lines(self) -> list[str]:
        data = os.read(0, 4096)
        if not data:
            self.stdin_ended = True
            self._watched = []
        *lines, self._pending = (self._pending + data).split(b"\n")
        return [line.decode("ascii", "replace").strip() for line in lines]
