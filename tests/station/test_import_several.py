"""Several recordings of one trip: one log by UTC, or one sentence and nothing left behind."""

import random
import re
from collections import Counter
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from common.errors import WayfixError
from common.frames_file import FramesFile
from common.messages import Frame
from common.units import NS_PER_S
from shore.imports import serial_port
from shore.imports.command import Given, given_as
from shore.logbook.log_reader import read_log
from shore.logbook.log_writer import LogWriter
from shore.main import main
from tests.station.imports import T0, Importer, delta, sealed, tpv

START = datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)
assert START.timestamp() * NS_PER_S == T0


def nmea(start: datetime = START, seconds: int = 20, *, dated: bool = True) -> str:
    """A receiver and a compass, once a second, going north."""
    lines = []
    for second in range(seconds):
        t = start + timedelta(seconds=second)
        place = f"60{second / 1000:06.3f},N,02400.000,E"
        if dated:
            lines.append(sealed(f"$GPRMC,{t:%H%M%S}.00,A,{place},8.0,000.0,{t:%d%m%y},,,A*"))
        else:
            lines.append(sealed(f"$GPGGA,{t:%H%M%S}.00,{place},1,08,1.0,10.0,M,0.0,M,,*"))
        lines.append(sealed(f"$HEHDT,{second:.1f},T*"))
    return "\r\n".join(lines) + "\r\n"


GYRO_MAP = '[boat]\nid = "skiff"\n[time]\ncolumn = "t"\n{time}\n[imu]\nyaw_rate = "r"\n'
FIX_MAP = '[boat]\nid = "skiff"\n[time]\ncolumn = "t"\nunix = true\n[fix]\nlat = "lat"\nlon = "lon"\n'


def gyro_rows(start: float, seconds: int = 20, rate: float = 1.0) -> str:
    return "t,r\n" + "".join(f"{start + tenth / 10:.1f},{rate}\n" for tenth in range(10 * seconds))


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Importer:
    """Temporary files lie in a directory of the test's own, so that one which is left behind is seen."""
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "tmp"))
    return Importer(tmp_path, capsys)


@pytest.fixture
def here(importer: Importer) -> Path:
    """The recordings that most tests take."""
    directory = importer.directory
    (directory / "gyro-map.toml").write_text(GYRO_MAP.format(time="unix = true"))
    (directory / "boot-map.toml").write_text(GYRO_MAP.format(time=""))
    (directory / "fix-map.toml").write_text(FIX_MAP)
    (directory / "a.nmea").write_text(nmea())
    (directory / "gyro.csv").write_text(gyro_rows(START.timestamp()))
    (directory / "boot.csv").write_text(gyro_rows(77.0))
    return directory


def names(directory: Path) -> list[str]:
    return sorted(str(path.relative_to(directory)) for path in directory.rglob("*"))


def utc_s(items: list[Any]) -> list[float]:
    return [round((item.t_ns - T0) / NS_PER_S, 1) for item in items]


def test_a_receiver_and_a_gyro_are_one_log(importer: Importer, here: Path) -> None:
    one = importer.together([here / "a.nmea", f"{here}/gyro.csv:{here}/gyro-map.toml"], filters="fuzzy")
    assert one.code == 0
    sensors = one.session[0]["connected"]["config"]["sensor"]
    assert [sensor["id"] for sensor in sensors] == ["compass1", "gps1", "gyro1"]
    assert one.summary["measurements"] == {"fixes": 20, "headings": 20, "turn_rates": 200}
    assert one.summary["utc"] == "2023-11-14T22:13:20+00:00"
    assert one.session[0]["connected"]["config"]["boat"]["id"] == "skiff"
    for number, frame in enumerate(one.frames):
        assert (frame.utc_ns, frame.seq) == (frame.t0_ns, number)
        assert all(frame.t0_ns <= item.t_ns < frame.t1_ns for item in frame.turn_rates)
    assert utc_s(one.turn_rates) == [tenth / 10 for tenth in range(200)]
    assert utc_s(one.fixes) == pytest.approx(list(range(20)), abs=0.11)
    assert median(fix.t_ns - (fix.utc_ns or 0) for fix in one.fixes) == 0
    assert one.summary["estimates"]["fuzzy"] > 150
    first, second = one.summary["files"]
    assert (first["file"], second["file"]) == ("a.nmea", "gyro.csv")
    assert second["sensors"] == {"gyro1": "gyro1"}
    assert second["measurements"] == {"gyro1": {"TurnRate": 200}}
    assert (second["from"], second["to"]) == ("2023-11-14T22:13:20Z", "2023-11-14T22:13:39Z")
    end = next(record for record in one.session if record["kind"] == "end")
    assert end["import"]["files"] == one.summary["files"]
    assert names(here / "tmp") == []


