"""Tables as real loggers write them: read, or refused naming line, column and value."""

from contextlib import suppress
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.units import NS_PER_S
from shore.imports.cells import angle_in, from_packed, number_and_unit
from shore.imports.line_counts import Rejected
from shore.imports.units import factor_of, unit_of_name
from tests.cases import CASES, needs_cases
from tests.station.imports import Imported, Importer

SHORE = CASES / "shore"
BEGIN_NS = round(datetime(2026, 5, 12, 10, 8, tzinfo=UTC).timestamp()) * NS_PER_S
BOAT = '[boat]\nid = "b"\n'
ISO_TIME = BOAT + '[time]\ncolumn = "time"\nformat = "iso"\nutc = true\n'
PLACE = '[fix]\nlat = "lat"\nlon = "lon"\n'


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def mapped(importer: Importer, text: str | bytes, mapping: str) -> Imported:
    (importer.directory / "map.toml").write_text(mapping, encoding="utf-8")
    return importer.text(text, "--map", str(importer.directory / "map.toml"), name="in.csv")


def places(imported: Imported) -> list[tuple[float | None, float | None]]:
    return [(fix.lat_deg, fix.lon_deg) for fix in imported.fixes]


def utc_s(imported: Imported) -> list[float]:
    """UTC of the fixes, s after the cases' first one."""
    return [(fix.utc_ns - BEGIN_NS) / NS_PER_S for fix in imported.fixes if fix.utc_ns is not None]


@needs_cases
def test_logger_ns_ew(importer: Importer) -> None:
    imported = importer(SHORE / "logger-ns-ew.csv", "--map", str(SHORE / "logger-ns-ew.toml"))
    assert places(imported)[0] == (42.23, -8.74)
    assert len(imported.fixes) == 4
    assert utc_s(imported) == [0.0, 1.0, 2.0, 3.0]
    assert "hemisphere of 'LONGITUDE' is taken from the column 'E/W'" in imported.words


@needs_cases
def test_logger_ns_ew_with_units_in_the_cells(importer: Importer) -> None:
    mapping = (SHORE / "logger-ns-ew.toml").read_text() + 'alt = "HEIGHT"\nsog = "SPEED"\n'
    imported = mapped(importer, (SHORE / "logger-ns-ew.csv").read_bytes(), mapping)
    assert [fix.alt_m for fix in imported.fixes] == [4.2] * 4
    assert [fix.sog_kn for fix in imported.fixes] == pytest.approx([9.3 / 1.852] * 4)


@needs_cases
def test_title_line_ddmm(importer: Importer) -> None:
    mapping = BOAT + '[time]\ncolumn = "Date"\nmore = ["Time"]\nformat = "%d/%m/%y %H:%M:%S"\nutc = true\n'
    mapping += '[fix]\nlat = "Lat"\nlon = "Lon"\n[heading]\ncolumn = "Heading"\n'
    imported = mapped(importer, (SHORE / "title-line-ddmm.tsv").read_bytes(), mapping)
    assert places(imported) == [pytest.approx((42.23, -8.74 + metres / 60.0)) for metres in (0.0, 0.0019, 0.0037)]
    assert [heading.heading_true_deg for heading in imported.headings] == [90.0, 91.0, 90.0]
    assert utc_s(imported) == [0.0, 1.0, 2.0]


@needs_cases
def test_excel_german_cp1252(importer: Importer) -> None:
    imported = importer(SHORE / "excel-german-cp1252.csv", "--map", str(SHORE / "excel-german.toml"))
    assert places(imported)[0] == (42.230013, -8.7399844)
    assert len(imported.fixes) == len((SHORE / "excel-german-cp1252.csv").read_bytes().splitlines()) - 1
    assert {fix.sog_kn for fix in imported.fixes} == {5.0}


@needs_cases
def test_newest_first(importer: Importer) -> None:
    imported = importer(SHORE / "newest-first.csv", "--map", str(SHORE / "own.toml"))
    assert utc_s(imported) == [float(second) for second in range(200)]
    assert places(imported)[-1] == (42.230004, -8.7337981)
    assert "the newest row stands first" in imported.words


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("42.23", 42.23), ("-8.74", -8.74), ("8.74 W", -8.74), ("W8.74", -8.74), ("8.74° west"[:7], -8.74),
        ("42°13.8'N", 42.23), ("N 42 13.800", 42.23), ("42° 13' 48.0\" N", 42.23), ("42:13:48", 42.23),
        ("42º13′48″ S", -42.23), ("8°44.4’W", -8.74), ("42,23", 42.23), ("42-13.8N", 42.23), ("-42 13 48", -42.23),
    ],
)  # fmt: skip
def test_forms_of_an_angle(text: str, expected: float) -> None:
    axis = "EW" if abs(expected) < 9.0 else "NS"
    assert angle_in(text, axis, ",").value == pytest.approx(expected)


