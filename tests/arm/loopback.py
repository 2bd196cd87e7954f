"""The daemon on an ARM system with Debian's packages: pseudo-terminals -> `wayfix-onboard run` -> frames over ZeroMQ.

tests/arm/smoke.sh runs it inside that system, with the project installed in /mnt/app. It has no pytest and no numpy.
"""

import compileall
import importlib.util
import json
import math
import os
import platform
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tty
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import reduce
from importlib.metadata import version
from itertools import pairwise
from operator import xor
from pathlib import Path
from typing import Any

import zmq

from common import link_messages as session
from common.codec import decode_frame, encode_frame
from common.keys import KeyPair, new_keys
from common.messages import Fix, Frame
from common.versions import LINK_VERSION, SCHEMA_VERSION
from onboard.link.allow_list import AllowList

APP = Path("/mnt/app")
BITS = {"armhf": 32, "arm64": 64}
LIBRARIES = ("pyzmq", "msgpack", "pyserial", "pynmea2", "systemd-python")
FRAMES = 20
LEAST = {"fixes": 2, "headings": 8, "IMU samples": 12}
"""Of about 10, 19 and 38 fed in 20 frames: an emulator on a busy machine must not fail."""
PATIENCE_MS = 30_000

CONFIG = """\
[boat]
id = "arm"
[link]
bind = "tcp://127.0.0.1:*"
"""
PORT = """\
[[port]]
name = "{role}"
path = "{path}"
baud = 38400
[[sensor]]
id = "{role}1"
port = "{role}"
role = "{role}"
model = "{model}"
rate_hz = {rate_hz}
"""


