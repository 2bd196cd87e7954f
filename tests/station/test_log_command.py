"""`wayfix log`: what people and programs are told, at every width, and the exit codes."""

import dataclasses
import json
import tomllib
from pathlib import Path

import pytest

from common.codec import encode_frame
from common.errors import WayfixError
from common.events import event
from common.messages import Frame
from common.toml_text import toml_lines
from shore.logbook.log_writer import new_log
from shore.logbook.missing_frames import Census, light_frame
from shore.terminal import say, tell
from tests.station.log_commands import answer, harmed, put, wayfix_log
from tests.station.log_files import EACH_NS, START, UTC_NS, frame, log_bytes, other_writer
from tests.strategies import frame_of

HOUR_NS = 3600 * 10**9


@pytest.fixture
def trips(tmp_path: Path) -> Path:
    directory = tmp_path / "logs"
    directory.mkdir()
    named = new_log(directory, "springer", UTC_NS + HOUR_NS)
    named.write_session({**START, "utc_ns": UTC_NS + HOUR_NS}, UTC_NS + HOUR_NS)
    named.write_session({"kind": "trip", "name": "sea trial [1/2]", "place": "Solent"}, UTC_NS + HOUR_NS)
    for number in range(15):
        happening = event("link-lost", 7 + number, "link", age_s=float(number))
        named.write_event(happening, UTC_NS + HOUR_NS + number * EACH_NS)
    named.close()
    put(directory / "old.mcap", log_bytes(100))
    put(directory / "cut.mcap", log_bytes(100)[:-12_000])
    put(directory / "notes.mcap", b"no log at all")
    (directory / ".hidden.mcap.1.part").write_bytes(b"")
    (directory / "notes.txt").write_text("x")
    return directory


