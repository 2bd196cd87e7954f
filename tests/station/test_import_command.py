"""`wayfix import` as a command: what it refuses, what it leaves behind, what stands in the log."""

import csv
import errno
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from common.errors import WayfixError
from common.units import NS_PER_S
from shore.imports import serial_port
from shore.imports.reader import digest_of
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import LogWriter
from shore.main import main
from tests.station.imports import MAP, T0, Importer, delta, sealed, tpv

NMEA = "\r\n".join(
    sealed(f"$GPRMC,1200{second:02d},A,6000.{second:03d},N,02400.000,E,8.0,000.0,141124,,,A*") for second in range(20)
)
GPSD = "\n".join(tpv(second, lat=60.0 + 1e-5 * second, lon=24.0, speed=4.0, track=0.0) for second in range(30))


def exported(log: Path) -> list[dict[str, str]]:
    """The rows of its CSV."""
    out = log.with_suffix(".csv")
    assert main(["export", str(log), "--to", "csv", str(out)]) == 0
    with out.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "there is nothing in it"),
        (b"\r\n \n", "there is nothing in it"),
        (b"\x89PNG\r\n\x1a\n" + bytes(64), "picture"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "MATLAB"),
        (b"\x1f\x8b" + bytes(50), "gunzip"),
        (bytes(range(256)) * 4, "is binary"),
        (b"\x89MCAP0\r\n\x01\x1a\0\0\0\0\0\0\0\0\0\0\0\6\0\0\0wayfix", "log already"),
        (b"\x89MCAP0\r\n\x01\x1a\0\0\0\0\0\0\0\0\0\0\0\6\0\0\0rosbag", "another program"),
        (b'{"a": 1, "b": [2]}', "its keys: a, b"),
        (b'{"vessels": {"self": {}}, "version": "1"}', "one moment"),
        (b'{"type": "FeatureCollection", "features": []}', "GeoJSON"),
        (b'{"type": "FeatureCollection", "generator": "wayfix", "features": [\n', "track of `wayfix export` (GeoJSON)"),
        ("$GPRMC,1\r\n".encode("utf-16"), "UTF-16"),
        ("$GPRMC,1\r\n".encode("utf-16-be").join((b"\xfe\xff", b"")), "UTF-16"),
        (b'{"log": [\n{"class": "TPV", "lat": 1}\n]}', "jq -c"),
        (b'<?xml version="1.0"?>\n<kml>\n</kml>', "is KML"),
        (b"time,lat,lon\n1,2,3\n4,5,6\n", "the columns time, lat, lon"),
        (b"MMSI,lat,lon\n1,2,3\n4,5,6\n", "other ships"),
        (b"Dear diary,\nnothing happened.\nSo it goes.\n", "not known here"),
    ],
)
def test_what_cannot_be_imported_is_named(content: bytes, words: str, importer: Importer) -> None:
    with pytest.raises(WayfixError, match=re.escape(words)) as caught:
        importer.text(content)
    assert caught.value.cure
    assert sorted(path.name for path in importer.directory.iterdir()) == ["in.log"]


def test_missing_files_and_directories(importer: Importer) -> None:
    with pytest.raises(WayfixError, match="cannot be read"):
        importer(importer.directory / "none.log")
    with pytest.raises(WayfixError, match="no plain file"):
        importer(Path("/dev/null"))
    with pytest.raises(WayfixError, match="cannot be written"):
        importer.text(GPSD, out="no/out.mcap")


