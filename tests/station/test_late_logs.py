"""Logs of late frames that are empty, damaged, foreign or wanted by two stations: the trips stay whole."""

import errno
import os
import re
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from common.codec import decode_frame, encode_frame
from common.errors import WayfixError
from common.messages import Frame
from shore.link.frame_ledger import Ledger
from shore.live.cursor import Cursor
from shore.live.earlier_trips import complete_trips
from shore.logbook.lock import turn_in
from shore.logbook.log_reader import late_logs, read_log
from shore.logbook.log_writer import late_log
from shore.trips.complete import complete
from tests.station.journeys import Board, session
from tests.station.logs import UTC_NS, log_of


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def trip_and_late(directory: Path, board: Board) -> tuple[Path, Path]:
    """The log of a trip, and beside it what came late of it: 30 frames."""
    log = session(directory, board, 1.0)[0].log_path
    assert log is not None
    board.make(30)
    session(directory, board, 2.0)
    return log, log.with_name(f"{log.stem}-late.mcap")


@pytest.mark.parametrize("content", [b"", b"no log at all"])
def test_a_late_log_that_is_no_log_keeps_no_station_away(tmp_path: Path, board: Board, content: bytes) -> None:
    log = session(tmp_path, board, 1.0)[0].log_path
    assert log is not None
    odd = log.with_name(f"{log.stem}-late.mcap")
    odd.write_bytes(content)
    said: list[str] = []
    cursor = Cursor(tmp_path, "springer", said.append)
    cursor.close()
    assert [str(odd) in line for line in said] == [True]
    assert [start["seen"] for start in cursor.ledger.as_record()] == [[[0, 9]]]


def test_a_late_log_that_cannot_begin_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("shore.logbook.log_writer.os.fsync", full)
    monkeypatch.setattr("shore.logbook.log_writer.sync_directory", lambda _directory: None)
    with pytest.raises(WayfixError, match="No space left"):
        late_log(tmp_path / "trip.mcap", {"kind": "start"}, UTC_NS)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_late_log_stays_a_log_of_its_own(tmp_path: Path, board: Board) -> None:
    log, late = trip_and_late(tmp_path, board)
    content = bytearray(late.read_bytes())
    _start, _greeting, frames, *_ = (found.start() for found in re.finditer(rb"\x28\xb5\x2f\xfd", content))
    content[frames + 60] ^= 0xFF
    late.write_bytes(content)
    reader = read_log(late)
    assert len(list(reader.frames())) < 30
    assert reader.losses
    assert not reader.is_cut
    before, said = log.read_bytes(), list[str]()
    complete_trips(tmp_path, said.append)
    assert said == [
        f"{late} stays a log of its own: {late}: is damaged; `wayfix log verify` says what is wrong with it"
    ]
    assert (log.read_bytes(), late.read_bytes()) == (before, bytes(content))


def test_a_cursor_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cursor = Cursor(tmp_path, "springer", print)
    save = cursor.saver(tmp_path / "trip.mcap", UTC_NS)
    done: list[str] = []
    move = Path.replace

    def replaced(source: Path, target: Path) -> Path:
        done.append("replace")
        return move(source, target)

    monkeypatch.setattr(
        "common.atomic_file.os.fsync", lambda number: done.append(str(Path(f"/proc/self/fd/{number}").readlink()))
    )
    monkeypatch.setattr(Path, "replace", replaced)
    save()
    cursor.close()
    file, renamed, directory = done
    assert Path(file).name.startswith(".springer.cursor.")
    assert (renamed, directory) == ("replace", str(tmp_path))
    assert (tmp_path / "springer.cursor").is_file()


