"""What an estimate rests on leaves the house: each export shows a loss of the fix, and no number of too much doubt."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from fastkml.validator import validate

from common.messages import Fix
from shore.exports.formats import FORMATS
from shore.logbook.estimate_rounding import as_before, is_near, logged
from shore.logbook.log_reader import LogRecord, read_log
from shore.main import main
from tests.cases import CASES, needs_cases
from tests.navigate.test_basis import GPS, boat, sailed
from tests.station.exporting import NS, empty_frame, estimate, export, gpx_of, log_of, mcap_messages, rows_of, sentences
from tests.station.imports import Imported, Importer
from tests.station.logs import Done, rewritten
from tests.station.logs import log_of as live_log
from tests.station.test_export_shapes import geojson_of

SIGMAS_M = {"fix": (2.0, 3.0, 4.9), "coasting": (5.0, 30.0, 60.0, 400.0), "lost": (900.0,), "again": (2.0, 2.0)}
"""1-sigma of a position on either axis, by the stretch of the trip."""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A second between rows; the last stretch has no compass."""
    items: list[Any] = []
    for stretch, sigmas_m in SIGMAS_M.items():
        for sigma_m in sigmas_m:
            t_s = 1.0 + len(items)
            is_fixed = stretch in ("fix", "again")
            more: dict[str, Any] = {"heading_from": "course", "aligned": False} if stretch == "again" else {}
            if stretch == "lost":
                more = {"heading_true_deg": None, "heading_from": None, "sigma_heading_deg": 40.0, "aligned": False}
            parts = {"lost": (), "again": ("position",)}.get(stretch, ("position", "heading"))
            items.append(
                estimate(
                    t_s, 50.0, t_s / 1e4, sigma_east_m=0.6 * sigma_m, sigma_north_m=0.8 * sigma_m,
                    covariance=((0.6 * sigma_m) ** 2, 0.0, (0.8 * sigma_m) ** 2), aligned_parts=parts,
                    position_from="fix" if is_fixed else "coasting",
                    position_since_ns=(1 if stretch == "fix" else 3 if not is_fixed else 9) * NS, **more,
                )
            )  # fmt: skip
    return log_of(tmp_path / "log.mcap", items)


def test_sentences_say_estimated_and_how_safe(log: Path, tmp_path: Path) -> None:
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    said = list(sentences(tmp_path / "a.nmea"))
    assert [gga.gps_qual for gga in said if gga.sentence_type == "GGA"] == [1, 1, 1, 6, 6, 6, 6, 0, 1, 1]
    rmc = [each for each in said if each.sentence_type == "RMC"]
    assert [(each.status, *each.data[11:]) for each in rmc] == [
        *[("A", "A", "S")] * 3, ("A", "E", "C"), ("A", "E", "C"), ("A", "E", "U"), ("A", "E", "U"), ("V", "N", "U"),
        *[("A", "A", "S")] * 2,
    ]  # fmt: skip
    assert [each.data[2:6] for each in rmc if each.status == "V"] == [["", "", "", ""]]
    text = (tmp_path / "a.nmea").read_text()
    assert text.count("HDT,12.500,T") == 7
    assert re.findall(r"\$..THS,.*?\*", text) == ["$INTHS,12.500,E*"] * 2


def test_a_raw_fix_keeps_its_quality(tmp_path: Path) -> None:
    frames = [
        empty_frame(t_s, fixes=(Fix(sensor="g", t_ns=round(t_s * NS), lat_deg=1.0, lon_deg=2.0, fix_quality=quality),))
        for t_s, quality in ((1.0, 1), (2.0, 2), (3.0, 4), (4.0, None))
    ]
    log = log_of(tmp_path / "log.mcap", frames)
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    said = list(sentences(tmp_path / "a.nmea"))
    assert [each.gps_qual for each in said if each.sentence_type == "GGA"] == [1, 2, 4, 1]
    assert [each.data[11:] for each in said if each.sentence_type == "RMC"] == [
        ["A", "C"], ["D", "C"], ["R", "C"], ["A", "C"],
    ]  # fmt: skip


