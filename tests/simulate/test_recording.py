"""Playing a column recording: the right rows, nothing invented, and mistakes told where they are."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from common.errors import SettingsError, WayfixError
from common.simulation.column_recording import recording_voyage
from common.simulation.readings import FixReading, HeadingReading, ImuReading
from tests.recordings import BLUEBOAT, BLUEBOAT_MAP

needs_blueboat = pytest.mark.skipif(not BLUEBOAT.is_dir(), reason="the BlueBoat recordings are not on this machine")

MAP = """
[boat]
id = "small"
[time]
column = "ms"
scale = 0.001
[fix]
lat = "lat"
lon = "lon"
rate_hz = 1
[heading]
column = "yaw"
rate_hz = 5
[imu]
accel_fwd = "ax"
accel_stb = "ay"
yaw_rate = "r"
yaw_rate_scale = 57.29577951308232
rate_hz = 10
[reference]
lat = "lat"
lon = "lon"
heading = "yaw"
v_fwd = "u"
v_stb = "v"
"""
HEADER = "ms,lat,lon,yaw,ax,ay,r,u,v"


def small(tmp_path: Path, rows: list[str], mapping: str = MAP, header: str = HEADER) -> tuple[Path, Path]:
    file, map_file = tmp_path / "run.csv", tmp_path / "map.toml"
    file.write_text("\n".join([header, *rows]) + "\n")
    map_file.write_text(mapping)
    return file, map_file


def good_row(k: int) -> str:
    return f"{5000 + 100 * k},50.0,{10 + 1e-5 * k:.7f},90.0,0.1,-0.2,0.1,1.5,0.25"


@needs_blueboat
def test_blueboat_235_has_all_its_rows() -> None:
    voyage = recording_voyage(BLUEBOAT / "fixed_00000235.csv", BLUEBOAT_MAP)
    assert Counter(timed.sensor for timed in voyage.readings) == {"gps1": 310, "compass1": 3098, "imu1": 3098}
    assert voyage.skipped == {}
    assert voyage.seconds == pytest.approx(309.7, abs=0.05)
    assert voyage.config.with_role("imu")[0].use == ("accel_fwd", "accel_stb", "yaw_rate")
    times = [timed.t_s for timed in voyage.readings]
    assert times == sorted(times)


@needs_blueboat
def test_blueboat_216_leaves_its_empty_fields_out() -> None:
    voyage = recording_voyage(BLUEBOAT / "fixed_00000216.csv", BLUEBOAT_MAP)
    assert voyage.skipped == {"fix": 1, "reference": 12}
    assert Counter(timed.sensor for timed in voyage.readings) == {"gps1": 49, "compass1": 486, "imu1": 486}
    fixes = [timed.reading for timed in voyage.readings if isinstance(timed.reading, FixReading)]
    assert all(abs(fix.lat_deg - 63.4) < 0.01 and abs(fix.lon_deg - 10.31) < 0.01 for fix in fixes)
    assert len(voyage.truth.t_s) == 486 - 12
    assert np.abs(voyage.truth.east_m).max() < 500


@needs_blueboat
def test_blueboat_fix_noise_is_the_declared_one_and_its_truth_is_consistent() -> None:
    voyage = recording_voyage(BLUEBOAT / "fixed_00000235.csv", BLUEBOAT_MAP, seed=3)
    fixes = [(timed.t_s, timed.reading) for timed in voyage.readings if isinstance(timed.reading, FixReading)]
    truth = voyage.truth.at(np.array([t_s for t_s, _ in fixes]))
    places = np.array([voyage.plane.to_east_north_m(fix.lat_deg, fix.lon_deg) for _, fix in fixes])
    errors = places - np.stack((truth.east_m, truth.north_m), axis=1)
    assert errors.std(axis=0) == pytest.approx([1.5, 1.5], rel=3 / np.sqrt(2 * len(fixes)))
    # Velocity from surge and sway is the derivative of the position: the signs of the body axes are right.
    walked = np.cumsum(voyage.truth.v_east_m_s[1:] * np.diff(voyage.truth.t_s))
    assert walked == pytest.approx(voyage.truth.east_m[1:] - voyage.truth.east_m[0], abs=4.0)


def test_values_units_and_rates(tmp_path: Path) -> None:
    voyage = recording_voyage(*small(tmp_path, [good_row(k) for k in range(21)]))
    assert Counter(timed.sensor for timed in voyage.readings) == {"gps1": 3, "compass1": 11, "imu1": 21}
    fix = next(timed for timed in voyage.readings if timed.sensor == "gps1" and timed.t_s > 1.5)
    assert fix.t_s == pytest.approx(2.0)
    assert isinstance(fix.reading, FixReading)
    assert (fix.reading.lat_deg, fix.reading.lon_deg) == pytest.approx((50.0, 10.0002), abs=1e-9)
    assert fix.reading.v_east_m_s is None
    assert voyage.readings[1].reading == HeadingReading(90.0)
    imu = voyage.readings[2].reading
    assert isinstance(imu, ImuReading)
    assert (imu.accel_fwd_m_s2, imu.accel_stb_m_s2, imu.yaw_rate_deg_s) == pytest.approx((0.1, -0.2, 5.729578))
    # Heading east: forward is east, starboard is south.
    assert voyage.truth.v_east_m_s[0] == pytest.approx(1.5)
    assert voyage.truth.v_north_m_s[0] == pytest.approx(-0.25)


def test_uneven_stamps_lose_no_sample(tmp_path: Path) -> None:
    rows = [good_row(k).replace(f"{5000 + 100 * k}", f"{5000 + 100 * k + (7 if k % 2 else -7)}", 1) for k in range(50)]
    assert Counter(timed.sensor for timed in recording_voyage(*small(tmp_path, rows)).readings)["imu1"] == 50


@pytest.mark.parametrize("empty", ["", "  ", "nan"])
def test_an_empty_field_is_left_out_and_counted(tmp_path: Path, empty: str) -> None:
    rows = [good_row(k) for k in range(11)]
    rows[3] = rows[3].replace(",0.1,-0.2,", f",{empty},-0.2,")
    voyage = recording_voyage(*small(tmp_path, rows))
    assert voyage.skipped == {"imu": 1}
    samples = [timed for timed in voyage.readings if isinstance(timed.reading, ImuReading)]
    assert len(samples) == 10
    assert all(isinstance(s.reading, ImuReading) and s.reading.accel_fwd_m_s2 == 0.1 for s in samples)


def test_rows_out_of_time_order_are_left_out_and_counted(tmp_path: Path) -> None:
    rows = [good_row(0), good_row(1), good_row(1), good_row(0), good_row(2)]
    voyage = recording_voyage(*small(tmp_path, rows))
    assert voyage.skipped == {"time": 2}
    assert len(voyage.truth.t_s) == 3


def test_seconds_cuts_the_recording(tmp_path: Path) -> None:
    file, map_file = small(tmp_path, [good_row(k) for k in range(30)])
    assert recording_voyage(file, map_file, seconds=1.0).seconds == pytest.approx(1.0)


def test_missing_columns_are_all_named(tmp_path: Path) -> None:
    file, map_file = small(tmp_path, [good_row(0)], header=HEADER.replace("yaw", "hdg").replace("ax", "acc"))
    with pytest.raises(WayfixError, match=r"run\.csv: has no column yaw, ax; .*hdg"):
        recording_voyage(file, map_file)


def test_text_where_a_number_belongs_is_told_with_its_line(tmp_path: Path) -> None:
    rows = [good_row(0), good_row(1).replace("-0.2", "fast"), good_row(2)]
    with pytest.raises(WayfixError, match=r"line 3: ay: 'fast' is not a number"):
        recording_voyage(*small(tmp_path, rows))


def test_a_wrong_mapping_is_told_with_the_key(tmp_path: Path) -> None:
    file, map_file = small(tmp_path, [good_row(0)], MAP.replace("accel_fwd", "accel_forward"))
    with pytest.raises(WayfixError, match=r"map\.toml: imu\.accel_forward: unknown key, did you mean accel_fwd"):
        recording_voyage(file, map_file)
    with pytest.raises(WayfixError, match="cannot be read"):
        recording_voyage(tmp_path / "none.csv", BLUEBOAT_MAP)


def test_what_only_an_import_understands_is_unknown_to_a_voyage(tmp_path: Path) -> None:
    mapping = MAP.replace('column = "ms"', 'column = "ms"\nunix = false').replace('lon = "lon"\nr', 'north = "n"\nr', 1)
    file, map_file = small(tmp_path, [good_row(0)], mapping)
    with pytest.raises(SettingsError) as caught:
        recording_voyage(file, map_file)
    assert caught.value.faults == [
        "time.unix: unknown key (known: column, scale)",
        "fix.north: unknown key (known: lat, lon, rate_hz, noise_m)",
        "fix.lon: missing",
    ]


def test_a_voyage_wants_every_part(tmp_path: Path) -> None:
    file, map_file = small(tmp_path, [good_row(0)], '[boat]\nid = "b"\n[time]\ncolumn = "ms"\n[imu]\nyaw_rate = "r"\n')
    with pytest.raises(SettingsError) as caught:
        recording_voyage(file, map_file)
    assert caught.value.faults == [
        "fix: missing",
        "heading: missing",
        "imu.accel_fwd: missing",
        "imu.accel_stb: missing",
        "reference: missing",
    ]
