"""Trip, unplug, restart, connect twice, export: no place that was not sailed, and each frame in exactly one trip."""

import copy
import random
import re
import shutil
from collections import Counter
from contextlib import suppress
from pathlib import Path

import pytest

from common.codec import decode_frame
from common.messages import Frame
from shore.live.earlier_trips import complete_trips
from shore.logbook.log_reader import read_log
from shore.replay.run import Replay
from shore.trips.examine import examine
from shore.trips.listing import trip_of
from tests.station.exporting import export
from tests.station.journeys import FILL, Board, session

TRIP_S, ALONE_S, DARK_S = 15.0, 8.0, 20.0


def frames_in(log: Path) -> list[Frame]:
    return [decode_frame(data) for data in read_log(log).frames()]


def seconds_of(log: Path) -> float:
    return float(trip_of(log, lambda _scan: None).summary["seconds"])


def check_each_frame_once(directory: Path, board: Board) -> None:
    """What all logs hold together is what the board made."""
    held = Counter((f.boot_id, f.seq) for log in directory.glob("*.mcap") for f in frames_in(log))
    made = {(name, frame.seq) for name, frames in board.made.items() for frame in frames}
    assert set(held.values()) == {1}
    assert set(held) == made


def journey(directory: Path, board: Board, fill: int = FILL) -> tuple[Path, Path, Path]:
    """The logs of three trips: sailed; after a restart without sensors; once more in that start."""
    logs = []
    logs.append(session(directory, board, TRIP_S)[0].log_path)
    board.make(int(ALONE_S * 10))
    board.has_sensors = False
    board.make(int(DARK_S * 10))
    board.restart()
    board.make(30)
    logs.append(session(directory, board, 12.0, fill)[0].log_path)
    board.make(50)
    logs.append(session(directory, board, 6.0, fill)[0].log_path)
    first, second, third = logs
    assert first is not None
    assert second is not None
    assert third is not None
    return first, second, third


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def test_ghost_track(tmp_path: Path, board: Board) -> None:
    first, second, third = journey(tmp_path / "logs", board)
    complete_trips(tmp_path / "logs", print)
    assert len(list((tmp_path / "logs").glob("*.mcap"))) == 3
    check_each_frame_once(tmp_path / "logs", board)
    for log in (second, third):
        assert list(read_log(log).estimates()) == []
        assert not {"filter-started", "filter-aligned"} & {event["code"] for event in read_log(log).events()}
        assert export(log, "--to", "gpx", tmp_path / f"{log.stem}.gpx") == 1
        assert not (tmp_path / f"{log.stem}.gpx").exists()
    assert export(first, "--to", "csv", tmp_path / "first.csv") == 0
    sailed_ns = board.made[f"{1:016x}"][0].t0_ns + TRIP_S * 1e9
    assert all(record["t_ns"] <= sailed_ns for record in read_log(first).estimates())


def test_a_trip_with_another_inside(tmp_path: Path, board: Board) -> None:
    """Ten seconds, long alone, eight seconds: the second trip is eight seconds long, and the first one whole."""
    first = session(tmp_path, board, TRIP_S)[0].log_path
    board.has_sensors = False
    board.make(13_730)
    second = session(tmp_path, board, 8.0, fill=200)[0].log_path
    assert first is not None
    assert second is not None
    assert seconds_of(second) == pytest.approx(8.0)
    complete_trips(tmp_path, print)
    assert seconds_of(first) == pytest.approx(TRIP_S + 1373.0)
    check_each_frame_once(tmp_path, board)


@pytest.mark.slow
def test_a_completed_trip_is_replayed_as_it_was_seen(tmp_path: Path, board: Board) -> None:
    """What came after its end was given to no filter, and `--order time` has it in its place."""
    first, *_ = journey(tmp_path, board)
    complete_trips(tmp_path, print)
    replay = Replay(first)
    steps = list(replay)
    assert replay.comparison is not None
    assert not replay.comparison.differs
    assert replay.comparison.estimates.equal > 100
    assert replay.source.late == round((ALONE_S + DARK_S) * 10)
    sailed = [step for step in Replay(first, order="time") if step.records]
    assert sailed[-1].frame.t1_ns > steps[round(TRIP_S * 10) - 1].frame.t1_ns + ALONE_S * 1e9


