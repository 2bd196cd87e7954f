"""A real systemd as process 1, in a container on an overlay of this machine's own root: nothing of the machine changes.

Only basic.target and what a test adds are started there, not the machine's own services. There is no network.
"""

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.debian import LIBRARIES, PACKAGES, SYSTEM_PYTHON, has_libraries
from tests.recordings import REPOSITORY

UNIT = "wayfix-onboard"
UNIT_FILE = REPOSITORY / "deploy" / f"{UNIT}.service"
INSIDE = Path(__file__).parent / "inside"
"""What is put into /opt/test of the container."""
PATIENCE_S = 30.0

TARGET = """[Unit]
Description=What the test needs and nothing else of this machine
Requires=basic.target
Wants=wayfix-onboard.service
After=basic.target
"""
FEEDER = f"[Service]\nExecStart={SYSTEM_PYTHON} /opt/test/feeder.py\n"
HANG_ON_DEMAND = "[Service]\nEnvironment=PYTHONPATH=/opt/test\n"
BOARD = """[boat]
id = "springer"
[[port]]
name = "gps"
path = "/dev/ttyUSB0"
[[port]]
name = "compass"
path = "/run/feeder/compass"
byte_budget_per_s = 2000
[[sensor]]
id = "gps1"
port = "gps"
role = "gps"
[[sensor]]
id = "compass1"
port = "compass"
role = "compass"
"""


def what_is_missing() -> str | None:
    """Why no container can be booted here, in one sentence."""
    if os.geteuid() != 0:
        return "a container with a systemd of its own needs root"
    if not shutil.which("systemd-nspawn"):
        return "systemd-nspawn is missing; apt-get install systemd-container"
    if not has_libraries((*LIBRARIES, "systemd")):
        return f"Debian's Python packages are missing; apt-get install {PACKAGES} python3-systemd"
    return None


