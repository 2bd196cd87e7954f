"""Recordings through the daemon's decoders offline: every line accounted for, the same bytes every time."""

import json
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.errors import CodecError, WayfixError
from common.frames_file import FramesFile, is_frames_file, write_frames_file
from common.messages import Fix, Frame
from common.settings import convert as as_config
from common.units import NS_PER_S
from onboard.main import main
from onboard.recorded.convert import convert
from onboard.recorded.recording import pace, read_recording
from onboard.recorded.sensors_found import sensors_in
from tests.acquire.sentences import ARDUIMU, GGA, GSA, RMC, recording, sealed
from tests.acquire.test_sentence_time import DBT, HDG, LINES, gga, rmc
from tests.recordings import SHARED_DATA as DATA

PLAIN = sorted(
    str(path.relative_to(DATA))
    for pattern in (
        "gpsd-receivers/*.log",
        "sailing-nmea/*.TXT",
        "ocean-rtk-usv/*.txt",
        "serial-snippets/*.txt",
        "signalk-boat-nmea/*.log",
        "radar-ttm-nmea/*.txt",
        "ais-live/*.txt",
        "milliampere-ferry/*_GPGGA.csv",
        "ddboat-imu-gps/*.log",
    )
    for path in DATA.glob(pattern)
)


def write(directory: Path, *lines: bytes, end: bytes = b"\r\n", name: str = "in.log") -> Path:
    path = directory / name
    path.write_bytes(b"".join(line + end for line in lines))
    return path


def frames_of(path: Path) -> list[Frame]:
    with FramesFile(path) as file:
        frames = [decode_frame(data) for data in file.frames()]
        assert file.cut is None
    return frames


def fixes_of(frames: list[Frame]) -> list[Fix]:
    return [fix for frame in frames for fix in frame.fixes]


def outcome_sum(summary: dict[str, Any]) -> int:
    accepted = sum(sum(kinds.values()) for kinds in summary["accepted"].values())
    return int(accepted + sum(summary["rejected"].values()) + sum(summary["ignored"].values()) + summary["too_long"])


LARGE_BYTES = 100_000


def marks_of(name: str) -> list[pytest.MarkDecorator]:
    path = DATA / name
    return [pytest.mark.slow] if path.exists() and path.stat().st_size > LARGE_BYTES else []


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=marks_of(name)) for name in PLAIN or ["gpsd-receivers/bu353s4.log"]]
)
def test_every_line_of_every_recording_is_accounted_for(name: str, tmp_path: Path) -> None:
    data = recording(name)
    summary = convert(DATA / name, tmp_path / "out.frames")
    lines = len([line for line in data.replace(b"\r", b"\n").split(b"\n") if line])
    assert summary["file_lines"] == lines
    assert summary["lines"] + sum(summary["skipped"].values()) == lines
    assert outcome_sum(summary) == summary["lines"]
    frames = frames_of(tmp_path / "out.frames")
    assert len(frames) == summary["frames"]
    assert [frame.seq for frame in frames] == list(range(len(frames)))
    assert all(a.t1_ns == b.t0_ns for a, b in pairwise(frames))
    newest = {report.sensor: report for frame in frames for report in frame.health}
    assert {sensor: sum(kinds.values()) for sensor, kinds in summary["accepted"].items()} == {
        sensor: report.accepted for sensor, report in newest.items() if report.accepted
    }
    assert all(report.discarded_bytes == 0 for report in newest.values())


