"""The mark of a running daemon, and the gap a restarted one tells from it."""

import asyncio
import signal
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from common.clock import BoatClock, boottime_ns, machine_clock_id
from common.framer import Identity
from common.messages import Frame
from common.units import NS_PER_S
from onboard.alive import AliveMark, Gap, gap_of, line_of
from onboard.config import load
from onboard.daemon import Daemon
from tests.system.harness import Process, compass_config

CLOCK = "0123456789abcdef" * 2
FORMER = Identity("b", "00000000000000aa", CLOCK, 4)
NOW = Identity("b", "00000000000000bb", CLOCK, 5)
T_NS = 1_000 * NS_PER_S


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (line_of(FORMER, T_NS).decode(), Gap(FORMER.boot_id, 6 * NS_PER_S)),
        (line_of(FORMER, T_NS + 6 * NS_PER_S).decode(), Gap(FORMER.boot_id, 0)),
        (line_of(FORMER, T_NS + 7 * NS_PER_S).decode(), None),
        (line_of(Identity("b", FORMER.boot_id, "f" * 32, 4), T_NS).decode(), None),
        (line_of(FORMER, T_NS).decode()[:-2], None),
        (line_of(FORMER, T_NS).decode() + "more", None),
        ("", None),
        ("\0" * 71, None),
    ],
)
def test_what_a_mark_tells(line: str, expected: Gap | None) -> None:
    assert gap_of(line, CLOCK, T_NS + 6 * NS_PER_S) == expected


def test_every_mark_is_equally_long() -> None:
    assert len({len(line_of(FORMER, t_ns)) for t_ns in (0, T_NS, 2**63)}) == 1


def test_a_mark_outlives_its_daemon_unless_that_says_goodbye(tmp_path: Path) -> None:
    former = AliveMark(tmp_path, FORMER)
    assert former.former(T_NS) is None
    former.keep(T_NS)
    former.keep(T_NS + NS_PER_S)
    found = AliveMark(tmp_path, NOW).former(T_NS + 3 * NS_PER_S)
    assert found == Gap(FORMER.boot_id, 2 * NS_PER_S)
    former.goodbye()
    assert AliveMark(tmp_path, NOW).former(T_NS + 3 * NS_PER_S) is None


def test_a_damaged_mark_is_overwritten_whole(tmp_path: Path) -> None:
    (tmp_path / "alive").write_bytes(b"\xff" * 500)
    mark = AliveMark(tmp_path, NOW)
    assert mark.former(T_NS) is None
    mark.keep(T_NS)
    assert (tmp_path / "alive").read_bytes() == line_of(NOW, T_NS)


@pytest.mark.parametrize("directory", [None, "/nowhere/at/all"])
def test_without_a_directory_there_is_no_mark(directory: str | None) -> None:
    mark = AliveMark(Path(directory) if directory else None, NOW)
    assert mark.former(T_NS) is None
    mark.keep(T_NS)
    mark.goodbye()


def test_a_killed_daemon_is_told_by_the_next_one_and_a_stopped_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    config = compass_config(tmp_path, p="/dev/nowhere")
    gaps = []
    for number in (signal.SIGKILL, signal.SIGTERM, signal.SIGTERM):
        daemon = Process("wayfix-onboard", "run", "--open", config)
        try:
            ready = daemon.ready()
            daemon.wait_for(partial(mark_of, tmp_path / "alive", ready["boot_id"]))
            daemon.send(number)
            daemon.finish()
            gaps.append([line for line in daemon.err if "without a goodbye" in line])
        finally:
            daemon.end()
    assert [len(lines) for lines in gaps] == [0, 1, 0]
    assert not (tmp_path / "alive").exists()


def daemon_of(directory: Path, frames: list[Frame]) -> Daemon:
    """A daemon in this process whose frames are kept."""
    daemon = Daemon(load(compass_config(directory, p="/dev/nowhere")), BoatClock(), runtime_dir=directory)
    hand_on = daemon.server.publish

    def publish(frame: Frame) -> None:
        frames.append(frame)
        hand_on(frame)

    daemon.server.publish = publish  # type: ignore[method-assign]
    return daemon


async def for_a_while(daemon: Daemon) -> None:
    running = asyncio.create_task(daemon.run("tcp://127.0.0.1:*", lambda _: None))
    await asyncio.sleep(0.4)
    daemon.stop("the test ends")
    await running


def test_the_gap_is_an_event_of_the_first_frame_and_reaches_back_to_the_last_one(tmp_path: Path) -> None:
    AliveMark(tmp_path, replace(FORMER, clock_id=machine_clock_id())).keep(boottime_ns() - 60 * NS_PER_S)
    frames: list[Frame] = []
    asyncio.run(for_a_while(daemon_of(tmp_path, frames)))
    (told,) = [item for item in frames[0].events if item.code == "daemon-resumed"]
    assert told.evidence["former_boot_id"] == FORMER.boot_id
    assert told.evidence["gap_s"] == pytest.approx(60, abs=1)
    assert not any(item.code == "daemon-resumed" for frame in frames[1:] for item in frame.events)


def test_a_daemon_that_ends_by_an_error_of_its_own_keeps_its_mark(tmp_path: Path) -> None:
    frames: list[Frame] = []
    daemon = daemon_of(tmp_path, frames)

    async def breaks() -> None:
        await asyncio.sleep(0.3)
        raise RuntimeError("a bug")

    daemon.server.run = breaks  # type: ignore[method-assign]
    with pytest.raises(RuntimeError, match="a bug"):
        asyncio.run(for_a_while(daemon))
    mark = (tmp_path / "alive").read_text(encoding="ascii")
    assert gap_of(mark, machine_clock_id(), boottime_ns()) is not None


def mark_of(file: Path, boot_id: str, _: Process) -> bool:
    return file.exists() and boot_id in file.read_text(encoding="ascii")
