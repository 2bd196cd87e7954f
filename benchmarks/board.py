"""A board without sensors: the real server, spool and keys, frames of a given size on an absolute grid.

    python -m benchmarks.board DIR [--hz 20] [--bytes 1800] [--history N] [--keys] [--plain]

First line of standard output: {"bind", "plain", "t0_ns", "period_ns", "boot_id", "key"}. Frame n ends, and is
published, at t0_ns + (n + 1) * period_ns. --history: so many of them at once, as if the board had run before. --keys:
DIR/allowed-keys says who may connect. --plain: a plain PUB socket beside the link sends the same frames, number and
bytes. The end of standard input ends the process.
"""

import argparse
import asyncio
import json
import sys
import threading
from contextlib import suppress
from pathlib import Path

import zmq

from common.boat_config import SpoolTable
from common.clock import boottime_ns
from common.codec import encode_frame
from common.framer import Identity
from common.messages import Event, Fix, Frame, RawLine
from common.units import NS_PER_S
from onboard.journal import Journal
from onboard.link.allow_list import AllowList
from onboard.link.authenticator import Zap
from onboard.link.router import Router
from onboard.link.server import Limits, Server
from onboard.spool import Spool

BOOT = "ab" * 8
LINE = "$" + "x" * 399
FIX_EACH = 20
"""A fix in each so-manieth frame, as of a receiver of 1 Hz."""


def frame_of(seq: int, t0_ns: int, period_ns: int, size: int) -> Frame:
    """Of about `size` bytes."""
    begin_ns = t0_ns + seq * period_ns
    raw = tuple(RawLine(sensor="gps1", t_ns=begin_ns, text=LINE) for _ in range(max(0, size - 180) // 438))
    return Frame(
        boat_id="b",
        boot_id=BOOT,
        seq=seq,
        clock_id="c",
        start_no=1,
        t0_ns=begin_ns,
        t1_ns=begin_ns + period_ns,
        fixes=(Fix(sensor="gps1", t_ns=begin_ns, lat_deg=50.8, lon_deg=-1.3),) if seq % FIX_EACH == 0 else (),
        raw=raw,
    )


class Board:
    """Everything but sensors."""

    def __init__(self, directory: Path, hz: float, size: int, history: int, *, keys: bool, plain: bool) -> None:
        self.period_ns = round(NS_PER_S / hz)
        self.t0_ns = (boottime_ns() // self.period_ns + 1 - history) * self.period_ns
        self.size = size
        self.seq = 0
        self.events: list[Event] = []
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.access = AllowList(directory) if keys else None
        self.zap = None if self.access is None else Zap(self.context, self.access)
        identity = Identity("b", BOOT, "c", 1)
        journal = Journal(self.events.append, boottime_ns)
        self.spool = Spool(directory / "spool", identity, SpoolTable(min_free_mib=0), journal)
        self.server = Server(
            Router(self.context, None if self.access is None else self.access.secret_key),
            self.spool,
            connected=lambda: {"boot_id": BOOT, "next_seq": self.seq, "config": {}},
            frame_period_ns=self.period_ns,
            journal=journal,
            rights=lambda key: frozenset({"read"}) if self.access is None else self.access.rights_of(key),
            limits=Limits(clients=128),
        )
        self.plain = self.context.socket(zmq.PUB) if plain else None
        if self.plain is not None:
            self.plain.bind("tcp://127.0.0.1:*")

    async def run(self) -> None:
        if self.zap is not None:
            guard = asyncio.create_task(self.zap.run())
            await self.zap.self_test()
        bind = self.server.bind("tcp://127.0.0.1:*")
        work = asyncio.create_task(self.server.run())
        ended = asyncio.Event()
        loop = asyncio.get_running_loop()
        threading.Thread(target=lambda: (sys.stdin.read(), loop.call_soon_threadsafe(ended.set)), daemon=True).start()
        plain = None if self.plain is None else self.plain.getsockopt_string(zmq.LAST_ENDPOINT)
        key = None if self.access is None else self.access.public_key.decode("ascii")
        ready = {"bind": bind, "plain": plain, "key": key, "boot_id": BOOT}
        print(json.dumps({**ready, "t0_ns": self.t0_ns, "period_ns": self.period_ns}), flush=True)
        while not ended.is_set():
            due_ns = self.t0_ns + (self.seq + 1) * self.period_ns
            with suppress(TimeoutError):
                await asyncio.wait_for(ended.wait(), max(0, due_ns - boottime_ns()) / NS_PER_S)
            if boottime_ns() >= due_ns:
                self._publish()
        work.cancel()
        if self.zap is not None:
            guard.cancel()
        self.server.close()

    def _publish(self) -> None:
        frame = frame_of(self.seq, self.t0_ns, self.period_ns, self.size)
        self.seq += 1
        self.server.publish(frame)
        if self.plain is not None:
            self.plain.send_multipart([b"%d" % frame.seq, encode_frame(frame)], zmq.NOBLOCK)
        self.events.clear()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR")
    parser.add_argument("--hz", type=float, default=20.0)
    parser.add_argument("--bytes", type=int, default=1800)
    parser.add_argument("--history", type=int, default=0)
    parser.add_argument("--keys", action="store_true")
    parser.add_argument("--plain", action="store_true")
    given = parser.parse_args()
    board = Board(given.directory, given.hz, given.bytes, given.history, keys=given.keys, plain=given.plain)
    asyncio.run(board.run())
    board.spool.close(1.0)


if __name__ == "__main__":
    main()