FORMS = ("{d}°{m:.6f}'{h}", "{h} {d} {m:.6f}", "{d}{m:09.6f}{h}", "{a:.8f} {h}", "{h}{a:.8f}°", "{v:.8f}")


@given(degrees=st.floats(-89.99, 89.99), write=st.sampled_from(FORMS))
def test_an_angle_in_any_form_is_the_same_angle(degrees: float, write: str) -> None:
    whole, minutes = divmod(round(abs(degrees) * 60.0, 6), 60.0)
    text = write.format(d=int(whole), m=minutes, h="S" if degrees < 0 else "N", a=abs(degrees), v=degrees)
    angle = angle_in(text, "NS", ".")
    value = from_packed(angle.value) if "09" in write else angle.value
    assert value == pytest.approx(degrees, abs=2e-8)


@given(st.text("0123456789.,-+NSEWnso°'\" e", max_size=14), st.sampled_from(["NS", "EW"]))
def test_any_text_for_an_angle_or_a_number(text: str, axis: str) -> None:
    for read in (lambda: angle_in(text, axis, ","), lambda: number_and_unit(text, ",")):
        with suppress(Rejected):
            read()


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("Speed (km/h)", "speed", "km/h"), ("speed [m/s]", "speed", "m/s"), ("sog_kn", "speed", "kn"),
        ("gyro_z_rad_s", "rate", "rad/s"), ("GyrZ", "rate", None), ("acc_x (g)", "acceleration", "g"),
        ("accel_fwd_m_s2", "acceleration", "m/s2"), ("time_ms", "time", "ms"), ("yaw_deg", "angle", "deg"),
        ("Breite (°)", "angle", "°"), ("speed", "speed", None), ("heading", "angle", None), ("ms", "time", None),
    ],
)  # fmt: skip
def test_the_unit_in_a_name(name: str, quantity: str, unit: str | None) -> None:
    assert unit_of_name(name, quantity) == unit
    assert unit is None or factor_of(unit, quantity) is not None


HEAD = "time,lat,lon,sog\n"
ROWS = "2026-05-12 10:08:00,42.23,-8.74,5\n2026-05-12T10:08:01.500Z,42.2301,-8.7399,5\n"
QUOTED = '2026-05-12 10:08:00,"42,23","-8,74","5"\n2026-05-12 10:08:01.5,"42,2301","-8,7399","5"\n'
EASTWARD = ROWS.replace("-8.7", "351.2").replace("351.24", "351.26").replace("351.2399", "351.2601")
PACKED = ROWS.replace("42.2301", "4213.806").replace("42.23", "4213.8").replace("-8.7399", "-844.394")
PACKED = PACKED.replace("-8.74", "-844.4")


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(HEAD + ROWS, id="plain"),
        pytest.param("sep=,\n" + HEAD + ROWS, id="sep"),
        pytest.param("sep=;\n" + (HEAD + ROWS).replace(",", ";"), id="sep-semicolon"),
        pytest.param("Device,X100\nOwner,somebody\n\n" + HEAD + ROWS, id="preamble"),
        pytest.param("# written by a logger\n#time,lat,lon,sog\n" + ROWS + "# end\n", id="comments"),
        pytest.param("// time;lat;lon;sog\n" + ROWS.replace(",", ";"), id="head-in-a-comment"),
        pytest.param((HEAD + ROWS).replace("\n", ",\n"), id="trailing-commas"),
        pytest.param((HEAD + ROWS).replace("\n", "\r\n").encode("utf-16"), id="utf-16"),
        pytest.param(HEAD + "ISO,deg,deg,kn\n" + ROWS, id="row-of-units"),
        pytest.param(HEAD + ROWS.replace(",5\n", ",5.0 kn\n"), id="units-in-cells"),
        pytest.param(HEAD + EASTWARD, id="0-to-360"),
        pytest.param((HEAD + ROWS).replace(",", ";").replace(".", ","), id="decimal-comma"),
        pytest.param(HEAD + QUOTED, id="quoted-decimal-comma"),
        pytest.param(HEAD + ROWS.split("\n", maxsplit=1)[0] + "\n" + HEAD + ROWS, id="two-files-in-one"),
        pytest.param(HEAD + PACKED, id="ddmm"),
        pytest.param(HEAD + "2026-05-12 10:07:59,--.--,--.--,--.--\n" + ROWS, id="dashes"),
    ],
)
def test_a_table_written_in_another_way(text: str | bytes, importer: Importer) -> None:
    imported = mapped(importer, text, ISO_TIME + PLACE + 'sog = "sog"\n')
    assert imported.code == 0
    assert [fix for fix in places(imported) if fix[0] is not None][-2:] == [
        pytest.approx((42.23, -8.74), abs=1e-9), pytest.approx((42.2301, -8.7399), abs=1e-9),
    ]  # fmt: skip
    assert {fix.sog_kn for fix in imported.fixes} == {5.0}
    assert utc_s(imported)[-2:] == [0.0, 1.5]
    assert not imported.account("rows")["rejected"]


