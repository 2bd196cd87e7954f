"""`wayfix log`: what people and programs are told, at every width, and the exit codes."""

import argparse
import dataclasses
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from common.codec import encode_frame
from common.command import run_command
from common.errors import SettingsError, WayfixError
from common.events import event
from common.messages import Frame
from shore.logbook.arguments import add_arguments
from shore.logbook.census import Census, light_frame
from shore.logbook.command import run
from shore.logbook.record import LogWriter
from shore.logbook.screens import toml_lines
from shore.terminal import say, tell
from tests.station.log_files import EACH_NS, START, UTC_NS, chunks_of, frame, log_bytes, other_writer, records_of, write
from tests.strategies import frame_of

HOUR_NS = 3600 * 10**9


def wayfix_log(*words: object) -> int:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return run(parser.parse_args([str(word) for word in words]))


def answer(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return told


def put(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def harmed(content: bytes, *numbers: int) -> bytes:
    broken = bytearray(content)
    for number in numbers:
        at, end = chunks_of(content)[number]
        broken[(at + end) // 2] ^= 0xFF
    return bytes(broken)


def test_verify_says_exactly_what_is_lost(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = log_bytes(100)
    path = put(tmp_path / "a.mcap", harmed(content, 3, 4, 7))
    assert wayfix_log("verify", path, "--json") == 1
    said = capsys.readouterr()
    (report,) = json.loads(said.out.splitlines()[-1])["logs"]
    assert report["state"] == "damaged"
    spans = [(loss["start_utc"], loss["end_utc"], loss["records"], loss["is_exact"]) for loss in report["losses"]]
    assert spans == [
        ("2026-11-18T11:06:42.100Z", "2026-11-18T11:06:44.000Z", 62, True),
        ("2026-11-18T11:06:46.100Z", "2026-11-18T11:06:47.000Z", 31, True),
    ]
    assert [loss["seconds"] for loss in report["losses"]] == [1.9, 0.9]
    assert (report["losses"][0]["first_byte"], report["losses"][1]["first_byte"]) == (
        chunks_of(content)[3][0],
        chunks_of(content)[7][0],
    )
    assert report["frames"] == {"count": 70, "missing_in_file": 30, "missing_on_link": 0}
    assert report["chunks"] == {"sound": len(chunks_of(content)) - 3, "with_checksum": len(chunks_of(content)) - 3}
    assert "a.mcap: damaged, 93 records lost" in said.out
    assert "30 more were in what is lost" in said.out


def test_frames_that_the_link_lost_are_told_from_those_the_file_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = [seq for seq in range(5, 100) if not 42 <= seq < 45]
    path, _ = write(tmp_path, order)
    assert wayfix_log("verify", path, "--json") == 0
    said = capsys.readouterr().out
    assert "92, 8 never came over the link" in said
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert report["frames"] == {"count": 92, "missing_in_file": 0, "missing_on_link": 8}
    put(path, harmed(path.read_bytes(), 8))
    assert wayfix_log("verify", path, "--json") == 1
    (report,) = answer(capsys)["logs"]
    assert report["frames"] == {"count": 82, "missing_in_file": 10, "missing_on_link": 8}


def test_a_cut_log_names_the_last_moment_it_knows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = log_bytes(100)
    at, end = chunks_of(content)[6]
    path = put(tmp_path / "cut.mcap", content[: (at + end) // 2])
    assert wayfix_log("verify", path, "--json") == 1
    said = capsys.readouterr().out
    assert "cut, what came after 2026-11-18 11:06:45 UTC is lost" in said
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert report["state"] == "cut"
    (loss,) = report["losses"]
    assert (loss["start_utc"], loss["end_utc"], loss["records"]) == ("2026-11-18T11:06:45.000Z", None, None)
    assert (loss["first_byte"], loss["end_byte"]) == (at, (at + end) // 2)


def test_damage_that_costs_nothing_is_damage_all_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = bytearray(log_bytes(100))
    content[-100] ^= 0xFF
    assert wayfix_log("verify", put(tmp_path / "a.mcap", bytes(content)), "--json") == 1
    said = capsys.readouterr().out
    assert "damaged, but no record is lost" in said
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert (report["losses"], len(report["flaws"])) == ([], 1)


def test_a_name_that_was_damaged_is_seen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = log_bytes(100)
    at, end = next((at, end) for opcode, at, end in records_of(content) if opcode == 12)
    broken = content[:at] + content[at:end].replace(b"springer", b"sprinter") + content[end:]
    assert broken != content
    assert wayfix_log("verify", put(tmp_path / "a.mcap", broken), "--json") == 1
    said = capsys.readouterr().out
    assert "not those of the records" in said
    assert json.loads(said.splitlines()[-1])["logs"][0]["summary_differs"] is True


def test_another_log_behind_is_said_and_nothing_is_counted_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = log_bytes(100)
    path = put(tmp_path / "a.mcap", content + content)
    said_twice = (
        f"another log begins at byte {len(content)}, which is not read (`tail -c +{len(content) + 1} LOG > NEW`"
    )
    assert wayfix_log("verify", path, "--json") == 1
    said = capsys.readouterr().out
    assert "a.mcap: damaged, another log stands behind it" in said
    assert said_twice in " ".join(said.split())
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert (report["frames"]["count"], report["losses"]) == (100, [])
    assert wayfix_log("ls", path, "--json") == 0
    (trip,) = answer(capsys)["trips"]
    assert (trip["state"], trip["frames"]) == ("damaged", 100)
    assert wayfix_log("recover", path) == 0
    assert said_twice in capsys.readouterr().out
    assert wayfix_log("verify", tmp_path / "a-recovered.mcap") == 0


def test_the_list_and_the_check_agree_on_a_damaged_header(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = log_bytes(40)
    header, part, magic = content[:9] + b"\xff" * 8 + content[17:], content[:12] + content[40:], bytes(8) + content[8:]
    for number, broken in enumerate((header, part, magic, content[300:])):
        path = put(tmp_path / f"{number}.mcap", broken)
        assert wayfix_log("verify", path, "--json") == 1
        state = answer(capsys)["logs"][0]["state"]
        assert wayfix_log("ls", path, "--json") == 0
        (trip,) = answer(capsys)["trips"]
        assert (trip["state"], trip["boat"]) == (state, "springer") == ("damaged", "springer")
        assert wayfix_log("recover", path) == 0
        assert wayfix_log("verify", tmp_path / f"{number}-recovered.mcap") == 0
        capsys.readouterr()


def test_a_log_that_ends_behind_its_magic_lost_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = put(tmp_path / "a.mcap", log_bytes(40)[:8])
    assert wayfix_log("verify", path) == 1
    said = capsys.readouterr().out
    assert "a.mcap: cut, all of it is lost" in said
    assert "an unknown number of records lost from the beginning, at byte 8: cut between two records" in " ".join(
        said.split()
    )


def test_names_cannot_steer_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = LogWriter(tmp_path, "springer", UTC_NS)
    writer.write_session({"kind": "trip", "name": "sea\x1b[31m\ntrial", "note": "first\nsecond\x07"}, UTC_NS)
    writer.close()
    path = writer.path.rename(tmp_path / "tri\x1b]0;p\n.mcap")
    put(tmp_path / "no\x9b log.mcap", b"none")
    for words in (("ls", tmp_path), ("info", path), ("verify", path), ("recover", path)):
        assert wayfix_log(*words) == 0
    said = capsys.readouterr().out
    assert not any(letter in said for letter in "\x1b\x07\x9b")
    assert r"tri\x1b]0;p\n.mcap" in said
    assert r"sea\x1b[31m\ntrial" in said
    assert re.search(r"note +first *\n", said), "a note may have lines"
    assert wayfix_log("verify", tmp_path / "no\x9b log.mcap") == 2
    assert r"no\x9b log.mcap: not an MCAP log" in capsys.readouterr().err


def test_a_sentence_about_a_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def faults() -> int:
        raise SettingsError("boat\x1b.toml", ["one", "two"])

    assert run_command("wayfix", "shore", lambda: wayfix_log("info", tmp_path / "a\x1b\nb.mcap")) == 2
    assert run_command("wayfix", "shore", faults) == 2
    first, second, third = capsys.readouterr().err.splitlines()
    assert r"/a\x1b\nb.mcap: cannot be read" in first
    assert (second, third) == (r"wayfix: boat\x1b.toml: one", r"boat\x1b.toml: two")


def test_a_trip_of_which_nothing_was_aligned_is_where_its_fixes_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = LogWriter(tmp_path, "springer", UTC_NS)
    for seq in range(10):
        writer.write_frame(encode_frame(frame(seq)), frame(seq), UTC_NS + seq)
    writer.close()
    assert wayfix_log("info", writer.path) == 0
    said = capsys.readouterr().out
    assert "nothing was aligned; the fixes are in 50.00000 N to 50.00090 N, 4.00000 W to 4.00000 W" in " ".join(
        said.split()
    )


def test_several_logs_are_verified_at_once_and_the_worst_decides(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, cut = put(tmp_path / "whole.mcap", log_bytes(40)), put(tmp_path / "cut.mcap", log_bytes(40)[:-9])
    other, none = put(tmp_path / "other.mcap", other_writer(use_chunking=False)), put(tmp_path / "n.mcap", b"no log")
    assert wayfix_log("verify", whole, other) == 0
    assert wayfix_log("verify", whole, cut) == 1
    assert wayfix_log("verify", whole, none, cut, tmp_path / "absent", "--json") == 2
    said = capsys.readouterr()
    assert [report["state"] for report in json.loads(said.out.splitlines()[-1])["logs"]] == [
        *("whole", "no log"),
        *("damaged", "no log"),
    ]
    assert "not an MCAP log" in said.err
    assert "cannot be read" in said.err
    assert "none: records have no checksum" in said.out


def test_a_log_being_written_is_told_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = LogWriter(tmp_path, "springer", UTC_NS)
    writer.write_session(START, UTC_NS)
    assert wayfix_log("verify", writer.path, "--json") == 0
    said = capsys.readouterr().out
    assert "being written, read up to its last whole chunk" in said
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert (report["state"], report["losses"]) == ("being written", [])
    assert wayfix_log("ls", tmp_path, "--json") == 0
    assert answer(capsys)["trips"][0]["state"] == "being written"
    writer.close()
    assert wayfix_log("verify", writer.path) == 0


@pytest.fixture
def trips(tmp_path: Path) -> Path:
    directory = tmp_path / "logs"
    directory.mkdir()
    named = LogWriter(directory, "springer", UTC_NS + HOUR_NS)
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
    monkeypatch.setattr("shore.logbook.trips.examine", None)
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
    assert "90, 10 more were in what is lost" in said


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
    assert census.missing(0) == (0, 2 + 10)
    census.frame(frame_of(seq=19, first_seq=10))
    assert census.missing(0) == (0, 2)
    census.frame(frame_of(seq=0, boot_id="b2"))
    census.file_lost_something()
    census.frame(frame_of(seq=5, boot_id="b2"))
    assert census.missing(None) == (4, 2)
    assert census.missing(3) == (3, 3)


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
