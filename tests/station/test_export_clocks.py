"""Which UTC the rows of an export have: clocks of boards, of receivers and of imports."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest
from fastkml.validator import validate
from hypothesis import given
from hypothesis import strategies as st

from common.codec import encode_frame
from common.messages import Frame
from shore.exports.utc import BoardClock, Clocks
from shore.logbook.log_writer import log_at
from shore.logbook.session import start_record
from tests.station.exporting import (
    NS,
    UTC_NS,
    empty_frame,
    estimate,
    export,
    gpx_of,
    kml_features,
    log_of,
    mcap_messages,
    rows_of,
    sentences,
)


def clock(*frames: Frame) -> BoardClock:
    made = BoardClock(0, 0, 0.0)
    for frame in frames:
        made.told(frame)
    made.settle()
    return made


def frame_at(t_s: float, offset_s: float, source: str = "gnss", epoch: int = 0) -> Frame:
    frame = empty_frame(t_s + 0.1, utc_src=source, clk_epoch=epoch)
    return replace(frame, utc_ns=frame.t0_ns + round(offset_s * NS))


def test_the_first_minutes_get_utc_from_when_it_was_known() -> None:
    """The board's own clock was an hour wrong until the receiver told it; nothing goes by it then."""
    made = clock(*(frame_at(t_s, 5000.0, "rtc") for t_s in (0, 15)), frame_at(30, 8600.0, epoch=1))
    assert made.utc_ns(0) == 8600 * NS
    assert made.utc_ns(60 * NS) == 8660 * NS


def test_a_date_of_another_year_that_a_receiver_told_for_a_while_is_no_utc() -> None:
    told = [frame_at(0, 4e8), *(frame_at(t_s, 1000.0, epoch=1) for t_s in (20, 30, 40))]
    assert clock(*told).utc_ns(0) == 1000 * NS
    assert clock(*told[:1]).utc_ns(0) == 400_000_000 * NS


def test_between_two_knots_utc_is_a_straight_line_and_after_a_step_the_nearer_holds() -> None:
    drift = clock(frame_at(0, 1000.0), frame_at(100, 1000.5))
    assert drift.utc_ns(50 * NS) == 1_050_250_000_000
    assert [drift.utc_ns(t_s * NS) for t_s in (-10, 110)] == [990 * NS, 1_110_500_000_000]
    step = clock(frame_at(0, 1000.0), frame_at(100, 2000.0, epoch=1))
    assert [step.utc_ns(t_s * NS) for t_s in (49, 51)] == [1049 * NS, 2051 * NS]
    backfilled = clock(frame_at(100, 1000.5), frame_at(0, 1000.0), frame_at(200, 1000.5))
    assert backfilled.utc_ns(50 * NS) == 1_050_250_000_000
    soon = clock(frame_at(0, 1000.0), frame_at(2, 2000.0, epoch=1))
    assert [soon.utc_ns(t_s * NS) for t_s in (0, 2)] == [1000 * NS, 2002 * NS]


@given(st.lists(st.tuples(st.integers(0, 10_000), st.floats(-0.5, 0.5)), min_size=2, max_size=30))
def test_utc_never_goes_back_while_the_mapping_is_one(told: list[tuple[int, float]]) -> None:
    made = clock(*(frame_at(20.0 * t_s, 1e6 + offset_s) for t_s, offset_s in told))
    found = [made.utc_ns(t_s * NS) for t_s in range(0, 200_000, 997)]
    assert all(a is not None and b is not None and a < b for a, b in itertools.pairwise(found))


def test_a_live_log_without_utc_goes_by_its_quickest_arrivals(tmp_path: Path) -> None:
    lags = (0.3, 0.05, 0.4, 0.2)
    plain = [replace(empty_frame(t_s), utc_ns=None, utc_src="none") for t_s in range(1, 5)]
    made = Clocks(None)
    for frame, lag_s in zip(plain, lags, strict=True):
        made.came(made.of_frame(frame), frame.t1_ns, UTC_NS + frame.t1_ns + round(lag_s * NS))
    made.settle()
    assert made.know_utc
    assert made.all[0].utc_ns(3 * NS) == UTC_NS + 3 * NS + 50_000_000


