"""Every real recording beside the repository: imported, or refused with a sentence that says what it is."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import pytest

from common.boat_config import BoatConfig
from common.codec import decode_frame
from common.errors import WayfixError
from common.settings import convert
from shore.imports.recognise import RecordingKind
from shore.logbook.estimate_rounding import logged
from shore.logbook.log_reader import read_log
from shore.pipeline import Pipeline
from tests.recordings import REPOSITORY, SHARED_DATA
from tests.station.imports import Imported, Importer

MAPS = {
    "blueboat-usv/*.csv": "blueboat",
    "milliampere-ferry/*_fix.csv": "milliampere-fix",
    "milliampere-ferry/*_heading.csv": "milliampere-heading",
    "milliampere-ferry/*_imu.csv": "milliampere-imu",
    "milliampere-ferry/*_nav_estimate.csv": "milliampere-nav",
    "car-imu-gps/*.csv": "car-imu-gps",
    "catabot-lake/*.csv": "catabot",
}
REFUSED = {
    "ais-live/*.csv": "AIS positions of other ships",
    "autoferry-tracking/*_detections.json": "decoded detections",
    "autoferry-tracking/*_groundTruth.json": "tracks of other vessels",
    "ddboat-imu-gps/*": "text log of a program",
    "target-worlds/*": "is JSON of another kind",
    "gpsd-receivers/ublox-neo-m8n.log": "is binary (u-blox UBX)",
    "telemetron-radar/*.mat": "MATLAB file",
    "telemetron-radar/*_detections.csv": "decoded radar detections",
    "telemetron-radar/*_truth.csv": "is a table with the columns time_unix_s",
}
NOTHING = (
    "ais-18-27.log.chk",
    "ais_unpack_sixbit.log.chk",
    "passthrough.log",
    "passthrough.log.chk",
    "tnt-revolution.log",
    "tnt-revolution.log.chk",
)
"""Exit code 1: gpsd's decoded AIS, JSON of no receiver, a compass that sends counts."""
LESS_THAN_HALF = ("tcp-torture.log.chk",)
"""Exit code 1 and a log: two of its three TPVs have no time."""
FIXES = {
    "gpsd-receivers/bu353s4.log": 25,
    "gpsd-receivers/bu353s4.log.chk": 25,
    "gpsd-receivers/neo-m8n.log": 24,
    "gpsd-receivers/nmea-rtk.log": 122,
    "gpsd-receivers/nmea-rtk.log.chk": 122,
    "gpsd-receivers/saab-r4.log": 12,
    "gpsd-receivers/saab-r4.log.chk": 12,
    "milliampere-ferry/maneuvering1_GPGGA.csv": 1795,
    "milliampere-ferry/maneuvering1_fix.csv": 1792,
    "milliampere-ferry/maneuvering1_heading.csv": 0,
    "milliampere-ferry/maneuvering1_nav_estimate.csv": 374,
    "blueboat-usv/fixed_00000216.csv": 485,
    "blueboat-usv/fixed_00000235.csv": 3098,
    "car-imu-gps/2014-03-26-000-Data_first4500.csv": 894,
    "catabot-lake/20201006_Lake_China_tlog_GPS_first5000.csv": 1240,
    "signalk-boat-nmea/plaka.log": 500,
}
"""Some of them, counted."""
KNOWN = (
    "ais-live", "autoferry-tracking", "blueboat-usv", "car-imu-gps", "catabot-lake", "ddboat-imu-gps", "gpsd-receivers",
    "milliampere-ferry", "ocean-rtk-usv", "radar-ttm-nmea", "sailing-nmea", "serial-snippets", "signalk-boat-nmea",
    "target-worlds", "telemetron-radar",
)  # fmt: skip
"""Folders of which this test knows what becomes of each file. A file of another folder may be imported or refused."""
LARGE_BYTES = 40_000
FILES = sorted(path for path in SHARED_DATA.glob("*/*") if path.is_file() and path.name != "README.md")


def named(path: Path) -> str:
    return str(path.relative_to(SHARED_DATA))


PARAMETERS = [
    pytest.param(path, id=named(path), marks=[pytest.mark.slow] if path.stat().st_size > LARGE_BYTES else [])
    for path in FILES
] or [pytest.param(SHARED_DATA / "nothing", marks=pytest.mark.skip(reason="no recordings beside the repository"))]