@contextmanager
def overlay(directory: Path) -> Iterator[Path]:
    """This machine's root to write on; what is written lies in memory and is gone at the end."""
    memory, merged = directory / "memory", directory / "root"
    memory.mkdir()
    merged.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1g,mode=755", "none", memory], check=True)
    try:
        upper, work = memory / "upper", memory / "work"
        upper.mkdir()
        work.mkdir()
        options = f"lowerdir=/,upperdir={upper},workdir={work}"
        done = subprocess.run(
            ["mount", "-t", "overlay", "overlay", "-o", options, merged], capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            pytest.skip(f"this kernel mounts no overlay here ({done.stderr.strip()})")
        try:
            yield merged
        finally:
            subprocess.run(["umount", "--lazy", merged], check=False)
    finally:
        subprocess.run(["umount", "--lazy", memory], check=False)


def install(root: Path, wheel: Path) -> None:
    """The daemon as README tells to install it, its unit, and what the test adds."""
    shutil.copy(wheel, root / "opt")
    for line in (
        [SYSTEM_PYTHON, "-m", "venv", "--system-site-packages", "/opt/wayfix"],
        ["/opt/wayfix/bin/pip", "install", "--quiet", "--no-deps", "--no-index", f"/opt/{wheel.name}"],
    ):
        environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
        subprocess.run(["chroot", root, *line], check=True, env=environment, timeout=300)
    shutil.copytree(INSIDE, root / "opt" / "test")
    (root / "etc" / "wayfix").mkdir(exist_ok=True)
    (root / "etc" / "wayfix" / "boat.toml").write_text(BOARD, encoding="utf-8")
    (root / "etc" / "machine-id").write_text("", encoding="utf-8")
    units = root / "etc" / "systemd" / "system"
    shutil.copy(UNIT_FILE, units)
    (units / "wayfix-test.target").write_text(TARGET, encoding="utf-8")
    (units / "feeder.service").write_text(FEEDER, encoding="utf-8")
    (units / f"{UNIT}.service.d").mkdir()
    (units / f"{UNIT}.service.d" / "test.conf").write_text(HANG_ON_DEMAND, encoding="utf-8")


class Container:
    """A booted container and what is asked of it."""

    def __init__(self, root: Path) -> None:
        line = ["systemd-nspawn", "--quiet", "--directory", str(root), "--machine", "wayfix-test", "--register=no"]
        line += ["--keep-unit", "--private-network", "--console=pipe", "--boot", "systemd.unit=wayfix-test.target"]
        self._nspawn = subprocess.Popen(
            line, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self._init = 0

    def wait_until_booted(self) -> None:
        """Until everything its target wants is there."""
        self._init = wait_for(self._find_init, "the container's process 1")
        wait_for(lambda: self.call("systemctl", "is-system-running").stdout.strip() == "running", "the end of its boot")

    def _find_init(self) -> int | None:
        assert self._nspawn.poll() is None, self._nspawn.communicate()
        pid = self._nspawn.pid
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split():
            status = Path(f"/proc/{child}/status").read_text(encoding="ascii")
            names = dict(line.split(":\t", 1) for line in status.splitlines())
            if names["Name"] == "systemd" and names["NSpid"].split()[-1] == "1":
                return int(child)
        return None

    def call(self, *command: str, seconds: float = PATIENCE_S) -> subprocess.CompletedProcess[str]:
        """Run a command inside as root."""
        enter = ["nsenter", "-t", str(self._init), "-m", "-u", "-i", "-n", "-p", "-C", "--"]
        return subprocess.run([*enter, *command], capture_output=True, text=True, timeout=seconds, check=False)

    def show(self, name: str, unit: str = UNIT) -> str:
        """One property of a unit."""
        return self.call("systemctl", "show", unit, "--property", name, "--value").stdout.strip()

    def active_since_s(self) -> float:
        """When the daemon was last ready, on this machine's monotonic clock."""
        return int(self.show("ActiveEnterTimestampMonotonic")) / 1e6

    def signal(self, name: str) -> float:
        """Send a signal to the daemon; returns the monotonic time just before."""
        pid = self.show("MainPID")
        now_s = time.monotonic()
        assert self.call("kill", f"-{name}", pid).returncode == 0
        return now_s

    def back_after_s(self, since_s: float, restarts: int) -> float:
        """Wait until the daemon was restarted once more and is ready; returns the seconds since `since_s`."""
        wait_for(lambda: int(self.show("NRestarts")) > restarts, "a restart")
        wait_for(lambda: self.show("ActiveState") == "active", "the restarted daemon to be ready")
        return self.active_since_s() - since_s

    def probe(self) -> dict[str, Any]:
        """`connected` of the daemon, asked by a client inside."""
        done = self.call("/opt/wayfix/bin/python", "/opt/test/probe.py")
        assert done.returncode == 0, done.stderr
        return dict(json.loads(done.stdout))

    def journal(self, *matches: str) -> list[dict[str, Any]]:
        """Entries of the daemon's unit, oldest first; systemd's own about it too."""
        done = self.call("journalctl", "--unit", UNIT, "--output=json", "--no-pager", "--all", *matches)
        return [json.loads(line) for line in done.stdout.splitlines()]

    def wait_for_entry(self, right: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """The newest entry of which this is true."""
        return dict(wait_for(lambda: next((e for e in reversed(self.journal()) if right(e)), None), what))

    def power_off(self) -> None:
        """End it in any case, half booted too."""
        try:
            if self._init:
                os.kill(self._init, signal.SIGRTMIN + 4)
                self._nspawn.wait(10)
            else:
                self._nspawn.kill()
        except (ProcessLookupError, subprocess.TimeoutExpired):
            self._nspawn.kill()
        self._nspawn.wait(10)
        assert self._nspawn.stdout is not None
        self._nspawn.stdout.close()


@contextmanager
def booted(root: Path) -> Iterator[Container]:
    """A container on this root, powered off at the end."""
    container = Container(root)
    try:
        container.wait_until_booted()
        yield container
    finally:
        container.power_off()


def wait_for(ask: Callable[[], Any], what: str, seconds: float = PATIENCE_S) -> Any:
    """The first answer that is true."""
    deadline = time.monotonic() + seconds
    while not (answer := ask()):
        assert time.monotonic() < deadline, f"waited {seconds:g} s for {what}"
        time.sleep(0.05)
    return answer
