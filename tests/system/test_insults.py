"""Insults to a running daemon on real pseudo-terminals: pulled plugs, silence, garbage, thieves, floods, clock steps.

Each is told with exactly the events it deserves, frames of the sensor resume by themselves, and the other port loses
no line. Figures that are asserted with room are printed (`pytest -s`).
"""

import ast
import fcntl
import os
import random
import signal
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from functools import reduce
from itertools import pairwise
from operator import xor
from pathlib import Path
from typing import Final

import pytest

from common.clock import boottime_ns
from common.codec import decode_frame
from common.messages import Event, Frame, SensorHealth
from common.units import NS_PER_S
from onboard.virtual.terminal import Terminal
from shore.link import Link
from tests.system.harness import Process, compass_config

RESUME_S: Final = 6.0
"""Twice what is asked (3 s): the machine of the tests is busy."""
ROOT: Final = Path(__file__).parents[2]
NOBODY: Final = 65534

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
        return str(self.terminal.link.readlink())

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

    def step(self, pause_s: float = 0.004) -> None:
        for device in self.devices.values():
            device.step()
        while (received := self._link.receive(pause_s)) is not None:
            pause_s = 0.0
            if received.frame is None:
                continue
            frame = decode_frame(received.frame)
            self.frames.append(frame)
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
        daemon = Process(*command, "run", config, "--clock-rate", f"{clock_rate:g}")
        stack.callback(daemon.end)
        link = Link(daemon.ready()["bind"])
        stack.callback(link.close)
        link.connect()
        link.run()
        yield Rig(daemon, devices, link, clock_rate)


def speaking(board: Rig) -> int:
    """Waits until all compasses deliver; returns how many events were told until then."""
    board.until_event("sensor-delivering", len(board.devices))
    return len(board.events)


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def figure(text: str) -> None:
    print(f"\n  insults: {text}")


def test_unplug_and_replug_five_times_while_another_port_goes_on(tmp_path: Path) -> None:
    resumed_s: list[float] = []
    with rig(tmp_path, "one", "two") as board:
        for outage_s in (0.05, 0.4, 0.8, 1.2, 2.2):
            since = speaking(board) if not resumed_s else len(board.events)
            board.devices["one"].terminal.unplug()
            assert "the device is gone" in board.until_event("port-lost", since=since).text
            board.boat_seconds(outage_s)
            assert board.health["compass1"].state == "missing"
            board.devices["one"].terminal.plug()
            resumed_s.append(board.until_line("compass1"))
            board.until_event("sensor-delivering", since=since)
            board.boat_seconds(0.3)
            assert board.told(since) == RETURN
        board.check_no_line_lost(board.devices["two"], "compass2")
        board.check_grid()
        assert sum("one lost" in line for line in board.daemon.err) == 5
        assert sum("one open at" in line for line in board.daemon.err) == 6
        assert sum("compass1 delivers" in line for line in board.daemon.err) == 6
    figure(f"replug: frames resume after {statistics.median(resumed_s):.2f} s (median of 5), {max(resumed_s):.2f} most")
    assert max(resumed_s) < RESUME_S