def map_of(path: Path) -> list[str]:
    found = [name for pattern, name in MAPS.items() if path.match(pattern)]
    return ["--map", str(REPOSITORY / "deploy" / "examples" / f"{found[0]}-map.toml")] if found else []


def refusal_of(path: Path) -> str | None:
    return next((words for pattern, words in REFUSED.items() if path.match(pattern)), None)


def kind_of(path: Path) -> RecordingKind:
    if path.suffix == ".chk" or path.name == "passthrough.log":
        return RecordingKind.GPSD
    return RecordingKind.TABLE if map_of(path) else RecordingKind.SERIAL


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


@pytest.mark.parametrize("path", PARAMETERS)
def test_every_file_is_imported_or_refused(path: Path, importer: Importer) -> None:
    refusal = refusal_of(path)
    if refusal is not None:
        with pytest.raises(WayfixError, match=re.escape(refusal)) as caught:
            importer(path)
        assert caught.value.cure
        assert not importer.directory.joinpath("out.mcap").exists()
        return
    if path.parent.name not in KNOWN:
        try:
            assert importer(path).code in (0, 1)
        except WayfixError as fault:
            assert fault.cure  # noqa: PT017
        return
    imported = importer(path, *map_of(path))
    assert imported.summary["kind"] == kind_of(path)
    if path.name in NOTHING:
        assert imported.code == 1
        assert imported.summary["measurements"] == {}
        assert not imported.out.exists()
        return
    assert imported.code == (path.name in LESS_THAN_HALF)
    assert sum(imported.summary["measurements"].values()) > 0
    assert imported.summary["measurements"].get("fixes", 0) == FIXES.get(
        named(path), imported.summary["measurements"].get("fixes", 0)
    )
    assert units_of(path) in [account["total"] for account in imported.summary["accounts"].values()]
    check_extent(path, imported)


def units_of(path: Path) -> int:
    """Lines of the file that are not empty, or rows below the head of a table."""
    data = path.read_bytes().replace(b"\r", b"\n")
    return sum(bool(line.strip()) for line in data.split(b"\n")) - bool(map_of(path))


def check_extent(path: Path, imported: Imported) -> None:
    """The track lies where the file says, and reaches as far; read here apart from all decoders."""
    places = set(places_in(path))
    fixes = [(fix.lat_deg, fix.lon_deg or 0.0) for fix in imported.fixes if fix.lat_deg is not None]
    assert bool(places) == bool(fixes)
    for axis in (0, 1):
        for end in (min, max):
            # Single fixes may be missing at the ends: before the first time, in a line that is cut.
            wanted = sorted(place[axis] for place in places)
            found = end(fix[axis] for fix in fixes) if fixes else None
            close = wanted[:3] if end is min else wanted[-3:]
            assert found is None or any(abs(found - place) < 2e-6 for place in close), (axis, end, found, close)


_PLACE = re.compile(
    rb"[$]..(?:GGA,[^,]*|GNS,[^,]*|RMC,[^,]*,[AV]|GLL),([0-9]+\.?[0-9]*),([NS]),([0-9]+\.?[0-9]*),([EW])[^\r\n]*\*"
)


def places_in(path: Path) -> list[tuple[float, float]]:
    if path.suffix == ".chk":
        objects = [json.loads(line) for line in path.read_bytes().splitlines() if line.startswith(b"{")]
        has_times = any("time" in one for one in objects)
        used = [one for one in objects if one["class"] == "TPV" and "lat" in one and ("time" in one or not has_times)]
        return [(one["lat"], one["lon"]) for one in used]
    if map_of(path):
        return [place for place in places_in_table(path) if place is not None]
    found = []
    for lat, south, lon, west in _PLACE.findall(path.read_bytes()):
        signs = (-1 if south == b"S" else 1, -1 if west == b"W" else 1)
        found.append((signs[0] * degrees(lat), signs[1] * degrees(lon)))
    return found


def degrees(text: bytes) -> float:
    whole, minutes = divmod(float(text), 100.0)
    return whole + minutes / 60.0