def test_numbers_follow_the_order_of_the_files_and_times_their_own(importer: Importer, here: Path) -> None:
    for name, start in (("a", 0), ("b", 30)):
        lines = [tpv(start + second, lat=60.0, lon=24.0 + second / 1e5, track=1.0) for second in range(9)]
        (here / f"{name}.json").write_text("\n".join([*lines, lines[-1].replace("TPV", "SKY")]))
    one = importer.together([here / "a.json", here / "b.json"], out="one.mcap")
    other = importer.together([here / "b.json", here / "a.json"], out="other.mcap")
    assert [fix.sensor for fix in one.fixes] == ["gps1"] * 9 + ["gps2"] * 9
    assert [fix.sensor for fix in other.fixes] == ["gps2"] * 9 + ["gps1"] * 9
    assert utc_s(one.fixes) == utc_s(other.fixes) == [*range(9), *range(30, 39)]
    assert [file["sensors"] for file in other.summary["files"]] == [{"gps1": "gps1"}, {"gps2": "gps1"}]
    assert "b.json goes on after" in one.words


def test_the_configuration_names_them_by_role(importer: Importer, here: Path) -> None:
    config = here / "boat.toml"
    text = '[boat]\nid = "mine"\n[[port]]\nname = "p"\npath = "/dev/ttyS0"\n'
    for sensor, role in (("bow", "gps"), ("fluxgate", "compass"), ("stern", "gps")):
        text += f'[[sensor]]\nid = "{sensor}"\nport = "p"\nrole = "{role}"\nsigma_m = 7.5\n'
    config.write_text(text)
    (here / "b.nmea").write_text("\r\n".join(nmea().split("\r\n")[::2]))  # the receiver alone
    one = importer.together([here / "a.nmea", here / "b.nmea"], "--config", str(config))
    assert Counter(fix.sensor for fix in one.fixes) == {"bow": 20, "stern": 20}
    assert {heading.sensor for heading in one.headings} == {"fluxgate"}
    boat = one.session[0]["connected"]["config"]
    assert (boat["boat"]["id"], {sensor["sigma_m"] for sensor in boat["sensor"]}) == ("mine", {7.5})
    (here / "c.nmea").write_text(nmea(START + timedelta(seconds=1)))
    with pytest.raises(WayfixError, match=r"has 1 \[\[sensor\]\] with role compass; compass1 of .*c.nmea is one more"):
        importer.together([here / "a.nmea", here / "c.nmea"], "--config", str(config), out="no.mcap")


def test_every_kind_in_one_log(importer: Importer, here: Path) -> None:
    (here / "b.json").write_text("\n".join(tpv(second, lat=60.0, lon=24.0 + second / 1e5) for second in range(9)))
    (here / "c.json").write_text("\n".join(delta(second, "c", headingTrue=0.1 * second) for second in range(8)))
    serial_port.convert(here / "a.nmea", here / "d.frames", [], print)
    (here / "e.nmea").write_text(nmea(START, 7))
    importer(here / "e.nmea", out="e.mcap")
    (here / "f.csv").write_text(f"t,lat,lon\n{START.timestamp()},60.0,24.0\n{START.timestamp() + 5},60.1,24.1\n")
    files = ["a.nmea", "b.json", "c.json", "d.frames", "e.mcap", f"f.csv:{here}/fix-map.toml"]
    one = importer.together([f"{here}/{file}" for file in files])
    assert Counter(fix.sensor for fix in one.fixes) == {"gps1": 20, "gps2": 9, "gps3": 20, "gps4": 7, "gps5": 2}
    headings = Counter(heading.sensor for heading in one.headings)
    assert headings == {"compass1": 20, "compass2": 8, "compass3": 20, "compass4": 7}
    kinds = [file["kind"] for file in one.summary["files"]]
    assert kinds == ["serial recording", "gpsd JSON", "Signal K deltas", "frames file", "log", "table (CSV)"]
    # The same receiver four ways: each of its fixes at one time and place.
    fixes = {sensor: [fix for fix in one.fixes if fix.sensor == sensor] for sensor in ("gps1", "gps3", "gps4")}
    for fix, again, logged in zip(*fixes.values(), strict=False):
        assert fix.t_ns == again.t_ns == logged.t_ns
        assert fix.lat_deg == again.lat_deg == logged.lat_deg


