"""Each call on a file fails once, on the board and ashore: all goes on, and nothing is lost that is not said.

pytest -m slow tests/system/test_disk_faults.py -s     # a quarter of all; WAYFIX_FAULTS=all makes each
"""

import errno
import os
import random
import signal
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import NamedTuple

import pytest

from common.codec import decode_frame
from shore.logbook.log_reader import read_log
from tests.link.spooling import read_all, spool_at
from tests.system.file_shim import before, variables
from tests.system.harness import Process, command

pytestmark = pytest.mark.slow

BOAT = """[boat]
id = "faults"
[frames]
rate_hz = 20
[[port]]
name = "g"
path = "/dev/ttyNONE"
[[sensor]]
id = "gps1"
port = "g"
role = "gps"
"""
CALLS = ("open", "write", "fsync", "fdatasync", "rename", "unlink", "ftruncate")
ERRORS = {"EIO": errno.EIO, "ENOSPC": errno.ENOSPC, "EINTR": errno.EINTR, "short": 0}
MOMENTS = ("at the start", "on the way", "at the end")
AT_ONCE = 6


class Fault(NamedTuple):
    """A call that fails once."""

    call: str
    error: str
    moment: str

    def arm(self, file: Path) -> None:
        file.write_text(f"{self.call} {ERRORS[self.error]} 0")


def faults(seed: int) -> list[Fault]:
    """All of them, or a quarter."""
    every = [Fault(*each) for each in product(CALLS, ERRORS, MOMENTS) if each[1] != "short" or each[0] == "write"]
    return every if os.environ.get("WAYFIX_FAULTS") == "all" else random.Random(seed).sample(every, len(every) // 4)


def run_through(fault: Fault, control: Path, process: Process, seconds: float) -> bool:
    """Arm it in time, and end the process; whether such a call came."""
    time.sleep(seconds / 2)
    if fault.moment == "on the way":
        fault.arm(control)
    time.sleep(seconds / 2)
    if fault.moment == "at the end":
        fault.arm(control)
    process.send(signal.SIGTERM)
    codes = {0, 1, 2} if fault.moment == "at the start" else {0, 1}  # who starts may refuse, with a sentence
    assert process.finish() in codes, (fault, process.err)
    assert "Traceback" not in "\n".join(process.err), (fault, process.err)
    return not control.read_text()


@contextmanager
def daemon(place: Path, *, inside: tuple[str, ...] = ()) -> Iterator[Process]:
    place.mkdir(parents=True, exist_ok=True)
    (place / "boat.toml").write_text(BOAT)
    where = ("--state", place / "state", "--runtime", place / "run", "--bind", "tcp://127.0.0.1:*")
    process = Process("wayfix-onboard", "run", "--open", *where, place / "boat.toml", inside=inside)
    try:
        yield process
    finally:
        process.end()


def on_board(fault: Fault, place: Path) -> bool:
    control, state = place / "control", place / "state"
    state.mkdir(parents=True)
    control.write_text("")
    if fault.moment == "at the start":
        fault.arm(control)
    with daemon(place, inside=before(variables(state, fault=control))) as process:
        process.ready()
        came = run_through(fault, control, process, 3.0)
    spool = spool_at(state / "spool", 1000)
    (run,) = [run for run in spool.runs() if run.start_no < 1000]
    found, _ = read_all(spool, run.boot_id, 0, run.next_seq - 1)
    spool.close(5.0)
    assert run.next_seq > 50, (fault, process.err)
    lost = set(range(run.next_seq)) - found.keys()
    is_said = any("stored" in line or "spool" in line for line in process.err)
    assert not lost or is_said, (fault, sorted(lost), process.err)
    with daemon(place) as process:  # the next start finds all in order
        process.ready()
        assert not any("mended" in line or "damaged" in line for line in process.err), (fault, process.err)
    return came


def ashore(fault: Fault, place: Path, address: str) -> bool:
    control, logs = place / "control", place / "logs"
    logs.mkdir(parents=True)
    control.write_text("")
    if fault.moment == "at the start":
        fault.arm(control)
    inside = before(variables(logs, fault=control))
    process = Process("wayfix", "connect", "--open", address, "--log", logs, "--filters", "kf", inside=inside)
    try:
        came = run_through(fault, control, process, 3.0)
    finally:
        process.end()
    again = Process("wayfix", "connect", "--open", address, "--log", logs, "--filters", "kf")
    try:
        again.wait_for_words(" 0 missing", 20.0)
        time.sleep(0.5)
        again.send(signal.SIGTERM)
        assert again.finish() == 0, (fault, again.err)
    finally:
        again.end()
    checked = [command("wayfix", "log", "info", log) for log in logs.glob("*.mcap")]
    assert all("Traceback" not in each.stderr for each in checked), (fault, checked)
    frames = [decode_frame(data) for log in logs.glob("*.mcap") for data in read_log(log).frames()]
    numbers = [seq for frame in frames for seq in range(frame.first, frame.seq + 1)]
    whole = set(range(min(numbers), max(numbers) + 1)) == set(numbers)
    is_said = any("log" in line and ("ended" in line or "cannot" in line or "stored" in line) for line in process.err)
    assert whole or is_said, (fault, process.err, again.err)
    return came


def check(each: Callable[[Fault, int], bool], seed: int) -> None:
    cases = faults(seed)
    wrong: list[str] = []

    def tried(fault: Fault, number: int) -> bool:
        try:
            return each(fault, number)
        except Exception as error:
            wrong.append(f"{fault}: {type(error).__name__}: {error}"[:1500])
            return False

    with ThreadPoolExecutor(AT_ONCE) as pool:
        came = list(pool.map(tried, cases, range(len(cases))))
    assert not wrong, "\n\n".join(wrong)
    print(f"\n  {len(cases)} faults, {sum(came)} of them met such a call; all went on")
    for call in CALLS:
        met = [
            f"{case.error} {case.moment}" for case, did in zip(cases, came, strict=True) if did and case.call == call
        ]
        print(f"    {call}: {', '.join(met) or 'none'}")
    assert sum(came) >= len(cases) // 4


def test_on_board(tmp_path: Path) -> None:
    check(lambda fault, number: on_board(fault, tmp_path / f"{number}"), seed=1)


def test_ashore(tmp_path: Path) -> None:
    with daemon(tmp_path / "board") as process:
        address = process.ready()["bind"].removeprefix("tcp://")
        check(lambda fault, number: ashore(fault, tmp_path / f"{number}", address), seed=2)
