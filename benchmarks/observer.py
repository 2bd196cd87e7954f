"""The daemon seen from outside: its processor time, its memory, its frames as a client gets them."""

import json
import statistics
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zmq

from benchmarks.feeder import GPS_FIELDS, IMU_FIRST_COUNT, MODULUS, ais_number
from common import link_messages as session
from common.clock import boottime_ns
from common.codec import decode_frame
from common.messages import Frame
from common.units import STANDARD_GRAVITY_M_S2
from common.versions import LINK_VERSION, SCHEMA_VERSION

COUNTS_PER_M_S2: Final = 4096 / STANDARD_GRAVITY_M_S2


class Child:
    """A process that says JSON lines and ends with its standard input."""

    def __init__(self, *command: str, stderr: Any = None, **options: Any) -> None:
        self.name = command[0]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=stderr, text=True, **options
        )

    def line(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        text = self.process.stdout.readline()
        if not text:
            raise SystemExit(f"{self.name} ended early, exit code {self.process.wait()}")
        return dict(json.loads(text))

    def tell(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write("\n")
        self.process.stdin.flush()

    def end(self) -> None:
        try:
            self.process.communicate(timeout=5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.communicate()


@contextmanager
def child(*command: str, **options: Any) -> Iterator[Child]:
    started = Child(*command, **options)
    try:
        yield started
    finally:
        started.end()


# --- the daemon seen from outside -----------------------------------------------------------------------------------


@dataclass
class Usage:
    """Processor ticks of the daemon, of this process and of the machine at one time."""

    t_ns: int
    user: int
    system: int
    own_s: float
    busy: int
    total: int


def usage(pid: int) -> Usage:
    after_name = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    machine = [int(text) for text in Path("/proc/stat").read_text(encoding="ascii").partition("\n")[0].split()[1:9]]
    total = sum(machine)
    idle = machine[3] + machine[4]
    return Usage(boottime_ns(), int(after_name[11]), int(after_name[12]), time.process_time(), total - idle, total)


def processor_ns(pid: int) -> int:
    """Time all threads of a process have run, finer than the ticks of `usage`."""
    tasks = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(task.read_text(encoding="ascii").split()[0]) for task in tasks)


def kilobytes(pid: int, file: str, key: str) -> int:
    for line in Path(f"/proc/{pid}/{file}").read_text(encoding="ascii").splitlines():
        if line.startswith(key):
            return int(line.split()[1])
    raise SystemExit(f"/proc/PID/{file} has no {key}")


def slope_kb_h(samples: Sequence[tuple[float, int]]) -> float | None:
    """Of the last three quarters, from five samples on."""
    late = samples[len(samples) // 4 :]
    if len(late) < 5:
        return None
    return 3600.0 * statistics.linear_regression([t for t, _ in late], [kb for _, kb in late]).slope


# --- the client -----------------------------------------------------------------------------------------------------


class Numbered:
    """Times of one stream's lines by line number, from values that repeat with the stream's modulus."""

    def __init__(self, modulus: int) -> None:
        self.modulus = modulus
        self.t_ns: dict[int, int] = {}
        self._last = -1

    def add(self, value: int, t_ns: int) -> None:
        self._last += 1 + (value - self._last - 1) % self.modulus
        self.t_ns[self._last] = t_ns


class Client:
    """One station that takes every frame and notes when it came."""

    def __init__(self, address: str, names: Iterable[str]) -> None:
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.connect(address)
        self.streams = {name: Numbered(MODULUS[name.rstrip("123456789")]) for name in names}
        self.delays_ns: list[tuple[int, int]] = []
        """(t1 of the frame, from t1 to its receipt)."""
        self.frames = self.lost = self.bytes = 0
        self.accepted: dict[str, int] = {}
        self.rejected: dict[str, int] = {}
        self._seq: int | None = None
        self._send("hello", schema=SCHEMA_VERSION, link=LINK_VERSION, client="benchmark")
        header = self._receive()[0]
        if header["type"] != "connected":
            raise SystemExit("the daemon did not greet the client")
        self._boot_id = str(header["boot_id"])
        self._renewed_ns = 0

    def listen(self, until_ns: int, meanwhile: Callable[[], None] = lambda: None) -> None:
        """Take frames until that boot time."""
        while boottime_ns() < until_ns:
            self._renew()
            header, data, now_ns = self._receive()
            if header["type"] == "alive":
                continue
            if header["type"] != "frame":
                raise SystemExit(f"the daemon said {header}")
            frame = decode_frame(data)
            self.bytes += len(data)
            self.delays_ns.append((frame.t1_ns, now_ns - frame.t1_ns))
            self._note(frame)
            meanwhile()

    def _renew(self) -> None:
        now_ns = boottime_ns()
        if now_ns - self._renewed_ns > 0.25e9:
            self._renewed_ns = now_ns
            lease = session.Lease("be", self._boot_id, session.MAX_WINDOW, self.bytes, now_ns)
            self._send("lease", **lease.as_fields())

    def close(self) -> None:
        self._send("bye", session="be")
        self._socket.close(linger=200)
        self._context.term()

    def _send(self, kind: str, **fields: Any) -> None:
        self._socket.send(session.pack(kind, **fields))

    def _receive(self) -> tuple[dict[str, Any], bytes, int]:
        if not self._socket.poll(10_000):
            raise SystemExit("nothing from the daemon for 10 s")
        parts = self._socket.recv_multipart()
        now_ns = boottime_ns()
        return session.unpack(parts[0], 2**20), parts[-1], now_ns

    def _note(self, frame: Frame) -> None:
        self.frames += 1
        if self._seq is not None:
            self.lost += frame.seq - self._seq - 1
        self._seq = frame.seq
        for line in frame.raw:
            formatter = line.text[3:6]
            text = line.text.partition("*")[0].split(",")[GPS_FIELDS[formatter]]
            self.streams[formatter].add(int(text.replace(".", "")), line.t_ns)
        for block in frame.imu:
            for t_ns, accel in zip(block.sample_t_ns, block.accel_fwd_m_s2, strict=True):
                self.streams[block.sensor].add(round(-accel * COUNTS_PER_M_S2) - IMU_FIRST_COUNT, t_ns)
        for heading in frame.headings:
            if heading.sensor in self.streams and heading.heading_mag_deg is not None:
                self.streams[heading.sensor].add(round(heading.heading_mag_deg * 10), heading.t_ns)
        for message in frame.ais:
            self.streams[message.sensor].add(ais_number(message.text), message.t_ns)
        for report in frame.health:
            self.accepted[report.sensor] = report.accepted
            self.rejected[report.sensor] = sum(report.rejected.values())