def nmea(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n".encode("ascii")


@dataclass(frozen=True)
class Position:
    """Epoch `number` of the receiver."""

    number: int

    @property
    def utc(self) -> datetime:
        return datetime(2026, 3, 1, 23, 59, 59, tzinfo=UTC) + timedelta(milliseconds=200 * self.number)

    @property
    def data(self) -> bytes:
        clock = f"{self.utc:%H%M%S}.{self.utc.microsecond // 1000:03d}"
        place = f"50{21 + self.number / 100:08.5f},N,004{8 + self.number / 50:08.5f},W"
        return (
            nmea(f"GPGGA,{clock},{place},1,08,1.1,2.5,M,47.0,M,,0000")
            + nmea("GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5")
            + nmea(f"GPRMC,{clock},A,{place},{3 + self.number / 10:.2f},123.45,{self.utc:%d%m%y},,,A")
        )

    def fits(self, fix: Fix) -> bool:
        near = (
            (fix.lat_deg, 50 + (21 + self.number / 100) / 60),
            (fix.lon_deg, -4 - (8 + self.number / 50) / 60),
            (fix.sog_kn, 3 + self.number / 10),
        )
        exact = (fix.fix_quality, fix.fix_mode, fix.satellites, fix.hdop, fix.vdop, fix.status_valid, fix.cog_true_deg)
        return (
            all(got is not None and math.isclose(got, fed, rel_tol=0, abs_tol=1e-9) for got, fed in near)
            and exact == (1, 3, 8, 1.1, 1.5, True, 123.45)
            and fix.utc_ns == round(self.utc.timestamp() * 1000) * 1_000_000
        )


def heading_deg(number: int) -> float:
    return (3300 + 37 * number) % 3600 / 10


def imu_counts(number: int) -> tuple[int, int, int]:
    """Yaw rate, forward and starboard acceleration."""
    return 37 * number - 200, 11 * number - 100, -7 * number


def imu_line(number: int) -> bytes:
    yaw, forward, starboard = imu_counts(number)
    body = f"VER:1.9,AN0:0,AN1:0,AN2:{yaw},AN3:{forward},AN4:{starboard},AN5:-4096,IMUH:253,TOW:0"
    return f"!!!{body}***\r\n".encode("ascii")


def imu_sample(number: int) -> tuple[float, ...]:
    """What a frame must hold: deg/s and m/s^2, rounded to f32."""
    yaw, forward, starboard = imu_counts(number)
    exact = (yaw / 16.4, forward / 4096 * 9.80665, starboard / 4096 * 9.80665)
    return struct.unpack("<3f", struct.pack("<3f", *exact))


class Device:
    """A pseudo-terminal that sends one measurement every 1/rate_hz s once it was started."""

    def __init__(self, role: str, model: str, rate_hz: int) -> None:
        self.role = role
        self.rate_hz = rate_hz
        self.sent = 0
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.config = PORT.format(role=role, path=os.ttyname(self.slave), model=model, rate_hz=rate_hz)

    def feed(self, elapsed_s: float) -> None:
        while self.sent <= elapsed_s * self.rate_hz:
            os.write(self.master, self._data())
            self.sent += 1

    def _data(self) -> bytes:
        match self.role:
            case "gps":
                return Position(self.sent).data
            case "compass":
                return nmea(f"HCHDG,{heading_deg(self.sent):05.1f},,,,")
        return imu_line(self.sent)


class Daemon:
    """The console script, run by this interpreter; the log goes to a file."""

    def __init__(self, directory: Path, config: str, station: KeyPair) -> None:
        AllowList(directory).add(station.public.decode(), "arm", frozenset({"read"}))
        (directory / "boat.toml").write_text(config, encoding="utf-8")
        script, config_file = str(APP / "bin/wayfix-onboard"), str(directory / "boat.toml")
        command = [sys.executable, script, "run", config_file, "--state", str(directory)]
        self.log = directory / "log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)

    def ready(self) -> dict[str, Any]:
        """Where it listens, and its public key."""
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line, f"the daemon ended with {self.process.wait()} before it was ready"
        return dict(json.loads(line)["ready"])

    def cpu_s(self) -> float:
        fields = Path(f"/proc/{self.process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(30)


class Client:
    """A session of exactly FRAMES frames, with keys."""

    def __init__(self, ready: dict[str, Any], keys: KeyPair) -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.CURVE_SERVERKEY, ready["public_key"].encode())
        self.socket.setsockopt(zmq.CURVE_PUBLICKEY, keys.public)
        self.socket.setsockopt(zmq.CURVE_SECRETKEY, keys.secret)
        self.socket.connect(ready["bind"])
        self.frames: list[Frame] = []
        self.versions: dict[str, str] = {}
        self._received = 0
        self._renewed_s = 0.0

    def run(self) -> None:
        hello = session.pack("hello", schema=SCHEMA_VERSION, link=LINK_VERSION, client="arm")
        self.socket.send(hello)
        head, _ = self._next(PATIENCE_MS)
        assert head is not None, "no answer to hello"
        assert head["type"] == "connected", head
        self.versions = head["versions"]
        self._boot_id, self._seq = head["boot_id"], head["next_seq"]

    def take(self) -> bool:
        """Take what comes within 10 ms; False = the session is over."""
        if time.monotonic() - self._renewed_s > 0.25:
            self._renewed_s = time.monotonic()
            run = session.BoundedRun(FRAMES, len(self.frames), self._boot_id, self._seq, None)
            lease = session.Lease("a", self._boot_id, session.MAX_WINDOW, self._received, 0, (), run)
            self.socket.send(session.pack("lease", **lease.as_fields()))
        head, data = self._next(10)
        if head is None or head["type"] == "alive":
            return True
        if head["type"] == "end":
            assert head["sent"] == FRAMES, head
            return False
        assert head["type"] == "frame", head
        assert head["k"] == len(self.frames) + 1, head
        frame = decode_frame(data[0])
        assert encode_frame(frame) == data[0], "decoded and encoded again, a frame has other bytes"
        self.frames.append(frame)
        self._received, self._seq = self._received + len(data[0]), frame.seq + 1
        return True

    def _next(self, wait_ms: int) -> tuple[dict[str, Any] | None, list[bytes]]:
        if not self.socket.poll(wait_ms):
            return None, []
        head, *data = self.socket.recv_multipart()
        return session.unpack(head, 2**20), data


def talk(daemon: Daemon, client: Client, devices: list[Device]) -> float:
    """Feed from the first frame to the last, so that what was fed first must come out first; CPU seconds a frame."""
    client.run()
    give_up_s = time.monotonic() + PATIENCE_MS / 1000
    started_s = cpu_s = 0.0
    while client.take():
        now_s = time.monotonic()
        assert now_s < give_up_s, f"only {len(client.frames)} of {FRAMES} frames came"
        if not client.frames:
            continue
        if not started_s:
            started_s, cpu_s = now_s, daemon.cpu_s()
        for device in devices:
            device.feed(now_s - started_s)
    return (daemon.cpu_s() - cpu_s) / (FRAMES - 1)


def check(frames: list[Frame]) -> str:
    """Consecutive frames, and in them the first of what was fed, complete and in order."""
    assert len(frames) == FRAMES, f"{len(frames)} frames"
    for before, after in pairwise(frames):
        follows = (after.seq, after.t0_ns) == (before.seq + 1, before.t1_ns)
        assert follows, f"frame {after.seq} does not follow frame {before.seq}"
    fixes = [fix for frame in frames for fix in frame.fixes]
    headings = [heading.heading_mag_deg for frame in frames for heading in frame.headings]
    blocks = [block for frame in frames for block in frame.imu]
    samples = [row for b in blocks for row in zip(b.yaw_rate_deg_s, b.accel_fwd_m_s2, b.accel_stb_m_s2, strict=True)]
    for number, fix in enumerate(fixes):
        assert Position(number).fits(fix), f"not what was fed as {Position(number)}: {fix}"
    for number, heading in enumerate(headings):
        assert heading == heading_deg(number), f"heading {number} is {heading}, fed was {heading_deg(number)}"
    for number, sample in enumerate(samples):
        assert sample == imu_sample(number), f"IMU sample {number} is {sample}, fed was {imu_sample(number)}"
    counts = dict(zip(LEAST, (len(fixes), len(headings), len(samples)), strict=True))
    assert all(counts[what] >= least for what, least in LEAST.items()), f"{counts}, wanted at least {LEAST}"
    return ", ".join(f"{count} {what}" for what, count in counts.items())


def loopback(directory: Path) -> str:
    devices = [Device("gps", "nmea", 5), Device("compass", "nmea", 10), Device("imu", "arduimu", 20)]
    keys = new_keys()
    daemon = Daemon(directory, CONFIG + "".join(device.config for device in devices), keys)
    try:
        client = Client(daemon.ready(), keys)
        cpu_s = talk(daemon, client, devices)
        counts = check(client.frames)
        code = daemon.stop()
        assert code == 0, f"exit code {code} after SIGTERM"
        assert "Traceback" not in daemon.log.read_text(encoding="utf-8")
    except BaseException:
        daemon.process.kill()
        sys.stderr.write("".join(daemon.log.read_text(encoding="utf-8").splitlines(keepends=True)[-40:]))
        raise
    return f"{FRAMES} frames, {counts} as fed, {1000 * cpu_s:.1f} ms of emulated CPU a frame"


def main(arch: str) -> int:
    system = f"{platform.machine()}, {8 * struct.calcsize('P')} bit"
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    try:
        assert system.endswith(f"{BITS[arch]} bit"), f"not the system wanted: {system}"
        assert importlib.util.find_spec("numpy") is None, "numpy is here, so its absence is not tried"
        assert importlib.util.find_spec("systemd.journal") is not None
        for package in ("common", "onboard"):
            assert compileall.compile_dir(APP / package, quiet=1), f"{package} does not compile"
        with tempfile.TemporaryDirectory() as directory:
            result = loopback(Path(directory))
    except AssertionError as error:
        print(f"{arch} ({system}): FAILED: {error}")
        return 1
    print(f"{arch} ({system}): {result}: OK (python {platform.python_version()}, {libraries})")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
