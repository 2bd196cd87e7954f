"""A cursor that is gone, damaged, hostile or of another boat: the logs beside it say what is here."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import CodecError
from common.link_messages import MAX_RUNS, check_end, check_greeting
from common.messages import Frame
from shore.link.frame_ledger import MAX_STARTS, Ledger
from shore.live.cursor import Cursor
from shore.live.earlier_trips import complete_trips
from shore.logbook.log_reader import read_log
from tests.cases import CASES, needs_cases
from tests.station.journeys import Board, session
from tests.station.test_journey import check_each_frame_once

ATTACKS = ("cursor-empty", "cursor-infinity.json", "cursor-names-no-log.json", "cursor-upto-1e30.json")

DEEP = b'{"cursor":' * 5000


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def changed(**more: Any) -> Callable[[bytes], bytes]:
    return lambda content: json.dumps({**json.loads(content), **more}).encode()


def with_start(**more: Any) -> Callable[[bytes], bytes]:
    def change(content: bytes) -> bytes:
        record = json.loads(content)
        record["starts"][0] |= more
        return json.dumps(record).encode()

    return change


HARM: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _content: b"",
    "zeroes": lambda content: bytes(len(content)),
    "cut": lambda content: content[: len(content) // 2],
    "no JSON": lambda _content: b"\xff\xfe\x00",
    "deep": lambda _content: DEEP,
    "huge number": lambda _content: b'{"cursor":1,"log_time_ns":' + b"9" * 10_000 + b"}",
    "a list": lambda _content: b"[1, 2]",
    "another boat": changed(boat_id="other"),
    "another form": changed(cursor=2),
    "infinite": lambda content: content.replace(b'"log_time_ns":', b'"log_time_ns":Infinity,"x":'),
    "negative": with_start(first=-100),
    "beyond": with_start(upto=10**30),
    "real": with_start(upto=1e30),
    "backwards": with_start(seen=[[5, 2]]),
    "odd ranges": with_start(seen=[5]),
    "no text": with_start(boot_id=5),
    "a path": changed(log="../../etc/passwd"),
    "a trip elsewhere": with_start(trips=[[0, "../other.mcap"]]),
    "lost less than none": changed(forgotten=-1),
    "a log that is gone": changed(log="20200101T000000Z-springer.mcap"),
    "no log": changed(log="springer.cursor"),
}


@pytest.mark.parametrize("harm", [*HARM, "gone", "directory"])
def test_whatever_the_cursor_holds_each_frame_is_fetched_once(harm: str, tmp_path: Path, board: Board) -> None:
    session(tmp_path, board, 3.0)
    board.make(30)
    board.reboot()
    board.make(20)
    cursor = tmp_path / "springer.cursor"
    content = cursor.read_bytes()
    cursor.unlink()
    if harm == "directory":
        cursor.mkdir()
    elif harm != "gone":
        cursor.write_bytes(HARM[harm](content))
    _, said = session(tmp_path, board, 4.0)
    if harm != "directory":
        complete_trips(tmp_path, print)
        check_each_frame_once(tmp_path, board)
    assert any("1 log of this boat" in line for line in said)
    assert any(str(cursor) in line for line in said) == (harm != "gone")


def test_a_cursor_of_an_older_backup_does_not_know_the_logs_beside_it(tmp_path: Path, board: Board) -> None:
    cursor = tmp_path / "springer.cursor"
    session(tmp_path, board, 2.0)
    older = cursor.read_bytes()
    board.make(30)
    session(tmp_path, board, 2.0)
    board.make(30)
    board.restart()
    session(tmp_path, board, 2.0)
    cursor.write_bytes(older)
    board.make(30)
    _, said = session(tmp_path, board, 2.0)
    assert any(f"{cursor}: it does not know the log " in line for line in said)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)
    _, said = session(tmp_path, board, 1.0)
    assert not any(str(cursor) in line for line in said), "it is made again"


def test_the_newest_log_that_was_removed_while_no_station_ran_is_fetched_again(tmp_path: Path, board: Board) -> None:
    session(tmp_path, board, 2.0)
    board.make(30)
    newest = session(tmp_path, board, 2.0)[0].log_path
    assert newest is not None
    newest.unlink()
    _, said = session(tmp_path, board, 2.0)
    assert any(f"it is of the log {newest.name}, which is not there any more" in line for line in said)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)


def test_logs_that_were_all_moved_away_are_not_fetched_again(tmp_path: Path, board: Board) -> None:
    logs, archive = tmp_path / "logs", tmp_path / "archive"
    archive.mkdir()
    for _ in range(2):
        log = session(logs, board, 2.0)[0].log_path
        assert log is not None
        log.rename(archive / log.name)
        board.make(30)
    log = session(logs, board, 2.0)[0].log_path
    held = [len(list(read_log(each).frames())) for each in archive.iterdir()]
    assert sorted(held) == [20, 20]


def test_what_a_station_that_died_left_of_its_cursor_is_removed(tmp_path: Path, board: Board) -> None:
    tmp_path.joinpath(".springer.cursor.4711.part").write_bytes(b"{")
    tmp_path.joinpath(".other.cursor.4711.part").write_bytes(b"{")
    session(tmp_path, board, 1.0)
    assert [path.name for path in tmp_path.glob(".*.part")] == [".other.cursor.4711.part"]


def test_a_cursor_keeps_what_is_lost_of_starts_that_it_forgot(tmp_path: Path) -> None:
    cursor = Cursor(tmp_path, "springer", print)
    cursor.ledger.forgotten = 7
    cursor.saver(tmp_path / "a.mcap", 1)()
    cursor.close()
    again = Cursor(tmp_path, "springer", print)
    again.close()
    assert again.ledger.gone_count == 7


@needs_cases
@pytest.mark.parametrize("name", ATTACKS)
def test_attack_cursor(name: str, tmp_path: Path, board: Board) -> None:
    session(tmp_path, board, 3.0)
    board.make(30)
    (tmp_path / "springer.cursor").write_bytes((CASES / "attack" / name).read_bytes())
    session(tmp_path, board, 3.0)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)


def test_a_log_that_cannot_be_read_is_asked_for_once_more(tmp_path: Path, board: Board) -> None:
    log = session(tmp_path, board, 3.0)[0].log_path
    assert log is not None
    (tmp_path / "springer.cursor").unlink()
    content = bytearray(log.read_bytes())
    content[len(content) // 2 :] = bytes(len(content) - len(content) // 2)
    log.write_bytes(content)
    _, said = session(tmp_path, board, 3.0)
    held = {seq for each in tmp_path.glob("*.mcap") for seq in range(len(list(read_log(each).frames())))}
    assert said
    assert len(held) >= 30


def test_without_a_log_nothing_older_is_asked_for(tmp_path: Path, board: Board) -> None:
    board.make(30)
    (tmp_path / "springer.cursor").write_bytes(b"")
    run, said = session(tmp_path, board, 2.0)
    assert "no log is beside it: frames are asked for from now on" in said[0]
    assert run.tally.received == 20


def test_two_boats_share_no_file(tmp_path: Path) -> None:
    cursors = [Cursor(tmp_path, boat_id, print) for boat_id in ("böat", "bäat", "boat", "b oat")]
    for cursor in cursors:
        cursor.saver(tmp_path / "a.mcap", 1)()
        cursor.close()
    assert len(list(tmp_path.glob("*.cursor"))) == 4


def test_300_starts_while_the_station_is_away(tmp_path: Path, board: Board) -> None:
    session(tmp_path, board, 1.0)
    board.has_sensors = False
    for number in range(300):
        board.make(2)
        if number % 2:
            board.reboot()
        else:
            board.restart()
    session(tmp_path, board, 15.0, fill=200)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)


def test_more_starts_than_a_greeting_lists_are_said(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    session(tmp_path, board, 1.0)
    for _ in range(12):
        board.make(3)
        board.restart()
    monkeypatch.setattr("tests.station.journeys.MOST_RUNS", 5)
    run, said = session(tmp_path, board, 2.0)
    (told,) = [line for line in said if "frames that are lost" in line]
    assert "the boat holds 8 more starts of its daemon than it lists; frames that are lost: 34" in told
    assert run.tally.holes.lost == 34
    _, said = session(tmp_path, board, 2.0)
    assert not any("more starts" in line for line in said), "these starts are known now"


def test_a_board_that_holds_nothing_that_this_station_knows_has_lost_frames(tmp_path: Path, board: Board) -> None:
    """Its spool was removed, or has rolled on for weeks: which frames came after the last one that is known, if any?"""
    session(tmp_path, board, 1.0)
    known = board.boot_id
    board.restart()
    board.make(20)
    _, said = session(tmp_path, board, 1.0)
    assert not any("frames that are lost" in line for line in said)
    for name in (known, board.boot_id):
        del board.made[name]
    board.restart()
    _, said = session(tmp_path, board, 1.0)
    (told,) = [line for line in said if "frames that are lost" in line]
    assert "no start of its daemon that this station knows; frames that are lost: nobody knows how many" in told


def test_a_start_that_is_not_remembered_any_more_counts_as_lost() -> None:
    ledger = Ledger()
    ledger.greet("0", 0, [])
    ledger.take("0", 0, 9)
    for number in range(1, MAX_STARTS + 1):
        ledger.greet(f"{number:x}", 5, [])
    assert ledger.gone_count == 0
    ledger.greet("ffff", 5, [])
    ledger.greet("fffe", 5, [])
    assert ledger.gone_count == 10, "of these two starts nothing had come"


GREETING: dict[str, Any] = {
    "boot_id": "1", "next_seq": 3, "config": {}, "runs": [["1", 1, 0, 3]], "sensors": [{"id": "gps1"}],
    "unlisted": [0, 0],
}  # fmt: skip


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("runs", 5), ("runs", [5]), ("runs", [["1", 1, 0]]), ("runs", [["x", 1, 0, 3]]), ("runs", [["1", 1, -1, 3]]),
        ("next_seq", "x"), ("next_seq", -1), ("next_seq", 2**70), ("next_seq", True), ("boot_id", 5), ("config", None),
        ("sensors", None), ("sensors", ["gps1"]), ("clock_rate", "fast"), ("clock_rate", 0),
        ("clock_rate", float("nan")),
        ("unlisted", 5), ("unlisted", [1]), ("unlisted", ["a", 1]),
    ],
)  # fmt: skip
def test_a_greeting_of_another_shape_names_its_field(field: str, value: Any) -> None:
    check_greeting(GREETING)
    with pytest.raises(CodecError, match=field if field != "runs" else "runs|boot_id|first_seq"):
        check_greeting({**GREETING, field: value})


ANY = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from([*GREETING, "clock_rate", "sent", "reason"]), ANY))
def test_any_greeting_and_end_is_one_sentence(fields: dict[str, Any]) -> None:
    for check in (check_greeting, check_end):
        try:
            check({**GREETING, **fields})
        except CodecError as error:
            assert error.what.isprintable()  # noqa: PT017 - most are refused, some are not


def test_a_greeting_of_a_thousand_starts_is_read(board: Board) -> None:
    check_greeting({**GREETING, "runs": [[f"{number:016x}", number, 0, 2**40] for number in range(MAX_RUNS)]})
