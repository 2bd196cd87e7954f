"""`wayfix log verify`: what it says of whole, damaged and foreign files, and the exit codes."""

import json
import re
from pathlib import Path

import pytest

from common.codec import encode_frame
from common.command import run_command
from common.errors import SettingsError
from shore.logbook.log_writer import new_log
from tests.station.log_commands import answer, harmed, put, wayfix_log
from tests.station.log_files import START, UTC_NS, chunks_of, frame, log_bytes, other_writer, records_of, write


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
    assert report["frames"] == {"count": 70, "missing": 0, "lost": 0, "not_stored": 30, "unknown": 0}
    assert report["chunks"] == {"sound": len(chunks_of(content)) - 3, "with_checksum": len(chunks_of(content)) - 3}
    assert "a.mcap: damaged, 93 records lost" in said.out
    assert "70; 30 frames are not stored: the log had ended, or its file lost them" in " ".join(said.out.split())


def test_frames_that_the_link_lost_are_told_from_those_the_file_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    order = [seq for seq in range(5, 100) if not 42 <= seq < 45]
    path, _ = write(tmp_path, order)
    assert wayfix_log("verify", path, "--json") == 0
    said = capsys.readouterr().out
    assert "92; 8 frames are not in this log, which does not say why" in " ".join(said.split())
    (report,) = json.loads(said.splitlines()[-1])["logs"]
    assert report["frames"] == {"count": 92, "missing": 0, "lost": 0, "not_stored": 0, "unknown": 8}
    put(path, harmed(path.read_bytes(), 8))
    assert wayfix_log("verify", path, "--json") == 1
    (report,) = answer(capsys)["logs"]
    assert report["frames"] == {"count": 82, "missing": 0, "lost": 0, "not_stored": 10, "unknown": 8}


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
    writer = new_log(tmp_path, "springer", UTC_NS)
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
    writer = new_log(tmp_path, "springer", UTC_NS)
    for seq in range(10):
        writer.write_frame(encode_frame(frame(seq)), frame(seq), UTC_NS + seq)
    writer.close()
    assert wayfix_log("info", writer.path) == 0
    said = capsys.readouterr().out
    assert "no position was valid; the fixes are in 50.00000 N to 50.00090 N, 4.00000 W to 4.00000 W" in " ".join(
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
    writer = new_log(tmp_path, "springer", UTC_NS)
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
