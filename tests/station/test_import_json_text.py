"""JSON as other programs wrap it: arrays, indentation, time stamps before each object."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shore.imports.json_lines import one_object_a_line
from shore.imports.recognise import RecordingKind, recognise
from tests.cases import CASES, needs_cases
from tests.station.imports import Importer, delta, tpv

SHORE = CASES / "shore"


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


@needs_cases
def test_gpsd_array(importer: Importer) -> None:
    imported = importer(SHORE / "gpsd-array.json")
    said = json.loads((SHORE / "gpsd-array.json").read_text())
    assert [(fix.lat_deg, fix.lon_deg) for fix in imported.fixes] == [(each["lat"], each["lon"]) for each in said]
    assert imported.code == 0


@needs_cases
def test_gpsd_stamped(importer: Importer) -> None:
    imported = importer(SHORE / "gpsd-stamped.json")
    lines = (SHORE / "gpsd-stamped.json").read_text().splitlines()
    said = [json.loads(line[line.index("{") :]) for line in lines]
    assert [fix.lat_deg for fix in imported.fixes] == [each["lat"] for each in said]
    assert imported.code == 0


OBJECTS = st.lists(
    st.dictionaries(st.text(max_size=4), st.integers() | st.text(max_size=5) | st.lists(st.integers(), max_size=2),
                    min_size=1, max_size=3),
    min_size=1, max_size=6,
)  # fmt: skip


@given(objects=OBJECTS, indent=st.sampled_from([None, 0, 2]))
def test_an_array_is_its_objects(objects: list[dict[str, object]], indent: int | None) -> None:
    text = json.dumps(objects, indent=indent)
    assert [json.loads(line) for line in one_object_a_line(text.splitlines(keepends=False))] == objects


@given(st.lists(st.text('{}[],:"ab1 ', max_size=20), max_size=8))
def test_no_text_is_lost_or_breaks_it(lines: list[str]) -> None:
    kept = "".join(one_object_a_line(lines))
    assert sum(map(kept.count, "ab1")) == sum("".join(lines).count(letter) for letter in "ab1")


def test_an_object_that_is_cut_does_not_take_the_next_one_with_it() -> None:
    lines = ['{"class": "TPV",', '{"class": "SKY"}', '{"class": "A', '{"class": "B"}']
    assert list(one_object_a_line(lines)) == lines


@pytest.mark.parametrize("indent", [None, 2])
@pytest.mark.parametrize("stamp", ["", "May 12 10:08:00 ", "[2026-05-12T10:08:00Z] "])
def test_fixes_however_they_are_wrapped(indent: int | None, stamp: str, importer: Importer) -> None:
    objects = [tpv(second, lat=60.0 + second / 1e4, lon=20.0) for second in range(5)]
    if stamp:
        text = "\n".join(stamp + each for each in objects)
    else:
        text = json.dumps([json.loads(each) for each in objects], indent=indent)
    assert len(importer.text(text).fixes) == 5


def test_an_array_of_deltas(importer: Importer) -> None:
    place = {"latitude": 60.0, "longitude": 20.0}
    text = json.dumps([json.loads(delta(second, "gps", position=place)) for second in range(5)])
    assert len(importer.text(text).fixes) == 5


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("[2026-05-12 10:08:00] $GPRMC,100800,A,4213.8,N,00844.4,W,5.0,90.0,120526,,*1B\n", RecordingKind.SERIAL),
        ("[10:08:00.200] $GPRMC,100800,A,4213.8,N,00844.4,W,5.0,90.0,120526,,*1B\n", RecordingKind.SERIAL),
        ("UTC;Pos Lat;Pos Lon\n" + "2026-05-12T10:08:00Z;N4213.80000;W00844.40000\n" * 5, RecordingKind.TABLE),
        ("1526118480000;nmea;$GPRMC,100800,A,4213.8,N,00844.4,W,5.0,90.0,120526,,*1B\n", RecordingKind.SIGNALK_LOG),
    ],
)
def test_a_time_in_brackets_is_no_json_and_a_table_of_places_no_server_log(
    text: str, kind: RecordingKind, tmp_path: Path
) -> None:
    file = tmp_path / "recording"
    file.write_text(text * 3, encoding="utf-8")
    assert recognise(file, has_map=kind is RecordingKind.TABLE, is_serial=False) is kind
