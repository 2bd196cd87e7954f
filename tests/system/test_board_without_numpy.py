"""The board has no numpy: the daemon runs with it (and what the station needs) blocked."""

import os
import pty
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.system.harness import command, compass_config

BLOCKED = ("numpy", "scipy", "pyais", "mcap", "rich", "matplotlib", "pygeomag")
PROGRAM = f"""
import sys
for name in {BLOCKED!r}:
    sys.modules[name] = None
from onboard.main import main
sys.exit(main(sys.argv[1:]))
"""


@contextmanager
def speaking(master: int, line: bytes) -> Iterator[None]:
    """The line ten times a second."""
    over = threading.Event()

    def speak() -> None:
        while not over.wait(0.1):
            os.write(master, line)

    voice = threading.Thread(target=speak)
    voice.start()
    try:
        yield
    finally:
        over.set()
        voice.join()


def test_the_daemon_delivers_frames_with_numpy_blocked(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    config = compass_config(tmp_path, p=os.ttyname(slave))
    line = [sys.executable, "-c", PROGRAM, "run", "--open", str(config)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as daemon:
        try:
            assert daemon.stdout is not None
            ready = daemon.stdout.readline()
            assert ready.startswith('{"ready"'), daemon.communicate(timeout=5)
            address = ready.split('"bind": "')[1].split('"')[0]
            with speaking(master, b"$HCHDG,123.4,,,,*46\r\n"):  # a station takes seconds to start on a busy machine
                done = command("wayfix", "connect", "--open", address, "--no-log", "--frames", "5", "--period", "0.1")
            assert done.returncode == 0, done.stderr
            assert "compass1 delivers" in done.stderr or "compass1 delivering" in done.stderr
        finally:
            daemon.terminate()
            _, errors = daemon.communicate(timeout=5)
            os.close(master)
            os.close(slave)
    assert "Traceback" not in errors
    assert daemon.returncode == 0
