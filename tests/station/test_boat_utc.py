"""The laptop's clock is not UTC: names, lists and stamps come from the boat once it knows UTC; 1970 is no date."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from common.boat_start import StartOrder
from common.messages import Frame
from shore.live.earlier_trips import complete_trips
from shore.logbook.log_reader import read_log
from shore.logbook.summary import UtcOfClocks
from shore.trips.command import _info
from shore.trips.examine import examine
from shore.trips.listing import Trip, day, trip_of
from shore.trips.tables import info_screen, trips_table
from tests.station.journeys import PERIOD_NS, Board, session
from tests.station.logs import UTC_NS
from tests.station.test_journey import check_each_frame_once
from tests.strategies import frame_of

BEGAN_NS = UTC_NS + 10**9
"""The voyage begins a second after its boat's clock."""
BEGAN = f"{datetime.fromtimestamp(BEGAN_NS // 10**9, UTC):%Y%m%dT%H%M%SZ}"


@pytest.fixture
def board(voyage: list[Frame]) -> Board:
    return Board(voyage)


def test_a_log_is_named_by_the_boats_utc_when_the_laptop_is_wrong(tmp_path: Path, board: Board) -> None:
    run, said = session(tmp_path, board, 3.0)
    assert run.log_path == tmp_path / f"{BEGAN}-springer.mcap"
    assert run.log_path.exists()
    assert [line for line in said if "clock" in line] == [
        f"this station's clock is not the boat's UTC: the log is {run.log_path.name}"
    ]
    board.make(20)
    session(tmp_path, board, 2.0)
    complete_trips(tmp_path, print)
    check_each_frame_once(tmp_path, board)
    assert len(list(tmp_path.glob("*.mcap"))) == 2


def test_a_good_clock_of_the_laptop_gives_the_name(
    tmp_path: Path, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.time_ns", lambda: UTC_NS + board.t_ns + 50 * 10**9)
    run, said = session(tmp_path, board, 1.0)
    assert run.log_path is not None
    assert run.log_path.name == f"{datetime.fromtimestamp(BEGAN_NS // 10**9 + 50, UTC):%Y%m%dT%H%M%SZ}-springer.mcap"
    assert not any("clock" in line for line in said)


def test_lists_and_stamps_are_the_boats(tmp_path: Path, board: Board) -> None:
    run, _ = session(tmp_path, board, 5.0)
    assert run.log_path is not None
    begin_ns, end_ns = BEGAN_NS, BEGAN_NS + 50 * PERIOD_NS
    summary = trip_of(run.log_path, lambda _scan: None).summary
    assert (summary["utc_ns"], summary["end_utc_ns"]) == (begin_ns, end_ns)
    result = examine(run.log_path, lambda _scan: None)
    assert _info(result, with_config=False)["start_utc"].startswith(f"{datetime.fromtimestamp(begin_ns / 1e9, UTC):%F}")
    list(info_screen(result, with_config=False))
    stamps = [
        json.loads(record.data)["timestamp"]["sec"]
        for record in read_log(run.log_path).records()
        if record.topic.startswith(("/fixes/", "/position/", "/events"))
    ]
    assert len(stamps) > 5
    assert all(begin_ns // 10**9 <= second <= end_ns // 10**9 for second in stamps)


def test_1970_is_no_date(tmp_path: Path) -> None:
    assert [day(ns) for ns in (0, 5 * 10**9, 10**17, None)] == ["unknown date", "unknown date", "unknown date", "?"]
    assert day(UTC_NS) == f"{datetime.fromtimestamp(UTC_NS // 10**9, UTC):%Y-%m-%d %H:%M}"
    trip = Trip(tmp_path / "a.mcap", 1, "closed", True, {"utc_ns": 7})
    assert trip.as_record()["start_utc"] is None
    assert list(trips_table([trip], 80))


def test_the_best_source_of_a_clock_holds_and_clocks_are_kept_apart() -> None:
    clocks = UtcOfClocks(StartOrder())
    frame = replace(frame_of(), clock_id="a", start_no=2, t0_ns=10, t1_ns=20)
    clocks.take(frame)
    assert clocks.span() == (None, None)
    for source, utc_ns in (("rtc", 1000), ("gnss", 5010), ("ntp", 3000)):
        clocks.take(replace(frame, utc_src=source, utc_ns=utc_ns))
    assert (clocks.span(), clocks.of(15)) == ((5010, 5020), 5015)
    clocks.take(replace(frame, clock_id="b", start_no=1, t0_ns=700, t1_ns=800, utc_ns=4700, utc_src="gnss"))
    assert (clocks.span(), clocks.of(15)) == ((4700, 5020), None)
