"""The unit file as systemd's own tools see it. Its behaviour is in test_systemd.py."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.service.container import UNIT_FILE

EXPOSURE = 16
"""Tenths: at most 1.6."""


@pytest.fixture(autouse=True)
def analyzer() -> None:
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd-analyze is missing; apt-get install systemd")


def test_verify_has_nothing_to_say(tmp_path: Path) -> None:
    text = UNIT_FILE.read_text(encoding="utf-8")
    program = "/opt/wayfix/bin/wayfix-onboard"
    assert text.count(program) == 1
    copy = tmp_path / UNIT_FILE.name  # verify wants the program to exist, and the unit's real name
    copy.write_text(text.replace(program, "/bin/true"), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", copy], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_its_exposure_is_low() -> None:
    line = ["systemd-analyze", "security", "--offline=yes", f"--threshold={EXPOSURE}", "--no-pager", str(UNIT_FILE)]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60)
    overall = done.stdout.splitlines()[-1:]
    print(*overall)
    assert done.returncode == 0, overall