@pytest.mark.parametrize(
    ("cell", "reason"),
    [
        ("8.74 N", "a letter of the other axis"), ("-8.74 W", "a minus and a letter contradict each other"),
        ("8 74.1 W", "no degrees, minutes and seconds"), ("8.74 O", "O is east in German"), ("west", "no angle"),
        ("181.5", "lon: out of range"),
    ],
)  # fmt: skip
def test_a_wrong_place_is_refused_by_line_column_and_value(cell: str, reason: str, importer: Importer) -> None:
    imported = mapped(importer, HEAD + ROWS + f"2026-05-12 10:08:02,42.23,{cell},5\n", ISO_TIME + PLACE)
    (found,) = imported.account("rows for fix")["rejected"]
    assert reason in found
    assert imported.account("rows for fix")["first"] == {found: f"line 4, column 'lon', value {cell!r}"}
    assert len(imported.fixes) == 2


def test_a_row_with_too_many_fields_is_not_read_askew(importer: Importer) -> None:
    imported = mapped(importer, HEAD + ROWS + "2026-05-12 10:08:02,42,23,-8,74,5\n", ISO_TIME + PLACE)
    assert len(imported.fixes) == 2
    assert imported.account("rows")["first"] == {"no row of this table": "line 4, 6 fields for 4 columns"}


def test_days_of_excel(importer: Importer) -> None:
    mapping = BOAT + '[time]\ncolumn = "day"\nexcel = true\nutc = true\n' + PLACE
    text = "day;lat;lon\n46154,4222222222;42,23;-8,74\n46154,4222337963;42,23;-8,74\n"
    assert utc_s(mapped(importer, text, mapping)) == [0.0, 1.0]


def test_days_and_fractions_of_excel(importer: Importer) -> None:
    mapping = BOAT + '[time]\ncolumn = "day"\nmore = ["of day"]\nexcel = true\nutc = true\n' + PLACE
    text = "day,of day,lat,lon\n46154,0.4222222222,42.23,-8.74\n46154,0.4222337963,42.23,-8.74\n"
    assert utc_s(mapped(importer, text, mapping)) == [0.0, 1.0]


@pytest.mark.parametrize("names", ["ns,ew", "N/S,E/W", "lat_dir,lon_dir", "LatRef,LonRef"])
def test_letters_of_the_hemisphere_that_stand_apart(names: str, importer: Importer) -> None:
    text = f"time,lat,lon,sog,{names}\n2026-05-12T10:08:00Z,42.23,8.74,5,N,W\n2026-05-12T10:08:01Z,42.23,8.74,5,N,W\n"
    assert places(mapped(importer, text, ISO_TIME + PLACE)) == [(42.23, -8.74)] * 2


def test_a_table_without_a_head(importer: Importer) -> None:
    mapping = BOAT + '[table]\ncolumns = ["t", "lat", "lon"]\n[time]\ncolumn = "t"\nunix = true\n' + PLACE
    imported = mapped(importer, "1778580480,42.23,-8.74\n1778580481,42.2301,-8.7399\n", mapping)
    assert utc_s(imported) == [0.0, 1.0]


def test_a_unit_that_contradicts_the_scale(importer: Importer) -> None:
    mapping = ISO_TIME + PLACE + 'sog = "sog"\nsog_scale = 1.9438\n'
    imported = mapped(importer, HEAD + ROWS.replace(",5\n", ",5 km/h\n"), mapping)
    assert imported.code == 1
    assert imported.account("rows for fix")["rejected"] == {"sog: its unit contradicts the scale of the mapping": 2}


