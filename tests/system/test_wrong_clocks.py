"""A board without a battery clock, and a laptop three hours off: what is stored is right all the same."""

import csv
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import pytest

from common.codec import decode_frame
from common.messages import Frame
from onboard.virtual.terminal import Terminal
from shore.logbook.log_reader import read_log
from tests.system.harness import Process, command
from tests.system.rig import sealed

pytestmark = pytest.mark.slow

BEFORE_GNSS_S, AFTER_S = 5.0, 6.0
BOARD_IN_1970 = """
import sys, time
began_s = time.monotonic()
time.time = lambda: time.monotonic() - began_s
time.time_ns = lambda: int(time.time() * 1e9)
from onboard.main import main
sys.exit(main())
"""
LAPTOP_AHEAD = """
import sys, time
right = time.time_ns
time.time_ns = lambda: right() + 3 * 3600 * 10**9
time.time = lambda: time.time_ns() / 1e9
from shore.main import main
sys.exit(main())
"""


@contextmanager
def receiver(link: Path, first_fix_s: float) -> Iterator[None]:
    """A GPS at 1 Hz that knows neither place nor date until then."""
    terminal, over = Terminal(link), threading.Event()

    def speak() -> None:
        began_s = time.monotonic()
        while not over.wait(1.0 - time.time() % 1.0):
            now = datetime.now(UTC)
            place = "5045.7220,N,00117.2800,W"
            if time.monotonic() - began_s < first_fix_s:
                lines = sealed("GPGGA,,,,,,0,00,,,M,,M,,") + sealed("GPRMC,,V,,,,,,,,,,N")
            else:
                lines = sealed(f"GPGGA,{now:%H%M%S}.00,{place},1,08,1.0,5.0,M,47.0,M,,") + sealed(
                    f"GPRMC,{now:%H%M%S}.00,A,{place},0.0,0.0,{now:%d%m%y},,,A"
                )
            terminal.write(lines)

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(3.0)
        terminal.unplug()


def frames_of(directory: Path) -> list[tuple[bytes, Frame]]:
    (log,) = directory.glob("*.mcap")
    return [(data, decode_frame(data)) for data in read_log(log).frames()]


def exported(directory: Path) -> dict[str, tuple[str, str, str]]:
    """UTC and place of each fix, by its boat time."""
    (log,) = directory.glob("*.mcap")
    out = directory / "fixes.csv"
    done = command("wayfix", "export", log, out, "--to", "csv", "--filter", "raw")
    assert done.returncode == 0, done.stderr
    with out.open(newline="", encoding="utf-8") as file:
        return {row["t_ns"]: (row["utc"], row["lat_deg"], row["lon_deg"]) for row in csv.DictReader(file)}


def test_board_in_1970_and_a_laptop_three_hours_ahead(tmp_path: Path) -> None:
    config = tmp_path / "boat.toml"
    config.write_text(
        f'[boat]\nid = "b"\n[link]\nbind = "tcp://127.0.0.1:*"\n[[port]]\nname = "gps"\npath = "{tmp_path / "gps"}"\n'
        '[[sensor]]\nid = "gps1"\nport = "gps"\nrole = "gps"\nlatency_ms = 0\n',
        encoding="utf-8",
    )
    with ExitStack() as stack:
        stack.enter_context(receiver(tmp_path / "gps", BEFORE_GNSS_S))
        daemon = Process("python", "-c", BOARD_IN_1970, "run", "--open", config, "--state", tmp_path / "state")
        stack.callback(daemon.end)
        bind = daemon.ready()["bind"]
        stations = [
            Process("wayfix", "connect", "--open", bind, "--log", tmp_path / "right"),
            Process("python", "-c", LAPTOP_AHEAD, "connect", "--open", bind, "--log", tmp_path / "ahead"),
        ]
        for process in stations:
            stack.callback(process.end)
            process.wait_for_words(" 0 missing", 20.0)
        offset_ns = time.time_ns() - time.clock_gettime_ns(time.CLOCK_BOOTTIME)
        time.sleep(BEFORE_GNSS_S + AFTER_S)
        for process in stations:
            process.send(signal.SIGINT)
            assert process.finish() == 0, process.err

    right, ahead = frames_of(tmp_path / "right"), frames_of(tmp_path / "ahead")
    common = {frame.seq for _, frame in right} & {frame.seq for _, frame in ahead}
    assert len(common) > 10 * AFTER_S
    assert [data for data, frame in right if frame.seq in common] == [
        data for data, frame in ahead if frame.seq in common
    ]
    frames = [frame for _, frame in right]
    assert all(after.t0_ns == before.t1_ns and after.seq == before.seq + 1 for before, after in pairwise(frames))
    assert frames[0].utc_ns is None
    dated = [(frame.utc_ns, frame.t0_ns) for frame in frames if frame.utc_ns is not None]
    assert len(dated) > 10
    assert max(abs(utc_ns - t0_ns - offset_ns) for utc_ns, t0_ns in dated) < 1e9

    rows = [exported(tmp_path / name) for name in ("right", "ahead")]
    both = rows[0].keys() & rows[1].keys()
    assert len(both) > AFTER_S / 2
    assert all(rows[0][key] == rows[1][key] for key in both)
