"""The walls between the rooms hold: a contract of pyproject.toml breaks when it is violated, inside a function too."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from tests.layout.tree import REPOSITORY, Tree

PACKAGES = ("common", "onboard", "shore")
VIOLATIONS = {
    "the board's rooms: each imports only what stands below it": (
        "onboard/reading/byte_budget.py",
        "onboard.link.server",
    ),
    "the station's rooms: each imports only what stands below it": ("shore/logbook/session.py", "shore.replay.run"),
    "the logbook: writers above readers above the forms of records": (
        "shore/logbook/schemas.py",
        "shore.logbook.log_writer",
    ),
    "MCAP: the walk above the records it finds": ("shore/logbook/mcap/walk.py", "shore.logbook.mcap.scan"),
    "no circles anywhere, in whatever room": ("shore/navigation/kalman.py", "shore.navigation.filters"),
    "common: nothing outside simulation imports it": ("common/events.py", "common.simulation.scenario"),
    "onboard and shore never import each other": ("onboard/spool/system_calls.py", "shore.terminal"),
}
"""Contract -> a module and what it must not import."""


def broken_in(root: Path) -> set[str]:
    """The contracts that lint-imports calls broken in this tree."""
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    program = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"],
        cwd=root, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = done.stdout.splitlines()
    assert any(line.startswith("Contracts: ") for line in lines), done.stdout + done.stderr
    return {line.removesuffix(" BROKEN") for line in lines if line.endswith(" BROKEN")}


def test_every_wall_breaks_when_a_function_imports_through_it(tmp_path: Path) -> None:
    for package in PACKAGES:
        shutil.copytree(REPOSITORY / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(REPOSITORY / "pyproject.toml", tmp_path)
    assert broken_in(tmp_path) == set()
    tree = Tree(tmp_path)
    for path, imported in VIOLATIONS.values():
        text = (tree.root / path).read_text(encoding="utf-8")
        violation = f"\n\ndef violation() -> None:\n    import {imported}\n"
        (tree.root / path).write_text(text + violation, encoding="utf-8")
    assert broken_in(tmp_path) >= set(VIOLATIONS)