def test_a_replug_under_another_number_and_the_end_of_a_line_that_was_under_way(tmp_path: Path) -> None:
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=40) as board:
        device = board.devices["one"]
        since, before = speaking(board), device.number
        device.terminal.unplug()
        board.until_event("port-lost", since=since)
        decoys: list[tuple[int, int]] = []

        def is_taken() -> bool:
            decoys.append(os.openpty())
            return before in [os.ttyname(slave) for _, slave in decoys]

        try:
            board.until(is_taken)  # the old number is somebody else's now
            board.boat_seconds(17)  # long enough for pauses that grow without end to be seen
            device.speaks = False
            device.terminal.plug()
            assert device.number != before
            returned_ns = board.frames[-1].t1_ns
            board.until_event("port-opened", since=since)
            count = len(board.headings["compass1"])
            device.terminal.write(b"23.4,,,,*6C\r\n")
            device.speaks = True
            board.until_line("compass1")
            assert board.frames[-1].t1_ns - returned_ns < RESUME_S * NS_PER_S
            board.until_event("sensor-delivering", since=since)
            board.boat_seconds(1.5)
            assert board.told(since) == RETURN
            assert board.health["compass1"].rejected == {}
            got = board.headings["compass1"][count:]
            assert got == [(device.sent - len(got) + k) % 3600 / 10 for k in range(len(got))] or got == [
                (device.sent - 1 - len(got) + k) % 3600 / 10 for k in range(len(got))
            ]
            board.check_no_line_lost(board.devices["two"], "compass2")
        finally:
            for descriptor in (item for decoy in decoys for item in decoy):
                os.close(descriptor)


def test_an_open_but_silent_sensor_is_one_event_and_reopenings_are_none(tmp_path: Path) -> None:
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=40) as board:
        device = board.devices["one"]
        since = speaking(board)
        board.until(lambda: sum(" delivers" in line for line in board.daemon.err) == 2)
        lines = len(board.daemon.err)
        folder, path = Path(f"/proc/{board.daemon.popen.pid}/fd"), device.number
        seen = [True]

        def reopened() -> int:
            """How often the daemon has let go of the pseudo-terminal and has it again."""
            is_open = any(item.is_symlink() and links_to(item, path) for item in folder.iterdir())
            if is_open != seen[-1]:
                seen.append(is_open)
            return seen[1:].count(True)

        device.speaks = False
        began_ns = board.frames[-1].t1_ns
        told = board.until_event("sensor-silent", since=since)
        assert 3.0 <= (told.t_ns - began_ns) / NS_PER_S < 6.0
        assert "check cable" in board.daemon.wait_for_words("is silent for")
        board.until(lambda: reopened() >= 3, 30)
        silent_s = (board.frames[-1].t1_ns - began_ns) / NS_PER_S
        assert 15.0 < silent_s < 40.0  # after 3, 6 and 12 s, not every 3 s
        assert board.health["compass1"].state == "silent"
        assert "nothing received for" in str(board.health["compass1"].reason)
        device.speaks = True
        resumed_s = board.until_line("compass1") * board.clock_rate
        board.until_event("sensor-delivering", since=since)
        board.boat_seconds(4)
        assert board.told(since) == SILENCE
        board.until(lambda: len(board.daemon.err) - lines >= 2)
        assert len(board.daemon.err) - lines == 2
        board.check_no_line_lost(board.devices["two"], "compass2")
    figure(f"silence of {silent_s:.0f} s with 3 reopenings: frames resume after {resumed_s:.2f} s of the boat clock")
    assert resumed_s < RESUME_S


def links_to(item: Path, path: str) -> bool:
    try:
        return str(item.readlink()) == path
    except OSError:
        return False  # closed meanwhile


def test_a_vanished_adapter_costs_an_idle_daemon_nothing(tmp_path: Path) -> None:
    with ExitStack() as stack:
        daemons = []
        for name in ("plugged", "vanished"):
            (tmp_path / name).mkdir()
            terminals = {port: Terminal(tmp_path / name / port) for port in ("one", "two", "three")}
            for terminal in terminals.values():
                stack.callback(terminal.unplug)
            paths = {port: str(terminal.link) for port, terminal in terminals.items()}
            daemon = Process("wayfix-onboard", "run", compass_config(tmp_path / name, **paths))
            stack.callback(daemon.end)
            daemon.ready()
            daemons.append(daemon)
        terminals["one"].unplug()
        daemon.wait_for_words("one lost")
        before = [cpu_s(daemon.popen.pid) for daemon in daemons]
        time.sleep(4.0)  # measured: silent ports are opened anew, the vanished one is tried, too
        plugged, vanished = (
            100 * (cpu_s(daemon.popen.pid) - begin) / 4.0 for daemon, begin in zip(daemons, before, strict=True)
        )
        assert [line for line in daemon.err if "one" in line and "open at" not in line][1:] == []
    figure(f"idle daemon, 3 ports: {plugged:.2f} % of a core, with a vanished adapter {vanished:.2f} %")
    assert vanished <= plugged + 3.0


