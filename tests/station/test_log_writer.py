"""What a log holds beside frames: summary, Foxglove's channels, a lock while it is written."""

import itertools
import json
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from common.errors import WayfixError
from common.events import event
from common.simulation.scenarios import scenario_voyage
from shore.logbook import foxglove
from shore.logbook.background_writer import LogRecorder
from shore.logbook.lock import is_being_written
from shore.logbook.log_writer import LogWriter, log_at, new_log
from shore.logbook.session import start_record, trip_record
from shore.pipeline import Pipeline
from tests.offline import frames_of, pushed

UTC_NS = 1_795_000_000_000_000_000


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A minute of a voyage with two filters."""
    path = tmp_path_factory.mktemp("log") / "trip.mcap"
    voyage = scenario_voyage("5.3", seed=1, seconds=60.0)
    pipeline = Pipeline(voyage.config, ["fuzzy", "ukf"])
    writer = log_at(path)
    writer.write_session(start_record({"config": {"boat": {"id": "springer"}}}, {"filters": ["fuzzy"]}, UTC_NS), UTC_NS)
    writer.write_session({"kind": "trip", "name": "sea trial", "place": "Solent"}, UTC_NS)
    for data, frame, output in pushed(pipeline, frames_of(voyage)):
        now_ns = UTC_NS + frame.t1_ns
        writer.write_frame(data, frame, now_ns)
        for estimate in output.estimates:
            writer.write_estimate(estimate.as_record(), now_ns)
        for happening in output.events:
            writer.write_event(happening, now_ns)
    writer.write_event(event("link-lost", 7, "link", age_s=3.5), UTC_NS + frame.t1_ns)
    writer.close()
    return path


def messages(path: Path, topic: str) -> list[dict[str, Any]]:
    with path.open("rb") as stream:
        return [json.loads(message.data) for _, _, message in make_reader(stream).iter_messages(topics=[topic])]


def test_every_message_fits_the_schema_of_its_channel(log: Path) -> None:
    seen = set()
    with log.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            if schema is not None:
                seen.add((channel.topic, schema.name))
                Draft202012Validator(json.loads(schema.data)).validate(json.loads(message.data))
    assert seen == {
        ("/session", "wayfix.Session"),
        ("/events", "foxglove.Log"),
        ("/fixes/gps1", "foxglove.LocationFix"),
        ("/position/fuzzy", "foxglove.LocationFix"),
        ("/position/ukf", "foxglove.LocationFix"),
        ("/estimates/fuzzy", "wayfix.Estimate"),
        ("/estimates/ukf", "wayfix.Estimate"),
    }


def test_foxglove_draws_one_valid_place_a_second_with_its_covariance(log: Path) -> None:
    places, estimates = messages(log, "/position/fuzzy"), messages(log, "/estimates/fuzzy")
    by_time = {item["t_ns"]: item for item in estimates}
    times = [place["t_ns"] for place in places]
    assert all(b - a == 10**9 for a, b in itertools.pairwise(times))
    valid = [item for item in estimates if "position" in item["aligned_parts"]]
    assert len(estimates) > len(valid)
    assert len(places) == pytest.approx(len(valid) / 10, abs=1)
    for place in places:
        same = by_time[place["t_ns"]]
        assert (place["latitude"], place["longitude"]) == (same["lat_deg"], same["lon_deg"])
        east, _, _, _, north = place["position_covariance"][:5]
        assert (east**0.5, north**0.5) == pytest.approx((same["sigma_east_m"], same["sigma_north_m"]), rel=1e-4)


def test_an_event_comes_back_whole() -> None:
    happening = event("link-lost", 7, "link", age_s=3.5)
    record = foxglove.log_record(happening, UTC_NS + 5)
    assert record["timestamp"] == {"sec": UTC_NS // 10**9, "nsec": 5}
    assert foxglove.event_of(record) == {name: getattr(happening, name) for name in happening.__slots__}
    old = {"t_ns": 7, "source": "link", "code": "link-lost", "level": "warning", "text": "...", "evidence": {}}
    assert foxglove.event_of(old) == old


def test_a_closed_log_ends_with_its_summary_which_other_programs_see_too(log: Path) -> None:
    last = messages(log, "/session")[-1]
    assert (last["kind"], last["name"], last["place"], last["boat"]) == ("summary", "sea trial", "Solent", "springer")
    assert last["frames"] == pytest.approx(610, abs=15)
    assert last["events"]["warning"] == 1
    assert 50.0 < last["distance_m"] < 200.0
    with log.open("rb") as stream:
        (metadata,) = make_reader(stream).iter_metadata()
    assert (metadata.name, metadata.metadata["name"]) == ("wayfix.trip", "sea trial")
    assert "note" not in metadata.metadata


def test_the_same_records_give_the_same_bytes(log: Path, tmp_path: Path) -> None:
    again = log_at(tmp_path / "again.mcap")
    other = log_at(tmp_path / "other.mcap")
    for writer in (again, other):
        writer.write_session({"kind": "start"}, UTC_NS)
        writer.close()
    assert (tmp_path / "again.mcap").read_bytes() == (tmp_path / "other.mcap").read_bytes()


def test_a_log_at_a_path_appears_when_it_is_closed_and_never_overwrites(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    writer = log_at(path)
    writer.write_session({"kind": "start"}, UTC_NS)
    assert not path.exists()
    writer.close()
    writer.close()
    assert list(tmp_path.iterdir()) == [path]
    before = path.read_bytes()
    with pytest.raises(WayfixError, match="exists already"):
        log_at(path)
    assert path.read_bytes() == before
    with pytest.raises(WayfixError, match="cannot be written"):
        log_at(tmp_path / "no" / "out.mcap")


def test_an_abandoned_log_leaves_nothing(tmp_path: Path) -> None:
    writer = log_at(tmp_path / "out.mcap")
    writer.write_session({"kind": "start"}, UTC_NS)
    writer.abandon()
    assert list(tmp_path.iterdir()) == []
    kept = log_at(tmp_path / "kept.mcap")
    kept.close()
    kept.abandon()
    assert list(tmp_path.iterdir()) == [tmp_path / "kept.mcap"]


def test_a_log_is_locked_while_it_is_written(tmp_path: Path) -> None:
    writer = new_log(tmp_path, "springer", UTC_NS)
    assert is_being_written(writer.path)
    writer.close()
    assert not is_being_written(writer.path)
    assert not is_being_written(tmp_path / "absent")


@pytest.mark.parametrize(
    ("name", "words"), [("\udcff", "no UTF-8"), ("x" * 201, "201 letters"), ("\x1b[31mred", "control characters")]
)
def test_a_name_that_no_screen_can_show_is_refused(name: str, words: str) -> None:
    with pytest.raises(WayfixError, match=f"--name: .*{words}"):
        trip_record(name, None, None)


def test_a_full_disk_names_the_log_and_promises_no_part_of_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    grown, at_once = new_log(tmp_path, "springer", UTC_NS), log_at(tmp_path / "out.mcap")
    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(WayfixError, match="what was written stays readable"):
        grown.sync()
    with pytest.raises(WayfixError) as caught:
        at_once.sync()
    monkeypatch.undo()
    assert str(caught.value).startswith(str(tmp_path / "out.mcap"))
    assert "stays readable" not in str(caught.value)
    grown.close()
    at_once.abandon()


def test_the_run_goes_on_without_a_log_and_knows_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    recorder = LogRecorder(tmp_path, "springer", said.append)
    recorder.write(LogWriter.sync)
    assert recorder.fault is None

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    recorder.write(LogWriter.sync)
    recorder.write(LogWriter.sync)
    monkeypatch.undo()
    assert "No space left" in str(recorder.fault)
    assert len(said) == 1
    recorder.close()


def test_a_slow_disk_delays_nothing_and_the_cursor_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder, is_free, done = LogRecorder(tmp_path, "springer", print), Event(), list[str]()
    monkeypatch.setattr("os.fsync", lambda _descriptor: is_free.wait(20.0))
    recorder.sync(lambda: lambda: done.append("first"))
    recorder.sync(lambda: lambda: done.append("left out: the disk is busy"))
    assert recorder.behind_s > 0.0
    assert done == []
    is_free.set()
    recorder.sync(lambda: lambda: done.append("last"), wait=True)
    recorder.close()
    assert done == ["first", "last"]
    assert recorder.behind_s == 0.0


def test_a_sync_that_fails_beside_the_run_ends_the_log_and_moves_no_cursor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    recorder = LogRecorder(tmp_path, "springer", said.append)

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    recorder.sync(lambda: lambda: said.append("cursor"))
    recorder.sync(lambda: lambda: said.append("cursor"), wait=True)
    monkeypatch.undo()
    assert "No space left" in str(recorder.fault)
    assert len(said) == 1
    recorder.close()


def test_a_trip_has_only_the_words_that_were_given() -> None:
    assert trip_record(None, None, "") is None
    assert trip_record("a", None, None) == {"kind": "trip", "name": "a"}