def test_ls_lists_trips_newest_first(trips: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert wayfix_log("ls", trips, "--json") == 0
    rows = answer(capsys)["trips"]
    assert Path(rows[0]["log"]).name == "20261118T120640Z-springer.mcap"
    by_name = {Path(row["log"]).name: row for row in rows}
    assert set(by_name) == {"20261118T120640Z-springer.mcap", "old.mcap", "cut.mcap", "notes.mcap"}
    old = by_name["old.mcap"]
    assert (old["state"], old["seconds"], old["boat"], old["frames"]) == ("closed", 10.0, "springer", 100)
    assert old["start_utc"] == "2026-11-18T11:06:40.000Z"
    assert old["distance_m"] == pytest.approx(1000, rel=0.2)
    assert by_name["cut.mcap"]["state"] == "cut"
    assert 50 < by_name["cut.mcap"]["frames"] < 100
    assert by_name["notes.mcap"]["state"] == "not an MCAP log"
    assert rows[0]["name"] == "sea trial [1/2]"


def test_ls_of_closed_logs_reads_no_record(
    trips: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert wayfix_log("recover", trips / "cut.mcap") == 0
    monkeypatch.setattr("shore.trips.listing.examine", None)
    logs = [path for path in trips.glob("*.mcap") if path.name not in ("cut.mcap", "notes.mcap")]
    assert wayfix_log("ls", *logs, "--json") == 0
    states = {Path(row["log"]).name: (row["state"], row["boat"]) for row in answer(capsys)["trips"]}
    assert len(states) == 3
    assert set(states.values()) == {("closed", "springer")}


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_screens_fit_the_terminal(
    trips: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    put(trips / "old.mcap", harmed(log_bytes(100), 3, 5))
    assert wayfix_log("ls", trips) == 0
    listing = capsys.readouterr().out
    for log in trips.glob("*.mcap"):
        assert log.name in listing
    if width != 120:  # there the words need a second line
        assert "sea trial [1/2], Solent" in listing
    assert wayfix_log("info", trips / "20261118T120640Z-springer.mcap") == 0
    assert wayfix_log("info", trips / "cut.mcap") == 0
    assert wayfix_log("verify", trips / "old.mcap") == 1
    shown = listing + capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= width


def test_info_tells_trip_sensors_warnings_and_versions(trips: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert wayfix_log("info", trips / "20261118T120640Z-springer.mcap", "--config", "--json") == 0
    said = capsys.readouterr().out
    assert "sea trial [1/2]" in said
    assert "gps1    gps   nmea   1 Hz" in said
    assert "wayfix 0.1.0" in said
    told = json.loads(said.splitlines()[-1])
    assert told["trip"]["place"] == "Solent"
    assert told["config"]["boat"]["id"] == "springer"
    assert [warning["evidence"]["age_s"] for warning in told["warnings"]] == [float(n) for n in range(5, 15)]
    assert said.count("no frame from the boat") == 2 * 10
    config = said[said.index("[boat]") :].rsplit("\n", 2)[0]
    assert tomllib.loads(config) == START["connected"]["config"]  # type: ignore[index]


def test_info_of_a_damaged_log_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = put(tmp_path / "a.mcap", harmed(log_bytes(100), 3))
    assert wayfix_log("info", path) == 0
    said = capsys.readouterr().out
    assert "31 records lost from 2026-11-18 11:06:42.100 UTC" in " ".join(said.split())
    assert "90; 10 frames are not stored: the log had ended, or its file lost them" in " ".join(said.split())


def test_info_of_a_log_of_another_program(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = put(tmp_path / "a.mcap", other_writer(topics=("/frames", "/session", "/events", "/estimates/x")))
    assert wayfix_log("info", path, "--json") == 0
    assert wayfix_log("verify", path, "--json") == 0
    (report,) = answer(capsys)["logs"]
    assert report["not_understood"] == {"/estimates/x": 15, "/events": 15, "/frames": 15, "/session": 15}


def test_recover_and_name_say_what_they_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = put(tmp_path / "a.mcap", harmed(log_bytes(100), 3))
    with pytest.raises(WayfixError, match=r"is damaged; `wayfix log recover /\S+/a.mcap`"):
        wayfix_log("name", path, "--name", "x")
    assert wayfix_log("recover", path, "--name", "x", "--json") == 0
    said = capsys.readouterr().out
    assert "read back and equal to what is sound in a.mcap" in said
    assert "31 records lost from" in said
    told = json.loads(said.splitlines()[-1])
    assert told["source"]["losses"][0]["records"] == 31
    out = Path(told["log"])
    assert wayfix_log("verify", out) == 0
    assert wayfix_log("name", out, "--place", "Solent") == 0
    assert wayfix_log("verify", out) == 0
    capsys.readouterr()
    assert wayfix_log("ls", out, "--json") == 0
    (trip,) = answer(capsys)["trips"]
    assert (trip["name"], trip["place"], trip["boat"]) == ("x", "Solent", "springer")
    with pytest.raises(WayfixError, match="give --name, --place or --note"):
        wayfix_log("name", out)
    with pytest.raises(WayfixError, match="no such file or directory"):
        wayfix_log("ls", tmp_path / "absent")


def test_census_counts_frames_whatever_their_order() -> None:
    census = Census()
    census.expect("0123456789abcdef", 3)
    for seq in (9, 8, 20, 5, 6, 7, 9):
        census.frame(frame(seq))
    assert census.holes(0) == (0, 0, 0, 2 + 10)
    census.frame(frame_of(seq=19, first_seq=10))
    assert census.holes(0) == (0, 0, 0, 2)
    census.frame(frame_of(seq=0, boot_id="b2"))
    census.file_lost_something()
    census.frame(frame_of(seq=5, boot_id="b2"))
    assert census.holes(None) == (0, 0, 4, 2)
    assert census.holes(3) == (0, 0, 3, 3)


def test_a_light_frame_has_what_a_summary_needs() -> None:
    whole: Frame = frame(7)
    light = light_frame(encode_frame(whole))
    for name in ("boat_id", "boot_id", "seq", "first_seq", "clock_id", "start_no", "t0_ns", "t1_ns"):
        assert getattr(light, name) == getattr(whole, name)
    assert [fix.usable for fix in light.fixes] == [fix.usable for fix in whole.fixes]
    held = dataclasses.replace(whole, fixes=(dataclasses.replace(whole.fixes[0], held=True),))
    assert [fix.usable for fix in light_frame(encode_frame(held)).fixes] == [False]


def test_configuration_is_shown_as_toml_that_reads_back() -> None:
    config = {
        "boat": {"id": 'a "b" \\ c\n\x1b\u202e', "variation_deg": None},
        "port": [{"name": "p", "baud": 4800, "use": ["x", "y"], "is": True}, {"name": "q", "share": 0.1}],
        "empty": [],
    }
    read = tomllib.loads("\n".join(toml_lines(config)))
    assert read == {"boat": {"id": 'a "b" \\ c\n\x1b\u202e'}, "port": config["port"], "empty": []}


def test_words_of_files_and_logs_cannot_steer_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    tell("a\x1b[31m.mcap: 3 frames\n\u202eb 5\u00b0")
    say("\x07c.mcap is cut")
    told = capsys.readouterr()
    assert told.out == "a\\x1b[31m.mcap: 3 frames\n\\u202eb 5\u00b0\n"
    assert told.err == "\\x07c.mcap is cut\n"
    lines = list(toml_lines({"id": 'a"\n\x1b', "mixed": [{}, 1]}))
    assert lines == ['id = "a\\"\\U0000000a\\U0000001b"', "mixed = [{}, 1]"]