@pytest.mark.parametrize("number", [1, 11, 12])
@pytest.mark.parametrize("is_connected", [True, False])
def test_a_start_counter_that_went_back_freezes_no_picture(
    number: int, is_connected: bool, tmp_path: Path, board: Board
) -> None:
    """A counter that is empty or of an older backup: while the station runs, or while it has frames to fetch."""
    board.numbers[board.boot_id] = 12
    if is_connected:
        looks = 0

        def look() -> None:
            nonlocal looks
            looks += 1
            if looks == 60:
                board.make(20)
                board.reboot(number)

        log = session(tmp_path, board, 12.0, look=look)[0].log_path
    else:
        session(tmp_path, board, 5.0)
        board.make(80)
        board.reboot(number)
        board.make(10)
        log = session(tmp_path, board, 8.0)[0].log_path
    assert log is not None
    made = list(read_log(log).estimates())
    newest = board.made[board.boot_id]
    assert made[-1]["t_ns"] == newest[-1].t1_ns
    first = next(record["t_ns"] for record in made if record["boot_id"] == board.boot_id)
    assert first - newest[0].t0_ns < 3e9
    replay = Replay(log)
    list(replay)
    assert replay.comparison is not None
    assert not replay.comparison.differs
    assert replay.comparison.estimates.equal == len(made)
    in_order = [step.frame.boot_id for step in Replay(log, order="time")]
    assert in_order == sorted(in_order), "these are numbered as they were made"
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)


def test_what_a_trip_lacks_is_said_until_it_came(tmp_path: Path, board: Board) -> None:
    board.has_sensors = False
    first = session(tmp_path, board, 3.0)[0].log_path
    board.make(600)
    second, said = session(tmp_path, board, 4.0, fill=5)
    missing = second.tally.missing
    assert missing == 600 - 5 * 40
    told = next(line for line in reversed(said) if "catching up" in line)
    assert re.search(r"catching up: 4\d\d frames of \d\d:\d\d:\d\d to \d\d:\d\d:\d\d, \d+ s left", told), told
    complete_trips(tmp_path, print)
    assert first is not None
    assert examine(first, lambda _scan: None).holes == (missing, 0, 0, 0)
    session(tmp_path, board, 3.0, fill=100)
    complete_trips(tmp_path, print)
    assert examine(first, lambda _scan: None).holes == (0, 0, 0, 0)
    check_each_frame_once(tmp_path, board)


def copied(source: str, target: str) -> None:
    """A file that is renamed meanwhile is not there any more."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


@pytest.mark.slow
def test_power_cuts_anywhere_leave_each_frame_in_one_trip(tmp_path: Path, board: Board) -> None:
    """The directory as it lies on the disk at some moments of a session that fetches the frames of two trips before."""
    logs = tmp_path / "logs"
    journey(logs, board, 1)
    board.make(60)
    draw = random.Random(1)
    cuts: list[tuple[Path, Board]] = []

    def cut() -> None:
        if draw.random() < 0.04 and len(cuts) < 6:
            place = tmp_path / f"cut{len(cuts)}"
            cuts.append((Path(shutil.copytree(logs, place, copy_function=copied)), copy.deepcopy(board)))

    session(logs, board, 6.0, fill=3, look=cut)
    assert len(cuts) == 6
    for directory, as_it_was in cuts:
        session(directory, as_it_was, 3.0, fill=50)
        complete_trips(directory, print)
        check_each_frame_once(directory, as_it_was)
    late = next(logs.glob("*-late.mcap"))
    content = late.read_bytes()
    for _ in range(2):  # the log has its new content, and what was put into it is still there
        late.write_bytes(content)
        complete_trips(logs, print)
        assert not late.exists()
    session(logs, board, 3.0, fill=50)
    complete_trips(logs, print)
    check_each_frame_once(logs, board)


def test_late_frames_of_a_log_that_is_gone_stay_a_log_of_their_own(tmp_path: Path, board: Board) -> None:
    first = session(tmp_path, board, 3.0)[0].log_path
    board.make(30)
    session(tmp_path, board, 2.0)
    assert first is not None
    first.unlink()
    said: list[str] = []
    for _ in range(2):
        complete_trips(tmp_path, said.append)
    assert [line.endswith("there is no such log any more; keep both") for line in said] == [True, True]
    late = tmp_path / f"{first.stem}-late.mcap"
    assert len(frames_in(late)) == 30
    assert list(Replay(late))[-1].records


def test_what_is_older_than_the_horizon_starts_no_filter(tmp_path: Path, board: Board) -> None:
    """Of this very trip: its start sailed for a while before the sensors went, and then a station came."""
    session(tmp_path, board, 1.0)
    board.restart()
    board.make(100)
    board.has_sensors = False
    board.make(60)
    log = session(tmp_path, board, 6.0, fill=200)[0].log_path
    assert log is not None
    assert len(frames_in(log)) == 220
    assert list(read_log(log).estimates()) == []


def test_ctrl_c_leaves_late_frames_beside_their_trip(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    session(tmp_path, board, 3.0)
    board.make(30)
    session(tmp_path, board, 2.0)
    names, said = set(tmp_path.iterdir()), list[str]()

    def pressed(*_arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("shore.trips.recover._compare", pressed)
        complete_trips(tmp_path, said.append)
    assert [line.partition(" stays")[2] for line in said] == [" a log of its own until the next `wayfix connect` ends"]
    assert set(tmp_path.iterdir()) == names
    check_each_frame_once(tmp_path, board)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)
    assert len(list(tmp_path.glob("*.mcap"))) == 2