def test_rows_dealt_to_three_files_come_together_again(importer: Importer, here: Path) -> None:
    draw = random.Random(5)
    rows = [(START.timestamp() + tenth / 10, round(draw.uniform(-9, 9), 3)) for tenth in range(400)]
    hands: list[list[tuple[float, float]]] = [[], [], []]
    for row in rows:
        draw.choice(hands).append(row)
    files = []
    for number, hand in enumerate(hands):
        (here / f"{number}.csv").write_text("t,r\n" + "".join(f"{t:.1f},{rate}\n" for t, rate in hand))
        files.append(f"{here}/{number}.csv:{here}/gyro-map.toml")
    one = importer.together(files)
    found = [(rate.t_ns, rate.rate_deg_s) for rate in one.turn_rates]
    assert found == [(round(t * 10) * NS_PER_S // 10, rate) for t, rate in rows]
    again = importer.together(files, out="again.mcap")
    assert one.out.read_bytes() == again.out.read_bytes()


def test_one_table_may_be_two_recordings_by_two_mappings(importer: Importer, here: Path) -> None:
    (here / "both.csv").write_text(gyro_rows(START.timestamp()).replace("t,r", "t,s").replace("s\n", "s\n", 1))
    (here / "s-map.toml").write_text(GYRO_MAP.format(time="unix = true").replace('"r"', '"s"'))
    table = f"{here}/both.csv:{here}/s-map.toml"
    with pytest.raises(WayfixError, match="is the same recording as"):
        importer.together([table, table])
    (here / "t-map.toml").write_text((here / "s-map.toml").read_text() + "yaw_rate_scale = -1.0\n")
    one = importer.together([table, f"{here}/both.csv:{here}/t-map.toml"])
    assert {(rate.sensor, rate.rate_deg_s) for rate in one.turn_rates} == {("gyro1", 1.0), ("gyro2", -1.0)}


def test_a_clock_from_zero_becomes_utc_by_its_mapping(importer: Importer, here: Path) -> None:
    files = [f"{here}/gyro.csv:{here}/gyro-map.toml", f"{here}/boot.csv:{here}/boot-map.toml"]
    with pytest.raises(WayfixError, match=r"boot.csv: counts its times from an unknown moment.*zero_utc"):
        importer.together(files)
    (here / "boot-map.toml").write_text(GYRO_MAP.format(time='zero_utc = "2023-11-14T22:12:03Z"'))
    one = importer.together(files)
    assert utc_s([rate for rate in one.turn_rates if rate.sensor == "gyro2"])[0] == 0.0
    alone = importer.together(files[1:], out="alone.mcap")
    assert alone.summary["utc"] == "2023-11-14T22:13:20+00:00"
    for wrong, words in (
        ('zero_utc = "noon"', "zero_utc: no ISO 8601"),
        ('unix = true\nzero_utc = "2023-11-14T22:12:03Z"', "counts from two moments"),
        ('format = "%S"\nzero_utc = "2023-11-14T22:12:03Z"', "text and a number"),
    ):
        (here / "boot-map.toml").write_text(GYRO_MAP.format(time=wrong))
        with pytest.raises(WayfixError, match=words):
            importer.together(files[1:], out="wrong.mcap")


def test_up_to_half_an_hour_apart_is_one_trip(importer: Importer, here: Path) -> None:
    files = {}
    for name, minutes in (("first", 0.0), ("between", 15.0), ("late", 30.0), ("later", 30.4)):
        (here / f"{name}.csv").write_text(gyro_rows(START.timestamp() + 60 * minutes))
        files[name] = f"{here}/{name}.csv:{here}/gyro-map.toml"
    one = importer.together([files["late"], files["first"]])
    assert len(one.frames) < 1200  # the break is one long frame behind a minute of empty ones
    assert [event.code for frame in one.frames for event in frame.events] == ["ticks-missed"]
    with pytest.raises(
        WayfixError, match=r"0 h 30 min after .*first.csv ended .*half an hour; import them as two logs"
    ):
        importer.together([files["later"], files["first"]], out="no.mcap")
    # What lies between bridges it, in whatever order the files are given.
    assert importer.together([files["later"], files["first"], files["between"]], out="yes.mcap").code == 0


def damage(data: bytes) -> bytes:
    return data[: len(data) // 2] + b"\xff" * 40 + data[len(data) // 2 + 40 :]


@pytest.mark.parametrize(
    ("files", "words"),
    [
        (
            ["gyro.csv:gyro-map.toml", "day.csv:gyro-map.toml"],
            "day.csv: begins 2023-11-15T22:13:20Z, 23 h 59 min after",
        ),
        (["boot.csv:boot-map.toml", "boot2.csv:boot-map.toml"], "boot.csv: counts its times from an unknown moment"),
        (["gyro.csv:gyro-map.toml", "undated.nmea"], "undated.nmea: says the time of day but no date"),
        (["gyro.csv:gyro-map.toml", "timeless.nmea"], "timeless.nmea: says no UTC"),
        (["gyro.csv:gyro-map.toml", "timeless.json"], "timeless.json: has no times"),
        (["gyro.csv:gyro-map.toml", "damaged.nmea"], r"damaged.nmea: is damaged: .* lines could not be read"),
        (
            ["gyro.csv:gyro-map.toml", "damaged.csv:gyro-map.toml"],
            r"damaged.csv: is damaged: .* rows could not be read",
        ),
        (["gyro.csv:gyro-map.toml", "garbled.nmea"], r"garbled.nmea: is damaged: 99 of .* bytes in it are control"),
        (["gyro.csv:gyro-map.toml", "cut.frames"], "cut.frames: is damaged: cut at byte"),
        (["gyro.csv:gyro-map.toml", "damaged.mcap"], r"damaged.mcap: is damaged: .*log recover"),
        (["gyro.csv:gyro-map.toml", "useless.json"], "useless.json: nothing in it could be used"),
        (["a.nmea", "empty"], "empty: there is nothing in it"),
        (["a.nmea", "picture"], "picture: is a picture"),
        (["a.nmea", "none.nmea"], "none.nmea: cannot be read"),
        (["a.nmea", "a.nmea"], "a.nmea: is the same recording as"),
        (["gyro.csv:gyro-map.toml", "a.nmea", "copy.nmea"], "copy.nmea: is the same recording as .*a.nmea"),
        (["a.nmea", "gyro.csv"], "gyro.csv: is a table .* FILE:MAP.toml"),
        (["a.nmea", "gyro.csv:fix-map.toml"], "gyro.csv: has no column lat, lon"),
        (["a.nmea", "gyro.csv:none.toml"], "none.toml: cannot be read"),
        (["a.nmea:gyro-map.toml", "boot.csv"], "a.nmea: is a serial recording, which needs no mapping"),
        (["gyro.csv:gyro-map.toml", "late.frames"], "late.frames: has frames that came late"),
    ],
)
def test_what_is_no_trip_is_one_sentence(
    files: list[str],
    words: str,
    importer: Importer,
    here: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: dict[str, Callable[[], bytes]] = {
        "day.csv": lambda: gyro_rows(START.timestamp() + 86_400).encode(),
        "damaged.csv": lambda: (
            gyro_rows(START.timestamp()).replace("5,1.0", "#,##").replace("7,1.0", "#,#").encode() + b"\n?"
        ),
        "boot2.csv": lambda: gyro_rows(99.0).encode(),
        "undated.nmea": lambda: nmea(dated=False).encode(),
        "timeless.nmea": lambda: (sealed("$HEHDT,10.0,T*") + "\r\n").encode() * 9,
        "timeless.json": lambda: b'{"class":"TPV","mode":3,"lat":60.0,"lon":24.0}\n' * 9,
        "damaged.nmea": (nmea()[:900] + nmea().replace(".0,T*", ".1,T*")[900:]).encode,
        "garbled.nmea": lambda: nmea().encode() + bytes(99),
        "cut.frames": lambda: frames_of(here)[:-9],
        "damaged.mcap": lambda: damage(importer(here / "a.nmea", out="whole.mcap").out.read_bytes()),
        "useless.json": lambda: b'{"class":"SKY"}\n{"class":"TPV","mode":1}\n',
        "empty": lambda: b"",
        "picture": lambda: b"\x89PNG\r\n\x1a\n" + bytes(64),
        "copy.nmea": (here / "a.nmea").read_bytes,
        "late.frames": lambda: swapped(here),
    }
    for name in (file.split(":")[0] for file in files):
        if name in made:
            (here / name).write_bytes(made[name]())
    before = names(here)
    capsys.readouterr()
    monkeypatch.chdir(here)
    assert main(["import", *files, "out.mcap", "--filters", "none"]) == 2
    (sentence,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("wayfix: ")]
    assert re.search(words, sentence), sentence
    assert names(here) == before


def frames_of(here: Path) -> bytes:
    serial_port.convert(here / "a.nmea", here / "whole.frames", [], print)
    return (here / "whole.frames").read_bytes()


def swapped(here: Path) -> bytes:
    """A frames file of which two frames changed places."""
    frames_of(here)
    with FramesFile(here / "whole.frames") as file:
        frames = list(file.frames())
    data = (here / "whole.frames").read_bytes()
    return data.replace(frames[20] + frames[21], frames[21] + frames[20])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--map", "gyro-map.toml"], "--map: is for one FILE"),
        (["--port", "gps"], "--port: is for one FILE"),
        (["--lines-per-second", "5"], "--lines-per-second: is for one recording without times"),
        (["--vessel", "230000000"], "--vessel: names a vessel of Signal K"),
        (["--config", "none.toml"], "none.toml: cannot be read"),
    ],
)
def test_options_of_one_file(options: list[str], words: str, importer: Importer, here: Path) -> None:
    with pytest.raises(WayfixError, match=words):
        importer.together([here / "a.nmea", f"{here}/gyro.csv:{here}/gyro-map.toml"], *options)
    assert not (here / "out.mcap").exists()


def test_a_forgotten_out_loses_no_recording(importer: Importer, here: Path) -> None:
    (here / "b.nmea").write_text(nmea(START, 3))
    before = (here / "b.nmea").read_bytes()
    with pytest.raises(WayfixError, match=r"b.nmea: exists already; the last path is OUT.mcap"):
        importer.together([here / "a.nmea", here / "gyro.csv"], out="b.nmea")
    assert (here / "b.nmea").read_bytes() == before


def test_a_colon_may_be_part_of_a_path(importer: Importer, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(here)
    (here / "12:30").mkdir()
    for name in ("a:b.csv", "12:30/a.csv", "both.csv:x.toml"):
        (here / name).write_text(gyro_rows(START.timestamp()))
    (here / "12:30/map.toml").write_text(GYRO_MAP.format(time="unix = true"))
    for text, file, mapping in (
        ("a.nmea", "a.nmea", None),
        ("a:b.csv", "a:b.csv", None),
        ("a:b.csv:gyro-map.toml", "a:b.csv", "gyro-map.toml"),
        ("12:30/a.csv:12:30/map.toml", "12:30/a.csv", "12:30/map.toml"),
        ("gyro.csv:12:30/map.toml", "gyro.csv", "12:30/map.toml"),
        ("both.csv:x.toml", "both.csv:x.toml", None),
        ("gone.csv:gyro-map.toml", "gone.csv", "gyro-map.toml"),
        ("gone:1.csv", "gone:1.csv", None),
    ):
        assert given_as(text) == Given(Path(file), None if mapping is None else Path(mapping)), text
    one = importer.together(["a:b.csv:gyro-map.toml"], out="one.mcap")
    with_option = importer.together(["a:b.csv"], "--map", "gyro-map.toml", out="option.mcap")
    assert one.out.read_bytes() == with_option.out.read_bytes()


def test_a_full_disk_leaves_nothing_behind(importer: Importer, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise WayfixError("the log cannot be written any further")

    (here / "boot.csv").write_text(gyro_rows(START.timestamp(), 3))
    before = names(here)
    monkeypatch.setattr(LogWriter, "write_frame", fail)
    with pytest.raises(WayfixError, match="any further"):
        importer.together([f"{here}/{name}.csv:{here}/gyro-map.toml" for name in ("gyro", "boot")])
    assert names(here) == before


def test_a_log_of_several_replays_to_the_bit(importer: Importer, here: Path) -> None:
    one = importer.together([here / "a.nmea", f"{here}/gyro.csv:{here}/gyro-map.toml"], filters="fuzzy")
    before = [record.data for record in read_log(one.out).records("/estimates/fuzzy")]
    assert main(["replay", str(one.out), "--record", str(here / "again.mcap")]) == 0
    assert [record.data for record in read_log(here / "again.mcap").records("/estimates/fuzzy")] == before


def test_what_comes_late_comes_late_in_the_log_too(importer: Importer, here: Path) -> None:
    """Half a second of delay on the way to the recorder keeps its time, and its frame is the one in which it came."""
    t = START.timestamp()
    (here / "late.csv").write_text(f"t,r\n{t},1\n{t + 1},2\n{t + 0.4},3\n{t + 2},4\n")
    one = importer.together([f"{here}/{name}.csv:{here}/gyro-map.toml" for name in ("late", "gyro")])
    (frame,) = [frame for frame in one.frames if any(rate.rate_deg_s == 3 for rate in frame.turn_rates)]
    late = next(rate for rate in frame.turn_rates if rate.rate_deg_s == 3)
    assert (late.t_ns - T0) / NS_PER_S == pytest.approx(0.4)
    assert frame.t0_ns == T0 + NS_PER_S
    assert isinstance(frame, Frame)
