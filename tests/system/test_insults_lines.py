"""What comes over the wire of a running daemon: garbage, half lines, a thief's leavings, another model, a flood."""

import random
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Final

import pytest

from onboard.virtual.terminal import Terminal
from tests.system.rig import SILENCE, cpu_s, figure, hdg, rig, sealed, speaking


@pytest.mark.alone
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
random.seed(1)
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
while True:
    select.select([port], [], [])
    os.read(port, random.choice((5, 5, 4096)))
    time.sleep(0.004)
"""


def half_a_line(k: int) -> bytes:
    return hdg(k // 2 % 3600 / 10)[9 * (k % 2) : 9 if k % 2 == 0 else None]


def test_a_second_reader_that_steals_is_told_once_and_its_end_once(tmp_path: Path) -> None:
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=150) as board:
        device, board.devices["two"].rate_hz = board.devices["one"], 40
        device.line = half_a_line
        since = speaking(board)
        # Who wins the race for a byte is the machine's matter: every other line is cut whatever the thief gets.
        device.line = lambda k: b"" if k % 4 == 0 else half_a_line(k)
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
            device.line = half_a_line
        board.until_event("lines-clean", since=since)
        board.boat_seconds(12)
        # The thief may get every byte for 3 s of the boat clock: that silence is told besides.
        of_lines = [told for told in board.told(since) if told[0] == "one"]
        assert of_lines == [("one", "lines-damaged"), ("one", "lines-clean")]
        assert board.health["compass1"].reason is None
        got = board.headings["compass1"]
        assert set(got) <= {k % 3600 / 10 for k in range(device.sent // 2 + 1)}
        board.check_no_line_lost(board.devices["two"], "compass2")
        lost = device.sent // 2 - len(got)
    figure(f"thief: {lost} of {device.sent // 2} lines lost to it; {told.text}")


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
        assert str(board.health["compass1"].reason).startswith(f"{words}: take the port of the compass")
        board.check_no_line_lost(board.devices["two"], "compass2")


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


@pytest.mark.alone
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