def test_the_unit_in_a_columns_name_is_taken_and_said(importer: Importer) -> None:
    text = (HEAD + ROWS).replace("sog", "Speed (km/h)")
    imported = mapped(importer, text, ISO_TIME + PLACE + 'sog = "Speed (km/h)"\n')
    assert [fix.sog_kn for fix in imported.fixes] == pytest.approx([5 / 1.852] * 2)
    assert "sog: 'Speed (km/h)' is taken as km/h" in imported.words


def test_two_columns_of_one_name_are_refused(importer: Importer) -> None:
    with pytest.raises(WayfixError, match="more than one column lat"):
        mapped(importer, (HEAD + ROWS).replace("sog", "lat"), ISO_TIME + PLACE)


def test_both_of_a_place_in_one_cell(importer: Importer) -> None:
    text = "time\tPosition\n2026-05-12 10:08:00\tN42 13.800 W8 44.400\n2026-05-12 10:08:01\t42.23, -8.74\n"
    imported = mapped(importer, text, ISO_TIME + '[fix]\nplace = "Position"\n')
    assert places(imported) == [pytest.approx((42.23, -8.74))] * 2


def test_less_than_half_used_is_exit_code_one(importer: Importer) -> None:
    rows = "".join(f"2026-05-12 10:08:{second:02d},42.23,8.74 N,5\n" for second in range(2, 5))
    imported = mapped(importer, HEAD + ROWS + rows, ISO_TIME + PLACE)
    assert imported.code == 1
    assert len(imported.fixes) == 2
    assert (
        "3 of 5 rows for fix were refused: lon: a letter of the other axis (3); the first is line 4" in imported.words
    )


@needs_cases
@pytest.mark.slow
def test_slow_no_compass(importer: Importer) -> None:
    imported = importer(SHORE / "slow-no-compass.nmea", filters="fuzzy")
    assert imported.summary["aligned_parts"]["position"] > 2000
    assert "no heading is valid: the filters waited for: heading (there is no compass in it)" in imported.words


def test_no_position_is_why_there_are_no_estimates(importer: Importer) -> None:
    (importer.directory / "map.toml").write_text(ISO_TIME + '[heading]\ncolumn = "sog"\n')
    imported = importer.text(HEAD + ROWS, "--map", str(importer.directory / "map.toml"), name="in.csv", filters="fuzzy")
    assert "there is no position in it" in imported.words


def test_a_place_without_a_fix_and_a_tail_of_zeros(importer: Importer) -> None:
    text = HEAD + "2026-05-12 10:07:59,0,0,0\n" + ROWS + "\0" * 700
    imported = mapped(importer, text, ISO_TIME + PLACE)
    assert len(imported.fixes) == 2
    (reason,) = imported.account("rows for fix")["rejected"]
    assert reason.startswith("place 0, 0")


def test_rows_of_one_minute_are_spread_and_said(importer: Importer) -> None:
    rows = "".join(f"2026-05-12T10:{8 + k // 60:02d}:00Z,42.23{k:02d},-8.74,5\n" for k in range(30, 150))
    imported = mapped(importer, HEAD + rows, ISO_TIME + PLACE)
    assert "most rows have the time of the row before; spread = true" in imported.words
    imported.out.unlink()
    spread = mapped(importer, HEAD + rows, ISO_TIME.replace("utc = true", "utc = true\nspread = true") + PLACE)
    times = [fix.t_ns for fix in spread.fixes]
    assert {b - a for a, b in pairwise(times)} == {NS_PER_S}


def test_a_time_of_day_without_a_date(importer: Importer) -> None:
    mapping = BOAT + '[time]\ncolumn = "time"\nformat = "%H:%M:%S"\nwraps_s = 86400\n' + PLACE
    rows = "".join(f"{second // 3600 % 24:02d}:{second // 60 % 60:02d}:{second % 60:02d},42.0,8.0,5\n"
                   for second in range(86_395, 86_405))  # fmt: skip
    imported = mapped(importer, HEAD + rows, mapping)
    assert (len(imported.fixes), imported.summary["seconds"], imported.summary["utc"]) == (10, 9.1, None)
    imported.out.unlink()
    with pytest.raises(WayfixError, match="UTC without a day"):
        mapped(importer, HEAD + rows, mapping.replace("wraps_s = 86400", "utc = true"))
