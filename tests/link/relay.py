"""A TCP relay on loopback that does to a connection what a radio does: tests need no root for it.

`Relay(target)` listens at `address`; what connects there is passed on to `target`. All controls are plain method calls
from the test's thread, they hold for every connection and last until the next one.

Limits of what it can show: TCP is passed on as a stream, so nothing is lost or reordered between two living
connections (that is what `tun_relay` is for), and both ends see an acknowledgement by this relay, not by each other.
"""

import asyncio
import random
import socket
import threading
from collections import deque
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any, Final, Self

CHUNK_BYTES: Final = 1_460
KERNEL_BUFFER_BYTES: Final = 8_192
"""Of the relay's own sockets: what lies there is back-pressure that comes too late."""
UNLIMITED_HELD_BYTES: Final = 2**20
CAPTURE_BYTES: Final = 64 * 2**20


class Way:
    """One direction: what passed, and what is on its way. `up` = from who connected to the target."""

    def __init__(self) -> None:
        self.bytes = 0
        """Passed on to the other end."""
        self.capture = bytearray()
        """The same bytes, all connections behind each other; the oldest are dropped after 64 MiB."""
        self.free_s = 0.0
        """When the line has sent all it was given, on the loop's clock."""

    def passed(self, data: bytes) -> None:
        self.bytes += len(data)
        self.capture += data
        del self.capture[: max(0, len(self.capture) - CAPTURE_BYTES)]


class _Line:
    """Bytes of one connection and direction that wait for their time."""

    def __init__(self) -> None:
        self.waiting: deque[tuple[float, bytes]] = deque()
        self.held = 0
        self.changed = asyncio.Event()
        self.last_s = 0.0


