"""What a run says of itself: its account at the end, why there are no estimates, and a log that is taken away."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.messages import Fix, Frame, SensorHealth
from shore.live.earlier_trips import complete_trips
from shore.logbook.log_reader import read_log
from shore.logbook.why_none import WhyNone
from shore.replay.run import Replay
from shore.settings.station import StationSettings, station_settings
from shore.trips.command import _info
from shore.trips.examine import examine
from tests.station.journeys import Board, session
from tests.station.test_journey import check_each_frame_once, frames_in
from tests.strategies import frame_of

ROLES = {"gps1": "gps", "compass1": "compass"}
LOST = SensorHealth(sensor="gps1", t_ns=5, state="missing", reason="no such file")
WHY = "no fix came (gps1 missing: no such file)"
FIX = Fix(sensor="gps1", t_ns=1, lat_deg=1.0, lon_deg=2.0)


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


@pytest.mark.parametrize(
    ("frames", "roles", "words"),
    [
        ([], ROLES, "no frame came"),
        ([frame_of()], {"compass1": "compass"}, "the boat's file names no gps"),
        ([frame_of()], ROLES, "no fix came"),
        ([replace(frame_of(), health=(LOST,))], ROLES, "no fix came (gps1 missing: no such file)"),
        (
            [frame_of(replace(FIX, fix_quality=0)), frame_of(replace(FIX, held=True))],
            ROLES,
            "none of 2 fixes is usable (void, repeated or estimated)",
        ),
        ([frame_of(FIX)], ROLES, "no heading came"),
        (
            [frame_of(FIX)],
            {"gps1": "gps"},
            "no compass is named, and a course is taken as heading only at 2 kn or more",
        ),
    ],
)
def test_why_there_are_no_estimates(frames: list[Frame], roles: dict[str, str], words: str) -> None:
    why = WhyNone()
    for frame in frames:
        why.frame(frame)
    assert why.text(roles) == words


def test_a_run_ends_with_what_it_was(tmp_path: Path, board: Board) -> None:
    run, _ = session(tmp_path, board, 15.0)
    lines = list(run.account.lines())
    assert lines[0] == "trip    0:00:15, 150 frames, 15 usable fixes"
    assert lines[1].startswith("sailed  ")
    assert lines[2].startswith("fuzzy   ")
    assert run.account.as_record()["why_no_estimates"] is None


def test_a_run_without_a_valid_estimate_says_what_the_filters_waited_for(tmp_path: Path, board: Board) -> None:
    run, _ = session(tmp_path, board, 4.0)
    assert run.account.as_record()["estimates"]
    assert "none is valid: the filters waited for noise of the sensors" in list(run.account.lines())


def test_a_run_without_estimates_says_why_live_in_the_log_and_in_a_replay(tmp_path: Path, board: Board) -> None:
    board.has_sensors = False
    run, _ = session(tmp_path, board, 2.0)
    assert list(run.account.lines()) == ["trip    0:00:02, 20 frames, 0 usable fixes", f"no estimates: {WHY}"]
    assert run.log_path is not None
    assert _info(examine(run.log_path, lambda _scan: None), with_config=False)["why_no_estimates"] == WHY
    replay = Replay(run.log_path)
    list(replay)
    assert replay.why_none == WHY


def test_a_log_directory_that_is_removed_is_begun_again(tmp_path: Path, board: Board) -> None:
    """At once, with a word, and what was in it is fetched from the board: nothing is lost."""
    logs = tmp_path / "logs"
    board_at: list[int] = []

    def remove() -> None:
        if board.count == 60 and not board_at:
            logs.rename(tmp_path / "gone")  # at once, unlike rmtree
            shutil.rmtree(tmp_path / "gone")
            board_at.append(board.count)

    run, said = session(logs, board, 15.0, look=remove)
    complete_trips(logs, print)
    assert any("was removed or moved while it was written" in line for line in said)
    assert run.log_path is not None
    assert run.log_path.exists()
    assert run.tally.received == 150
    assert run.account.as_record()["frames"] == 150
    check_each_frame_once(logs, board)
    assert len(frames_in(run.log_path)) == 150
    assert len(list(read_log(run.log_path).estimates())) > 50
    replay = Replay(run.log_path)
    list(replay)
    assert not replay.differs
    assert replay.why_not is not None
    assert "began in the middle" in replay.why_not


@pytest.mark.parametrize(("line", "expected"), [(None, "kept"), ("other", "other"), ("", "")])
def test_where_logs_are_kept_has_one_rule(tmp_path: Path, line: str | None, expected: str) -> None:
    """The settings, and the command line that wins."""
    assert StationSettings().log.directory == "logs"
    file = tmp_path / "wayfix.toml"
    file.write_text('[log]\ndirectory = "kept"\n')
    settings: Any = station_settings(file, log=line)
    assert settings.log.directory == expected
