"""A board whose start counter goes back (card of a backup, empty counter): order of the starts in logs and replays."""

from pathlib import Path

import pytest

from common.messages import Frame
from shore.live.earlier_trips import complete_trips
from shore.replay.run import Replay
from tests.station.journeys import Board, session
from tests.station.test_journey import check_each_frame_once


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def check_order(directory: Path) -> None:
    """In order of time each log has the starts as the board made them."""
    for log in directory.glob("*.mcap"):
        order = [step.frame.boot_id for step in Replay(log, order="time")]
        assert order == sorted(order), log


def test_starts_while_the_station_is_away_stand_in_their_order_in_the_trip_before(tmp_path: Path, board: Board) -> None:
    """They come late, and only the greeting of the next session names them."""
    board.numbers[board.boot_id] = 12
    session(tmp_path, board, 3.0)
    for number in (5, 3, 4):
        board.make(20)
        board.reboot(number)
    board.make(10)
    session(tmp_path, board, 3.0)
    check_order(tmp_path)  # what came late is a log of its own yet
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)
    check_order(tmp_path)


def test_without_a_cursor_the_starts_stand_in_their_order_too(tmp_path: Path, board: Board) -> None:
    board.numbers[board.boot_id] = 12
    session(tmp_path, board, 2.0)
    board.make(20)
    board.reboot(2)
    board.make(20)
    session(tmp_path, board, 2.0)
    board.make(20)
    board.reboot(1)
    board.make(20)
    (tmp_path / "springer.cursor").unlink()
    session(tmp_path, board, 2.0)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)
    check_order(tmp_path)