def test_a_wrong_baud_rate_is_one_event_that_says_so_and_its_end_is_one(tmp_path: Path) -> None:
    chance = random.Random(1)
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=40) as board:
        device = board.devices["one"]
        since = speaking(board)
        right, device.line = device.line, lambda _k: chance.randbytes(100)
        cpu, began_s = cpu_s(board.daemon.popen.pid), time.monotonic()
        told = board.until_event("sensor-silent", since=since)
        assert "none readable: wrong baud rate?" in told.text
        board.boat_seconds(14)
        used = 100 * (cpu_s(board.daemon.popen.pid) - cpu) / (time.monotonic() - began_s)
        assert "wrong baud rate" in str(board.health["compass1"].reason)
        device.line = right
        board.until_event("sensor-delivering", since=since)
        board.boat_seconds(25)  # longer than damage is remembered
        assert board.told(since) == SILENCE
        assert board.health["compass1"].reason is None
        board.check_no_line_lost(board.devices["two"], "compass2")
    figure(f"4000 bytes/s of garbage: {used:.1f} % of a core (80 frames/s)")
    assert used < 30.0


def test_half_lines_are_never_joined_to_a_wrong_value(tmp_path: Path) -> None:
    chance = random.Random(5)
    stream: list[bytes] = []
    for k in range(300):
        line = hdg(k / 10)
        match chance.choice("wwwwhtme"):
            case "w":
                stream.append(line)
            case "h":  # the beginning is lost
                stream.append(line[chance.randrange(1, len(line) - 2) :])
            case "t":  # the end is lost with its line end: the next line runs into it
                stream.append(line[: chance.randrange(1, len(line) - 2)])
            case "m":  # a hole
                begin = chance.randrange(1, len(line) - 3)
                stream.append(line[:begin] + line[chance.randrange(begin + 1, len(line) - 1) :])
            case "e":  # the end is lost, its line end is not
                stream.append(line[: chance.randrange(1, len(line) - 2)] + b"\r\n")
    stream += [b"\r\n", last := hdg(359.9)]
    whole = {hdg(k / 10).rstrip(): k / 10 for k in range(300)} | {last.rstrip(): 359.9}
    expected = [whole[line] for line in b"".join(stream).split(b"\r\n") if line in whole]
    assert 100 < len(expected) < 200
    with rig(tmp_path, "one", edit=lambda text: text.replace("2000", "100000")) as board:
        device = board.devices["one"]
        device.speaks = False
        board.until_event("client-joined")
        for piece in stream:
            cuts = sorted(chance.sample(range(len(piece) + 1), min(2, len(piece))))
            for part in (piece[: cuts[0]], piece[cuts[0] : cuts[-1]], piece[cuts[-1] :]):
                device.terminal.write(part)
                board.step(chance.choice((0.0, 0.0, 0.002, 0.01)))
        board.until(lambda: board.headings.get("compass1", [None])[-1] == 359.9)
        assert board.headings["compass1"] == expected
        board.boat_seconds(1.1)
        assert board.health["compass1"].accepted == len(expected)


THIEF: Final = """
import os, random, select, sys, time
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
while True:
    select.select([port], [], [])
    os.read(port, random.choice((5, 5, 4096)))
    time.sleep(0.004)
"""


