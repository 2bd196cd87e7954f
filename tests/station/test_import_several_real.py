"""Real recordings of one trip in several files, beside the repository: what they say together."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from common.units import NS_PER_S
from tests.recordings import BLUEBOAT, REPOSITORY, SHARED_DATA
from tests.station.imports import Imported, Importer

FERRY = SHARED_DATA / "milliampere-ferry"
EXAMPLES = REPOSITORY / "deploy" / "examples"
Series = npt.NDArray[np.float64]

pytestmark = pytest.mark.skipif(not FERRY.exists(), reason="no recordings beside the repository")


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


def ferry(part: str) -> str:
    return f"{FERRY}/maneuvering1_{part}.csv:{EXAMPLES}/milliampere-{part}-map.toml"


def sensors_of(imported: Imported) -> list[str]:
    return [sensor["id"] for sensor in imported.session[0]["connected"]["config"]["sensor"]]


def compass_and_gyro(imported: Imported) -> tuple[Series, Series, Series]:
    """Times of the gyro, s; the compass heading and the gyro's integral at them, deg, both from 0 on."""
    headings = [(heading.t_ns, heading.heading_true_deg) for frame in imported.frames for heading in frame.headings]
    samples = [
        (t_ns, rate)
        for frame in imported.frames
        for block in frame.imu
        for t_ns, rate in zip(block.sample_t_ns, block.yaw_rate_deg_s, strict=True)
    ]
    start_ns = headings[0][0]
    t_s, heading_deg = np.array([((t_ns - start_ns) / NS_PER_S, deg) for t_ns, deg in headings], dtype=float).T
    gyro_s, rate_deg_s = np.array([((t_ns - start_ns) / NS_PER_S, rate) for t_ns, rate in samples], dtype=float).T
    steps_s = np.diff(gyro_s, prepend=gyro_s[0])
    heading = np.interp(gyro_s, t_s, np.unwrap(heading_deg, period=360.0))
    return gyro_s, heading - heading[0], np.cumsum(rate_deg_s * steps_s)


def check_ferry(imported: Imported) -> None:
    """Its inertial unit is read out of a growing backlog: in one log with the compass anybody sees it."""
    assert sensors_of(imported) == ["compass1", "gps1", "imu1"]
    assert imported.summary["measurements"]["imu_samples"] == 1791
    t_s, heading, integral = compass_and_gyro(imported)
    assert t_s[-1] - t_s[0] == pytest.approx(89.85, abs=0.1)
    assert np.ptp(heading) == pytest.approx(52, abs=3)
    assert np.max(np.abs(integral - heading)) > 60.0
    assert abs(np.corrcoef(np.diff(heading), np.diff(integral))[0, 1]) < 0.3


def test_tables_of_the_ferry_are_one_log(importer: Importer) -> None:
    imported = importer.together([ferry("fix"), ferry("heading"), ferry("imu")])
    assert imported.summary["measurements"] == {"fixes": 1792, "headings": 1792, "imu_samples": 1791}
    check_ferry(imported)


@pytest.mark.slow
def test_sentences_and_inertial_unit_of_the_ferry_are_one_log(importer: Importer) -> None:
    imported = importer.together([FERRY / "maneuvering1_GPGGA.csv", ferry("imu")])
    assert imported.summary["measurements"] == {"fixes": 1795, "headings": 1792, "imu_samples": 1791}
    check_ferry(imported)
    # The receiver's sentences, and the same headings as the ferry's computer stamped them: within a tenth of a second.
    both = importer.together([FERRY / "maneuvering1_GPGGA.csv", ferry("heading")], out="both.mcap")
    first, second = (
        np.array([(h.t_ns / NS_PER_S, h.heading_true_deg) for h in both.headings if h.sensor == sensor], dtype=float)
        for sensor in ("compass1", "compass2")
    )
    assert len(first) == len(second) == 1792
    assert np.max(np.abs(first[:, 1] - second[:, 1])) < 0.01
    assert 0.0 < np.median(second[:, 0] - first[:, 0]) < 0.1


def split(source: Path, directory: Path, columns: Sequence[str], rows: slice, name: str) -> Path:
    """A recorder of its own: some columns of some rows."""
    with source.open(newline="") as stream:
        table = list(csv.DictReader(stream))[rows]
    target = directory / f"{name}.csv"
    with target.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, ["original_timestamp", *columns], extrasaction="ignore")
        writer.writeheader()
        writer.writerows(table)
    return target


def test_gyro_and_compass_of_two_recorders_turn_alike(importer: Importer, tmp_path: Path) -> None:
    """A lake boat's columns as three files: the compass turns as its gyro says, by sign and by size."""
    source = BLUEBOAT / "fixed_00000216.csv"
    clock = (
        '[boat]\nid = "lake"\n[time]\ncolumn = "original_timestamp"\nscale = 0.001\nzero_utc = "2024-06-01T08:00:00Z"\n'
    )
    maps = {
        "fix": '[fix]\nlat = "lat"\nlon = "lon"\n',
        "heading": '[heading]\ncolumn = "yaw"\n',
        "imu": '[imu]\naccel_fwd = "surge_dot"\naccel_stb = "sway_dot"\n'
        'yaw_rate = "yaw_rate"\nyaw_rate_scale = 57.29577951308232\n',
    }
    columns = {"fix": ("lat", "lon"), "heading": ("yaw",), "imu": ("surge_dot", "sway_dot", "yaw_rate")}
    files = []
    for name, part in maps.items():
        (tmp_path / f"{name}.toml").write_text(clock + part)
        rows = slice(20, None) if name == "imu" else slice(None)  # switched on later
        files.append(f"{split(source, tmp_path, columns[name], rows, name)}:{tmp_path}/{name}.toml")
    imported = importer.together(files[::-1])
    assert sensors_of(imported) == ["compass1", "gps1", "imu1"]
    t_s, heading, integral = compass_and_gyro(imported)
    assert t_s[0] == pytest.approx(2.0, abs=0.2)
    assert np.ptp(heading) > 90.0
    assert np.corrcoef(heading, integral)[0, 1] > 0.99
    slope = float(np.sum(heading * integral) / np.sum(heading**2))
    assert 0.9 < slope < 1.1
