import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from common.errors import WayfixError
from common.messages import Fix
from common.units import NS_PER_S
from shore.report.reference import read_reference
from shore.report.score import Consistency, consistency_table, score_of
from tests.navigate.voyages import BOAT
from tests.strategies import frame_of

HEAD = "t_s,lat_deg,lon_deg,heading_true_deg\n"


def reference(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "reference.csv"
    file.write_bytes(text.encode())
    return file


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "has 0 rows"),
        (HEAD + "0,1,1,1\n", "has 1 row,"),
        ("t_s,y,x,h\n0,1,1,1\n1,1,1,1\n", "has no column lat_deg, lon_deg"),
        ("s,lat,lon,h\n0,1,1,1\n1,1,1,1\n", "has no column t_s"),
        ("utc,lat,lon\n2026-05-12,1,1\n1,1,1\n", "line 2: utc cannot be '2026-05-12'"),
        ("utc,lat,lon\n2026-05-12T10:08:00Z,1,1\n2026-05-12T10:08:01Z,1,1\n", "the log does not know UTC"),
        ("<gpx><trk><trkseg><trkpt lat='1' lon='1'/></trkseg></trk></gpx>", "has 0 points with a time"),
        ("<!DOCTYPE a []><gpx></gpx>", "holds a document type"),
        (HEAD + "0,1,1,1\n1,nan,1,1\n", "line 3: lat_deg cannot be 'nan'"),
        (HEAD + "0,1,1,1\n1,inf,1,1\n", "line 3: lat_deg cannot be 'inf'"),
        (HEAD + "0,95,1,1\n1,1,1,1\n", "line 2: lat_deg cannot be '95'"),
        (HEAD + "0,1,1,1\n1,1\n", "line 3: lon_deg cannot be None"),
        (HEAD + "1,1,1,1\n0,1,1,1\n", "line 3: time does not grow"),
        (HEAD + "x" * 200_000, "is no CSV text"),
    ],
)
def test_a_reference_that_cannot_be_right_is_one_sentence(tmp_path: Path, text: str, part: str) -> None:
    with pytest.raises(WayfixError) as caught:
        read_reference(reference(tmp_path, text), 0)
    assert part in str(caught.value)
    assert "reference.csv" in str(caught.value)


def test_a_reference_is_interpolated_across_north_and_never_over_a_hole(tmp_path: Path) -> None:
    text = "\ufefft_s, lat_deg, lon_deg, heading_true_deg\n0,50,1,350\n1,50,1,10\n10,50,1,20\n11,50,1,30\n"
    track = read_reference(reference(tmp_path, text), 5 * NS_PER_S)
    middle = track.at(int(5.5 * NS_PER_S))
    assert middle is not None
    assert middle.heading_deg is not None
    assert math.isclose(math.remainder(middle.heading_deg, 360.0), 0.0, abs_tol=1e-9)
    assert track.at(10 * NS_PER_S) is None
    assert track.at(4 * NS_PER_S) is None
    assert track.at(17 * NS_PER_S) is None
    assert track.at(int(15.5 * NS_PER_S)) is not None


TWO = "2023-11-14T22:13:2{}Z"
UTC_NS = 1_700_000_000 * NS_PER_S


@pytest.mark.parametrize(
    "text",
    [
        f"utc,lat,lon,heading\n{TWO.format(0)},50,1,350\n{TWO.format(1)},50,1,\n",
        "timestamp;latitude;longitude\n1700000000;50;1\n1700000001;50;1\n",
        "time,lat_deg,lon_deg\n1700000000000,50,1\n1700000001000,50,1\n",
        "<gpx xmlns='http://www.topografix.com/GPX/1/0'><trk><trkseg>{}{}</trkseg></trk></gpx>".format(
            *(f"<trkpt lat='50' lon='1'><time>{TWO.format(second)}</time></trkpt>" for second in (1, 0))
        ),
    ],
)
def test_a_reference_in_utc_and_without_heading(text: str, tmp_path: Path) -> None:
    track = read_reference(reference(tmp_path, text), 0, lambda: UTC_NS - 5 * NS_PER_S)
    middle = track.at(int(5.5 * NS_PER_S))
    assert middle is not None
    assert (middle.east_m, middle.north_m, middle.heading_deg) == (0.0, 0.0, None)
    assert track.at(4 * NS_PER_S) is None


def record(name: str, nis: float, *, aligned: bool = True) -> dict[str, Any]:
    channel = {"sigma": 1.0, "dom_ratio": None, "nis": nis}
    parts = ["position", "heading"] if aligned else []
    return {
        "filter": name, "aligned": aligned, "aligned_parts": parts,
        "sigma_east_m": 3.0, "sigma_north_m": 4.0, "sigma_heading_deg": 2.0,
        "channels": {"gps1.east": channel, "gps1.north": {**channel, "nis": 2.0 * nis}, "compass1.heading": channel},
    }  # fmt: skip


def test_consistency_counts_each_update_once_and_what_is_aligned() -> None:
    consistency = Consistency()
    for nis, repeats in ((1.0, 10), (4.0, 3), (2.0, 1)):
        for _ in range(repeats):
            consistency.take(record("ukf", nis))
    consistency.take(record("ukf", 99.0, aligned=False))
    consistency.take(record("kf", 0.5))
    summary = consistency.summary()
    assert summary["ukf"] == {
        "nis_position": 3.5, "nis_heading": 2.3333, "sigma_m": 5.0, "sigma_deg": 2.0, "aligned": 14,
    }  # fmt: skip
    assert list(summary) == ["ukf", "kf"]
    assert consistency_table(summary).splitlines()[2].split() == ["ukf", "3.50", "2.33", "5.00", "2.00", "14"]


def test_frames_and_estimates_are_gone_through_once(tmp_path: Path) -> None:
    """Iterators are enough; errors are those of hand: 1.11 m north of the truth at 0.5 s, 10 deg at 0.6 s."""
    path = reference(tmp_path, HEAD + "0,50,1,350\n1,50,1,350\n")
    fix = Fix(sensor="gps1", t_ns=1_500_000_000, lat_deg=50.0 + 1e-5, lon_deg=1.0, fix_quality=1)
    frame = frame_of(fix, t0_ns=NS_PER_S, t1_ns=2 * NS_PER_S)
    estimate = {"filter": "ukf", "t_ns": 1_600_000_000, "lat_deg": 50.0, "lon_deg": 1.0, "heading_true_deg": 0.0}
    score = score_of(path, BOAT, iter([frame]), iter([estimate]))
    summary = score.summary()
    assert summary["position_rms_m"] == pytest.approx({"gps": 1.112, "ukf": 0.0}, abs=2e-3)
    assert summary["heading_rms_deg"] == {"compass": None, "ukf": 10.0}
    with pytest.raises(WayfixError, match="does not overlap"):
        score_of(path, BOAT, iter([replace(frame, fixes=())]), iter([{**estimate, "t_ns": 9 * NS_PER_S}]))
    with pytest.raises(WayfixError, match="neither a fix nor an estimate"):
        score_of(path, BOAT, iter([replace(frame, fixes=())]), iter([]))
