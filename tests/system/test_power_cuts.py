"""Power cuts in every state that a file system may leave: no synced frame is lost, and no boat is a new one.

pytest -m slow tests/system/test_power_cuts.py -s      # 150 states each; WAYFIX_STATES=1500 makes more
"""

import os
import subprocess
import sys
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from common.codec import decode_frame
from common.errors import WayfixError
from onboard.spool.segment_format import name_of
from onboard.start_counter import count_start
from shore.live.cursor import Cursor
from shore.logbook.log_reader import read_log
from tests.link.spooling import read_all, spool_at
from tests.system.crash_states import states
from tests.system.file_shim import Call, before, calls_in, variables
from tests.system.harness import Process

pytestmark = pytest.mark.slow

STATES = int(os.environ.get("WAYFIX_STATES", "150"))
BOAT = (
    '[boat]\nid = "cut"\n[frames]\nrate_hz = 20\n[spool]\nsync_s = 0.2\n[[port]]\nname = "g"\npath = "/dev/ttyNONE"\n'
)
SENSOR = '[[sensor]]\nid = "gps1"\nport = "g"\nrole = "gps"\n'
WRITER = """
import sys, time
from pathlib import Path
from common.boat_config import SpoolTable
from onboard.start_counter import count_start
from tests.link.spooling import payload, spool_at
state = Path(sys.argv[1])
number = count_start(state).number
spool = spool_at(state / "spool", number, table=SpoolTable(max_mib=3, min_free_mib=0, sync_s=0.05))
said = -1
for seq in range(int(sys.argv[2])):
    spool.append(seq, payload(seq, 9000))
    time.sleep(0.003)
    if spool.synced_seq > said:
        said = spool.synced_seq
        with open(sys.argv[4], "ab", buffering=0) as record:
            record.write(b"said %d %d 0 \\t\\n" % (number, said))
if sys.argv[3] == "close":
    spool.close(5.0)
"""
ROOT = Path(__file__).parents[2]


def write_spool(state: Path, record: Path, frames: int, end: str) -> None:
    environment = {**os.environ, **variables(state, record=record), "PYTHONPATH": str(ROOT)}
    subprocess.run(
        [sys.executable, "-c", WRITER, str(state), str(frames), end, str(record)], env=environment, check=True
    )


def durable_frames(calls: list[Call]) -> dict[int, range]:
    """By number of the start: the frames that the spool had called durable, without those it had removed."""
    said = {call.inode: call.offset for call in calls if call.op == "said"}
    there: dict[int, set[int]] = {}
    for call in calls:
        name = name_of(Path(call.path).name)
        if call.op == "create" and name is not None:
            there.setdefault(name.number, set()).add(name.first_seq)
        elif call.op == "unlink" and name is not None:
            there[name.number].remove(name.first_seq)
    return {number: range(min(firsts), said.get(number, -1) + 1) for number, firsts in there.items() if firsts}


def test_the_board_loses_no_synced_frame(tmp_path: Path) -> None:
    board, record = tmp_path / "state", tmp_path / "record"
    board.mkdir()
    for frames, end in ((250, "die"), (300, "close"), (120, "die")):
        write_spool(board, record, frames, end)
    calls = calls_in(record)
    assert sum(call.op == "unlink" for call in calls) > 1
    checked, sure = Counter[str](), 0
    for turn, each in enumerate(states(calls, STATES, seed=1)):
        place = each.put(board, tmp_path / f"s{turn}")
        wanted = durable_frames(calls[: each.after])
        start = count_start(place)
        spool = spool_at(place / "spool", start.number)
        runs = {run.start_no: run for run in spool.runs()}
        assert all(number <= start.number for number in runs), each.kind
        assert len(runs) == len(spool.runs()), "a number of a start was given twice"
        for start_no, numbers in wanted.items():
            held = runs.get(start_no)
            found, _ = ({}, set()) if held is None else read_all(spool, held.boot_id, held.first_seq, held.next_seq - 1)
            lost = set(numbers) - found.keys()
            assert not lost, (each.kind, each.after, start_no, sorted(lost)[:5])
            sure += len(numbers)
        spool.close(5.0)
        checked[each.kind] += 1
    print(f"\n  board: {checked.total()} states {dict(checked)}, {sure} synced frames looked for, none lost")
    assert checked.total() > 0.5 * STATES
    assert sure > 5_000


def connected(address: str, logs: Path, record: Path, seconds: float, *, kill: bool) -> None:
    """A station for so long, recorded."""
    shim = before(variables(logs, record=record))
    station = Process("wayfix", "connect", "--open", address, "--log", logs, "--filters", "kf", inside=shim)
    try:
        station.wait_for_words(" missing")
        time.sleep(seconds)
        station.popen.kill() if kill else station.popen.terminate()
        station.finish()
    finally:
        station.end()


def held_in(logs: Path) -> dict[str, set[int]]:
    """The frames in all logs of a directory, by boot_id."""
    found: dict[str, set[int]] = {}
    for log in logs.glob("*.mcap"):
        with suppress(WayfixError):  # an empty one
            for data in read_log(log).frames():
                frame = decode_frame(data)
                found.setdefault(frame.boot_id, set()).update(range(frame.first, frame.seq + 1))
    return found


def test_the_station_takes_no_boat_for_a_new_one_and_claims_no_frame_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "boat.toml").write_text(BOAT + SENSOR)
    logs, record = tmp_path / "logs", tmp_path / "record"
    logs.mkdir()
    place = ("--state", tmp_path / "state", "--runtime", tmp_path / "run", "--bind", "tcp://127.0.0.1:*")
    daemon = Process("wayfix-onboard", "run", "--open", *place, tmp_path / "boat.toml")
    try:
        address = daemon.ready()["bind"].removeprefix("tcp://")
        boot_id = daemon.said("ready")["boot_id"]  # type: ignore[index]
        for seconds, kill in ((3.0, False), (2.5, True), (3.0, False)) * (1 + STATES // 300):
            connected(address, logs, record, seconds, kill=kill)
            time.sleep(0.5)
    finally:
        daemon.end()
    calls = calls_in(record)
    checked, known, kept = Counter[str](), 0, 0
    met = min(held_in(logs)[boot_id])
    for number, each in enumerate(states(calls, STATES, seed=2)):
        found = each.put(logs, tmp_path / f"s{number}")
        said: list[str] = []
        cursor = Cursor(found, "cut", said.append)
        cursor.close()
        ledger, held = cursor.ledger, held_in(found)
        starts = {start["boot_id"]: start for start in ledger.as_record()}
        if boot_id in held:
            known += 1
            assert boot_id in starts, (each.kind, each.after, said)
            # Every frame since the station met the boat is here or will be asked for.
            assert starts[boot_id]["first"] <= met, (each.kind, each.after, said)
        claimed = {seq for first, last in starts.get(boot_id, {}).get("seen", ()) for seq in range(first, last + 1)}
        assert claimed <= held.get(boot_id, set()), (each.kind, each.after, said)
        kept += len(claimed)
        checked[each.kind] += 1
    print(f"\n  station: {checked.total()} states {dict(checked)}, the boat known in {known}, {kept} frames claimed")
    assert known > 0.5 * checked.total()
