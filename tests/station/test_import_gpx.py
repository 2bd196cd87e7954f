"""GPX tracks of devices and programs: read; what is no recording, or an attack, is refused."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import WayfixError
from common.units import NS_PER_S
from shore.report.gpx_points import GpxPoints
from tests.station.imports import T0, Importer, iso

HEAD = '<?xml version="1.0"?>\n<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">\n'


def point(second: float, lat: float, more: str = "") -> str:
    return f'<trkpt lat="{lat}" lon="-8.74"><time>{iso(second)}</time>{more}</trkpt>\n'


def gpx(*segments: str) -> str:
    return HEAD + "<trk>" + "".join(f"<trkseg>{segment}</trkseg>" for segment in segments) + "</trk></gpx>"


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def test_points_are_fixes(importer: Importer) -> None:
    more = "<ele>4.2</ele><course>90</course><speed>2.5</speed><fix>dgps</fix>"
    garmin = "<extensions><g:TrackPointExtension xmlns:g='urn:g'><g:speed>2.0</g:speed></g:TrackPointExtension>"
    text = gpx(point(0, 42.23, more) + point(1, 42.2301, garmin + "</extensions>"))
    imported = importer.text(text.replace("<trk>", "<wpt lat='1' lon='1'/><trk>"))
    first, second = imported.fixes
    assert (first.lat_deg, first.lon_deg, first.alt_m, first.cog_true_deg) == (42.23, -8.74, 4.2, 90.0)
    assert (first.fix_mode, first.fix_quality, first.utc_ns) == (3, 2, T0)
    assert [fix.sog_kn for fix in (first, second)] == pytest.approx([2.5 * 3600 / 1852, 2.0 * 3600 / 1852])
    assert imported.account("points")["ignored"] == {"waypoint": 1}


def test_the_newest_segment_first_and_a_segment_twice(importer: Importer) -> None:
    old, new = (point(start, 42.0) + point(start + 1, 42.1) for start in (0, 30))
    imported = importer.text(gpx(new, old, old))
    assert [((fix.utc_ns or 0) - T0) // NS_PER_S for fix in imported.fixes] == [0, 1, 30, 31]
    assert imported.code == 0


def test_the_newest_point_first(importer: Importer) -> None:
    imported = importer.text(gpx(point(2, 42.2) + point(1, 42.1) + point(0, 42.0)))
    assert [fix.lat_deg for fix in imported.fixes] == [42.0, 42.1, 42.2]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1"])
def test_any_encoding_of_xml(encoding: str, importer: Importer) -> None:
    text = gpx(point(0, 42.0) + point(1, 42.1)).replace('"1.0"?', f'"1.0" encoding="{encoding}"?')
    text = text.replace("<trk>", "<trk><name>Küste</name>")
    assert len(importer.text(text.encode(encoding)).fixes) == 2


def test_a_track_that_is_cut_off_is_read_up_to_there(importer: Importer) -> None:
    imported = importer.text(gpx(point(0, 42.0) + point(1, 42.1) + point(2, 42.2))[:-60])
    assert len(imported.fixes) == 2
    assert "damaged or cut off" in imported.words


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (gpx('<trkpt lat="42" lon="-8"/>'), "no times: a drawing"),
        (HEAD.replace("<gpx", '<!DOCTYPE gpx [<!ENTITY a "aaaa">]>\n<gpx') + "</gpx>", "holds a document type"),
        (HEAD.replace("<gpx", '<!DOCTYPE gpx SYSTEM "file:///etc/passwd">\n<gpx') + "</gpx>", "holds a document type"),
        (HEAD + "<a>" * 100, "nests its elements"),
        ("<html><gpx/></html>", "its root is <html>"),
    ],
)
def test_what_is_no_recording_is_refused(text: str, words: str, importer: Importer) -> None:
    with pytest.raises(WayfixError, match=words) as caught:
        importer.text(text)
    assert caught.value.cure


PARTS = (
    "<trkpt lat='1' lon='2'>",
    "</trkpt>",
    "<time>",
    "</time>",
    "2023",
    "<fix>",
    "&lt;",
    "</fix>",
    "&x;",
    "<",
    "\0",
)


@given(parts=st.lists(st.sampled_from(PARTS), max_size=12))
def test_any_xml_is_read_as_far_as_it_goes(parts: list[str], tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("gpx") / "in.gpx"
    path.write_text(HEAD + point(0, 1.0) + "".join(parts))
    assert next(iter(GpxPoints(path))).lat == "1.0"
    assert len(list(GpxPoints(path))) <= 1 + parts.count("</trkpt>")
