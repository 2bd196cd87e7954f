"""What the tests of outages share: a board that only makes frames, a station made of link and ledger alone."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from common.codec import decode_frame
from common.errors import LinkError
from shore.link.frame_ledger import Ledger
from shore.link.link import Link, Wants
from shore.logbook.log_reader import read_log
from tests.system.harness import Process, compass_config

FRAME_HZ = 20


def config_of(directory: Path) -> Path:
    """A board whose only sensor is unplugged: frames are made all the same."""
    config = compass_config(directory, compass=str(directory / "unplugged"))
    config.write_text(f"[frames]\nrate_hz = {FRAME_HZ}\n" + config.read_text(encoding="utf-8"), encoding="utf-8")
    return config


@contextmanager
def daemon_of(config: Path, *arguments: str | Path) -> Iterator[Process]:
    process = Process("wayfix-onboard", "run", "--open", config, *arguments)
    try:
        process.ready()
        yield process
    finally:
        process.end()


def place_of(daemon: Process) -> tuple[str, int]:
    host, port = daemon.ready()["bind"].removeprefix("tcp://").rsplit(":", 1)
    return host, int(port)


class LightStation(threading.Thread):
    """Link and ledger, and nothing behind them."""

    def __init__(self, address: str) -> None:
        super().__init__(daemon=True)
        self.address = address
        self.came: Counter[int] = Counter()
        self.at_s: dict[int, float] = {}
        self.missing = 0
        self.fault: Exception | None = None
        self.ledger = Ledger()
        self.over = threading.Event()

    def run(self) -> None:
        link = Link(self.address)
        try:
            greeting = link.connect(wants=lambda: Wants(missing=self.ledger.missing()))
            self._greet(greeting)
            while not self.over.is_set():
                received = link.receive(0.05)
                if received is not None and received.frame is not None:
                    self._take(received.frame)
                    if self.ledger.has_hole:
                        link.ask_soon()
                self.missing = self.ledger.missing_count
        except (LinkError, AssertionError) as error:
            self.fault = error
        finally:
            link.close()

    def _greet(self, greeting: dict[str, Any]) -> None:
        runs = [(name, first, upto) for name, _, first, upto in greeting["runs"]]
        self.ledger.greet(greeting["boot_id"], greeting["next_seq"], runs)

    def _take(self, data: bytes) -> None:
        frame = decode_frame(data)
        self.came[frame.seq] += 1
        self.at_s.setdefault(frame.seq, time.monotonic())
        self.ledger.take(frame.boot_id, frame.seq, frame.seq)

    def end(self) -> None:
        self.over.set()
        self.join(10.0)

    @property
    def newest(self) -> int:
        return max(self.at_s, default=-1)

    def check(self) -> None:
        assert self.fault is None, self.fault
        assert sorted(self.came) == list(range(min(self.came), max(self.came) + 1))
        assert set(self.came.values()) == {1}


def wait_until(true: Callable[[], bool], seconds: float) -> float | None:
    """Seconds until it was so."""
    began_s = time.monotonic()
    while not true():
        if time.monotonic() - began_s > seconds:
            return None
        time.sleep(0.01)
    return time.monotonic() - began_s


def seqs_of(directory: Path) -> list[tuple[str, int]]:
    """(boot_id, seq) of every frame in all logs, in order of the logs."""
    logs = sorted(directory.glob("*.mcap"))
    frames = (decode_frame(data) for log in logs for data in read_log(log).frames())
    return [(frame.boot_id, frame.seq) for frame in frames]


def check_whole(directory: Path) -> int:
    """No frame is missing, none is there twice; how many there are."""
    found = seqs_of(directory)
    assert len(found) == len(set(found)), "twice"
    for boot_id in {name for name, _ in found}:
        seqs = sorted(seq for name, seq in found if name == boot_id)
        assert seqs == list(range(seqs[0], seqs[-1] + 1)), boot_id
    return len(found)
