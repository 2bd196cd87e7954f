"""Steps of the wall clock and of a receiver's date, under a running daemon."""

import ast
import signal
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import pytest

from common.clock import boottime_ns
from common.units import NS_PER_S
from tests.system.rig import RETURN, rig, sealed, speaking

ROOT: Final = Path(__file__).parents[2]


def rmc(utc: datetime) -> bytes:
    tod, date = f"{utc:%H%M%S}.{utc.microsecond // 10_000:02d}", f"{utc:%d%m%y}"
    return sealed(f"GPRMC,{tod},A,3747.0873,S,17518.8938,E,0.69,181.39,{date},,,A")


def test_a_gnss_date_that_jumps_is_one_step_and_one_wrong_sentence_is_none(tmp_path: Path) -> None:
    start_s, shifts = time.monotonic(), [timedelta()]

    def line(_k: int) -> bytes:
        now = datetime(2026, 5, 1, 12, tzinfo=UTC) + timedelta(seconds=board.clock_rate * (time.monotonic() - start_s))
        return rmc(now + (shifts.pop() if len(shifts) > 1 else shifts[0]))

    def edit(text: str) -> str:
        return text.replace('id = "compass1"', 'id = "gps1"').replace('role = "compass"', 'role = "gps"')

    with rig(tmp_path, "gps", clock_rate=8, rate_hz=20, edit=edit) as board:
        device = board.devices["gps"]
        device.line = line
        board.until(lambda: board.frames and board.frames[-1].utc_src == "gnss")
        board.boat_seconds(2)
        since, epoch = len(board.events), board.frames[-1].clk_epoch
        for wrong in (timedelta(days=1), timedelta(hours=-3), timedelta(days=-366)):
            shifts.append(wrong)
            board.until(lambda: len(shifts) == 1)
            board.boat_seconds(4)
        assert board.told(since) == []
        assert {frame.clk_epoch for frame in board.frames} == {epoch}
        shifts[:] = [timedelta(hours=1)]
        told = board.until_event("clock-stepped", since=since)
        board.boat_seconds(8)
        assert board.told(since) == [("gps1", "clock-stepped")]
        assert float(told.evidence["step_s"] or 0) == pytest.approx(3600, abs=1)
        assert {frame.clk_epoch for frame in board.frames} == {epoch, epoch + 1}
        assert board.frames[-1].clk_epoch == epoch + 1
        board.check_grid()


STEPPING: Final = """
import atexit, collections, itertools, json, sys, time

callers = collections.Counter()
steps = itertools.cycle((0, 86_400, -86_400, 3_600))
real_time = time.time

def stepping():
    callers[sys._getframe(1).f_globals["__name__"]] += 1
    return real_time() + next(steps)

def stepping_ns():  # what logging asks from Python 3.13 on
    callers[sys._getframe(1).f_globals["__name__"]] += 1
    return int((real_time() + next(steps)) * 1e9)

time.time, time.time_ns = stepping, stepping_ns

from onboard.main import main

code = main(sys.argv[1:])
ours = [module.__file__ for name, module in sys.modules.items() if name.split(".")[0] in ("onboard", "common")]
print(json.dumps({"wall": {"callers": callers, "files": ours}}), flush=True)
sys.exit(code)
"""
MAY_READ_THE_WALL_CLOCK: Final = {"logging"}
"""The stamp of a log record; the log's own affair."""
WALL_CLOCK: Final = {"time", "time_ns", "ctime", "gmtime", "localtime", "strftime", "now", "utcnow", "today"}


def wall_clock_readings(file: str) -> list[str]:
    """Places in a file that read the wall clock of the machine."""
    found = []
    for node in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
        match node:
            case ast.Attribute(value=ast.Name(id="time" | "datetime" | "date"), attr=attr) if attr in WALL_CLOCK:
                found.append(f"{file}:{node.lineno} {attr}")
            case ast.Attribute(value=ast.Attribute(attr="datetime" | "date"), attr="now" | "utcnow" | "today"):
                found.append(f"{file}:{node.lineno} datetime")
            case ast.Attribute(attr="CLOCK_REALTIME" | "CLOCK_TAI"):
                found.append(f"{file}:{node.lineno} CLOCK_REALTIME")
            case ast.ImportFrom(module="time", names=names) if {name.name for name in names} & WALL_CLOCK:
                found.append(f"{file}:{node.lineno} from time import")
    return found


def test_the_boat_clock_does_not_follow_the_wall_clock(tmp_path: Path) -> None:
    """The wall clock of the daemon jumps by a day at every reading; nothing it sends may notice."""
    with rig(tmp_path, "one", command=(sys.executable, "-c", STEPPING)) as board:
        since = speaking(board)
        board.boat_seconds(2)
        assert abs(board.frames[-1].t1_ns - boottime_ns()) < 2 * NS_PER_S
        board.devices["one"].terminal.unplug()
        board.until_event("port-lost", since=since)
        board.devices["one"].terminal.plug()
        board.until_event("sensor-delivering", since=since)
        board.check_grid()
        assert board.told(since) == RETURN
        board.daemon.send(signal.SIGTERM)
        assert board.daemon.finish() == 0
        wall = board.daemon.said("wall")
        assert wall is not None
        assert set(wall["callers"]) <= MAY_READ_THE_WALL_CLOCK
        assert len(wall["files"]) > 30
        assert [place for file in wall["files"] for place in wall_clock_readings(file)] == []


def test_the_search_for_wall_clock_readings_finds_some(tmp_path: Path) -> None:
    texts = (
        "import time\ntime.time()",
        "import time\ntime.clock_gettime(time.CLOCK_REALTIME)",
        "from time import time_ns",
        "import datetime\ndatetime.datetime.now()",
        "from datetime import datetime\ndatetime.now()",
    )
    for number, text in enumerate(texts):
        file = tmp_path / f"{number}.py"
        file.write_text(text, encoding="utf-8")
        assert len(wall_clock_readings(str(file))) == 1
