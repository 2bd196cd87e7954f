"""Ports on real pseudo-terminals; the chain behind a port with a silent reopen."""

import asyncio
import os
import pty
import threading
import time
import tty
from collections.abc import Iterator
from typing import Any

import pytest

from common.boat_config import BoatConfig, BoatTable, PortTable, SensorTable
from common.clock import BoatClock
from common.framer import Identity
from common.messages import Event
from common.units import NS_PER_S
from onboard.reading.acquisition import Acquisition
from onboard.reading.ports import Port, reason_of

Pty = tuple[int, int, str]


@pytest.fixture
def terminal() -> Iterator[Pty]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield master, slave, os.ttyname(slave)
    for descriptor in (master, slave):
        try:
            os.close(descriptor)
        except OSError:
            continue  # the test has pulled the plug


class Watched:
    """A port that notes what it is told."""

    def __init__(self, path: str) -> None:
        self.chunks: list[bytes] = []
        self.reasons: list[str | None] = []
        self.port = Port(
            PortTable(name="p", path=path), BoatClock(), lambda data, _t: self.chunks.append(data), self.reasons.append
        )

    async def until(self, true: Any, seconds: float = 5.0) -> None:
        deadline = time.monotonic() + seconds
        while not true():
            assert time.monotonic() < deadline, (self.chunks, self.reasons)
            await asyncio.sleep(0.01)


def test_a_port_reads_is_lost_once_and_idles_without_spinning(terminal: Pty) -> None:
    master, slave, path = terminal

    async def run() -> None:
        watched = Watched(path)
        task = asyncio.create_task(watched.port.run())
        await watched.until(lambda: watched.reasons == [None])
        os.write(master, b"hello\r\n")
        await watched.until(lambda: b"".join(watched.chunks) == b"hello\r\n")
        os.close(slave)
        os.close(master)
        await watched.until(lambda: watched.reasons[-1] is not None)
        used_s = time.process_time()
        await asyncio.sleep(0.5)
        assert time.process_time() - used_s < 0.25  # a vanished adapter is readable for ever
        assert watched.reasons[0] is None
        assert len(watched.reasons) <= 3  # lost, and at most one other reason while it is gone
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())


def test_an_empty_read_without_a_hang_up_is_no_loss(terminal: Pty) -> None:
    """A second reader was faster."""
    master, _, path = terminal

    async def run() -> None:
        watched = Watched(path)
        task = asyncio.create_task(watched.port.run())
        await watched.until(lambda: watched.reasons == [None])
        watched.port._readable()
        os.write(master, b"hello\r\n")
        await watched.until(lambda: b"".join(watched.chunks) == b"hello\r\n")
        assert watched.reasons == [None]
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())


def test_an_open_that_hangs_is_waited_for_once_and_does_not_hold_up_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    release, started = threading.Event(), []

    def hang(table: PortTable) -> None:
        started.append(table.name)
        release.wait(20)

    monkeypatch.setattr("onboard.reading.ports.open_serial", hang)
    monkeypatch.setattr("onboard.reading.ports.OPEN_DEADLINE_S", 0.05)
    monkeypatch.setattr("onboard.reading.ports.LAST_BACK_OFF_S", 0.05)
    monkeypatch.setattr("onboard.reading.ports.FIRST_BACK_OFF_S", 0.05)

    async def run() -> None:
        watched = Watched("/dev/none")
        task = asyncio.create_task(watched.port.run())
        await asyncio.wait_for(watched.port.tried.wait(), 5)
        await asyncio.sleep(0.5)
        assert watched.reasons == ["opening takes longer than 0.05 s"]
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    began = time.monotonic()
    asyncio.run(run())
    assert time.monotonic() - began < 5.0
    assert started == ["p"]
    release.set()


def test_reasons_are_words() -> None:
    assert reason_of(FileNotFoundError(2, "x")) == "no such device"
    assert reason_of(ValueError("odd")) == "odd"