def test_no_cursor_claims_frames_of_a_log_that_was_removed(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    claims: list[int] = []
    before: list[int] = []
    saver = Cursor.saver

    def noted(cursor: Cursor, log: Path, log_time_ns: int) -> Callable[[], None]:
        seen = [item for start in cursor.ledger.as_record() for item in start["seen"]]
        claims.append(sum(last - first + 1 for first, last in seen))
        return saver(cursor, log, log_time_ns)

    def removed() -> None:
        if board.count == 15 and not before:
            before.append(len(claims))
            next(tmp_path.glob("*.mcap")).unlink()

    monkeypatch.setattr(Cursor, "saver", noted)
    session(tmp_path, board, 3.0, look=removed)
    assert claims[before[0]] == 0


def test_a_trip_of_a_boat_whose_name_ends_in_late_is_no_late_log(tmp_path: Path, voyage: list[Frame]) -> None:
    trip = log_of(tmp_path, voyage[:10])
    other = trip.with_name(f"{trip.stem}-late.mcap")
    trip.rename(other)  # the same boat even: what its log is named proves nothing
    log_of(tmp_path, voyage[10:20])
    said: list[str] = []
    complete_trips(tmp_path, said.append)
    assert said == []
    assert (len(list(read_log(trip).frames())), len(list(read_log(other).frames()))) == (10, 10)


def test_frames_of_another_boat_are_put_into_no_trip(tmp_path: Path, voyage: list[Frame]) -> None:
    trip = log_of(tmp_path, voyage[:10])
    writer = late_log(trip, {"kind": "start"}, UTC_NS)
    stranger = replace(voyage[10], boat_id="other")
    writer.write_frame(encode_frame(stranger), stranger, UTC_NS)
    writer.close()
    said: list[str] = []
    complete_trips(tmp_path, said.append)
    assert [line.endswith("holds a frame of another boat (other); keep both") for line in said] == [True]
    assert writer.path.exists()


def test_a_start_that_greets_once_more_is_the_newest_again() -> None:
    """Two boxes of one boat, connected in turn: the backfill begins with the newest frame of the one that greeted."""
    ledger = Ledger()
    for name in ("x", "y", "x"):
        ledger.greet(name, 5, [(name, 0, 5)])
    ledger.take("x", 5, 5)
    ledger.take("y", 5, 5)
    assert ledger.is_newest("x", 5)
    assert not ledger.is_newest("y", 5)


def two_late_logs(directory: Path, voyage: list[Frame]) -> list[Path]:
    """Of two trips, one frame each."""
    made = []
    for number in range(2):
        writer = late_log(log_of(directory, voyage[:10]), {"kind": "start"}, UTC_NS)
        writer.write_frame(encode_frame(voyage[20 + number]), voyage[20 + number], UTC_NS)
        writer.close()
        made.append(writer.path)
    return made


def test_a_trip_that_another_station_completed_keeps_no_other_from_it(
    tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = sorted(two_late_logs(tmp_path, voyage))

    def removed(trip: Path, late: Path) -> int:
        if late == first:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(late))
        return complete(trip, late)

    monkeypatch.setattr("shore.live.earlier_trips.complete", removed)
    complete_trips(tmp_path, print)
    assert (first.exists(), second.exists()) == (True, False)


def test_two_stations_complete_the_trips_of_a_directory_in_turn(
    tmp_path: Path, voyage: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    two_late_logs(tmp_path, voyage)
    said: list[str] = []
    others: list[threading.Thread] = []

    def slow(trip: Path, late: Path) -> int:
        if not others:  # another station ends in this very moment, and has to wait until this one is done
            asked = threading.Event()

            def waits() -> None:
                said.append("waits")
                asked.set()

            def other() -> None:
                with turn_in(tmp_path, waits):
                    said.append(f"{len(late_logs(tmp_path))} left")
                asked.set()

            others.append(threading.Thread(target=other))
            others[0].start()
            assert asked.wait(10.0)
        return complete(trip, late)

    monkeypatch.setattr("shore.live.earlier_trips.complete", slow)
    complete_trips(tmp_path, lambda _line: None)
    others[0].join(10.0)
    assert said == ["waits", "0 left"]


def test_a_log_that_has_lost_its_end_is_asked_for_once_more(tmp_path: Path, board: Board) -> None:
    log = session(tmp_path, board, 1.0)[0].log_path
    assert log is not None
    board.make(30)
    session(tmp_path, board, 2.0)
    newest = max(tmp_path.glob("*.mcap"))
    held = Cursor(tmp_path, "springer", print)
    held.close()
    before = seen(held)
    data = newest.read_bytes()
    newest.write_bytes(data[: len(data) // 2])
    said: list[str] = []
    cursor = Cursor(tmp_path, "springer", said.append)
    cursor.close()
    assert [f"{newest}: it has lost its end" in line for line in said] == [True]
    kept, in_log = seen(cursor), {frame.seq for frame in map(decode_frame, read_log(newest).frames())}
    assert kept >= in_log
    assert kept < before


def seen(cursor: Cursor) -> set[int]:
    ranges = [part for start in cursor.ledger.as_record() for part in start["seen"]]
    return {seq for first, last in ranges for seq in range(first, last + 1)}
