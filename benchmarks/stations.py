"""Stations for the link's benchmark and tests: one that keeps times and gaps, a crowd of small ones, a plain SUB.

    python -m benchmarks.stations ADDRESS   # one small station, which says each second how many frames came

All know when frame n was made: at t0_ns + (n + 1) * period_ns (benchmarks.board).
"""

import json
import sys
import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Final

import zmq

from common import link_messages as session
from common.clock import boottime_ns
from common.codec import decode_frame
from common.link_messages import Lease
from common.units import NS_PER_S
from shore.link.frame_ledger import Ledger
from shore.link.link import Link, Wants
from shore.link.transport import LinkKeys

RENEW_NS: Final = int(session.RENEW_S * NS_PER_S)


@dataclass(frozen=True, slots=True)
class Arrival:
    """One frame."""

    t_s: float
    """On the boat clock, which is this machine's."""
    seq: int
    late_s: float
    is_newest: bool
    """No later one was here before."""


class Listener(ABC):
    """Arrivals, gathered in a thread of its own; `stop` it."""

    def __init__(self, ready: dict[str, Any]) -> None:
        self.arrivals: list[Arrival] = []
        self._ready = ready
        self._newest = -1
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, daemon=True)

    def start(self) -> "Listener":
        self._thread.start()
        return self

    def stop(self) -> None:
        self._stop.set()
        self._thread.join(10)

    def lost(self, first: int, last: int) -> int:
        """How many of these frames have not come."""
        return last - first + 1 - len({item.seq for item in self.arrivals if first <= item.seq <= last})

    def live_ms(self, begin_s: float, end_s: float) -> list[tuple[float, float]]:
        """(time of arrival in s, age in ms) of each frame that was the newest."""
        return [
            (item.t_s, item.late_s * 1000) for item in self.arrivals if item.is_newest and begin_s <= item.t_s < end_s
        ]

    def _came(self, seq: int) -> None:
        now_ns = boottime_ns()
        made_ns = self._ready["t0_ns"] + (seq + 1) * self._ready["period_ns"]
        item = Arrival(now_ns / NS_PER_S, seq, (now_ns - made_ns) / NS_PER_S, seq > self._newest)
        self._newest = max(self._newest, seq)
        self.arrivals.append(item)

    @abstractmethod
    def _work(self) -> None:
        """Take frames until stopped."""


class Station(Listener):
    """Our own link and ledger; no log and no filter."""

    def __init__(self, address: str, ready: dict[str, Any], keys: LinkKeys | None = None) -> None:
        super().__init__(ready)
        self._link = Link(address, keys=keys)
        self._ledger = Ledger()
        greeting = self._link.connect(wants=lambda: Wants(self._ledger.missing()))
        self._ledger.greet(greeting["boot_id"], greeting["next_seq"], [])

    @property
    def missing(self) -> int:
        return self._ledger.missing_count

    def _work(self) -> None:
        while not self._stop.is_set():
            received = self._link.receive(0.05)
            if received is None or received.frame is None:
                continue
            frame = decode_frame(received.frame)
            if self._ledger.take(frame.boot_id, frame.seq, frame.seq):
                self._came(frame.seq)
            if self._ledger.has_hole:
                self._link.ask_soon()
        self._link.close()


class PlainSub(Listener):
    """What ZeroMQ does by itself."""

    def __init__(self, address: str, ready: dict[str, Any]) -> None:
        super().__init__(ready)
        self._address = address

    def _work(self) -> None:
        with zmq.Context() as context, context.socket(zmq.SUB) as sub:
            sub.setsockopt(zmq.LINGER, 0)
            sub.setsockopt(zmq.SUBSCRIBE, b"")
            sub.connect(self._address)
            while not self._stop.is_set():
                if sub.poll(50):
                    self._came(int(sub.recv_multipart()[0]))


class Small:
    """A client without ledger: takes what comes, and says that it came."""

    def __init__(
        self, context: "zmq.Context[zmq.Socket[bytes]]", address: str, name: str, keys: LinkKeys | None
    ) -> None:
        self.name = name
        self.socket = context.socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        if keys is not None:
            self.socket.curve_serverkey = keys.boat
            self.socket.curve_publickey, self.socket.curve_secretkey = keys.public, keys.secret
        self.socket.connect(address)
        self.frames = 0
        self.received = 0
        self._due_ns = 0
        self._told = 0

    def renew(self, boot_id: str) -> None:
        now_ns = boottime_ns()
        if now_ns >= self._due_ns or self.received - self._told > session.WINDOW_BYTES // 2:
            lease = Lease(self.name, boot_id, session.WINDOW_BYTES, self.received, now_ns)
            self.socket.send(session.pack("lease", client=self.name, **lease.as_fields()), zmq.NOBLOCK)
            self._due_ns, self._told = now_ns + RENEW_NS, self.received

    def take(self) -> None:
        while True:
            try:
                parts = self.socket.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                return
            if len(parts) == 2:
                self.frames += 1
                self.received += len(parts[1])


def crowd(clients: list[Small], boot_id: str, seconds: float) -> None:
    """All of them listen for so long, in this thread."""
    poller = zmq.Poller()
    by_socket = {client.socket: client for client in clients}
    for client in clients:
        poller.register(client.socket, zmq.POLLIN)
    end_ns = boottime_ns() + round(seconds * NS_PER_S)
    while boottime_ns() < end_ns:
        for socket, _ in poller.poll(50):
            by_socket[socket].take()
        for client in clients:
            client.renew(boot_id)


def main() -> None:
    with zmq.Context() as context:
        client = Small(context, sys.argv[1], "f00d", None)
        while True:
            crowd([client], "0", 1.0)
            print(json.dumps({"frames": client.frames}), flush=True)


if __name__ == "__main__":
    main()
