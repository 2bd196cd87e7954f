"""`wayfix-onboard virtual --nmea`: recordings played as they were, on the time of their sentences."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from common.errors import WayfixError
from onboard.config import load
from onboard.virtual.player import Player
from tests.acquire.sentences import ARDUIMU, sealed
from tests.acquire.test_sentence_time import DBT, HDG, gga, rmc
from tests.simulate.test_virtual_command import FAST, ROOT, RUN, Reader, said, tell, virtual

S = 1_000_000_000


def write(directory: Path, name: str, *lines: bytes, end: bytes = b"\r\n") -> Path:
    path = directory / name
    path.write_bytes(b"".join(line + end for line in lines))
    return path


def second(t: float) -> tuple[bytes, ...]:
    return gga(t), rmc(t), HDG, DBT


def test_a_recording_comes_out_as_it_went_in(tmp_path: Path) -> None:
    body = [line for t in range(6) for line in second(t)]
    source = write(tmp_path, "my log.1.nmea", b"# Name: X", b"# Date: Y", *body)
    with virtual(tmp_path / "out", "--nmea", str(source), "--hold", *FAST) as process:
        ready = said(process, "ready")
        assert list(ready["ports"]) == ["my-log"]
        assert ready["seconds"] == pytest.approx(5.9, abs=0.2)
        config = load(ready["config"])
        assert [sensor.id for sensor in config.sensor] == ["gps1", "compass1"]
        assert config.port[0].baud == ready["bauds"]["my-log"] == 4800
        reader = Reader(ready["ports"]["my-log"])
        begun = time.monotonic()
        tell(process, "go\n")
        start_ns = said(process, "started")["t_ns"]
        done = said(process, "done")
        assert time.monotonic() - begun > 5.5 / 16
        reader.wait_for(len(body))
        assert reader.data == b"".join(line + b"\r\n" for line in body)
    assert done["sent"] == {"my-log": 24}
    assert done["dropped_bytes"] == 0
    (file,) = done["files"].values()
    assert file == {"file": str(source), "lines": 26, "sent": 24, "skipped": {"comment": 2}, "not_sent": 0}
    sent = [json.loads(line) for line in Path(ready["sent"]).read_text().splitlines()]
    assert [record["line"] for record in sent] == list(range(3, 27))
    assert [record["t_ns"] - start_ns for record in sent[::4]] == [t * S for t in range(6)]


def test_the_board_plays_without_numpy(tmp_path: Path) -> None:
    code = RUN.replace(
        "import argparse, sys", "import argparse, sys; sys.modules['numpy'] = sys.modules['pyais'] = None"
    )
    source = write(tmp_path, "a.log", gga(1), gga(2))
    line = [sys.executable, "-c", code, "--nmea", str(source), "--dir", str(tmp_path / "out"), "--exit-at-end", *FAST]
    result = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert '"sent": {"a": 2}' in result.stdout


def test_lines_of_a_table_are_the_sentences_in_it(tmp_path: Path) -> None:
    rows = [b'2025/04/11 12:08:16,1,"' + gga(t) + b'"' for t in range(4)]
    player = Player([write(tmp_path, "a_GPGGA.csv", b"time,sentence", *rows)])
    assert [line.data for line in player.lines(0, 1.0)["a_GPGGA"]] == [gga(t) + b"\r\n" for t in range(4)]
    counts = player.done({"a_GPGGA": 4})["files"]["a_GPGGA"]
    assert (counts["lines"], counts["sent"], counts["skipped"], counts["not_sent"]) == (5, 4, {"no-sentence": 1}, 0)


def test_any_bytes_are_played(tmp_path: Path) -> None:
    raw = bytes(range(256)) * 3 + b"!!!VER:1.9,tail without end"
    source = tmp_path / "raw"
    source.write_bytes(raw)
    player = Player([source])
    assert b"".join(line.data for line in player.lines(0, 1.0)["raw"]) == raw
    # Something has to count what is refused.
    assert [sensor.id for sensor in player.config({"raw": "/dev/pts/1"}, "tcp://*:1").sensor] == ["gps1"]


def test_files_whose_times_overlap_keep_their_distance(tmp_path: Path) -> None:
    gps = write(tmp_path, "gps.log", *[line for t in range(100, 110) for line in (gga(t), rmc(t))])
    other = write(tmp_path, "other.log", *[line for t in range(97, 105) for line in (rmc(t), HDG)])
    later = write(tmp_path, "later.log", *[gga(t) for t in range(9000, 9004)])
    silent = write(tmp_path, "imu.log", *[ARDUIMU] * 4)
    player = Player([gps, other, later, silent, gps])
    lines = {name: list(items) for name, items in player.lines(0, 1.0).items()}
    first_ns = {name: items[0].ready_ns for name, items in lines.items()}
    assert first_ns == {"gps": 3 * S, "other": 0, "later": 0, "imu": 0, "gps+2": 3 * S}
    config = player.config({name: f"/dev/pts/{number}" for number, name in enumerate(lines)}, "tcp://*:1")
    assert [sensor.id for sensor in config.sensor] == ["gps1", "gps2", "compass1", "gps3", "imu1", "gps4"]


def test_the_pace_of_lines_without_times(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write(tmp_path, "imu.log", *[ARDUIMU] * 5)
    player = Player([source], lines_per_second=20)
    assert [line.ready_ns for line in player.lines(0, 1.0)["imu"]] == [n * S // 20 for n in range(5)]
    assert capsys.readouterr().err == ""
    Player([source])
    assert capsys.readouterr().err == (
        "imu: no times inside, played at 4800 baud; --lines-per-second X sets another pace\n"
    )


def test_what_a_person_should_know_is_told_before_it_begins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gap = write(tmp_path, "gap.log", *[line for t in (*range(9), *range(809, 819)) for line in second(t)])
    player = Player([gap])
    assert capsys.readouterr().err == "gap: nothing for 800 s before line 37; --longest-gap S shortens it\n"
    assert player.ready(tmp_path)["seconds"] > 800
    assert Player([gap], longest_gap_s=5).ready(tmp_path)["seconds"] < 30
    busy = write(tmp_path, "busy.log", *[line for t in range(9) for line in (*second(t), *[HDG] * 40)])
    capsys.readouterr()
    Player([busy], baud=4800)
    assert "busy: 4800 baud cannot carry it, lines come up to" in capsys.readouterr().err


def test_only_the_beginning(tmp_path: Path) -> None:
    source = write(tmp_path, "a.log", *[line for t in range(60) for line in second(t)])
    player = Player([source], seconds=10)
    assert len(list(player.lines(5 * S, 1.0)["a"])) == 40
    assert player.ready(tmp_path)["seconds"] == 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--nmea", "none.log"], "none.log: cannot be read"),
        (["--nmea", "."], "is no plain file"),
        (["--nmea", "empty"], "there is nothing in it"),
        (["--nmea", "a.log", "--lines-per-second", "5"], "has its own times"),
        (["--nmea", "a.log", "--map", "m.toml"], "belongs to a recording"),
        (["--baud", "4800"], "--baud: belongs to a raw recording; add --nmea FILE"),
        (["--longest-gap", "5"], "add --nmea FILE"),
        (["--lines-per-second", "5"], "add --nmea FILE"),
    ],
)
def test_wrong_input_is_told_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: list[str], words: str
) -> None:
    import argparse

    from onboard.virtual import command

    write(tmp_path, "a.log", gga(1), gga(2))
    write(tmp_path, "empty")
    before = sorted(tmp_path.iterdir())
    monkeypatch.chdir(tmp_path)
    parser = argparse.ArgumentParser()
    command.add_arguments(parser.add_subparsers())
    arguments = parser.parse_args(["virtual", "--dir", str(tmp_path), *options])
    with pytest.raises(WayfixError) as caught:
        arguments.command(arguments)
    assert words in str(caught.value)
    assert sorted(tmp_path.iterdir()) == before


def test_a_damaged_sentence_is_played_too(tmp_path: Path) -> None:
    bad = sealed("GPGGA,1")[:-1] + b"Z"
    player = Player([write(tmp_path, "a.log", gga(1), bad, b"\xff\x00", b"# later", gga(2))])
    assert [line.data.strip() for line in player.lines(0, 1.0)["a"]] == [gga(1), bad, b"\xff\x00", b"# later", gga(2)]


def test_only_the_beginning_of_a_recording_without_times(tmp_path: Path) -> None:
    source = write(tmp_path, "a.log", *[HDG] * 1000)
    player = Player([source], baud=4800, seconds=1.0)
    played = sum(len(line.data) for line in player.lines(0, 1.0)["a"])
    assert 480 <= played <= 480 + len(HDG) + 2


def test_a_clock_that_the_recording_does_not_go_by_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    local = [sealed(f"IIZDA,{2 + t // 3600:02}00{t:02}.00,16,04,2014,00,00") for t in range(20)]
    lines = [line for t in range(20) for line in (gga(t), rmc(t), local[t])]
    player = Player([write(tmp_path, "plotter.log", *lines)])
    assert player.ready(tmp_path)["seconds"] < 20
    said = "plotter: IIZDA gives local time, 2 h 00 min ahead of GPRMC: its 20 sentences are not used\n"
    assert capsys.readouterr().err == said


def test_files_of_two_days_do_not_overlap(tmp_path: Path) -> None:
    one = write(tmp_path, "a.log", *(line for t in range(20) for line in second(t)))
    lines = [line for t in range(5, 25) for line in second(t)]
    other = write(tmp_path, "b.log", *(sealed(line[1:-3].decode().replace("160414", "170414")) for line in lines))
    assert Player([one, other]).ready(tmp_path)["seconds"] < 21
