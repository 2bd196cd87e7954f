"""A running daemon with compasses on pseudo-terminals and a client, all in the thread of the test."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import reduce
from itertools import pairwise
from operator import xor
from pathlib import Path
from typing import Final

from common.codec import decode_frame
from common.link_messages import MAX_WINDOW, BoundedRun
from common.messages import Event, Frame, SensorHealth
from common.units import NS_PER_S
from onboard.virtual.terminal import Terminal
from shore.link.link import Link, Wants
from tests.system.harness import Process, compass_config

RESUME_S: Final = 6.0
"""Twice what is asked (3 s): the machine of the tests is busy."""

RETURN: Final = [("one", "port-lost"), ("one", "port-opened"), ("compass1", "sensor-delivering")]
SILENCE: Final = [("compass1", "sensor-silent"), ("compass1", "sensor-delivering")]


def sealed(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n".encode()


def hdg(heading_deg: float) -> bytes:
    return sealed(f"HCHDG,{heading_deg:.1f},,,,")


class Device:
    """An adapter and the compass behind it, whose lines count up by 0.1 deg."""

    def __init__(self, link: Path, rate_hz: float) -> None:
        self.terminal = Terminal(link)
        self.rate_hz = rate_hz
        self.line: Callable[[int], bytes] = lambda k: hdg(k % 3600 / 10)
        self.speaks = True
        self.sent = 0
        self._due_s = time.monotonic()

    @property
    def number(self) -> str:
        return os.path.realpath(self.terminal.link)

    def step(self) -> None:
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = max(self._due_s + 1 / self.rate_hz, now_s - 1.0)
        if self.speaks and self.terminal.plugged:
            data = self.line(self.sent)
            assert self.terminal.write(data) == len(data), "nobody reads"
            self.sent += 1


class Rig:
    """A daemon, the devices on its ports, and a client that takes its frames: all in the thread of the test."""

    def __init__(self, daemon: Process, devices: dict[str, Device], link: Link, clock_rate: float) -> None:
        self.daemon = daemon
        self.devices = devices
        self.clock_rate = clock_rate
        self.frames: list[Frame] = []
        self.events: list[Event] = []
        self.headings: dict[str, list[float | None]] = {}
        self.health: dict[str, SensorHealth] = {}
        self._link = link
        connected = link.connect(wants=self._wants)
        self._next = connected["boot_id"], connected["next_seq"]

    def _wants(self) -> Wants:
        """Every frame, in order."""
        return Wants(run=BoundedRun(None, len(self.frames), *self._next, None))

    def step(self, pause_s: float = 0.004) -> None:
        for device in self.devices.values():
            device.step()
        while (received := self._link.receive(pause_s)) is not None:
            pause_s = 0.0
            if received.frame is None:
                continue
            frame = decode_frame(received.frame)
            self.frames.append(frame)
            self._next = frame.boot_id, frame.seq + 1
            self.events += frame.events
            for heading in frame.headings:
                self.headings.setdefault(heading.sensor, []).append(heading.heading_mag_deg)
            self.health |= {report.sensor: report for report in frame.health}

    def until(self, true: Callable[[], object], seconds: float = 15.0) -> float:
        """Steps until the condition holds; real seconds that took."""
        began_s = time.monotonic()
        while not true():
            assert time.monotonic() - began_s < seconds, (self.events[-8:], self.health, self.daemon.err[-8:])
            assert self.daemon.popen.poll() is None, self.daemon.err
            self.step()
        return time.monotonic() - began_s

    def boat_seconds(self, seconds: float) -> None:
        """Frames for so long on the boat clock."""
        end_ns = self.frames[-1].t1_ns + seconds * NS_PER_S
        self.until(lambda: self.frames[-1].t1_ns >= end_ns)

    def until_event(self, code: str, count: int = 1, since: int = 0) -> Event:
        self.until(lambda: sum(item.code == code for item in self.events[since:]) >= count)
        return next(item for item in reversed(self.events) if item.code == code)

    def until_line(self, sensor: str) -> float:
        """Real seconds until one more heading of the sensor has come."""
        count = len(self.headings.get(sensor, ()))
        return self.until(lambda: len(self.headings.get(sensor, ())) > count)

    def told(self, since: int) -> list[tuple[str, str]]:
        return [(item.source, item.code) for item in self.events[since:]]

    def check_no_line_lost(self, device: Device, sensor: str) -> None:
        device.speaks = False
        self.until(lambda: len(self.headings[sensor]) >= device.sent)
        assert self.headings[sensor] == [k % 3600 / 10 for k in range(device.sent)]

    def check_grid(self) -> None:
        assert all(after.t0_ns == before.t1_ns for before, after in pairwise(self.frames))
        assert [frame.seq for frame in self.frames] == list(range(self.frames[0].seq, self.frames[-1].seq + 1))


@contextmanager
def rig(
    directory: Path,
    *names: str,
    clock_rate: float = 1.0,
    rate_hz: float = 20.0,
    edit: Callable[[str], str] = str,
    command: tuple[str, ...] = ("wayfix-onboard",),
) -> Iterator[Rig]:
    """Devices speak `rate_hz` lines in a real second, once the daemon is ready; `edit` changes its configuration."""
    with ExitStack() as stack:
        devices = {name: Device(directory / name, rate_hz) for name in names}
        for device in devices.values():
            stack.callback(device.terminal.unplug)
        config = compass_config(directory, **{name: str(directory / name) for name in names})
        config.write_text(edit(config.read_text(encoding="utf-8")), encoding="utf-8")
        daemon = Process(*command, "run", "--open", config, "--clock-rate", f"{clock_rate:g}")
        stack.callback(daemon.end)
        link = Link(daemon.ready()["bind"], window=MAX_WINDOW)
        stack.callback(link.close)
        yield Rig(daemon, devices, link, clock_rate)


def speaking(board: Rig) -> int:
    """Waits until the client has joined and all compasses deliver; returns how many events were told until then."""
    expected = {("link", "client-joined")} | {
        (f"compass{k + 1}", "sensor-delivering") for k in range(len(board.devices))
    }
    board.until(lambda: expected <= set(board.told(0)))
    return len(board.events)


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def figure(text: str) -> None:
    print(f"\n  insults: {text}")