def test_nothing_is_overwritten(importer: Importer) -> None:
    (importer.directory / "out.mcap").write_bytes(b"mine")
    with pytest.raises(WayfixError, match="exists already"):
        importer.text(GPSD)
    assert (importer.directory / "out.mcap").read_bytes() == b"mine"
    with pytest.raises(WayfixError, match="it would be lost"):
        importer.text(GPSD, name="same", out="same")
    (importer.directory / "link.mcap").symlink_to("nowhere")
    with pytest.raises(WayfixError, match="exists already"):
        importer.text(GPSD, out="link.mcap")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--filters", "magic"], "unknown filter"),
        (["--port", "gps"], "--port"),
        (["--map", "map.toml"], "needs no mapping"),
        (["--vessel", "230000000"], "Signal K"),
        (["--lines-per-second", "5"], "has its own times"),
        (["--config", "none.toml"], "cannot be read"),
    ],
)
def test_options_that_do_not_fit(options: list[str], words: str, importer: Importer) -> None:
    with pytest.raises(WayfixError, match=words):
        importer.text(GPSD, *options)
    assert not (importer.directory / "out.mcap").exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("lat = ", "lat_deg = "), "fix.lat_deg: unknown key"),
        (('lat = "lat"\n', ""), "no position"),
        (('"psi"', '"heading"'), "has no column heading"),
        (('column = "psi"', 'quaternion = ["v"]'), "no direction"),
        (("unix = true", "utc = true"), "not its format"),
        (("[imu]", '[imu]\naccel_fwd = "v"'), "one acceleration"),
    ],
)
def test_mappings_that_do_not_fit(change: tuple[str, str], words: str, importer: Importer) -> None:
    mapping = importer.directory / "map.toml"
    mapping.write_text(MAP.replace(*change))
    with pytest.raises(WayfixError, match=words):
        importer.text("t,lat,lon,v,psi,r\n1,2,3,4,5,6\n7,8,9,1,2,3\n", "--map", str(mapping))


def test_the_log_is_one_like_any_other(importer: Importer) -> None:
    imported = importer.text(GPSD, "--name", "Race", "--place", "Helsinki", filters="fuzzy,kf")
    kinds = [record["kind"] for record in imported.session]
    assert kinds == ["start", "trip", "end", "summary"]
    start, trip, end, summary = imported.session
    assert start["options"]["filters"] == ["fuzzy", "kf"]
    assert start["connected"]["config"]["boat"]["id"] == "gpsd"
    assert (trip["name"], trip["place"]) == ("Race", "Helsinki")
    assert (summary["name"], summary["boat"], summary["fixes"]) == ("Race", "gpsd", 30)
    assert end["received"] == summary["frames"] == len(imported.frames)
    assert end["import"]["sha256"] == digest_of(importer.directory / "in.log")
    assert imported.summary["estimates"]["fuzzy"] == imported.summary["estimates"]["kf"] > 200
    with imported.out.open("rb") as stream:
        times = [message.log_time for _, _, message in make_reader(stream, validate_crcs=True).iter_messages()]
    assert times == sorted(times)
    frames = imported.frames
    assert {(frame.utc_src, frame.utc_ns == frame.t0_ns) for frame in frames} == {("gnss", True)}
    log_times = [record.log_time_ns for record in read_log(imported.out).records("/frames")]
    assert log_times == [frame.t1_ns for frame in frames]
    assert all(record.topic != "" for record in read_log(imported.out).records("/position/fuzzy"))


def test_no_filters_is_frames_only(importer: Importer) -> None:
    imported = importer.text(GPSD)
    assert imported.summary["estimates"] == {}
    assert list(read_log(imported.out).records("/estimates/fuzzy")) == []
    assert len(imported.fixes) == 30


def test_the_same_bytes_whenever_and_wherever(
    importer: Importer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "elsewhere").mkdir()
    for name, text in (("a.log", NMEA), ("b.log", GPSD), ("c.log", delta(0, "a", headingTrue=1.0))):
        first = importer.text(text, name=name, out=f"{name}.mcap", filters="fuzzy").out.read_bytes()
        with monkeypatch.context() as context:
            context.setattr("time.time_ns", lambda: 0)
            context.setattr("time.time", lambda: 0.0)
            again = importer.text(text, name=f"elsewhere/{name}", out=f"again-{name}", filters="fuzzy").out.read_bytes()
        assert first == again


