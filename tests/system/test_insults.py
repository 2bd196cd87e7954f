"""Pulled plugs, silence and other holders of a running daemon's ports, on real pseudo-terminals.

Each is told with exactly the events it deserves, frames of the sensor resume by themselves, and the other port loses
no line. Figures that are asserted with room are printed (`pytest -s`).
"""

import fcntl
import os
import signal
import statistics
import subprocess
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import pytest

from common.units import NS_PER_S
from onboard.virtual.terminal import Terminal
from tests.system.harness import Process, compass_config
from tests.system.rig import RESUME_S, RETURN, SILENCE, cpu_s, figure, rig, speaking

NOBODY: Final = 65534


@pytest.mark.alone
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
            # Consecutive up to the last ones, which are on the way: at 320 lines a second 8 take 25 ms.
            ends = [(device.sent - on_the_way) % 3600 for on_the_way in range(9)]
            assert any(got == [(end - len(got) + k) % 3600 / 10 for k in range(len(got))] for end in ends)
            board.check_no_line_lost(board.devices["two"], "compass2")
        finally:
            for descriptor in (item for decoy in decoys for item in decoy):
                os.close(descriptor)


@pytest.mark.alone
def test_an_open_but_silent_sensor_is_one_event_and_reopenings_are_none(tmp_path: Path) -> None:
    # The daemon itself says with -v when it opens a silent port anew: it is closed for 31 ms only, easily overlooked.
    with rig(tmp_path, "one", "two", clock_rate=8, rate_hz=40, command=("wayfix-onboard", "-v")) as board:
        device = board.devices["one"]
        since = speaking(board)

        def reopened() -> int:
            return sum("is opened anew" in line for line in board.daemon.err)

        def others() -> int:
            return len(board.daemon.err) - reopened()

        board.until(lambda: sum(" delivers" in line for line in board.daemon.err) == 2)
        lines = others()
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
        board.until(lambda: others() - lines >= 2)
        assert others() - lines == 2
        board.check_no_line_lost(board.devices["two"], "compass2")
    figure(f"silence of {silent_s:.0f} s with 3 reopenings: frames resume after {resumed_s:.2f} s of the boat clock")
    assert resumed_s < RESUME_S


@pytest.mark.alone
def test_a_vanished_adapter_costs_an_idle_daemon_nothing(tmp_path: Path) -> None:
    with ExitStack() as stack:
        daemons = []
        for name in ("plugged", "vanished"):
            (tmp_path / name).mkdir()
            terminals = {port: Terminal(tmp_path / name / port) for port in ("one", "two", "three")}
            for terminal in terminals.values():
                stack.callback(terminal.unplug)
            paths = {port: str(terminal.link) for port, terminal in terminals.items()}
            daemon = Process("wayfix-onboard", "run", "--open", compass_config(tmp_path / name, **paths))
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
        assert [line for line in daemon.err if " one " in line and "open at" not in line][1:] == []
    figure(f"idle daemon, 3 ports: {plugged:.2f} % of a core, with a vanished adapter {vanished:.2f} %")
    assert vanished <= plugged + 3.0


def test_a_port_that_another_program_holds_is_busy_and_opens_when_it_is_let_go(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path / "one")
    holder = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(holder, fcntl.LOCK_EX)
    daemon = Process("wayfix-onboard", "run", "--open", compass_config(tmp_path, one=str(terminal.link)))
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
    number = os.path.realpath(terminal.link)
    Path(number).chmod(0o666)
    port = tmp_path / "ttyUSB0"  # under /dev/pts the daemon does without TIOCEXCL, which a killed one would leave there
    port.touch()
    if subprocess.run(["mount", "--bind", number, port], capture_output=True, check=False).returncode:
        terminal.unplug()
        pytest.skip("no mount may be made here")
    daemon = None
    try:
        assert as_nobody(number) == ""
        daemon = Process("wayfix-onboard", "run", "--open", compass_config(tmp_path, one=str(port)))
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