class Relay:
    """Between a client and `target` (host, port); a context manager."""

    def __init__(self, target: tuple[str, int], seed: int = 1) -> None:
        self.target = target
        """Where new connections go; may be set at any time."""
        self.up, self.down = Way(), Way()
        self.accepted = 0
        self._random = random.Random(seed)
        self._delay_s = self._jitter_s = 0.0
        self._bits_per_s: float | None = None
        self._queue_bytes = 0
        self._pairs: set[tuple[socket.socket, socket.socket]] = set()
        self._fillers: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()
        # Keeps the port while nobody listens there, so that a cut refuses and never answers in another's name.
        self._holder = _bound(("127.0.0.1", 0))
        self.host, self.port = self._holder.getsockname()
        self._listener: socket.socket | None = None
        self._accepting: asyncio.Task[None] | None = None
        self._loop = asyncio.new_event_loop()
        self._flowing = asyncio.Event()
        self._flowing.set()
        self._thread = threading.Thread(target=self._loop.run_forever, name="relay", daemon=True)
        self._thread.start()
        self._do(self._listen())

    @property
    def address(self) -> str:
        """`127.0.0.1:PORT`."""
        return f"{self.host}:{self.port}"

    @property
    def connections(self) -> int:
        """That are passed on at the moment."""
        return len(self._pairs)

    def cut(self) -> None:
        """Close all connections and refuse new ones."""
        self._do(self._cut())

    def blackhole(self) -> None:
        """Pass nothing on, in silence: connections stay open, new ones get no answer (their SYN is dropped)."""
        self._do(self._blackhole())

    def restore(self) -> None:
        """End of `cut` and `blackhole`; what was held flows again, as TCP would have sent it again."""
        self._do(self._restore())

    def delay(self, ms: float, jitter_ms: float = 0.0) -> None:
        """Every chunk `ms` later, give or take up to `jitter_ms`; the order is kept."""
        self._delay_s, self._jitter_s = ms / 1000, jitter_ms / 1000

    def limit(self, bits_per_s: float | None, queue_bytes: int = 16_384) -> None:
        """So much each way, all connections together; None = all there is.

        queue_bytes: what waits here before the sender is made to wait.
        """
        self._bits_per_s, self._queue_bytes = bits_per_s, queue_bytes

    def close(self) -> None:
        """End it; safe to call twice."""
        if self._loop.is_closed():
            return
        self._do(self._cut())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._holder.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _do(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(10)

    async def _listen(self) -> None:
        self._listener = _bound((self.host, self.port))
        self._listener.listen(128)
        self._accepting = self._loop.create_task(self._accept(self._listener))

    async def _accept(self, listener: socket.socket) -> None:
        while True:
            near, _ = await self._loop.sock_accept(listener)
            self.accepted += 1
            task = self._loop.create_task(self._serve(near))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)

    async def _stop_accepting(self) -> None:
        if self._accepting is not None:
            self._accepting.cancel()
            await asyncio.gather(self._accepting, return_exceptions=True)
            self._accepting = None

    async def _cut(self) -> None:
        await self._stop_accepting()
        self._drop_fillers()
        if self._listener is not None:
            self._listener.close()
            self._listener = None
        self._flowing.set()
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _blackhole(self) -> None:
        self._flowing.clear()
        await self._stop_accepting()
        if self._listener is None:  # after a cut: nothing answers from now on, not even a refusal
            self._listener = _bound((self.host, self.port))
        # A full queue of connections nobody accepts makes the kernel drop every further SYN.
        self._listener.listen(0)
        for _ in range(8):
            filler = socket.socket()
            filler.setblocking(False)
            self._fillers.append(filler)
            filler.connect_ex((self.host, self.port))
        await asyncio.sleep(0.01)

    async def _restore(self) -> None:
        if self._fillers and self._listener is not None:
            self._drop_fillers()
            self._listener.listen(128)
            self._accepting = self._loop.create_task(self._accept(self._listener))
        elif self._listener is None:
            await self._listen()
        self._flowing.set()

    def _drop_fillers(self) -> None:
        for filler in self._fillers:
            filler.close()
        self._fillers.clear()

    async def _serve(self, near: socket.socket) -> None:
        far = socket.socket()
        try:
            for end in (near, far):
                end.setblocking(False)
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BUFFER_BYTES)
                end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BUFFER_BYTES)
            await self._loop.sock_connect(far, self.target)
            self._pairs.add((near, far))
            await self._both_ways(near, far)
        except OSError:
            pass  # an end that dies takes the other with it
        finally:
            self._pairs.discard((near, far))
            near.close()
            far.close()

    async def _both_ways(self, near: socket.socket, far: socket.socket) -> None:
        up, down = _Line(), _Line()
        work = (
            self._read(near, up, self.up), self._write(far, up, self.up),
            self._read(far, down, self.down), self._write(near, down, self.down),
        )  # fmt: skip
        tasks = [self._loop.create_task(each) for each in work]
        try:
            await asyncio.gather(*tasks)
        except OSError:
            await self._flowing.wait()  # in a blackhole the death of one end is not heard at the other
            raise
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _read(self, source: socket.socket, line: _Line, way: Way) -> None:
        data = b"."
        while data:
            await self._flowing.wait()
            data = await self._loop.sock_recv(source, CHUNK_BYTES)
            await self._flowing.wait()
            now_s = self._loop.time()
            if self._bits_per_s is not None:
                way.free_s = max(now_s, way.free_s) + len(data) * 8 / self._bits_per_s
            sent_s = now_s if self._bits_per_s is None else way.free_s
            late_s = self._delay_s + self._random.uniform(-self._jitter_s, self._jitter_s)
            line.last_s = max(line.last_s, sent_s + late_s)
            line.waiting.append((line.last_s, data))
            line.held += len(data)
            line.changed.set()
            while line.held > self._may_hold():
                line.changed.clear()
                with suppress(TimeoutError):
                    await asyncio.wait_for(line.changed.wait(), 0.1)

    def _may_hold(self) -> float:
        if self._bits_per_s is None:
            return UNLIMITED_HELD_BYTES
        return self._queue_bytes + self._bits_per_s * (self._delay_s + self._jitter_s) / 8

    async def _write(self, sink: socket.socket, line: _Line, way: Way) -> None:
        while True:
            while not line.waiting:
                line.changed.clear()
                await line.changed.wait()
            due_s, data = line.waiting[0]
            await asyncio.sleep(max(0.0, due_s - self._loop.time()))
            await self._flowing.wait()
            line.waiting.popleft()
            if not data:
                with suppress(OSError):
                    sink.shutdown(socket.SHUT_WR)
                return
            await self._loop.sock_sendall(sink, data)
            way.passed(data)
            line.held -= len(data)
            line.changed.set()


def _bound(address: tuple[str, int]) -> socket.socket:
    bound = socket.socket()
    bound.setblocking(False)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, KERNEL_BUFFER_BYTES)
    bound.bind(address)
    return bound