def test_a_serial_recording_and_its_frames_file_give_one_log(importer: Importer) -> None:
    direct = importer.text(NMEA, filters="fuzzy")
    assert direct.summary["kind"] == "serial recording"
    assert direct.summary["utc"] == "2024-11-14T12:00:00+00:00"
    frames = importer.directory / "out.frames"
    serial_port.convert(importer.directory / "in.log", frames, [], print)
    second = importer(frames, out="second.mcap", filters="fuzzy")
    assert second.summary["kind"] == "frames file"
    topics = ("/frames", "/estimates/fuzzy", "/events")
    assert list(read_log(direct.out).records(*topics)) == list(read_log(second.out).records(*topics))


def test_a_cut_frames_file_is_told(importer: Importer) -> None:
    importer.text(NMEA)
    frames = importer.directory / "whole.frames"
    serial_port.convert(importer.directory / "in.log", frames, [], print)
    imported = importer.text(frames.read_bytes()[:-40], name="cut.frames", out="cut.mcap")
    assert "cut at byte" in imported.words
    assert imported.summary["frames"] > 100


def test_old_recordings_have_the_time_of_their_fixes(importer: Importer) -> None:
    imported = importer.text(NMEA.replace("\r\n", "\n").replace("141124", "141110"))
    assert imported.code == 1  # checksums
    old = "\n".join(sealed(line[:-2]) for line in NMEA.replace("141124", "141110").split("\r\n"))
    imported = importer.text(old)
    assert imported.summary["utc"] == "2010-11-14T12:00:00+00:00"
    assert {frame.utc_src for frame in imported.frames} == {"gnss"}


def test_with_a_configuration_its_sensors_hold(importer: Importer) -> None:
    config = importer.directory / "boat.toml"
    config.write_text(
        '[boat]\nid = "skiff"\n[[port]]\nname = "p"\npath = "/dev/ttyS0"\n'
        '[[sensor]]\nid = "gps1"\nport = "p"\nrole = "gps"\nsigma_m = 7.5\n'
    )
    for name, text in (("a.log", NMEA), ("b.log", GPSD)):
        imported = importer.text(text, "--config", str(config), name=name, out=f"{name}.mcap")
        boat = imported.session[0]["connected"]["config"]
        assert boat["boat"]["id"] == "skiff"
        assert [(sensor["id"], sensor["sigma_m"]) for sensor in boat["sensor"]] == [("gps1", 7.5)]


def test_nothing_usable_is_exit_1_with_counts(importer: Importer) -> None:
    imported = importer.text('{"class":"SKY"}\n{"class":"TPV","mode":1}\n')
    assert imported.code == 1
    assert imported.account("lines")["ignored"] == {"SKY": 1, "TPV without a value": 1}
    assert sorted(path.name for path in importer.directory.iterdir()) == ["in.log"]
    assert "nothing in it could be used" in imported.words


