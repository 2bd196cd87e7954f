"""The board's own troubles: killed, restarted, a card that hangs or is full; and a bounded run over a cut."""

import os
import random
import signal
import statistics
import subprocess
import time
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from common.codec import decode_frame
from shore.logbook.log_reader import read_log
from tests.link.relay import Relay
from tests.system.harness import Process, command, station
from tests.system.outages import (
    FRAME_HZ,
    LightStation,
    check_whole,
    config_of,
    daemon_of,
    place_of,
    seqs_of,
    wait_until,
)

pytestmark = pytest.mark.slow

KILLS = 50
FILLED_S = 60.0
STALLED = """
import os, sys, time
def stalled(fd, sync):
    time.sleep(0.5)
    sync(fd)
os.fsync, os.fdatasync = (lambda fd, sync=sync: stalled(fd, sync) for sync in (os.fsync, os.fdatasync))
from onboard.main import main
sys.exit(main())
"""


def synced_seq(runtime: Path) -> int:
    status = command("wayfix-onboard", "status", "--runtime", runtime, "--json")
    line = next(line for line in status.stdout.splitlines() if "synced_seq" in line and not line.startswith("{"))
    return int(line.split(": ")[1])


def test_a_daemon_killed_again_and_again_loses_no_frame_that_was_synced(tmp_path: Path) -> None:
    rng = random.Random(7)
    config, state, runtime = config_of(tmp_path), tmp_path / "state", tmp_path / "run"
    places = ("--state", state, "--runtime", runtime)
    durable: dict[str, int] = {}
    with ExitStack() as stack:
        first = stack.enter_context(daemon_of(config, *places))
        bind = first.ready()["bind"]
        awake, asleep = (stack.enter_context(station(bind, "--log", tmp_path / name)) for name in ("awake", "asleep"))
        for process in (awake, asleep):
            process.wait_for_words(" missing", 30.0)
        asleep.send(signal.SIGSTOP)
        daemon = first
        for turn in range(KILLS):
            time.sleep(rng.uniform(0.2, 2.0))
            durable[daemon.ready()["boot_id"]] = synced_seq(runtime)
            daemon.send(signal.SIGTERM if turn == 0 else signal.SIGKILL)
            daemon.finish()
            daemon = stack.enter_context(daemon_of(config, *places, "--bind", bind))
        asleep.send(signal.SIGCONT)
        for process in (awake, asleep):
            assert wait_until(partial(is_current, process), FILLED_S) is not None, process.err[-5:]
            process.send(signal.SIGINT)
            assert process.finish() == 0
    assert max(durable.values()) >= FRAME_HZ
    for name in ("awake", "asleep"):
        check_whole(tmp_path / name)
        found = seqs_of(tmp_path / name)
        for boot_id, last in durable.items():
            assert max(seq for boot, seq in found if boot == boot_id) >= last, (name, boot_id)
    verified = command("wayfix-onboard", "spool", "verify", "--state", state)
    assert verified.returncode in (0, 1), verified.stderr  # a torn last frame is named


def is_current(process: Process) -> bool:
    return " 0 missing" in process.err[-1] and "LOST" not in process.err[-1]


def test_a_bounded_run_over_a_cut_has_exactly_its_frames(tmp_path: Path) -> None:
    with daemon_of(config_of(tmp_path)) as daemon, Relay(place_of(daemon)) as relay:
        bounded = ("--frames", "100", "--period", "0.1", "--log", tmp_path / "log")
        with station(relay.address, *bounded) as ashore:
            ashore.wait_for_words(" missing", 30.0)
            time.sleep(2.0)
            relay.cut()
            time.sleep(5.0)
            relay.restore()
            assert ashore.finish(30.0) == 0, ashore.err
    frames = [decode_frame(data) for log in (tmp_path / "log").glob("*.mcap") for data in read_log(log).frames()]
    assert len(frames) == 100
    for before, after in pairwise(frames):
        assert after.first_seq == before.seq + 1
        assert after.t0_ns == before.t1_ns
    assert {frame.t1_ns - frame.t0_ns for frame in frames} == {100_000_000}


def test_a_card_that_hangs_half_a_second_at_each_sync_delays_no_frame(tmp_path: Path) -> None:
    config = config_of(tmp_path)
    config.write_text(config.read_text(encoding="utf-8") + "[spool]\nsync_s = 0.0\n", encoding="utf-8")
    with ExitStack() as stack:
        daemon = Process("python", "-c", STALLED, "run", "--open", config, "--state", tmp_path / "state")
        stack.callback(daemon.end)
        light = LightStation(daemon.ready()["bind"])
        light.start()
        assert wait_until(lambda: light.newest >= 0, 10.0) is not None
        time.sleep(1.0)
        first, began_s = light.newest, time.monotonic()
        time.sleep(20.0)
        rate_hz = (light.newest - first) / (time.monotonic() - began_s)
        light.end()
    light.check()
    pauses = [light.at_s[seq + 1] - light.at_s[seq] for seq in range(first, light.newest)]
    print(f"\n  {rate_hz:.2f} frames/s, longest pause {max(pauses) * 1000:.0f} ms")
    assert rate_hz == pytest.approx(FRAME_HZ, rel=0.02)
    assert statistics.median(pauses) < 0.1
    assert len(list((tmp_path / "state" / "spool").glob("*.seg"))) == 1


def test_a_full_card_stops_nothing(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("a file system of 8 MiB is mounted by root only")
    state = tmp_path / "state"
    state.mkdir()
    config = config_of(tmp_path)
    spool = "[spool]\nmin_free_mib = 0\nsync_s = 0.2\n"
    config.write_text(config.read_text(encoding="utf-8") + spool, encoding="utf-8")
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(state)], check=True)
    try:
        with ExitStack() as stack:
            daemon = stack.enter_context(daemon_of(config, "--state", state))
            light = LightStation(daemon.ready()["bind"])
            light.start()
            assert wait_until(lambda: light.newest >= 2 * FRAME_HZ, 15.0) is not None
            before = light.newest
            with (state / "filler").open("wb", buffering=0) as filler:
                while written(filler.fileno()):
                    pass
            time.sleep(8.0)
            light.end()
    finally:
        subprocess.run(["umount", "--lazy", str(state)], check=True)
    light.check()
    assert light.newest - before >= 7 * FRAME_HZ
    told = [line for line in daemon.err if "disk" in line]
    assert 1 <= len(told) <= 2, told


def written(descriptor: int) -> bool:
    try:
        return os.write(descriptor, b"x" * 4096) > 0
    except OSError:
        return False