def test_a_fix_of_no_use_is_drawn_by_nobody(tmp_path: Path) -> None:
    fix = Fix(sensor="g", t_ns=NS, lat_deg=1.0, lon_deg=2.0, fix_quality=1)
    changes: tuple[dict[str, Any], ...] = ({}, {"held": True}, {"fix_quality": 0}, {"status_valid": False})
    frames = [
        empty_frame(t_s, fixes=(replace(fix, t_ns=t_s * NS, **each),)) for t_s, each in enumerate(changes, start=1)
    ]
    log = log_of(tmp_path / "log.mcap", frames)
    assert export(log, "--to", "mcap", tmp_path / "a.mcap") == 0
    assert len(told(log, "/fixes/g")) == len(mcap_messages(tmp_path / "a.mcap", "/fixes/g")) == 1


@pytest.mark.slow
def test_maps_have_a_piece_for_each_stretch_and_no_place_of_too_much_doubt(log: Path, tmp_path: Path) -> None:
    assert export(log, "--to", "gpx", tmp_path / "a.gpx") == 0
    segments = gpx_of(tmp_path / "a.gpx").tracks[0].segments
    assert [[point.type_of_gpx_fix for point in segment.points] for segment in segments] == [
        [None] * 3, ["none"] * 4, [None] * 2,
    ]  # fmt: skip
    assert export(log, "--to", "kml", tmp_path / "a.kml") == 0
    assert validate(file_to_validate=tmp_path / "a.kml")
    text = (tmp_path / "a.kml").read_text()
    placemarks = [each for each in text.split("<Placemark>")[1:] if "<gx:Track>" in each]
    assert [(each.count("<gx:Track>"), each.count("<when>"), "coasting)" in each) for each in placemarks] == [
        (2, 5, False), (1, 4, True),
    ]  # fmt: skip
    pieces = [each["properties"] for each in geojson_of(log)["features"]]
    assert [(each["position_from"], len(each["coordTimes"])) for each in pieces] == [
        ("fix", 3), ("coasting", 4), ("fix", 2),
    ]  # fmt: skip
    assert pieces[1]["coordTimes"][0] == pieces[1]["begin_utc"] < pieces[1]["coordTimes"][1]
    assert export(log, "--to", "png", tmp_path / "a.png") == 0
    assert export(log, "--to", "mcap", tmp_path / "a.mcap") == 0
    assert len(mcap_messages(tmp_path / "a.mcap", "/position/ukf")) == 9


