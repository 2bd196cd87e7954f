"""The spool: bytes written per byte of payload, cost of an append, speed of reading and of opening.

python -m benchmarks.spool DIR                # some 20 s; DIR on the disk that is meant
python -m benchmarks.spool DIR --json
"""

import argparse
import json
import random
import sys
import time
from pathlib import Path
from typing import Any

from common.boat_config import SpoolTable
from common.framer import Identity
from onboard.journal import Journal
from onboard.spool import Spool

FRAME_BYTES = 1235
MANUAL = SpoolTable(max_mib=4096, min_free_mib=0, sync_s=0.0)


def written_bytes() -> int:
    """What this process made the disk write so far; 0 where the kernel does not count it."""
    try:
        lines = Path("/proc/self/io").read_text("ascii").splitlines()
    except OSError:
        return 0
    return next(int(line.split()[1]) for line in lines if line.startswith("write_bytes"))


def spool_at(directory: Path, start_no: int, table: SpoolTable = MANUAL) -> Spool:
    identity = Identity("springer", f"{start_no:016x}", "c" * 32, start_no)
    return Spool(directory, identity, table, Journal(lambda _: None, lambda: 0))


def wait_for(spool: Spool, seq: int) -> None:
    while spool.synced_seq < seq:
        time.sleep(0.0005)


def write_factor(directory: Path, *, frames: int, frame_bytes: int, per_sync: int) -> float:
    """Bytes written per byte of payload when `per_sync` frames share a sync."""
    spool = spool_at(directory, 1)
    data = random.Random(1).randbytes(frame_bytes)
    before = written_bytes()
    for first in range(0, frames, per_sync):
        with spool._state.condition:  # noqa: SLF001 - the writer gets them all at once
            for seq in range(first, first + per_sync):
                spool.append(seq, data)
        wait_for(spool, first + per_sync - 1)
    figure = (written_bytes() - before) / (frames * frame_bytes)
    spool.close(10.0)
    return figure


def append_us(directory: Path, frames: int, pace_s: float) -> list[float]:
    """Time of each append, microseconds, with a sync once a second."""
    spool = spool_at(directory, 2, SpoolTable(max_mib=4096, min_free_mib=0, sync_s=1.0))
    data = random.Random(2).randbytes(FRAME_BYTES)
    spent = []
    for seq in range(frames):
        begin_ns = time.perf_counter_ns()
        spool.append(seq, data)
        spent.append((time.perf_counter_ns() - begin_ns) / 1000)
        time.sleep(pace_s)
    spool.close(10.0)
    return sorted(spent)


def reading(directory: Path, mib: int) -> dict[str, float]:
    """Open a spool of so many MiB, read all of it, and single frames anywhere in it."""
    frames = mib * 2**20 // FRAME_BYTES
    spool = spool_at(directory, 3)
    data = random.Random(3).randbytes(FRAME_BYTES)
    for seq in range(frames):
        spool.append(seq, data)
        if seq % 2000 == 0:
            wait_for(spool, seq)
    spool.close(60.0)
    begin_s = time.perf_counter()
    spool = spool_at(directory, 4)
    open_s = time.perf_counter() - begin_s
    boot_id = spool.runs()[0].boot_id
    longest_s, count, at = 0.0, 0, 0
    begin_s = time.perf_counter()
    while at is not None and at < frames:
        call_s = time.perf_counter()
        batch = spool.read(boot_id, at, frames - 1, 65_536)
        longest_s = max(longest_s, time.perf_counter() - call_s)
        count += len(batch.frames)
        at = frames if batch.next_seq is None else batch.next_seq
    all_s = time.perf_counter() - begin_s
    draw, singles = random.Random(4), 500
    begin_s = time.perf_counter()
    for _ in range(singles):
        seq = draw.randrange(frames)
        spool.read(boot_id, seq, seq, 65_536)
    single_s = (time.perf_counter() - begin_s) / singles
    spool.close(1.0)
    return {
        "open_ms": 1000 * open_s,
        "read_mib_per_s": count * FRAME_BYTES / 2**20 / all_s,
        "longest_read_ms": 1000 * longest_s,
        "one_frame_us": 1e6 * single_s,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, metavar="DIR", help="is made, and must be empty")
    parser.add_argument("--mib", type=int, default=256, help="to read (default 256)")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    given.directory.mkdir(parents=True, exist_ok=True)
    if any(given.directory.iterdir()):
        parser.error(f"{given.directory} is not empty")
    result: dict[str, Any] = {}
    for per_sync in (1, 10, 50):
        where = given.directory / f"factor-{per_sync}"
        result[f"write_factor_{per_sync}"] = write_factor(
            where, frames=3000, frame_bytes=FRAME_BYTES, per_sync=per_sync
        )
    spent = append_us(given.directory / "append", 500, 0.01)
    result |= {"append_us_p50": spent[len(spent) // 2], "append_us_p99": spent[-len(spent) // 100]}
    result |= reading(given.directory / "read", given.mib)
    for name, value in result.items():
        print(f"{name:20} {value:10.3f}")
    if given.json:
        print(json.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