def test_a_second_reader_that_steals_is_told_once_and_its_end_once(tmp_path: Path) -> None:
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=150) as board:
        device, board.devices["two"].rate_hz = board.devices["one"], 40
        device.line = lambda k: hdg(k // 2 % 3600 / 10)[9 * (k % 2) : 9 if k % 2 == 0 else None]
        since = speaking(board)
        thief = subprocess.Popen([sys.executable, "-c", THIEF, board.devices["one"].number])
        try:
            told = board.until_event("lines-damaged", since=since)
            board.daemon.wait_for_words("gpsd, ModemManager")
            assert sum("gpsd, ModemManager" in line for line in board.daemon.err) == 1
            board.boat_seconds(8)
            assert "second reader" in str(board.health["compass1"].reason)
        finally:
            thief.kill()
            thief.wait()
        board.until_event("lines-clean", since=since)
        board.boat_seconds(12)
        assert board.told(since) == [("one", "lines-damaged"), ("one", "lines-clean")]
        assert board.health["compass1"].reason is None
        got = board.headings["compass1"]
        assert set(got) <= {k % 3600 / 10 for k in range(device.sent // 2 + 1)}
        board.check_no_line_lost(board.devices["two"], "compass2")
        lost = device.sent // 2 - len(got)
    figure(f"thief: {lost} of {device.sent // 2} lines lost to it; {told.text}")


def test_a_port_that_another_program_holds_is_busy_and_opens_when_it_is_let_go(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "one")
    holder = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    daemon = Process("wayfix-onboard", "run", compass_config(tmp_path, one=str(terminal.link)))
    try:
        daemon.wait_for_words("one cannot be opened: busy; another program holds it")
        daemon.ready()
        os.close(holder)
        daemon.wait_for_words("one open at", RESUME_S)
        assert sum("cannot be opened" in line for line in daemon.err) == 1
        assert sum(" lost" in line for line in daemon.err) == 0
    finally:
        daemon.end()
        terminal.unplug()


def as_nobody(path: str) -> str:
    """What a plain opening of a port by another user says: nothing = it opens."""
    line = ["head", "-c", "0", path]
    return subprocess.run(line, user=NOBODY, group=NOBODY, capture_output=True, text=True, timeout=10).stderr  # noqa: PLW1510


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to become another user and to mount")
def test_another_user_cannot_open_a_port_that_the_daemon_holds(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "terminal")
    number = str(terminal.link.readlink())
    Path(number).chmod(0o666)
    port = tmp_path / "ttyUSB0"  # under /dev/pts the daemon does without TIOCEXCL, which a killed one would leave there
    port.touch()
    if subprocess.run(["mount", "--bind", number, port], capture_output=True, check=False).returncode:
        terminal.unplug()
        pytest.skip("no mount may be made here")
    daemon = None
    try:
        assert as_nobody(number) == ""
        daemon = Process("wayfix-onboard", "run", compass_config(tmp_path, one=str(port)))
        daemon.ready()
        daemon.wait_for_words("one open at")
        assert "Device or resource busy" in as_nobody(number)
        daemon.send(signal.SIGTERM)
        assert daemon.finish() == 0
        assert as_nobody(number) == ""
    finally:
        if daemon is not None:
            daemon.end()
        subprocess.run(["umount", port], check=True)
        terminal.unplug()


def test_a_sensor_that_returns_as_another_model_is_named(tmp_path: Path) -> None:
    edit = 'id = "compass1"\nport = "one"\nrole = "compass"\n'
    with rig(
        tmp_path,
        "one",
        "two",
        clock_rate=8,
        rate_hz=40,
        edit=lambda text: text.replace(edit, edit + 'model="hsc100"\n'),
    ) as board:
        device = board.devices["one"]
        since = speaking(board)
        device.terminal.unplug()
        board.until_event("port-lost", since=since)
        device.line = lambda k: sealed(f"C{k % 3600 / 10:.1f}P28.4R-12.4X55.11Y12.33Z-18.43T22.3E000")
        device.terminal.plug()
        told = board.until_event("sensor-silent", since=since)
        board.boat_seconds(25)
        assert board.told(since) == [("one", "port-lost"), ("one", "port-opened"), ("compass1", "sensor-silent")]
        words = "lines like those of compass tcm2 come; configured: compass hsc100"
        assert words in told.text
        assert board.health["compass1"].reason == words
        board.check_no_line_lost(board.devices["two"], "compass2")


def rmc(utc: datetime) -> bytes:
    tod, date = f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}", f"{utc:%d%m%y}"
    return sealed(f"GPRMC,{tod},A,3747.0873,S,17518.8938,E,0.69,181.39,{date},,,A")


def test_a_gnss_date_that_jumps_is_one_step_and_one_wrong_sentence_is_none(tmp_path: Path) -> None:
    start_s, shifts = time.monotonic(), [timedelta()]

    def line(_k: int) -> bytes:
        now = datetime(2026, 5, 1, 12, tzinfo=UTC) + timedelta(seconds=board.clock_rate * (time.monotonic() - start_s))
        return rmc(now + (shifts.pop() if len(shifts) > 1 else shifts[0]))

    def edit(text: str) -> str:
        return text.replace('id = "compass1"', 'id = "gps1"').replace('role = "compass"', 'role = "gps"')

    with rig(tmp_path, "gps", clock_rate=8, rate_hz=20, edit=edit) as board:
        device = board.devices["gps"]
        device.line = line
        board.until(lambda: board.frames and board.frames[-1].utc_src == "gnss")
        board.boat_seconds(2)
        since, epoch = len(board.events), board.frames[-1].clk_epoch
        for wrong in (timedelta(days=1), timedelta(hours=-3), timedelta(days=-366)):
            shifts.append(wrong)
            board.until(lambda: len(shifts) == 1)
            board.boat_seconds(4)
        assert board.told(since) == []
        assert {frame.clk_epoch for frame in board.frames} == {epoch}
        shifts[:] = [timedelta(hours=1)]
        told = board.until_event("clock-stepped", since=since)
        board.boat_seconds(8)
        assert board.told(since) == [("gps1", "clock-stepped")]
        assert float(told.evidence["step_s"] or 0) == pytest.approx(3600, abs=1)
        assert {frame.clk_epoch for frame in board.frames} == {epoch, epoch + 1}
        assert board.frames[-1].clk_epoch == epoch + 1
        board.check_grid()


STEPPING: Final = """
import atexit, collections, itertools, json, sys, time

callers = collections.Counter()
steps = itertools.cycle((0, 86_400, -86_400, 3_600))
real_time = time.time

def stepping():
    callers[sys._getframe(1).f_globals["__name__"]] += 1
    return real_time() + next(steps)

time.time, time.time_ns = stepping, lambda: int(stepping() * 1e9)

from onboard.main import main

code = main(sys.argv[1:])
ours = [module.__file__ for name, module in sys.modules.items() if name.split(".")[0] in ("onboard", "common")]
print(json.dumps({"wall": {"callers": callers, "files": ours}}), flush=True)
sys.exit(code)
"""
MAY_READ_THE_WALL_CLOCK: Final = {"logging"}
"""The stamp of a log record; the log's own affair."""
WALL_CLOCK: Final = {"time", "time_ns", "ctime", "gmtime", "localtime", "strftime", "now", "utcnow", "today"}


def wall_clock_readings(file: str) -> list[str]:
    """Places in a file that read the wall clock of the machine."""
    found = []
    for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
        match node:
            case ast.Attribute(value=ast.Name(id="time" | "datetime" | "date"), attr=attr) if attr in WALL_CLOCK:
                found.append(f"{file}:{node.lineno} {attr}")
            case ast.Attribute(value=ast.Attribute(attr="datetime" | "date"), attr="now" | "utcnow" | "today"):
                found.append(f"{file}:{node.lineno} datetime")
            case ast.Attribute(attr="CLOCK_REALTIME" | "CLOCK_TAI"):
                found.append(f"{file}:{node.lineno} CLOCK_REALTIME")
            case ast.ImportFrom(module="time", names=names) if {name.name for name in names} & WALL_CLOCK:
                found.append(f"{file}:{node.lineno} from time import")
    return found


def test_the_boat_clock_does_not_follow_the_wall_clock(tmp_path: Path) -> None:
    """The wall clock of the daemon jumps by a day at every reading; nothing it sends may notice."""
    with rig(tmp_path, "one", command=(sys.executable, "-c", STEPPING)) as board:
        since = speaking(board)
        board.boat_seconds(2)
        assert abs(board.frames[-1].t1_ns - boottime_ns()) < 2 * NS_PER_S
        board.devices["one"].terminal.unplug()
        board.until_event("port-lost", since=since)
        board.devices["one"].terminal.plug()
        board.until_event("sensor-delivering", since=since)
        board.check_grid()
        assert board.told(since) == RETURN
        board.daemon.send(signal.SIGTERM)
        assert board.daemon.finish() == 0
        wall = board.daemon.said("wall")
        assert wall is not None
        assert set(wall["callers"]) <= MAY_READ_THE_WALL_CLOCK
        assert len(wall["files"]) > 30
        assert [place for file in wall["files"] for place in wall_clock_readings(file)] == []


def test_the_search_for_wall_clock_readings_finds_some(tmp_path: Path) -> None:
    texts = (
        "import time\ntime.time()",
        "import time\ntime.clock_gettime(time.CLOCK_REALTIME)",
        "from time import time_ns",
        "import datetime\ndatetime.datetime.now()",
        "from datetime import datetime\ndatetime.now()",
    )
    for number, text in enumerate(texts):
        file = tmp_path / f"{number}.py"
        file.write_text(text, encoding="utf-8")
        assert len(wall_clock_readings(str(file))) == 1


class Flood(threading.Thread):
    """Writes a fixed sentence at a fixed rate until stopped, without ever waiting for the reader."""

    def __init__(self, terminal: Terminal, bytes_per_s: float) -> None:
        super().__init__(daemon=True)
        self.terminal = terminal
        self.bytes_per_s = bytes_per_s
        self.offered = self.taken = 0
        self.stopping = threading.Event()

    def run(self) -> None:
        block = hdg(111.1) * 400
        began_s = time.monotonic()
        while not self.stopping.wait(0.002):
            due = int(self.bytes_per_s * (time.monotonic() - began_s)) - self.offered
            while due > 0:
                data = block[: min(due, 4096)]
                self.offered += len(data)
                self.taken += self.terminal.write(data)
                due -= len(data)


def test_a_flood_of_a_megabyte_a_second_takes_no_line_from_the_other_port(tmp_path: Path) -> None:
    with rig(tmp_path, "one", "two") as board:
        since = speaking(board)
        board.devices["one"].speaks = False
        flood = Flood(board.devices["one"].terminal, 1.2e6)
        before, began_s = cpu_s(board.daemon.popen.pid), time.monotonic()
        flood.start()
        board.boat_seconds(2.5)
        flood.stopping.set()
        flood.join()
        spent_s = time.monotonic() - began_s
        used = 100 * (cpu_s(board.daemon.popen.pid) - before) / spent_s
        board.until_event("port-calm", since=since)
        board.devices["one"].speaks = True
        board.boat_seconds(1.5)
        assert [item for item in board.told(since) if item[0] == "one"] == [
            ("one", "port-flooded"),
            ("one", "port-calm"),
        ]
        assert board.health["compass1"].discarded_bytes > 0.5 * flood.taken
        assert board.health["compass2"].discarded_bytes == 0
        board.check_no_line_lost(board.devices["two"], "compass2")
        board.check_grid()
    figure(f"flood: {flood.offered / spent_s / 1e6:.2f} MB/s offered, {flood.taken / spent_s / 1e6:.2f} taken")
    figure(f"flood: the daemon uses {used:.1f} % of a core")
    assert flood.offered / spent_s >= 1e6