def test_what_a_map_leaves_out_is_said_and_a_map_of_nothing_is_not_written(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(log, "--to", "gpx", tmp_path / "a.gpx", "--json") == 0
    said = capsys.readouterr().out
    assert "1 estimate is left out: the doubt of their position is beyond 500 m" in said
    assert (json.loads(said.splitlines()[-1])["rows"], json.loads(said.splitlines()[-1])["left_out"]) == (9, 1)
    lost = [estimate(t_s, 50.0, 1.0, sigma_east_m=900.0, aligned_parts=()) for t_s in (1.0, 2.0)]
    lost_log = log_of(tmp_path / "lost.mcap", lost)
    for kind in ("gpx", "kml", "geojson", "png"):
        out = tmp_path / f"lost.{kind}"
        assert export(lost_log, "--to", kind, out) == 1
        assert not out.exists()
        assert "2 estimates are left out" in capsys.readouterr().err
    assert export(lost_log, "--to", "csv", tmp_path / "lost.csv") == 0


def test_tables_have_columns_of_it_and_leave_doubtful_numbers_out(log: Path, tmp_path: Path) -> None:
    assert export(log, "--to", "csv", tmp_path / "a.csv") == 0
    rows = rows_of(tmp_path / "a.csv")
    assert [row["position_from"] for row in rows] == [*["fix"] * 3, *["coasting"] * 5, *["fix"] * 2]
    assert [row["position_since_ns"] for row in rows] == [f"{t_s * NS}" for t_s in (1, 1, 1, 3, 3, 3, 3, 3, 9, 9)]
    assert [row["heading_from"] for row in rows][6:] == ["compass", "", "course", "course"]
    assert [row["lat_deg"] == row["lon_deg"] == row["heading_true_deg"] == "" for row in rows] == [
        *[False] * 7, True, False, False,
    ]  # fmt: skip
    assert rows[7]["aligned_parts"] == ""
    assert float(rows[7]["sigma_east_m"]) == 540.0
    assert export(log, "--to", "parquet", tmp_path / "a.parquet") == 0
    table = pl.read_parquet(tmp_path / "a.parquet")
    assert table["position_from"].to_list() == [row["position_from"] for row in rows]
    assert table["position_since_ns"].dtype == pl.Int64


def test_a_course_of_too_much_doubt_is_no_number(tmp_path: Path) -> None:
    names, speed = ("east_m", "north_m", "v_east_m_s", "v_north_m_s"), 3.0 * 1852 / 3600

    def at(t_s: float, sigma_m_s: float) -> dict[str, Any]:
        upper = (4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, sigma_m_s**2, 0.0, sigma_m_s**2)
        return estimate(t_s, 50.0, 1.0, names=names, state=(0.0, 0.0, 0.0, speed), covariance=upper, cog_true_deg=45.0)

    log = log_of(tmp_path / "log.mcap", [at(1.0, 0.57 * speed), at(2.0, 0.58 * speed)])  # tan 30 deg = 0.577
    assert export(log, "--to", "csv", tmp_path / "a.csv") == 0
    assert [row["cog_true_deg"] for row in rows_of(tmp_path / "a.csv")] == ["45.0", ""]


SLOW = boat(GPS)
"""A boat without compass."""


@pytest.fixture(scope="module")
def slow_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds at 1.2 kn without compass: no heading is known."""
    frames = [sailed(second, 1.2, compass=False) for second in range(1, 21)]
    return live_log(tmp_path_factory.mktemp("slow"), frames, {0: SLOW})


def written_before(log: Path, path: Path, comma: str = ",") -> Path:
    """The same log in the form that did not say what estimates rest on, with a heading whatever its doubt.

    comma: behind each field; another one than ours is that of another program.
    """
    made = [logged(as_before(record)) for record in Done(log).estimates]
    assert None not in [record["heading_true_deg"] for record in made]

    def change(record: LogRecord, number: int) -> bytes:
        if not record.topic.startswith("/estimates"):
            return record.data
        return json.dumps(made[number], separators=(comma, ":")).encode()

    return rewritten(log, path, change)


@pytest.mark.slow
def test_a_log_of_before_is_the_same_in_a_replay_and_shows_no_heading_of_too_much_doubt(
    slow_log: Path, tmp_path: Path
) -> None:
    assert all(record["heading_true_deg"] is None for record in read_log(slow_log).estimates())
    before = written_before(slow_log, tmp_path / "before.mcap")
    for log in (slow_log, before, written_before(slow_log, tmp_path / "foreign.mcap", ", ")):
        done = Done(log)
        assert done.counts().equal == done.counts().recorded == done.counts().made == 20
    recorded = list(read_log(before).estimates())
    assert [record["aligned_parts"] for record in recorded] == [[]] * 20
    assert {record["position_from"] for record in recorded} == {None}
    assert is_near(Done(before).estimates[-1], recorded[-1])
    for kind in FORMATS:
        assert export(before, "--to", kind, tmp_path / f"a.{kind}") == 0
    assert {row["heading_true_deg"] for row in rows_of(tmp_path / "a.csv")} == {""}
    assert "HDT" not in (tmp_path / "a.nmea").read_text()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("aligned_parts", ["position", "heading"]),
        ("position_from", "coasting"),
        ("position_since_ns", 7),
        ("heading_from", "compass"),
        ("heading_true_deg", 12.5),
    ],
)
def test_another_basis_is_a_difference(field: str, value: Any, slow_log: Path, tmp_path: Path) -> None:
    def change(record: LogRecord, number: int) -> bytes:
        if not record.topic.startswith("/estimates") or number != 5:
            return record.data
        return json.dumps(json.loads(record.data) | {field: value}, separators=(",", ":")).encode()

    done = Done(rewritten(slow_log, tmp_path / "other.mcap", change))
    assert done.counts().different == 1
    assert field in str(done.run.comparison and done.run.comparison.first)


# The cases, each named after its input

BOAT_1_HZ = """
[boat]
id = "case"
[frames]
rate_hz = 1.0
[[port]]
name = "p"
path = "/dev/p"
[[sensor]]
id = "gps1"
port = "p"
role = "gps"
model = "nmea"
"""
A_COMPASS = """
[[sensor]]
id = "compass1"
port = "p"
role = "compass"
model = "nmea"
"""


def case_of(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], sensors: str = "") -> Imported:
    """A case as it is imported, with one frame a second."""
    config = tmp_path / "boat.toml"
    config.write_text(BOAT_1_HZ + sensors, encoding="utf-8")
    return Importer(tmp_path, capsys)(CASES / "shore" / name, "--config", str(config), filters="fuzzy")


def told(log: Path, topic: str) -> list[bytes]:
    return [each.data for each in read_log(log).records(topic)]


@needs_cases
def test_gps_outage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The receiver says V from 150 s to 270 s: estimated in the sentences, and two events."""
    log = case_of("gps-outage.nmea", tmp_path, capsys, A_COMPASS).out
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    qualities: dict[int, set[Any]] = {}
    for each in sentences(tmp_path / "a.nmea"):
        if each.sentence_type in ("GGA", "RMC"):
            hour, minute, second = each.data[0][:2], each.data[0][2:4], float(each.data[0][4:])
            t_s = round((int(hour) - 10) * 3600 + (int(minute) - 8) * 60 + second)
            qualities.setdefault(t_s, set()).add(each.gps_qual if each.sentence_type == "GGA" else each.data[11])
    assert all(qualities[t_s] == {1, "A"} for t_s in (*range(20, 150), *range(272, 401)))
    assert all(qualities[t_s] == {6, "E"} for t_s in range(152, 270))
    codes = [each["code"] for each in map(json.loads, told(log, "/events"))]
    assert [code for code in codes if code.startswith("fix-")] == ["fix-lost", "fix-regained"]
    capsys.readouterr()
    assert main(["log", "info", str(log)]) == 0
    assert "0:02:00 coasting without a fix (longest 0:02:00)" in " ".join(capsys.readouterr().out.split())


@needs_cases
def test_slow_no_compass(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """300 s at 1.2 kn with RMC alone: a position track, and the heading is not known."""
    made = case_of("slow-no-compass.nmea", tmp_path, capsys)
    log, valid = made.out, made.summary["aligned_parts"]
    assert (made.code, valid["heading"]) == (0, 0)
    assert valid["position"] > 280
    (summary,) = (each for each in map(json.loads, told(log, "/session")) if each["kind"] == "summary")
    assert summary["north_deg"] - summary["south_deg"] < 1e-4
    assert summary["east_deg"] - summary["west_deg"] == pytest.approx(0.00217, abs=0.0001)
    assert summary["heading_from_s"].keys() == {"unknown"}
    assert export(log, "--to", "nmea", tmp_path / "a.nmea") == 0
    said = list(sentences(tmp_path / "a.nmea"))
    assert {each.sentence_type for each in said} == {"GGA", "RMC"}
    assert [each.gps_qual for each in said if each.sentence_type == "GGA"].count(1) > 280
    codes = [each["code"] for each in map(json.loads, told(log, "/events"))]
    assert codes.count("heading-unknown") == 1
