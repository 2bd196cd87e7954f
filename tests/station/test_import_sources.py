"""Sources of one recording with clocks of their own: they are put on the clock of the fixes, and named."""

from array import array
from datetime import UTC, datetime
from pathlib import Path

import pytest

from common.units import NS_PER_S
from shore.imports.record_times import NO_TIME
from shore.imports.source_clocks import SourceClocks, offset_ns
from tests.station.imports import T0, Importer, delta, tpv

LONG = 40


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


@pytest.mark.parametrize(
    ("ahead_s", "words"),
    [
        (7200, "the clock of /dev/gps1 is 2 h 00 min ahead of that of /dev/gps: it is put right"),
        (-3600, "the clock of /dev/gps1 is 1 h 00 min behind that of /dev/gps: it is put right"),
        (18, "the clock of /dev/gps1 is 18 s ahead of that of /dev/gps: it is put right"),
        (2, "the clock of /dev/gps1 is 2 s ahead of that of /dev/gps: it is put right"),
        (-2, "the clock of /dev/gps1 is 2 s behind that of /dev/gps: it is put right"),
        (0.25, None),
    ],
)
def test_gpsd_devices_with_clocks_apart_are_one_recording(
    ahead_s: float, words: str | None, importer: Importer
) -> None:
    def said(device: str, second: float) -> str:
        time = datetime.fromtimestamp(T0 / NS_PER_S + second, UTC).isoformat(timespec="milliseconds")
        return tpv(None, lat=1.0, lon=2.0, device=device, time=time)

    first = [said("/dev/gps", k / 2) for k in range(LONG)]
    second = [said("/dev/gps1", k / 2 + ahead_s) for k in range(LONG)]
    found = importer.text("\n".join(line for pair in zip(first, second, strict=True) for line in pair))
    assert found.summary["utc"] == "2023-11-14T22:13:20+00:00"
    assert found.summary["seconds"] == pytest.approx(LONG / 2, abs=2.5)
    assert found.summary["measurements"]["fixes"] == 2 * LONG
    assert (words is None) == ("put right" not in found.words)
    assert words is None or words in found.words
    if words is not None:
        assert all(fix.utc_ns == fix.t_ns for fix in found.fixes)


def test_a_signal_k_source_in_local_time_keeps_its_values(importer: Importer) -> None:
    lines = []
    for k in range(LONG):
        lines.append(delta(k, "gps", position={"latitude": 1.0 + k * 1e-5, "longitude": 2.0}))
        lines.append(delta(k + 0.25, "compass", headingTrue=1.0).replace("T22:", "T20:"))
    found = importer.text("\n".join(lines))
    assert found.summary["measurements"] == {"fixes": LONG, "headings": LONG}
    assert "the clock of compass is 2 h 00 min behind that of gps: it is put right" in found.words
    assert [heading.t_ns for heading in found.headings] == [T0 + k * NS_PER_S + NS_PER_S // 4 for k in range(LONG)]


@pytest.mark.parametrize(
    ("apart_s", "offset_s"),
    [
        ([0.0, 0.4, 0.9, 0.2, 0.0], 0),
        ([-1.0] * 20, 0),
        ([18.0, 18.3, 18.9, 18.1, 18.0, 18.4], 18),
        ([7200.5, 7200.1, 7200.9, 7200.0, 7201.0], 7200),
        ([100.0, -300.0, 50.0, 4000.0, 100.0], 0),
        ([7200.0] * 4, 0),
    ],
)
def test_only_a_steady_offset_is_a_clocks(apart_s: list[float], offset_s: int) -> None:
    assert offset_ns([round(step * NS_PER_S) for step in apart_s]) == offset_s * NS_PER_S


def test_records_without_a_time_stay_so() -> None:
    clocks = SourceClocks()
    times = array("q")
    for k in range(20):
        clocks.note("gps", 1)
        clocks.note("log", 0)
        times.extend([k * NS_PER_S, NO_TIME if k % 4 == 0 else (k + 3600) * NS_PER_S])
    clocks.align(times)
    assert list(times[1::2]) == [NO_TIME if k % 4 == 0 else k * NS_PER_S for k in range(20)]
