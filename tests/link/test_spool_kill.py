"""A real process that is killed while it writes, and what the disk has to take: real files, no fault is simulated."""

import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.link.spooling import filled, identity, payload, read_all, spool_at

WRITER = """
import sys, time
from pathlib import Path
from common.boat_config import SpoolTable
from tests.link.spooling import payload, spool_at
table = SpoolTable(max_mib=1000, min_free_mib=0, sync_s=float(sys.argv[3]))
spool = spool_at(Path(sys.argv[1]), int(sys.argv[2]), table=table)
for seq in range(10**9):
    spool.append(seq, payload(seq, 1200))
    if spool.synced_seq >= 0:
        sys.stdout.write(f"{spool.synced_seq}\\n")
        sys.stdout.flush()
    time.sleep(0.0005)
"""
ROOT = Path(__file__).parents[2]


def kill_at_random(directory: Path, start_no: int, draw: random.Random) -> int:
    """Start a writer, kill it, and what it had said to be durable."""
    sync_s = str(draw.choice((0.0, 0.01, 0.05)))
    command = [sys.executable, "-c", WRITER, str(directory), str(start_no), sync_s]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        time.sleep(draw.uniform(0.0, 0.25))
        process.kill()
        said = (first + process.stdout.read()).split(b"\n")[:-1]  # the last line may be cut
    return max(map(int, said), default=-1)


def kills(directory: Path, count: int, seed: int) -> None:
    draw = random.Random(seed)
    for start_no in range(1, count + 1):
        durable = kill_at_random(directory, start_no, draw)
        assert durable >= 0
        spool = spool_at(directory, 1000 + start_no)
        run = next(run for run in spool.runs() if run.start_no == start_no)
        frames, gone = read_all(spool, run.boot_id, 0, run.next_seq - 1)
        spool.close(1.0)
        assert run.next_seq > durable
        assert not gone
        assert frames == {seq: payload(seq, 1200) for seq in range(run.next_seq)}


def test_killed_twice(tmp_path: Path) -> None:
    kills(tmp_path / "spool", 2, 1)


@pytest.mark.slow
def test_killed_fifty_times(tmp_path: Path) -> None:
    kills(tmp_path / "spool", 50, 2)


@pytest.mark.alone  # on a busy machine the kernel writes pages of its own accord between two syncs
def test_bytes_written_per_byte_of_payload(tmp_path: Path) -> None:
    """As the kernel counts them. Pages are 4 KiB: one is written again with each sync, and little more than that."""
    from benchmarks.spool import write_factor, written_bytes

    before = written_bytes()
    with (tmp_path / "probe").open("wb") as stream:
        stream.write(bytes(8192))
        os.fsync(stream.fileno())
    if written_bytes() - before < 8192:
        pytest.skip("the temporary directory is no real file system: nothing is counted there")
    for per_sync in (1, 10, 50):
        bound = 1.05 * (1 + 4096 / (1235 * per_sync))
        for turn in range(3):  # what the kernel writes of its own accord only adds: the least figure is the spool's
            place = tmp_path / f"spool-{per_sync}-{turn}"
            figure = write_factor(place, frames=30 * per_sync, frame_bytes=1235, per_sync=per_sync)
            if figure <= bound:
                break
        least = 1 + 0.8 * (bound / 1.05 - 1)  # less would be frames that were never synced
        assert least <= figure <= bound, f"{per_sync} frames a sync"


def test_opening_is_quick(tmp_path: Path) -> None:
    """Of many starts only the ends are read."""
    for start_no in range(1, 4):
        filled(tmp_path / "spool", 4000, start_no, 1000)
    begin_s = time.process_time()
    spool = spool_at(tmp_path / "spool", 9)
    spent_s = time.process_time() - begin_s
    assert [run.boot_id for run in spool.runs()] == [
        *(identity(number).boot_id for number in range(1, 4)),
        identity(9).boot_id,
    ]
    assert spent_s < 0.5
    spool.close(1.0)
