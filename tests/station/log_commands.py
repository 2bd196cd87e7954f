"""`wayfix log` as tests run it: in this process, its answer and harmed files at hand."""

import argparse
import json
from pathlib import Path
from typing import Any

import pytest

from shore.trips.arguments import add_arguments
from shore.trips.command import run
from tests.station.log_files import chunks_of


def wayfix_log(*words: object) -> int:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return run(parser.parse_args([str(word) for word in words]))


def answer(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return told


def put(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def harmed(content: bytes, *numbers: int) -> bytes:
    broken = bytearray(content)
    for number in numbers:
        at, end = chunks_of(content)[number]
        broken[(at + end) // 2] ^= 0xFF
    return bytes(broken)