def places_in_table(path: Path) -> list[tuple[float, float] | None]:
    with path.open(newline="") as stream:
        rows = [{key.strip(): value for key, value in row.items() if key} for row in csv.DictReader(stream)]
    for lat, lon, scale in (
        ("lat", "lon", 1.0),
        ("latitude", "longitude", 1.0),
        ("mavlink_global_position_int_t.lat", "mavlink_global_position_int_t.lon", 1e-7),
    ):
        if lat in rows[0]:
            return [(float(row[lat]) * scale, float(row[lon]) * scale) if row[lat] else None for row in rows]
    if "pose_position_x" in rows[0]:
        # The flat formula of the sphere is enough: within the ferry's harbour it is good to a decimetre.
        return [place_of(float(row["pose_position_x"]), float(row["pose_position_y"])) for row in rows]
    return []


def place_of(north_m: float, east_m: float) -> tuple[float, float]:
    # Radii of curvature of WGS 84 at 63.44 deg: 6387.0 km in the meridian, 6395.2 km across, times cos(latitude).
    return 63.4389029083 + north_m / 111_474.0, 10.39908278 + east_m / 49_909.0


def small(pattern: str) -> list[Path]:
    return [path for path in FILES if path.match(pattern) and refusal_of(path) is None and path.name not in NOTHING]


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(path, id=named(path), marks=[] if number % 10 == 0 else [pytest.mark.slow])
        for number, path in enumerate([*small("gpsd-receivers/*"), *small("serial-snippets/*"), *small("*/*.csv")])
    ]
    or PARAMETERS,
)
def test_an_import_gives_the_same_bytes_again(path: Path, importer: Importer) -> None:
    first = importer(path, *map_of(path), out="a.mcap", filters="fuzzy")
    again = importer(path, *map_of(path), out="b.mcap", filters="fuzzy")
    assert first.out.read_bytes() == again.out.read_bytes()


LOGS = [path for path in small("gpsd-receivers/*.log") if path.with_name(path.name + ".chk").exists()]


@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem) for path in LOGS[::3]] or PARAMETERS)
def test_gpsd_says_the_same_places(path: Path, importer: Importer) -> None:
    """The .chk is gpsd's own reading of the same bytes: each of its fixes is one of ours of that time of day."""
    ours = importer(path, out="log.mcap")
    try:
        theirs = importer(path.with_name(path.name + ".chk"), out="chk.mcap")
    except WayfixError:
        pytest.skip("gpsd says nothing of it")
    if theirs.code == 1:
        return
    places: dict[int, list[tuple[float, float]]] = {}
    for fix in ours.fixes:
        if fix.tod_ms is not None and fix.lat_deg is not None and fix.lon_deg is not None:
            places.setdefault(fix.tod_ms, []).append((fix.lat_deg, fix.lon_deg))
    compared = 0
    for fix in theirs.fixes:
        if fix.tod_ms is None or fix.lat_deg is None or fix.lon_deg is None:
            continue
        compared += 1
        near = [max(abs(lat - fix.lat_deg), abs(lon - fix.lon_deg)) for lat, lon in places.get(fix.tod_ms, [])]
        assert near, (path.stem, fix.tod_ms)
        assert min(near) < 1e-6, (path.stem, fix.tod_ms)
    timed = [fix for fix in theirs.fixes if fix.tod_ms is not None and fix.lat_deg is not None]
    assert compared == len(timed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["saab-r4.log.chk", "humminbird-M37.log", "nmea-rtk.log"])
def test_an_imported_log_replays_bit_for_bit(name: str, importer: Importer) -> None:
    path = SHARED_DATA / "gpsd-receivers" / name
    if not path.exists():
        pytest.skip("no recordings beside the repository")
    imported = importer(path, filters="fuzzy,ukf")
    replayed = replay_of(imported.out)
    assert replayed == [record.json() for record in read_log(imported.out).records("/estimates/fuzzy")]
    assert len(replayed) > 100


def replay_of(log: Path) -> list[dict[str, Any]]:
    """The log's frames through a pipeline made of nothing but the log."""
    reader = read_log(log)
    start = next(record.json() for record in reader.records("/session"))
    config = convert(start["connected"]["config"], BoatConfig)
    pipeline = Pipeline(config, start["options"]["filters"])
    return [
        json.loads(json.dumps(logged(estimate.as_record())))
        for record in reader.records("/frames")
        for estimate in pipeline.push(decode_frame(record.data)).estimates
        if estimate.filter == "fuzzy"
    ]