def test_gofree_has_one_fix_an_epoch_and_all_its_sensors(tmp_path: Path) -> None:
    recording("signalk-boat-nmea/gofree-merrimac.log")
    summary = convert(DATA / "signalk-boat-nmea" / "gofree-merrimac.log", tmp_path / "out")
    frames = frames_of(tmp_path / "out")
    fixes = fixes_of(frames)
    assert len(fixes) == len({fix.tod_ms for fix in fixes}) == 142
    assert summary["sensors"] == ["gps1", "compass1", "ais1"]
    assert sum(len(frame.ais) for frame in frames) == 1507
    # t_ns is the time of day: a Fix is stamped with its own UTC, but for what its sentences take on the wire.
    assert all(0 <= fix.t_ns - (fix.tod_ms or 0) * 1_000_000 < NS_PER_S // 4 for fix in fixes)
    assert all(fix.sog_kn is not None and fix.fix_quality == 1 and fix.fix_mode == 3 for fix in fixes)


def test_a_three_sentence_receiver_gives_whole_fixes(tmp_path: Path) -> None:
    recording("gpsd-receivers/bu353s4.log")
    convert(DATA / "gpsd-receivers" / "bu353s4.log", tmp_path / "out")
    fixes = fixes_of(frames_of(tmp_path / "out"))
    assert len(fixes) == 25
    assert all(fix.fix_quality == 1 and fix.fix_mode == 3 and fix.sog_kn is not None for fix in fixes)
    assert all(b.t_ns - a.t_ns == NS_PER_S for a, b in pairwise(fixes))


def test_a_gap_is_silence_then_a_hole(tmp_path: Path) -> None:
    before = [line for t in range(20) for line in (gga(t), rmc(t), HDG)]
    after = [line for t in range(820, 840) for line in (gga(t), rmc(t), HDG)]
    summary = convert(write(tmp_path, *before, *after), tmp_path / "out")
    frames = frames_of(tmp_path / "out")
    assert [gap["line"] for gap in summary["gaps"]] == [61]
    assert len(fixes_of(frames)) == 40
    events = [(event.code, event.source) for frame in frames for event in frame.events]
    assert ("sensor-silent", "gps1") in events
    assert ("ticks-missed", "daemon") in events
    assert 980 < len(frames) < 1040
    silent = [r for frame in frames for r in frame.health if r.sensor == "gps1" and r.state == "silent"]
    assert len(silent) >= 50
    newest = {report.sensor: report.state for frame in frames for report in frame.health}
    assert newest == {"gps1": "delivering", "compass1": "delivering"}


def test_a_short_gap_is_all_empty_frames(tmp_path: Path) -> None:
    lines = [line for t in (*range(10), *range(50, 60)) for line in (gga(t), DBT)]
    convert(write(tmp_path, *lines), tmp_path / "out")
    frames = frames_of(tmp_path / "out")
    assert {frame.t1_ns - frame.t0_ns for frame in frames} == {NS_PER_S // 10}
    assert "ticks-missed" not in [event.code for frame in frames for event in frame.events]


def test_the_same_recording_gives_the_same_bytes_wherever_it_lies(tmp_path: Path) -> None:
    lines = [GGA, GSA, RMC, ARDUIMU, HDG]
    convert(write(tmp_path, *lines), tmp_path / "a")
    (tmp_path / "elsewhere").mkdir()
    convert(write(tmp_path / "elsewhere", *lines, name="b.txt"), tmp_path / "b")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    convert(write(tmp_path, *lines, HDG, name="c.txt"), tmp_path / "c")
    first, other = frames_of(tmp_path / "a")[0], frames_of(tmp_path / "c")[0]
    assert len(first.boot_id) == 16
    assert (first.boot_id, first.clock_id) != (other.boot_id, other.clock_id)
    # An old result may be made anew in place.
    convert(tmp_path / "c.txt", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "c").read_bytes()


def test_a_configuration_of_ones_own(tmp_path: Path) -> None:
    config = tmp_path / "boat.toml"
    config.write_text(
        '[boat]\nid = "b"\n[[port]]\nname = "one"\npath = "/dev/a"\n[[port]]\nname = "two"\npath = "/dev/b"\n'
        '[[port]]\nname = "three"\npath = "/dev/c"\nbyte_budget_per_s = 100\n'
        '[[sensor]]\nid = "compass1"\nport = "one"\nrole = "compass"\n'
        '[[sensor]]\nid = "gps1"\nport = "three"\nrole = "gps"\ntalkers = ["GP"]\nlatency_ms = 300\n',
        encoding="utf-8",
    )
    source = write(tmp_path, *[line for t in range(1000, 1030) for line in (gga(t), GSA, rmc(t), HDG, sealed("X" * 9))])
    summary = convert(source, tmp_path / "out", config_file=config, port="three")
    assert summary["accepted"] == {"gps1": {"GGA": 30, "GSA": 30, "RMC": 30}}
    with FramesFile(tmp_path / "out") as file:
        used = as_config(file.greeting["config"], BoatConfig)
        assert file.greeting["start_no"] == 1
    assert [port.path for port in used.port] == ["/dev/c"]
    fix = fixes_of(frames_of(tmp_path / "out"))[0]
    assert fix.t_ns == 1000 * NS_PER_S - 300_000_000
    for port, words in (
        (None, "it has several ports"),
        ("four", "no [[port]] is named four"),
        ("two", "no [[sensor]]"),
    ):
        with pytest.raises(WayfixError, match=r"ports|is named|is on the port") as caught:
            convert(source, tmp_path / "no", config_file=config, port=port)
        assert words in str(caught.value)


def test_a_stream_without_times_and_without_line_ends_that_we_know(tmp_path: Path) -> None:
    raw = bytes(range(256)) * 8
    source = tmp_path / "ubx"
    source.write_bytes(raw)
    assert b"".join(read_recording(source).lines) == raw
    summary = convert(source, tmp_path / "out")
    assert outcome_sum(summary) == summary["lines"] == 17
    assert summary["sensors"] == ["gps1"]
    imu = write(tmp_path, *[ARDUIMU] * 40, end=b"\r", name="imu.txt")
    summary = convert(imu, tmp_path / "imu", lines_per_second=20)
    assert summary["accepted"] == {"imu1": {"ArduIMU": 40}}
    assert summary["seconds"] == pytest.approx(4.0, abs=0.2)


@given(LINES)
def test_whatever_the_lines_are_their_sum_is_right(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes]
) -> None:
    directory = tmp_path_factory.mktemp("any")
    source = write(directory, gga(43_000), *lines)
    summary = convert(source, directory / "out")
    assert outcome_sum(summary) == summary["lines"] == summary["file_lines"] - sum(summary["skipped"].values())
    frames = frames_of(directory / "out")
    assert all(a.t1_ns == b.t0_ns for a, b in pairwise(frames))
    shutil.rmtree(directory)


@pytest.mark.parametrize(
    ("name", "sensors"),
    [
        ("radar-ttm-nmea/RadarLogs_lines_1-2000.txt", ["gps nmea", "compass nmea", "radar nmea"]),
        ("gpsd-receivers/saab-r4.log", ["gps nmea", "compass nmea", "ais nmea"]),
        ("serial-snippets/avalon_test_compass.txt", ["compass tcm2"]),
        ("gpsd-receivers/passthrough.log", ["gps nmea"]),
    ],
)
def test_the_sensors_that_speak_are_found(name: str, sensors: list[str]) -> None:
    recording(name)
    found = sensors_in(pace(read_recording(DATA / name)))
    assert [f"{item.role} {item.model}" for item in found] == sensors


@pytest.mark.parametrize("keep", [0.0, 0.003, 0.3, 0.77, 0.999])
def test_a_cut_file_is_read_up_to_the_cut(tmp_path: Path, keep: float) -> None:
    convert(write(tmp_path, *[line for t in range(9) for line in (gga(t), rmc(t))]), tmp_path / "out")
    whole = (tmp_path / "out").read_bytes()
    count = len(frames_of(tmp_path / "out"))
    (tmp_path / "out").write_bytes(whole[: int(keep * len(whole))])
    if keep < 0.1:
        with pytest.raises(CodecError, match=r"is no frames file|is cut in its greeting"):
            FramesFile(tmp_path / "out")
        return
    with FramesFile(tmp_path / "out") as file:
        frames = [decode_frame(data) for data in file.frames()]
        assert file.cut is not None
        assert file.cut.at_byte + file.cut.lost_bytes == int(keep * len(whole))
        assert "bytes there are lost" in str(file.cut)
    assert [frame.seq for frame in frames] == list(range(len(frames)))
    assert len(frames) < count


def test_what_follows_a_damaged_place_is_not_guessed(tmp_path: Path) -> None:
    convert(write(tmp_path, gga(1), gga(2)), tmp_path / "out")
    whole = (tmp_path / "out").read_bytes()
    count = len(frames_of(tmp_path / "out"))
    for junk in (b"\xc1", b"\x01\x02", b"\xdb\xff\xff\xff\xff", b"\x91" * 5000, b"\xdf\xff\xff\xff\xff"):
        (tmp_path / "out").write_bytes(whole + junk)
        with FramesFile(tmp_path / "out") as file:
            assert len(list(file.frames())) == count
            assert file.cut is not None
            assert file.cut.at_byte == len(whole)


def test_any_reader_of_messagepack_reads_the_file(tmp_path: Path) -> None:
    convert(write(tmp_path, gga(1), gga(2)), tmp_path / "out")
    with (tmp_path / "out").open("rb") as stream:
        first, *frames = msgpack.Unpacker(stream)
    assert first["type"] == "connected"
    assert first["file"]["format"] == 1
    assert [frame["seq"] for frame in frames] == list(range(len(frames_of(tmp_path / "out"))))


def test_nothing_is_left_of_a_file_that_could_not_be_finished(tmp_path: Path) -> None:
    def broken() -> Any:
        yield b"\x80"
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        write_frames_file(tmp_path / "out", {}, broken())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("which", ["missing", "directory", "device", "empty", "blank", "comments"])
def test_a_recording_that_is_none_is_told_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], which: str
) -> None:
    empty, blank = write(tmp_path, name="e"), write(tmp_path, b"", b"", name="b")
    comments = write(tmp_path, b"# Name: x", name="c")
    source, words = {
        "missing": (tmp_path / "none", "cannot be read"),
        "directory": (tmp_path, "is no plain file"),
        "device": (Path("/dev/zero"), "is no plain file"),
        "empty": (empty, "there is nothing in it"),
        "blank": (blank, "there is nothing in it"),
        "comments": (comments, "there are only comments in it"),
    }[which]
    assert main(["convert", str(source), str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_target_that_is_somebody_elses_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write(tmp_path, gga(1), gga(2))
    other = write(tmp_path, b"dear diary", name="diary")
    for target, words in (
        (source, "is the recording itself"),
        (other, "exists already and is no frames file"),
        (tmp_path, "exists already and is no frames file"),
        (Path("/dev/full"), "exists already and is no frames file"),
        (tmp_path / "no" / "out", "cannot be written"),
        (Path("/proc/out"), "cannot be written"),
    ):
        assert main(["convert", str(source), str(target)]) == 2
        assert words in capsys.readouterr().err
    assert other.read_bytes() == b"dear diary\r\n"
    assert not is_frames_file(source)
    assert main(["convert", str(source), str(tmp_path / "o"), "--port", "x"]) == 2
    assert "add --config" in capsys.readouterr().err
    assert main(["convert", str(source), str(tmp_path / "o"), "--lines-per-second", "5"]) == 2
    assert "has its own times" in capsys.readouterr().err


PROGRAM = """
import resource, sys
for name in ("numpy", "scipy", "pyais", "mcap", "rich", "matplotlib"):
    sys.modules[name] = None
limit = int(sys.argv[1])
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
from onboard.main import main
sys.exit(main(sys.argv[2:]))
"""


def run(limit: int, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-c", PROGRAM, str(limit), *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)


def test_it_runs_without_numpy_and_says_what_became_of_the_lines(tmp_path: Path) -> None:
    source = write(tmp_path, *[line for t in range(5) for line in (gga(t), rmc(t), HDG, b"$GPGGA,1*00", DBT)])
    done = run(0, "convert", source, tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    *words, last = done.stdout.splitlines()
    summary = json.loads(last)
    assert summary["accepted"] == {"compass1": {"HDG": 5}, "gps1": {"GGA": 5, "RMC": 5}}
    assert summary["rejected"] == {"checksum": 5}
    assert summary["ignored"] == {"DBT": 5}
    assert words[0] == "25 lines in the recording"
    assert "  accepted gps1            10   GGA 5, RMC 5" in words
    assert "  all                      25" in words


def test_a_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    source = write(tmp_path, *[line for t in range(60) for line in (gga(t), rmc(t), HDG)])
    done = run(4096, "convert", source, tmp_path / "out")
    assert done.returncode == 2
    assert "out: cannot be written (File too large); check space and rights" in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["in.log"]


def test_a_file_in_which_nothing_is_understood_is_a_no(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = tmp_path / "letter.txt"
    text.write_text("dear all,\nthe log is attached\n")
    assert main(["convert", str(text), str(tmp_path / "out.frames")]) == 1
    assert "no line was accepted" in capsys.readouterr().err


def test_an_interrupted_conversion_leaves_nothing_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_frame: Frame) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr("onboard.recorded.convert.encode_frame", interrupted)
    out = tmp_path / "out.frames"
    assert main(["convert", str(write(tmp_path, GGA, GSA, RMC)), str(out)]) == 0
    assert "was not written" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["in.log"]
