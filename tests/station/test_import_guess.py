"""A proposed mapping works when it is used, and finds what a person would have written."""

import argparse
import dataclasses
import tomllib
import typing
from pathlib import Path
from typing import Any

import pytest

from common.errors import WayfixError
from common.simulation.column_map import ColumnMap
from shore.imports.arguments import add_arguments
from shore.imports.command import run
from shore.imports.guess import proposed
from tests.cases import CASES, needs_cases
from tests.recordings import REPOSITORY, SHARED_DATA
from tests.station.imports import Imported, Importer

NOW_S = 1_780_300_000.0
"""In June 2026: what can be the 5th of December is the 12th of May."""
LOGGERS = {
    "excel": "sep=;\r\nDatum;Uhrzeit;Breite;Länge;Fahrt (km/h);Kurs\r\n"
    + "".join(f"12.05.2026;10:08:{k:02d};42,23{k:02d};-8,74;9,3;0\r\n" for k in range(20)),
    "excel-serial": "Date,Lat,Lon\n" + "".join(f"{46154.4 + k / 86400:.8f},42.23{k:02d},-8.74\n" for k in range(20)),
    "garmin": "Header\tPosition\tTime\tAltitude\n"
    + "".join(f"Trackpoint\tN42 13.8{k:02d} W8 44.400\t5/12/2026 10:08:{k:02d} AM\t4 m\n" for k in range(13, 40)),
    "ardupilot": "timestamp,TimeUS,Status,Lat,Lng,Alt,Spd,GCrs\n"
    + "".join(f"{1778580480 + k},{k}000000,3,42.23{k:02d},-8.74,4.2,2.5,0.0\n" for k in range(20)),
    "mavlink": "time_boot_ms,lat,lon,vx\n" + "".join(f"{k * 200},4223{k:02d}000,-87400000,0\n" for k in range(20)),
    "qgroundcontrol": "Timestamp,roll,heading,groundSpeed,gps.lat,gps.lon,gps.courseOverGround,yawRate\n"
    + "".join(f"2026-05-12 10:08:{k:02d}.123,0.1,90,2.5,42.23{k:02d},-8.74,--.--,0.1\n" for k in range(20)),
    "sbg": "# written by sbg\ntimestamp\tlatitude\tlongitude\tyaw\tgyro z\n(us)\t(deg)\t(deg)\t(deg)\t(rad/s)\n"
    + "".join(f"{k}00000\t42.23{k:02d}\t-8.74\t90.0\t0.001\n" for k in range(20)),
    "arduino": "millis,fix,lat,lon,knots\n" + "".join(f"{k}000,1,4213.8{k:02d},-844.400,5.0\n" for k in range(20)),
    "pandas": ",time,latitude,longitude,speed_mps,heading_deg\n"
    + "".join(f"{k},2026-05-12 10:08:{k:02d}+00:00,42.23{k:02d},351.26,2.5,90.0\n" for k in range(20)),
    "nmea-like": "date,utc,lat,ns,lon,ew,sog\n"
    + "".join(f"120526,1008{k:02d},4213.8{k:02d},N,00844.400,W,5.0\n" for k in range(20)),
}


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def by_its_proposal(importer: Importer, source: Path) -> tuple[dict[str, Any], Imported]:
    text = proposed(source, NOW_S).text()
    mapping = importer.directory / "map.toml"
    mapping.write_text(text, encoding="utf-8")
    return tomllib.loads(text), importer(source, "--map", str(mapping))


@pytest.mark.parametrize("name", LOGGERS)
def test_the_proposal_reads_the_table(name: str, importer: Importer) -> None:
    source = importer.directory / f"{name}.csv"
    source.write_bytes(LOGGERS[name].encode("cp1252"))
    tables, imported = by_its_proposal(importer, source)
    rows = imported.account("rows for fix")
    assert imported.code == 0
    assert not rows["rejected"]
    assert not imported.account("rows")["rejected"]
    assert [fix.lon_deg for fix in imported.fixes] == pytest.approx([-8.74] * rows["total"])
    assert all(abs((fix.lat_deg or 0.0) - 42.23) < 0.01 for fix in imported.fixes)
    assert {round(fix.sog_kn, 1) for fix in imported.fixes if fix.sog_kn is not None} <= {5.0, 2.5, 4.9}
    if name not in ("mavlink", "sbg", "arduino"):
        assert imported.summary["utc"] is not None
        assert imported.summary["utc"].startswith("2026-05-12T"), tables["time"]


def test_the_command_prints_it_and_writes_nothing(importer: Importer, capsys: pytest.CaptureFixture[str]) -> None:
    (importer.directory / "a.csv").write_text(LOGGERS["pandas"])
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    assert run(parser.parse_args(["--guess", str(importer.directory / "a.csv")])) == 0
    assert tomllib.loads(capsys.readouterr().out)["fix"] == {
        "lat": "latitude", "lon": "longitude", "sog": "speed_mps",
    }  # fmt: skip
    assert [path.name for path in importer.directory.iterdir()] == ["a.csv"]


@needs_cases
def test_units_and_signs_that_no_name_tells(importer: Importer) -> None:
    first = CASES / "first-contact"
    tables, imported = by_its_proposal(importer, first / "yaw-rate-in-rad.csv")
    assert tables["imu"]["yaw_rate_scale"] == pytest.approx(57.29578)
    assert imported.summary["notes"] == []


@pytest.mark.skipif(not SHARED_DATA.is_dir(), reason="no recordings beside the repository")
def test_the_mapping_of_a_car_is_found_again() -> None:
    (path,) = (SHARED_DATA / "car-imu-gps").glob("*.csv")
    example = tomllib.loads((REPOSITORY / "deploy" / "examples" / "car-imu-gps-map.toml").read_text())
    found = tomllib.loads(proposed(path, NOW_S).text())
    assert found["imu"] == example["imu"]
    assert "heading" not in found  # its yaw is none
    assert found["fix"]["sog_scale"] == pytest.approx(example["fix"]["sog_scale"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n3,4\n", "no column that looks like a time"),
        ("time,b\n2026-05-12 10:08:00,2\n2026-05-12 10:08:01,4\n", "no column that looks like a place"),
    ],
)
def test_what_cannot_be_proposed_is_one_sentence(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(WayfixError, match=words) as caught:
        proposed(tmp_path / "a.csv", NOW_S)
    assert caught.value.cure


def keys_of(table: Any) -> set[str]:
    found = set()
    for field in dataclasses.fields(table):
        hint = typing.get_type_hints(table, include_extras=False)[field.name]
        found.add(field.name)
        for part in (hint, *typing.get_args(hint)):
            if dataclasses.is_dataclass(part):
                found |= keys_of(part)
    return found


def test_every_key_is_in_the_documentation() -> None:
    text = (REPOSITORY / "docs" / "mapping.md").read_text()
    keys = keys_of(ColumnMap)
    assert {"packed", "skip_lines", "sigma_m", "lat", "variation_deg"} <= keys
    assert [key for key in sorted(keys) if f"`{key}`" not in text and f"`[{key}]`" not in text] == []
