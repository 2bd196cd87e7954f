"""A replay beside what was recorded: equal, different, missing, extra; the first difference by name."""

import json
from pathlib import Path

import pytest

from common.errors import WayfixError
from common.messages import Frame
from shore.logbook.log_reader import LogRecord
from shore.main import main
from shore.replay.run import Replay
from tests.station.logs import Done, log_of, rewritten


def test_a_changed_digit_is_found_and_named(tmp_path: Path, log: Path, voyage: list[Frame]) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if record.topic == "/estimates/ukf" and number in (70, 80):
            fields = record.json()
            return json.dumps(fields | {"sigma_east_m": 1.5, "digest": "0" * 16}).encode()
        return record.data

    done = Done(rewritten(log, tmp_path / "changed.mcap", change))
    counts = done.counts()
    assert (counts.equal, counts.different, counts.missing, counts.extra) == (len(voyage) - 2, 2, 0, 0)
    first = done.run.comparison and done.run.comparison.first
    assert first
    assert first.t_ns == voyage[70].t1_ns
    assert f"ukf at {first.t_s:.3f} s: sigma_east_m is " in str(first)
    assert "recorded was 1.5" in str(first)
    assert first.t_s == pytest.approx(7.1)


def test_a_log_of_other_filters_is_said_to_be_one(tmp_path: Path, log: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if record.topic == "/estimates/ukf":
            two = {"names": ["east_m", "north_m"], "state": [1.0, 2.0], "covariance": [1.0, 0.0, 1.0]}
            return json.dumps(record.json() | two | {"digest": "0" * 16}).encode()
        return record.data

    done = Done(rewritten(log, tmp_path / "old.mcap", change))
    assert done.run.comparison is not None
    assert str(done.run.comparison.first).endswith("recorded were 2: another version of Wayfix made the log")


def test_a_digit_that_the_log_does_not_store_counts_too(tmp_path: Path, log: Path, voyage: list[Frame]) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if record.topic == "/estimates/ukf" and number == 70:
            return json.dumps(record.json() | {"digest": "0" * 16}).encode()
        return record.data

    done = Done(rewritten(log, tmp_path / "changed.mcap", change))
    assert done.counts().different == 1
    assert done.run.comparison is not None
    assert "only digits that the log does not store" in str(done.run.comparison.first)


def test_what_is_missing_on_either_side_is_counted(tmp_path: Path, log: Path, voyage: list[Frame]) -> None:
    def change(record: LogRecord, number: int) -> bytes | None:
        is_lost = record.topic == "/estimates/ukf" and number in (3, 4, len(voyage) - 1)
        return None if is_lost or (record.topic == "/events" and number == 0) else record.data

    done = Done(rewritten(log, tmp_path / "lost.mcap", change))
    counts, events = done.counts(), done.run.comparison and done.run.comparison.events
    assert (counts.equal, counts.different, counts.missing, counts.extra) == (len(voyage) - 3, 0, 0, 3)
    assert events
    assert (events.extra, events.different, events.missing) == (1, 0, 0)
    frames = rewritten(
        log, tmp_path / "frames.mcap", lambda record, number: None if skipped(record, number) else record.data
    )
    done = Done(frames)
    counts = done.counts()
    assert counts.missing == 20
    assert counts.equal == 150
    assert counts.different > 0
    assert done.run.comparison is not None
    assert "in the log, but not made" in str(done.run.comparison.first)


def skipped(record: LogRecord, number: int) -> bool:
    return record.topic == "/frames" and 150 <= number < 170


def test_an_event_with_other_words_is_different(tmp_path: Path, log: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if record.topic == "/events" and number == 0:
            return json.dumps(record.json() | {"message": "other words"}).encode()
        return record.data

    comparison = Done(rewritten(log, tmp_path / "changed.mcap", change)).run.comparison
    assert comparison
    assert comparison.events
    assert (comparison.events.different, comparison.events.missing, comparison.events.extra) == (1, 0, 0)
    assert str(comparison.first).startswith("filter-started of filter at 0.100 s: text is filters start at ")
    assert str(comparison.first).endswith("recorded was other words")


def test_a_damaged_chunk_costs_its_frames_and_is_said(
    tmp_path: Path, voyage: list[Frame], capsys: pytest.CaptureFixture[str]
) -> None:
    path = log_of(tmp_path, voyage, synced=True)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert main(["replay", str(path), "--json"]) == 0
    said = capsys.readouterr()
    summary = json.loads(said.out.splitlines()[-1])
    assert 0 < summary["frames"]["read"] < len(voyage)
    assert str(path) in said.err
    assert "were replayed" in said.err


def test_an_estimate_of_another_version_is_different_and_no_error(tmp_path: Path, log: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if record.topic == "/estimates/ukf":
            return json.dumps({"filter": "ukf", "t_ns": record.publish_time_ns}).encode()
        return record.data

    counts = Done(rewritten(log, tmp_path / "old.mcap", change)).counts()
    assert counts.different == counts.recorded == counts.made > 0


def test_what_other_programs_write_beside_is_passed_over(tmp_path: Path, log: Path, voyage: list[Frame]) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        return b'{"message": "theirs"}' if record.topic == "/events" else record.data

    done = Done(rewritten(log, tmp_path / "theirs.mcap", change))
    assert done.counts().equal == len(voyage)


def test_a_session_without_configuration_is_a_sentence(tmp_path: Path, log: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        return b'{"kind": "start"}' if record.topic == "/session" else record.data

    with pytest.raises(WayfixError, match="has no configuration of the board"):
        Replay(rewritten(log, tmp_path / "none.mcap", change))


def test_a_log_without_estimates_is_replayed_and_nothing_is_compared(
    tmp_path: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def change(record: LogRecord, number: int) -> bytes | None:
        return record.data if record.topic in ("/frames", "/session") else None

    path = rewritten(log, tmp_path / "bare.mcap", change)
    assert main(["replay", str(path), "--json"]) == 0
    words = capsys.readouterr().out
    assert "estimates are not compared with recorded ones: the log holds none of these filters" in words
    summary = json.loads(words.splitlines()[-1])
    assert summary["estimates"]["made"] == summary["frames"]["read"]


def test_changed_numbers_of_the_boat_are_seen(tmp_path: Path, log: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        fields = record.json() if record.topic == "/session" else {}
        if fields.get("kind") != "start":
            return record.data
        fields["connected"]["config"]["sensor"][0]["sigma_m"] = 6.6
        return json.dumps(fields).encode()

    counts = Done(rewritten(log, tmp_path / "other.mcap", change)).counts()
    assert counts.different > 0.9 * counts.recorded


def test_another_filter_is_not_compared_and_a_further_one_does_not_disturb(log: Path) -> None:
    other, both = Done(log, filters=("kf",)), Done(log, filters=("kf", "ukf"))
    assert other.run.comparison is None
    assert other.run.why_not == "other filters ran"
    counts = both.counts()
    assert counts.equal == counts.recorded == counts.made == len(both.frames)
    assert both.run.comparison is not None
    assert both.run.comparison.events is None