def test_without_the_boats_program_one_sentence(importer: Importer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", str(importer.directory / "python"))
    with pytest.raises(WayfixError, match=r"wayfix-onboard.*pip install"):
        importer.text(NMEA)


def test_convert_speaks_of_the_file_that_was_given(importer: Importer) -> None:
    with pytest.raises(WayfixError, match="cannot be read") as caught:
        importer.text(NMEA, "--config", str(importer.directory / "none.toml"))
    assert "wayfix-onboard:" not in str(caught.value)


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_a_full_disk_or_ctrl_c_leaves_nothing_behind(
    fault: BaseException, importer: Importer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> None:
        if isinstance(fault, OSError):
            raise WayfixError("the log cannot be written any further") from fault
        raise fault

    monkeypatch.setattr(LogWriter, "write_estimate", fail)
    if isinstance(fault, OSError):
        with pytest.raises(WayfixError, match="cannot be written"):
            importer.text(GPSD, filters="fuzzy")
    else:
        interrupted = importer.text(GPSD, filters="fuzzy")
        assert (interrupted.code, interrupted.summary) == (0, {})
        assert interrupted.words.endswith("out.mcap was not written\n")
    assert sorted(path.name for path in importer.directory.iterdir()) == ["in.log"]


def test_a_long_hole_is_no_frames(importer: Importer) -> None:
    early, late = tpv(0, lat=1.0, lon=2.0), tpv(5, lat=1.0, lon=2.0).replace("T22:13", "T23:13")
    imported = importer.text(f"{early}\n{late}")
    frames = imported.frames
    assert len(frames) < 700
    assert max((frame.t1_ns - frame.t0_ns) / 1e9 for frame in frames) == pytest.approx(3600 - 55, abs=1.5)
    assert [event.code for frame in frames for event in frame.events] == ["ticks-missed"]


def test_a_clock_that_was_set_back_is_told(importer: Importer) -> None:
    seconds = [10.0, 11.0, 12.0, 1.0, 2.0, 3.0]
    lines = [tpv(second, lat=1.0 + number / 1000, lon=2.0) for number, second in enumerate(seconds)]
    imported = importer.text("\n".join(lines))
    assert [(fix.t_ns - imported.fixes[0].t_ns) / 1e9 for fix in imported.fixes] == [0, 1, 2, 3, 4, 5]
    (event,) = [event for frame in imported.frames for event in frame.events]
    assert (event.code, event.evidence["step_s"]) == ("clock-stepped", -12.0)
    assert {frame.clk_epoch for frame in imported.frames} == {0, 1}
    for frame in imported.frames:
        assert frame.utc_ns is not None
        for fix in frame.fixes:
            assert fix.utc_ns == frame.utc_ns + fix.t_ns - frame.t0_ns


def test_a_receiver_before_its_first_fix_does_not_date_the_trip(importer: Importer) -> None:
    after = [tpv(second, lat=1.0 + second / 1e5, lon=2.0) for second in range(20)]
    for name, date in (("old", "1980-01-06T00:00"), ("ahead", "2036-02-07T06:28")):
        before = [line.replace("2023-11-14T22:13", date) for line in after[:5]]
        imported = importer.text("\n".join([*before, *after]), out=f"{name}.mcap", filters="fuzzy")
        assert imported.summary["utc"] == "2023-11-14T22:13:15+00:00"
        assert imported.summary["seconds"] == pytest.approx(24.1, abs=0.1)
        assert "5 records bear another date" in imported.words
        times = [fix.t_ns for fix in imported.fixes]
        assert times == [times[0] + number * NS_PER_S for number in range(25)]
        told = [frame.utc_ns for frame in imported.frames]
        known = [utc_ns for utc_ns in told if utc_ns is not None]
        assert 40 < told.count(None) < 60
        assert (min(known) - T0) // NS_PER_S in (-1, 0)
        records = list(read_log(imported.out).records("/frames"))
        assert records[-1].log_time_ns - records[0].log_time_ns == imported.frames[-1].t1_ns - imported.frames[0].t1_ns
        rows = exported(imported.out)
        assert rows[0]["utc"].startswith("2023-11-14T22:13:15")
        assert rows[-1]["utc"].startswith("2023-11-14T22:13:39")


def test_a_serial_recording_is_dated_by_most_of_its_frames(importer: Importer) -> None:
    ahead = [
        sealed(line[:-2].replace("141124", "070236").replace(",1200", ",1159")) for line in NMEA.split("\r\n")[-5:]
    ]
    # Rows of NMEA, five seconds earlier and twelve years later.
    ahead = [sealed(f"$GPRMC,1159{second},A,6000.000,N,02400.000,E,8.0,000.0,070236,,,A*") for second in range(55, 60)]
    imported = importer.text("\r\n".join([*ahead, NMEA]))
    assert imported.summary["utc"] == "2024-11-14T11:59:55+00:00"
    log_times = [record.log_time_ns for record in read_log(imported.out).records("/frames")]
    assert (log_times[-1] - log_times[0]) / NS_PER_S == pytest.approx(imported.summary["seconds"], abs=0.2)


def test_json_is_the_last_line(importer: Importer) -> None:
    imported = importer.text(GPSD)
    assert json.loads(json.dumps(imported.summary))["out"] == str(imported.out)
