"""Pseudo-terminals: bytes at the speed of the baud rate, stable names, and never a block."""

import os
import select
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.clock import BoatClock
from onboard.virtual.baud_pacing import SerialLine, paced, portion_bytes
from onboard.virtual.boat import VirtualBoat

NS = 1_000_000_000


def play(boat: VirtualBoat, lines: dict[str, list[SerialLine]], baud: int) -> list[dict[str, Any]]:
    """Load the boat; the records of the lines sent come into the list."""
    sent: list[dict[str, Any]] = []
    boat.start({name: iter(port) for name, port in lines.items()}, dict.fromkeys(lines, baud), sent.append)
    return sent


def run_until_out(boat: VirtualBoat, real_s: float = 5.0) -> None:
    end = time.monotonic() + real_s
    while (pause := boat.advance()) is not None and time.monotonic() < end:
        time.sleep(min(pause, 0.01))


def line(text: bytes, ready_ns: int = 0, **record: object) -> SerialLine:
    return SerialLine(ready_ns, text, record)


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[VirtualBoat]:
    boat = VirtualBoat(tmp_path, BoatClock(8.0), ("gps", "imu"))
    yield boat
    boat.close()


def read_whole(fd: int, expected: bytes) -> bytes:
    """As many bytes as expected: the kernel hands a write over in its own time."""
    data = b""
    while len(data) < len(expected) and (more := read_some(fd)):
        data += more
    return data


def hung_up(fd: int) -> bool:
    """After at most what was still on its way, the reader of a pulled adapter finds the end."""
    try:
        while read_some(fd):
            pass
    except OSError:
        return True
    return bool(select.select([fd], [], [], 0)[0])


def read_some(fd: int, wait_s: float = 0.5) -> bytes:
    ready, _, _ = select.select([fd], [], [], wait_s)
    return os.read(fd, 65536) if ready else b""


@given(st.lists(st.tuples(st.integers(0, 10**9), st.integers(1, 100)), max_size=20), st.integers(1, 64))
def test_no_byte_is_early_and_no_line_overtakes(gaps: list[tuple[int, int]], portion: int) -> None:
    ready, lines = 0, []
    for gap, length in gaps:
        ready += gap
        lines.append(SerialLine(ready, bytes(range(length)), {}))
    chunks = list(paced(lines, 4800, portion))
    assert b"".join(chunk.data for chunk in chunks) == b"".join(item.data for item in lines)
    assert [chunk.ends for chunk in chunks if chunk.ends] == lines
    assert [chunk.due_ns for chunk in chunks] == sorted(chunk.due_ns for chunk in chunks)
    assert all(len(chunk.data) <= portion for chunk in chunks)
    # Byte by byte, as the wire would carry them.
    arrivals: list[float] = []
    for item in lines:
        for k in range(len(item.data)):
            wire_ns = arrivals[-1] + 10 * NS / 4800 if arrivals else 0
            arrivals.append(max(wire_ns, item.ready_ns) if k == 0 else wire_ns)
    end = 0
    for chunk in chunks:
        end += len(chunk.data)
        assert chunk.due_ns == pytest.approx(arrivals[end - 1], abs=100)


def test_first_byte_comes_when_the_line_is_ready() -> None:
    (first, *_, last) = paced([line(b"$" + b"x" * 47, ready_ns=NS)], 4800, 16)
    assert (first.due_ns, first.data) == (NS, b"$")
    assert last.due_ns == NS + 47 * 10 * NS // 4800


def test_portions_grow_only_with_the_clock_rate() -> None:
    assert portion_bytes(38400, 1.0) == 16
    assert portion_bytes(4800, 16.0) == 16
    assert portion_bytes(38400, 16.0) == 61


