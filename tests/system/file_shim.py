"""The shim of file_shim.c: compiled, put under a command, and what it recorded."""

import os
import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Final, NamedTuple

import pytest

SOURCE: Final = Path(__file__).with_suffix(".c")
_HEAD: Final = re.compile(rb"(\w+) (\d+) (-?\d+) (\d+) ([^\t\n]*)\t([^\n]*)\n")


class Call(NamedTuple):
    """A call that changed something, or made it durable."""

    op: str
    """create, write, truncate, sync, rename, unlink or mkdir; `said`: what a test puts between them."""
    inode: int
    offset: int
    """Where a write begins; the size that a truncate leaves."""
    data: bytes
    path: str
    target: str
    """The new name of a rename."""


@cache
def library() -> Path:
    """The compiled shim; skips the test where there is no compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    made = Path(mkdtemp(prefix="wayfix-shim-")) / "shim.so"
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", str(made), str(SOURCE), "-ldl"], check=True)
    return made


def variables(root: Path, *, record: Path | None = None, fault: Path | None = None) -> dict[str, str]:
    """The environment of a command whose calls below `root` are recorded, or made to fail."""
    found = {"LD_PRELOAD": str(library()), "SHIM_ROOT": os.fspath(root)}
    found |= {} if record is None else {"SHIM_RECORD": os.fspath(record)}
    return found | ({} if fault is None else {"SHIM_FAULT": os.fspath(fault)})


def before(names: dict[str, str]) -> tuple[str, ...]:
    """The same as what stands before a command."""
    return ("env", *(f"{name}={value}" for name, value in names.items()))


def calls_in(record: Path) -> list[Call]:
    """What was recorded, in its order."""
    data, at, calls = record.read_bytes(), 0, []
    while match := _HEAD.match(data, at):
        op, inode, offset, length, path, target = match.groups()
        at = match.end() + int(length)
        content = data[match.end() : at]
        calls.append(Call(op.decode(), int(inode), int(offset), content, os.fsdecode(path), os.fsdecode(target)))
    assert at == len(data)
    return calls
