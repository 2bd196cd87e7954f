"""A log directory that is removed or exchanged while a station runs: said, begun again, and fetched again."""

import shutil
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import pytest

from common.errors import WayfixError
from common.messages import Frame
from shore.live.earlier_trips import complete_trips
from shore.logbook import log_writer
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import LogWriter
from shore.trips.examine import examine
from tests.station.journeys import Board, session
from tests.station.logs import UTC_NS
from tests.station.test_journey import check_each_frame_once


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


@pytest.fixture(autouse=True)
def each_log_has_a_second_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    seconds: Iterator[int] = count(UTC_NS, 10**9)
    monkeypatch.setattr("shore.logbook.background_writer.time", SimpleNamespace(time_ns=lambda: next(seconds)))
    for name in ("RETRY_S", "LONGEST_RETRY_S"):
        monkeypatch.setattr(f"shore.logbook.background_writer.{name}", 1.0)


def removed(logs: Path) -> None:
    logs.rename(logs.with_name("gone"))  # at once, unlike rmtree
    shutil.rmtree(logs.with_name("gone"))


def exchanged(logs: Path) -> None:
    removed(logs)
    logs.mkdir()
    logs.joinpath("20200101T000000Z-other.mcap").write_bytes(b"")


def unlinked(logs: Path) -> None:
    for log in logs.glob("*.mcap"):
        log.unlink()


def replaced(logs: Path) -> None:
    """Each log by a copy of itself, as a synchronising program does it."""
    for log in logs.glob("*.mcap"):
        copy = log.with_suffix(".copy")
        shutil.copy2(log, copy)
        copy.replace(log)


HARM: dict[str, Callable[[Path], None]] = {
    "removed": removed, "exchanged": exchanged, "unlinked": unlinked, "replaced": replaced,
}  # fmt: skip


@pytest.mark.parametrize("harm", HARM)
@pytest.mark.parametrize("when", ["all came", "fetching", "twice"])
def test_each_frame_that_the_board_holds_is_in_the_logs_again(
    harm: str, when: str, tmp_path: Path, board: Board
) -> None:
    logs = tmp_path / "logs"
    session(logs, board, 3.0)
    board.has_sensors = when != "fetching"
    board.make({"all came": 0, "twice": 20, "fetching": 300}[when])
    at = {board.count + 20, board.count + 45} if when == "twice" else {board.count + 20}
    said_at: list[int] = []

    def look() -> None:
        if board.count in at:
            at.discard(board.count)
            said_at.append(board.count)
            HARM[harm](logs)

    run, said = session(logs, board, 12.0, look=look, fill=5)
    session(logs, board, 2.0, fill=400)
    complete_trips(logs, print)
    assert sum("was removed or moved while it was written" in line for line in said) == len(said_at)
    assert run.log_fault is None
    for other in logs.glob("*-other.mcap"):
        other.unlink()
    if harm == "replaced":
        held = {frame for log in logs.glob("*.mcap") for frame in read_log(log).frames()}
        assert len(held) == board.count, "the copy has them as well"
    else:
        check_each_frame_once(logs, board)


def test_a_disk_that_was_pulled_out_and_comes_back(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Writes to it fail; for a while there is no directory at all; then another disk is there."""
    logs = tmp_path / "logs"
    session(logs, board, 3.0)
    begins, ends = board.count + 20, board.count + 50
    guarded, new = LogWriter.guarded, log_writer.new_log

    def writes(writer: LogWriter, action: Callable[[], None]) -> None:
        if not writer.path.exists():
            raise WayfixError("Input/output error")
        guarded(writer, action)

    def begins_again(directory: Path, boat_id: str, utc_ns: int) -> LogWriter:
        if board.count < ends:
            raise WayfixError("no such device")
        return new(directory, boat_id, utc_ns)

    def look() -> None:
        if board.count == begins and logs.exists():
            removed(logs)
            monkeypatch.setattr(LogWriter, "guarded", writes)
            monkeypatch.setattr("shore.logbook.background_writer.new_log", begins_again)

    run, said = session(logs, board, 12.0, look=look)
    assert sum("the run goes on without a log" in line for line in said) == 1
    assert sum("was removed or moved while it was written" in line for line in said) == 1
    assert any("NO LOG" in line for line in said)
    assert run.log_fault is None
    assert run.tally.holes == (0, 0, 0, 0)
    session(logs, board, 1.0)
    complete_trips(logs, print)
    check_each_frame_once(logs, board)


@pytest.mark.parametrize("faults", [1, 4])
@pytest.mark.parametrize("begun", [False, True], ids=["at any call", "in a log that has begun"])
def test_a_disk_that_fails_for_a_moment_costs_no_frame(
    faults: int, begun: bool, tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the log lacks since its disk failed goes beside it, and a new log goes on."""
    logs = tmp_path / "logs"
    session(logs, board, 3.0)
    begins, guarded, left = board.count + 20, LogWriter.guarded, [faults]

    def fails(writer: LogWriter, action: Callable[[], None]) -> None:
        def failing() -> None:
            if board.count >= begins and left[0] and (not begun or writer.log_time_ns):
                left[0] -= 1
                raise OSError(5, "Input/output error")
            action()

        guarded(writer, failing)

    monkeypatch.setattr(LogWriter, "guarded", fails)
    run, said = session(logs, board, 15.0)
    assert left == [0]
    assert len(list(logs.glob("*.mcap"))) == 3 + 1  # of what failed at its begin no file stays; one is of late frames
    assert any("had ended by a fault of the disk; it goes on in" in line for line in said)
    assert run.log_fault is None
    assert run.tally.holes == (0, 0, 0, 0)
    session(logs, board, 1.0)
    complete_trips(logs, print)
    check_each_frame_once(logs, board)
    for log in logs.glob("*.mcap"):
        assert examine(log, lambda _scan: None).holes == (0, 0, 0, 0), log