def test_4800_baud_is_480_bytes_a_boat_second(boat: VirtualBoat) -> None:
    sentence = b"$GPGGA," + b"0" * 73 + b"\r\n"
    start_ns = boat.clock.now_ns() + NS // 10
    play(boat, {"gps": [line(sentence, start_ns) for _ in range(60)]}, 4800)
    fd = os.open(boat.terminals["gps"].link, os.O_RDONLY | os.O_NOCTTY)
    arrivals: list[tuple[int, int]] = []

    def reader() -> None:
        while sum(count for _, count in arrivals) < 60 * len(sentence):
            data = read_some(fd, 2.0)
            arrivals.append((boat.clock.now_ns(), len(data)))
            if not data:
                return

    thread = threading.Thread(target=reader)
    thread.start()
    run_until_out(boat)
    thread.join()
    os.close(fd)
    total = sum(count for _, count in arrivals)
    assert total == 60 * len(sentence)
    boat_s = (arrivals[-1][0] - arrivals[0][0]) / NS
    assert total / boat_s == pytest.approx(480, rel=0.1)
    # Portions of a FIFO, not of a disk; generous because the machine may be busy.
    assert sorted(count for _, count in arrivals)[len(arrivals) // 2] <= 256
    assert boat.dropped_bytes == 0


def test_nobody_reads_and_nothing_blocks(boat: VirtualBoat) -> None:
    now = boat.clock.now_ns()
    sent = play(boat, {"gps": [line(b"x" * 100, now - 10 * NS, n=n) for n in range(1000)]}, 4_000_000)
    began = time.monotonic()
    run_until_out(boat)
    assert time.monotonic() - began < 3.0
    assert boat.dropped_bytes > 50_000
    assert 0 < len(sent) < 1000
    fd = os.open(boat.terminals["gps"].link, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    held = 0
    while data := read_some(fd, 0.05):
        held += len(data)
    os.close(fd)
    assert held == 100_000 - boat.dropped_bytes


def test_bytes_pass_unchanged(boat: VirtualBoat) -> None:
    every = bytes(range(256))
    play(boat, {"imu": [line(every, boat.clock.now_ns())]}, 38400)
    fd = os.open(boat.terminals["imu"].link, os.O_RDONLY | os.O_NOCTTY)
    run_until_out(boat)
    assert read_whole(fd, every) == every
    os.close(fd)


def test_the_name_survives_unplug_and_replug(boat: VirtualBoat) -> None:
    link = boat.terminals["gps"].link
    now = boat.clock.now_ns()
    sent = play(boat, {"gps": [line(b"one\r\n", now, n=1), line(b"two\r\n", now + 2 * NS, n=2)]}, 4800)
    fd = os.open(link, os.O_RDONLY | os.O_NOCTTY)
    while not sent:
        boat.advance()
    assert read_some(fd).startswith(b"o")
    boat.unplug("gps")
    with pytest.raises(FileNotFoundError):
        os.open(link, os.O_RDONLY | os.O_NOCTTY)
    assert hung_up(fd)
    os.close(fd)
    boat.replug("gps")
    fd = os.open(link, os.O_RDONLY | os.O_NOCTTY)
    run_until_out(boat)
    assert read_whole(fd, b"two\r\n") == b"two\r\n"
    os.close(fd)
    assert sent == [{"n": 1}, {"n": 2}]


def test_an_unplugged_line_is_not_counted_as_sent(boat: VirtualBoat) -> None:
    now = boat.clock.now_ns()
    sent = play(boat, {"gps": [line(b"x" * 20, now, n=1), line(b"y" * 20, now + NS, n=2)]}, 4800)
    boat.unplug("gps")
    while boat.clock.now_ns() < now + NS // 2:
        boat.advance()
    boat.replug("gps")
    run_until_out(boat)
    assert sent == [{"n": 2}]
    assert boat.dropped_bytes == 0


def test_a_silent_device_leaves_its_port_open(boat: VirtualBoat) -> None:
    now = boat.clock.now_ns()
    play(boat, {"gps": [line(b"gps\r\n", now)], "imu": [line(b"imu\r\n", now)]}, 38400)
    fds = {name: os.open(boat.terminals[name].link, os.O_RDONLY | os.O_NOCTTY) for name in ("gps", "imu")}
    boat.silence("gps")
    run_until_out(boat)
    assert read_whole(fds["imu"], b"imu\r\n") == b"imu\r\n"
    assert read_some(fds["gps"], 0.05) == b""
    for fd in fds.values():
        os.close(fd)


def test_close_removes_the_names(tmp_path: Path) -> None:
    boat = VirtualBoat(tmp_path, BoatClock(), ("gps",))
    assert (tmp_path / "gps").is_symlink()
    boat.close()
    assert list(tmp_path.iterdir()) == []