def test_a_port_that_comes_back_at_once_delivers_when_its_first_line_comes_and_not_before() -> None:
    table, told = PortTable(name="p", path="/dev/none"), list[str]()
    sensor = SensorTable(id="compass1", port="p", role="compass")
    config = BoatConfig(boat=BoatTable(id="b"), port=(table,), sensor=(sensor,))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda item: told.append(item.code))
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    chain.chunk(b"$HCHDG,101.1,,,,*43\r\n", NS_PER_S)
    acquisition.frame(2 * NS_PER_S)
    chain.changed("the device is gone", 2 * NS_PER_S)
    chain.changed(None, 2_500_000_000)
    assert acquisition.frame(3 * NS_PER_S).health[0].state == "silent"
    assert told == ["port-opened", "sensor-delivering", "port-lost", "port-opened"]
    chain.chunk(b"$HCHDG,101.1,,,,*43\r\n", 3_100_000_000)
    assert acquisition.frame(4 * NS_PER_S).health[0].state == "delivering"
    assert told[4:] == ["sensor-delivering"]


@pytest.mark.parametrize("garbage_s", range(14, 24))
def test_lines_that_come_right_after_a_silence_full_of_garbage_are_not_called_damaged(garbage_s: int) -> None:
    table, told = PortTable(name="p", path="/dev/none"), list[str]()
    sensor = SensorTable(id="compass1", port="p", role="compass")
    config = BoatConfig(boat=BoatTable(id="b"), port=(table,), sensor=(sensor,))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda item: told.append(item.code))
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    for tick in range(1, 10 * (10 + garbage_s + 30)):
        now_ns = tick * NS_PER_S // 10
        is_right = not 10 <= tick / 10 < 10 + garbage_s
        chain.chunk(b"$HCHDG,101.1,,,,*43\r\n" if is_right else b"\xf0\x8a\xfe" * 7 + b"\r\n", now_ns)
        chain.flush(now_ns)
        acquisition.frame(now_ns)
    assert told == ["port-opened", "sensor-delivering", "sensor-silent", "sensor-delivering"]


def test_a_flood_that_leaves_no_whole_line_is_not_called_a_wrong_baud_rate() -> None:
    table, told = PortTable(name="p", path="/dev/none"), list[Event]()
    sensor = SensorTable(id="compass1", port="p", role="compass")
    config = BoatConfig(boat=BoatTable(id="b"), port=(table,), sensor=(sensor,))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, told.append)
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    block = b"$HCHDG,101.1,,,,*43" * 220  # no line ever ends
    for k in range(2000):
        chain.chunk(block[k % 21 : k % 21 + 4095], 4_000_000 * k)
        if k % 25 == 0:
            chain.flush(4_000_000 * k)
            acquisition.frame(4_000_000 * k + 1_000)
    silent = [item.text for item in told if item.code == "sensor-silent"]
    assert len(silent) == 1
    assert "more than the port's byte budget" in silent[0]


def test_a_half_line_from_before_a_silent_reopen_is_never_joined_to_a_new_one() -> None:
    sensor = SensorTable(id="imu1", port="p", role="imu", model="arduimu")
    table = PortTable(name="p", path="/dev/none")
    config = BoatConfig(boat=BoatTable(id="b"), port=(table,), sensor=(sensor,))
    acquisition = Acquisition(config, Identity("b", "0" * 16, "clock", 1), 0, 0, lambda _event: None)
    (chain,) = acquisition.chains
    chain.changed(None, 0)
    line = b"!!!VER:1.9,AN0:1,AN1:1,AN2:16,AN3:1,AN4:1,AN5:-4096,IMUH:253***\r\n"
    chain.chunk(line, NS_PER_S)
    assert chain.tally.lines == 1
    chain.chunk(line[:26], 2 * NS_PER_S)  # ... AN2:1
    assert chain.silent(9 * NS_PER_S)
    chain.reopening(9 * NS_PER_S)
    chain.chunk(line[31:], 10 * NS_PER_S)
    assert chain.tally.lines == 1
    chain.chunk(line, 11 * NS_PER_S)
    assert chain.tally.accepted == {("imu1", "ArduIMU"): 2}
