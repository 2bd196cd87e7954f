"""What a stranger meets first: names that say the format, the newest trip, near names, lines that fit the terminal."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from common.command import sentence_of
from common.errors import WayfixError
from common.messages import Fix, Frame, Heading
from common.simulation.scenarios import find_scenario
from shore.exports.formats import FORMATS, format_of
from shore.lab.parallel_runs import Campaign, run_tasks
from shore.lab.tables import tables_of
from shore.link.catching_up import CatchingUp
from shore.pipeline import Output, Pipeline
from shore.settings.station import station_settings
from shore.watchers.newest import Newest
from shore.watchers.status import catching_up_text, status_text
from shore.watchers.watcher import SourceState
from tests.navigate.voyages import BOAT
from tests.station.exporting import export
from tests.station.logs import log_of

UTC_NS = 1_795_000_000 * 10**9


@pytest.mark.parametrize("name", FORMATS)
def test_the_ending_of_a_name_says_the_format(name: str) -> None:
    assert format_of(f"a/b.c/trip.{name.upper()}") == name


def test_a_name_that_says_no_format_is_asked_for_one() -> None:
    with pytest.raises(WayfixError, match=r"trip.gpy: the name says no format, did you mean gpx\?; give it an ending"):
        format_of("trip.gpy")


def test_a_directory_stands_for_its_newest_trip(
    tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    old = log_of(tmp_path / "logs", voyage[:50])
    new = log_of(tmp_path / "logs", voyage)
    new.rename(new.with_name("20990101T000000Z-springer.mcap"))
    assert old.exists()
    assert export(tmp_path / "logs", tmp_path / "track.gpx") == 0
    assert "20990101T000000Z-springer.mcap: the newest trip in" in capsys.readouterr().err
    assert (tmp_path / "track.gpx").read_text().count("<trkpt") > 50
    (tmp_path / "none").mkdir()
    with pytest.raises(WayfixError, match="holds no log"):
        export(tmp_path / "none", tmp_path / "other.gpx")


def test_a_near_name_is_named(tmp_path: Path, voyage: list[Frame]) -> None:
    log = log_of(tmp_path, voyage[:3])
    with pytest.raises(WayfixError) as refused:
        export(log.with_suffix(".mcp"), tmp_path / "track.gpx")
    assert f", did you mean {log.name}?" in sentence_of(refused.value)
    with pytest.raises(WayfixError, match=r"unknown filter 'fuzy', did you mean fuzzy\?"):
        station_settings(None, "fuzy", environ={})


@pytest.fixture(scope="module")
def newest(voyage: list[Frame]) -> Newest:
    line, pipeline = Newest(BOAT, "fuzzy"), Pipeline(BOAT, ("fuzzy",))
    for frame in voyage:
        line.take(frame, pipeline.push(frame))
    assert line.estimate is not None
    return line


@given(
    st.integers(0, 10**7),
    st.none() | st.floats(0, 10**6),
    st.none() | st.floats(0, 10**7),
    st.booleans(),
    st.sampled_from((None, "the board does not list this station")),
)
def test_the_status_line_is_one_line_of_80_columns(
    newest: Newest, missing: int, lost_s: float | None, left_s: float | None, has_log: bool, refusal: str | None
) -> None:
    lack = CatchingUp(missing, UTC_NS, UTC_NS + 3600 * 10**9, left_s)
    now = SourceState(10**6, missing, 3, lost_s, refusal, 12.0, has_log, catching_up=lack)
    text = status_text(newest, now, 80)
    assert len(text) <= 80
    assert "\n" not in text
    assert ("LINK LOST" in text) == (lost_s is not None)
    assert ("NO LOG" in text) == (not has_log)
    if lost_s is None:
        assert "°T" in text


def test_what_is_stale_is_said_before_what_is_well(newest: Newest) -> None:
    text = status_text(newest, SourceState(300, 0, round_trip_ms=3.0), 80)
    assert " 0 missing" in text
    assert "gps1" not in text
    later = replace(newest.fix or Fix(sensor="gps1", t_ns=0), t_ns=newest.t_ns - 9 * 10**9)
    old = Newest(BOAT, "fuzzy")
    heading = Heading(sensor="compass1", t_ns=newest.t_ns, heading_mag_deg=1.0)
    frame = replace(Frame(
        boat_id="b", boot_id="b", seq=1, clock_id="c", start_no=1, t0_ns=0, t1_ns=newest.t_ns
    ), fixes=(later,), headings=(heading,))  # fmt: skip
    old.take(frame, Output())
    assert "gps1 GPS STALE (9 s)" in status_text(old, SourceState(1, 0), 60)


@pytest.mark.parametrize(
    ("lack", "words"),
    [
        (CatchingUp(8327, UTC_NS, UTC_NS + 900 * 10**9, 63.0), "8,327 frames of 11:06 to 11:21, 1 min left"),
        (CatchingUp(80, UTC_NS, UTC_NS + 8 * 10**9, 2.4), "80 frames of 11:06:40 to 11:06:48, 2 s left"),
        (CatchingUp(1), "1 frame"),
    ],
)
def test_what_is_missing_is_said_with_its_time_and_how_long_it_takes(lack: CatchingUp, words: str) -> None:
    assert catching_up_text(lack) == f"catching up: {words}"


@pytest.mark.slow
def test_the_tables_of_the_laboratory_fit_80_columns() -> None:
    campaign = Campaign((find_scenario("5.3"),), ("ukf", "fuzzy-thesis"), 2, 1, "stated")
    (result,) = campaign.results(run_tasks(list(campaign.tasks()), 1, lambda: None))
    console = Console(width=80, record=True, file=StringIO())
    for part in tables_of(result):
        console.print(part)
    text = console.export_text()
    assert "…" not in text
    heads = [line.split() for line in text.splitlines() if line.startswith(("filter", "published"))]
    assert len(heads) == 5
    assert sum(line.startswith("fuzzy-thesis") for line in text.splitlines()) == 4 + 3
