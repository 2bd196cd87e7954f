"""Archives: a recording of past years is believed, and dated by the clock that leads it."""

import math
from pathlib import Path

import pytest

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.settings import convert
from shore.logbook.log_reader import read_log
from shore.navigation.measurements import Reader, TrueHeading
from tests.acquire.test_recording_clocks import START, later, said, stream
from tests.cases import CASES, needs_cases
from tests.station.imports import Importer


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def codes(out: Path) -> set[str]:
    """Events of the log's frames."""
    frames = (decode_frame(record.data) for record in read_log(out).records("/frames"))
    return {event.code for frame in frames for event in frame.events}


@needs_cases
def test_old_log_2014(importer: Importer) -> None:
    found = importer(CASES / "shore" / "old-log-2014.nmea")
    assert found.summary["utc"] == "2014-08-21T16:18:03+00:00"
    assert not codes(found.out) & {"week-rollover", "date-refused", "week-rollover-repaired"}
    reader = Reader(
        convert(found.session[0]["connected"]["config"], BoatConfig, "boat", strict=False), lambda told: None
    )
    headings = [item for frame in found.frames for item in reader.read(frame) if isinstance(item, TrueHeading)]
    assert len(headings) == 40
    # 86.8 and 87.0 magnetic; variation 1.25 east by WMM2010.
    assert {round(math.degrees(item.heading_rad), 1) for item in headings} == {88.1, 88.3}


@needs_cases
@pytest.mark.parametrize("is_told", [True, False])
def test_two_rollovers(importer: Importer, tmp_path: Path, is_told: bool) -> None:
    config = tmp_path / "boat.toml"
    config.write_text(
        '[boat]\nid = "b"\n[[port]]\nname = "p"\npath = "/dev/p"\n[[sensor]]\nid = "gps1"\nport = "p"\nrole = "gps"\n'
        f"week_rollover = {str(is_told).lower()}\n"
    )
    found = importer(CASES / "board" / "two-rollovers.nmea", "--config", str(config))
    assert ("week-rollover-repaired" if is_told else "week-rollover") in codes(found.out)
    assert ("week_rollover = true" in found.words) != is_told
    if is_told:
        assert found.summary["utc"] == "2026-08-29T12:00:00+00:00"


@needs_cases
@pytest.mark.parametrize(
    ("name", "utc", "long_s"),
    [
        ("shore/gll-local-time", "2026-05-12T10:08:00+00:00", 20),
        ("shore/zda-local-time", "2026-05-12T10:08:00+00:00", 40),
        ("shore/plotter-repeats", "2026-05-12T10:08:00+00:00", 100),
        ("board/tag-block-times", "2026-11-30T12:00:00+00:00", 50),
        ("board/time-before-compass", "2026-11-30T12:00:00+00:00", 50),
        ("board/time-behind-sentence", "2026-11-30T12:00:00+00:00", 50),
    ],
)
def test_an_import_goes_by_one_clock_and_names_the_others(
    name: str, utc: str, long_s: float, importer: Importer
) -> None:
    found = importer(CASES / f"{name}.nmea")
    assert found.summary["utc"] == utc
    assert found.summary["seconds"] == pytest.approx(long_s, abs=3.0)
    for clock in found.summary["clocks"]:
        assert clock["names"][0] in found.words


def test_files_in_the_wrong_order_are_one_log(importer: Importer) -> None:
    lines = [*stream(start=later(minutes=20)), *stream()]
    found = importer.text(b"\r\n".join(lines))
    assert found.summary["utc"] == START.isoformat()
    assert len({fix.utc_ns - fix.t_ns for fix in found.fixes if fix.utc_ns is not None}) == 1
    assert "put in that order" in found.words


def test_a_receiver_that_loses_its_weeks_on_the_way_keeps_its_date(importer: Importer) -> None:
    lines = [said("GP", "RMC", later(weeks=-500 - 1024 * (k > 20), seconds=k)) for k in range(40)]
    found = importer.text(b"\r\n".join(lines))
    assert "week-rollover-repaired" in codes(found.out)
    assert found.summary["utc"] == later(weeks=-500).isoformat()
    assert found.frames[-1].clk_epoch == 0
