"""A hole has one name: status line, event, account, exit code and `wayfix log` agree on what is missing or lost."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from common.errors import WayfixError
from common.link_messages import FrameRange
from common.messages import Frame
from shore.link.frame_ledger import MAX_RANGES, Ledger
from shore.live.command import _exit_code
from shore.live.earlier_trips import complete_trips
from shore.live.run import Options
from shore.logbook.holes import Holes, count_listed
from shore.logbook.log_writer import LogWriter
from shore.logbook.missing_frames import Census
from shore.trips.examine import Examination, examine
from shore.trips.tables import frames_text, info_screen
from tests.station.journeys import Board, session
from tests.station.log_commands import harmed
from tests.station.log_files import chunks_of
from tests.strategies import frame_of


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def seen(log: Path | None) -> Examination:
    assert log is not None
    return examine(log, lambda _scan: None)


LOST = "30 frames are lost: the boat does not hold them any more, or does not list them"


def status_of(said: list[str]) -> str:
    return [line for line in said if "round trip" in line or " frames, " in line][-1]


def test_frames_lost_in_a_trip_are_lost_everywhere(tmp_path: Path, board: Board) -> None:
    def look() -> None:
        if board.count == 20:
            board.make(30)  # the link is down, and the spool is small
            board.held_from[board.boot_id] = 50

    run, said = session(tmp_path, board, 4.0, look=look)
    assert run.tally.holes == (0, 30, 0, 0)
    assert any("so that they are lost: 30" in line for line in said)
    assert "0 missing, 30 lost" in status_of(said)
    assert run.tally.holes.sentences() == [LOST]
    assert _exit_code(run.tally, Options(), is_stopped=True) == 1
    info = seen(run.log_path)
    assert info.holes == run.tally.holes
    assert frames_text(info) == f"40; {LOST}"


def test_frames_lost_between_trips_are_lost_in_the_trip_before(tmp_path: Path, board: Board) -> None:
    first = session(tmp_path, board, 2.0)[0].log_path
    board.make(60)
    board.held_from[board.boot_id] = 50
    run, said = session(tmp_path, board, 2.0)
    complete_trips(tmp_path, print)
    assert run.tally.holes == (0, 30, 0, 0)
    assert "0 missing, 30 lost" in status_of(said)
    assert seen(first).holes == (0, 30, 0, 0)
    second = seen(run.log_path)
    assert second.holes == (0, 0, 0, 0)
    told = Console(width=200)
    with told.capture() as captured:
        for part in info_screen(second, with_config=False):
            told.print(part)
    assert f"of earlier trips {LOST}" in captured.get()


def test_frames_that_are_still_to_come_are_missing_everywhere_and_no_failure(tmp_path: Path, board: Board) -> None:
    run, said = session(tmp_path, board, 3.0, fill=0, look=lambda: board.make(30) if board.count == 20 else None)
    assert run.tally.holes == (30, 0, 0, 0)
    assert "catching up: 30 frames" in status_of(said)
    assert _exit_code(run.tally, Options(), is_stopped=True) == 0
    info = seen(run.log_path)
    assert info.holes == run.tally.holes
    assert frames_text(info) == "30; 30 frames are missing still: the next `wayfix connect` fetches them"


def test_frames_that_came_when_the_log_had_ended_are_not_stored(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_arguments: object) -> None:
        raise WayfixError("No space left on device")

    def look() -> None:
        if board.count == 20:
            monkeypatch.setattr(LogWriter, "write_frame", full)

    run, said = session(tmp_path, board, 3.0, look=look)
    assert run.log_fault is not None
    assert run.tally.holes == (0, 0, 9, 0)
    assert "0 missing, 9 not stored" in status_of(said)
    monkeypatch.undo()
    session(tmp_path, board, 2.0)
    complete_trips(tmp_path, print)
    assert seen(run.log_path).holes == (0, 0, 0, 0), "the next run fetched them"


def test_what_the_file_lost_is_not_stored(tmp_path: Path, board: Board) -> None:
    log = session(tmp_path, board, 4.0)[0].log_path
    assert log is not None
    assert seen(log).holes == (0, 0, 0, 0)
    content, held = log.read_bytes(), seen(log).census.count
    for number in range(len(chunks_of(content))):
        log.write_bytes(harmed(content, number))
        harm = seen(log)
        assert harm.holes == (0, 0, held - harm.census.count, 0)


@given(st.lists(st.booleans(), max_size=40), st.integers(0, 40))
def test_ledger_and_census_count_alike(came: list[bool], held_from: int) -> None:
    """Frames that came, that are lost and that are still to come, as the ledger's record says it to the census."""
    ledger, census = Ledger(), Census()
    ledger.greet("a", 0, [("a", 0, 0)])
    ledger.begin_trip("a", 0, "log")
    census.expect("a", 0)
    ledger.exists("a", len(came))
    for seq in (seq for seq, is_here in enumerate(came) if is_here):
        ledger.take("a", seq, seq)
        census.frame(frame_of(boot_id="a", seq=seq))
    ledger.is_gone(FrameRange("a", 0, held_from))
    record = ledger.holes_of("log")
    census.ended(record)
    assert census.holes(0) == (ledger.missing_count, ledger.gone_count, 0, 0)
    assert census.holes(0)[:2] == (count_listed(record, "lacks"), count_listed(record, "lost"))
    assert len(came) == sum(census.holes(0)) + sum(came)


def test_ranges_beyond_the_most_that_a_log_lists_are_counted() -> None:
    ledger, census = Ledger(), Census()
    ledger.greet("a", 0, [("a", 0, 0)])
    ledger.begin_trip("a", 0, "log")
    for seq in range(0, 4 * MAX_RANGES, 2):
        ledger.take("a", seq, seq)
        census.frame(frame_of(boot_id="a", seq=seq))
    record = ledger.holes_of("log")
    assert len(record["lacks"]) == MAX_RANGES
    assert count_listed(record, "lacks") == ledger.missing_count == 2 * MAX_RANGES - 1
    census.ended(record)
    assert census.holes(0) == (ledger.missing_count, 0, 0, 0)


@given(st.tuples(*[st.integers(0, 3)] * 4))
def test_each_kind_of_hole_is_told_once(counts: tuple[int, int, int, int]) -> None:
    holes = Holes(*counts)
    assert len(holes.sentences()) == sum(map(bool, counts))
    assert holes.for_good == (holes.lost > 0)
    assert all(f"{count} " in holes.brief() for count in counts if count)
