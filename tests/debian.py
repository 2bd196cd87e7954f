"""Debian's own Python and its packages: the floor that the board's side must run on."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.recordings import REPOSITORY

SYSTEM_PYTHON = "/usr/bin/python3"
LIBRARIES = ("zmq", "msgpack", "serial", "pynmea2", "venv", "ensurepip")
PACKAGES = "python3-venv python3-zmq python3-msgpack python3-serial python3-nmea2"


def has_libraries(modules: Sequence[str]) -> bool:
    """True when the system's interpreter finds all of these modules."""
    if not Path(SYSTEM_PYTHON).exists():
        return False
    line = [SYSTEM_PYTHON, "-c", f"import {', '.join(modules)}"]
    return subprocess.run(line, capture_output=True, check=False).returncode == 0


def make_wheel(directory: Path) -> Path:
    """The working tree as a wheel."""
    line = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*line, "--wheel-dir", directory, REPOSITORY], check=True, timeout=300)
    return next(directory.glob("wayfix-*.whl"))