def test_an_import_with_a_date_goes_by_what_it_says(tmp_path: Path) -> None:
    """Its frames had no UTC, its arrivals are the recording's own."""
    log = tmp_path / "log.mcap"
    writer = log_at(log)
    connected = {"config": {"boat": {"id": "x"}}, "file": {"clock": "own"}}
    writer.write_session(start_record(connected, {"filters": ["ukf"]}, UTC_NS), UTC_NS)
    frame = replace(empty_frame(1.0), utc_ns=None, utc_src="none")
    writer.write_frame(encode_frame(frame), frame, UTC_NS + 5)
    writer.write_estimate(estimate(1.0, 50.0, 1.0), UTC_NS + 5)
    writer.close()
    assert export(log, "--to", "gpx", tmp_path / "a.gpx") == 0
    (point,) = gpx_of(tmp_path / "a.gpx").tracks[0].segments[0].points
    assert point.time.timestamp() == UTC_NS / NS


def test_arrivals_before_2000_are_no_utc() -> None:
    made = Clocks(None)
    frame = replace(empty_frame(1.0), utc_ns=None, utc_src="none")
    made.came(made.of_frame(frame), frame.t1_ns, frame.t1_ns)
    made.settle()
    assert not made.know_utc


def test_a_recording_without_date_says_so_and_has_no_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at_s = 13 * 3600 + 5 * 60 + 6.5
    items = [estimate(at_s + second, 50.0, 1.0) for second in range(3)]
    log = log_of(tmp_path / "log.mcap", items, {"clock": "utc-time-of-day"})
    for kind in ("csv", "gpx", "kml", "geojson", "nmea", "mcap", "parquet", "png"):
        assert export(log, "--to", kind, tmp_path / f"a.{kind}") == 0
        said = capsys.readouterr().out
        assert "the log knows the time of day, but no date: times are seconds of the log" in said
    assert {row["utc"] for row in rows_of(tmp_path / "a.csv")} == {""}
    assert {point.time for point in gpx_of(tmp_path / "a.gpx").tracks[0].segments[0].points} == {None}
    assert validate(file_to_validate=tmp_path / "a.kml")
    (line,) = (feature.geometry for feature in kml_features(tmp_path / "a.kml") if hasattr(feature, "geometry"))
    assert len(list(line.geoms)) == 1
    whole = json.loads((tmp_path / "a.geojson").read_text(encoding="utf-8"))
    assert whole["features"][0]["properties"]["begin_utc"] is None
    gga, rmc, *_ = sentences(tmp_path / "a.nmea")
    assert (gga.data[0], rmc.data[0], rmc.data[8]) == ("130506.500", "130506.500", "")
    first = mcap_messages(tmp_path / "a.mcap", "/position/ukf")[0]
    assert first["timestamp"] == {"sec": 0, "nsec": 100_000_000}


def test_a_recording_without_times_gives_sentences_without_times(tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.mcap", [estimate(1.0, 50.0, 1.0)], {"clock": "from-zero"})
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    gga, rmc, hdt = sentences(tmp_path / "a.nmea")
    assert (gga.data[0], rmc.data[0], rmc.data[8], hdt.data[0]) == ("", "", "", "12.500")


def test_seconds_go_on_over_a_reboot_as_in_replay() -> None:
    made = Clocks(None)
    first = made.of_frame(empty_frame(10.0))
    made.came(first, 70 * NS, UTC_NS)
    second = made.of_frame(empty_frame(5.0, clock_id="c2", boot_id="b2"))
    assert first.seconds(20 * NS) == pytest.approx(10.1)
    assert second.seconds(6 * NS) == pytest.approx(60.1 + 1.1)
    assert made.of_boot("b1", 0) is first
    assert made.of_boot("unknown", 0) is second
