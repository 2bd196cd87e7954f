"""Magnetic variation by the World Magnetic Model: the published values, when it is worked out anew, what is told."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from common.boat_config import BoatTable
from common.messages import Event, Fix, Frame, Heading
from common.units import NS_PER_S
from shore.navigation.magnetic_variation import Variation, decimal_year
from shore.navigation.measurements import Reader, TrueHeading
from shore.pipeline import Pipeline
from tests.navigate.voyages import BOAT, sail
from tests.strategies import numbered_frame

PUBLISHED = (
    (2025.0, 80.0, 0.0, 1.28),
    (2025.0, 0.0, 120.0, -0.16),
    (2025.0, -80.0, 240.0, 68.78),
    (2027.5, 80.0, 0.0, 2.59),
    (2027.5, 0.0, 120.0, -0.24),
    (2027.5, -80.0, 240.0, 68.49),
)
"""Year, latitude, longitude, declination at height 0: "Test values for WMM2025" (NOAA NCEI and BGS,
WMM2025testvalues.pdf), printed to 0.01 deg."""

NO_VARIATION = replace(BOAT, boat=BoatTable(id="springer"))


def utc_ns(year: int, month: int = 1, day: int = 1) -> int:
    return int(datetime(year, month, day, tzinfo=UTC).timestamp()) * NS_PER_S


def utc_of(year: float) -> int:
    """UTC of a decimal year."""
    start, end = utc_ns(int(year)), utc_ns(int(year) + 1)
    return round(start + (year - int(year)) * (end - start))


def asked(lat: float, lon: float, date_ns: int | None, t_ns: int = 0) -> tuple[float, list[Event]]:
    told: list[Event] = []
    variation = Variation(told.append)
    variation.see(lat, lon, date_ns)
    found = variation.east_deg(t_ns, "compass1")
    assert found is not None
    return found, told


@pytest.mark.parametrize(("year", "lat", "lon", "expected_deg"), PUBLISHED)
def test_the_published_test_values_of_wmm2025(year: float, lat: float, lon: float, expected_deg: float) -> None:
    assert asked(lat, lon, utc_of(year))[0] == pytest.approx(expected_deg, abs=0.01)


@pytest.mark.parametrize(
    ("date", "year"),
    [((2025, 1, 1), 2025.0), ((2027, 1, 1), 2027.0), ((2028, 7, 2), 2028.5), ((2026, 12, 31), 2027.0 - 1 / 365)],
)
def test_decimal_years(date: tuple[int, int, int], year: float) -> None:
    assert decimal_year(utc_ns(*date)) == pytest.approx(year, abs=1e-9)


def test_before_a_fix_nothing_is_known() -> None:
    assert Variation(lambda told: None).east_deg(0, "compass1") is None


def test_it_is_worked_out_anew_after_ten_kilometres_or_a_day() -> None:
    told: list[Event] = []
    variation = Variation(told.append)
    day_ns = 24 * 3600 * NS_PER_S
    start_ns = utc_ns(2026, 6, 1)
    values = []
    for lat, date_ns in (
        (50.0, start_ns), (50.08, start_ns), (50.1, start_ns), (50.1, start_ns + day_ns), (50.1, start_ns + 2 * day_ns)
    ):  # fmt: skip
        variation.see(lat, -4.0, date_ns)
        values.append(variation.east_deg(0, "compass1"))
    assert values[0] == values[1] != values[2] == values[3] != values[4]
    assert [each.code for each in told] == ["variation-used"] * 3
    assert told[0].level == "info"


@pytest.mark.parametrize(("date", "same_as"), [((2007, 4, 7), 2025.0), ((2031, 5, 1), 2030.0)])
def test_outside_the_models_years_the_nearest_is_used_and_told_once(date: tuple[int, int, int], same_as: float) -> None:
    told: list[Event] = []
    variation = Variation(told.append)
    for days in range(4):
        variation.see(50.0, -4.0, utc_ns(*date) + 2 * days * 24 * 3600 * NS_PER_S)
        assert variation.east_deg(0, "compass1") == pytest.approx(asked(50.0, -4.0, utc_of(same_as))[0], abs=1e-9)
    expired = [each for each in told if each.code == "variation-expired"]
    assert len(expired) == 1
    assert expired[0].level == "warning"
    assert expired[0].evidence == {"year": pytest.approx(date[0], abs=0.5), "used_year": same_as}


def test_in_the_last_hour_of_its_years_the_model_is_valid() -> None:
    assert [told.code for told in asked(50.0, -4.0, utc_ns(2030) - 3600 * NS_PER_S)[1]] == ["variation-used"]


@pytest.mark.parametrize(
    ("lat", "lon", "codes"),
    [(78.2, 15.6, []), (75.0, -100.0, ["compass-weak"]), (85.8, 139.0, ["compass-useless"]), (90.0, 0.0, None)],
)
def test_near_a_magnetic_pole_the_compass_is_doubted(lat: float, lon: float, codes: list[str] | None) -> None:
    value, told = asked(lat, lon, utc_ns(2026, 11, 22))
    assert math.isfinite(value)
    if codes is not None:
        assert [each.code for each in told] == ["variation-used", *codes]


def test_without_a_date_the_middle_of_the_models_years_stands_and_is_told_when_no_date_comes() -> None:
    told: list[Event] = []
    variation = Variation(told.append)
    middle, _ = asked(50.0, -4.0, utc_of(2027.5))
    variation.see(50.0, -4.0, None)
    for t_s in range(30):
        assert variation.east_deg(t_s * NS_PER_S, "compass1") == pytest.approx(middle, abs=1e-9)
        assert len(told) == (t_s >= 10)
    assert told[0].code == "variation-undated"
    variation.see(50.0, -4.0, utc_ns(2026, 6, 1))
    assert variation.east_deg(0, "compass1") == asked(50.0, -4.0, utc_ns(2026, 6, 1))[0]
    variation.see(51.0, -4.0, None)
    assert variation.east_deg(0, "compass1") == asked(51.0, -4.0, utc_ns(2026, 6, 1))[0]


def magnetic(frames: list[Frame], date_ns: int | None, variation_deg: float) -> list[Frame]:
    """The same voyage under another variation, the frames dated."""
    return [
        replace(
            frame,
            utc_ns=None if date_ns is None else date_ns + frame.t0_ns,
            headings=tuple(
                replace(h, heading_mag_deg=((h.heading_mag_deg or 0.0) - variation_deg) % 360.0) for h in frame.headings
            ),
        )
        for frame in frames
    ]


def shifted(frames: list[Frame], lat: float, lon: float) -> list[Frame]:
    """The same voyage elsewhere: degrees added to the fixes."""
    return [
        replace(
            frame,
            fixes=tuple(
                replace(fix, lat_deg=(fix.lat_deg or 0.0) + lat, lon_deg=(fix.lon_deg or 0.0) + lon)
                for fix in frame.fixes
            ),
        )
        for frame in frames
    ]


def test_a_boat_with_a_magnetic_compass_alone_finds_its_true_heading(short_voyage: list[Frame]) -> None:
    """Off Newfoundland, 17 deg W: without the model the heading would be wrong by that."""
    date_ns = utc_ns(2026, 11, 22)
    frames = shifted(short_voyage[:200], -2.9, -48.5)
    lat, lon = frames[0].fixes[0].lat_deg or 0.0, frames[0].fixes[0].lon_deg or 0.0
    west_deg, _ = asked(lat, lon, date_ns)
    assert west_deg < -15.0
    frames = magnetic(frames, date_ns, west_deg)
    pipelines = [Pipeline(NO_VARIATION, ("ukf",)) for _ in range(2)]
    first, second = ([pipeline.push(frame) for frame in frames] for pipeline in pipelines)
    assert first == second
    truth_deg = np.degrees(sail(62, 0.05).states[2 * 200, 4])
    assert abs(math.remainder(first[-1].estimates[0].heading_true_deg - float(truth_deg), 360.0)) < 1.0
    codes = [told.code for output in first for told in output.events]
    assert codes == ["variation-used", "filter-started", "filter-aligned"]


def dated_frame(seq: int, *entries: Fix | Heading) -> Frame:
    return numbered_frame(seq, *entries, utc_ns=utc_ns(2026, 6, 1) + seq * 10**8)


def test_a_magnetic_heading_waits_for_the_fix_that_places_it() -> None:
    reader = Reader(NO_VARIATION, lambda told: None)
    reading = Heading(sensor="compass1", t_ns=0, heading_mag_deg=10.0)
    fix = Fix(sensor="gps1", t_ns=0, lat_deg=47.0, lon_deg=-52.0)
    assert reader.read(dated_frame(0, reading)) == ()
    _, heading = reader.read(dated_frame(1, fix, reading))
    assert isinstance(heading, TrueHeading)
    assert math.degrees(heading.heading_rad) == pytest.approx(
        10.0 + asked(47.0, -52.0, utc_ns(2026, 6, 1))[0], abs=1e-4
    )


def test_device_and_boats_file_go_before_the_model() -> None:
    told: list[Event] = []
    reader = Reader(replace(BOAT, boat=BoatTable(id="b", variation_deg=3.0)), told.append)
    fix = Fix(sensor="gps1", t_ns=0, lat_deg=47.0, lon_deg=-52.0)
    readings = tuple(
        Heading(sensor="compass1", t_ns=k, heading_mag_deg=10.0, variation_deg=(None, -4.0)[k]) for k in range(2)
    )
    _, by_file, by_device = reader.read(dated_frame(0, fix, *readings))
    assert isinstance(by_file, TrueHeading)
    assert isinstance(by_device, TrueHeading)
    assert math.degrees(by_file.heading_rad) == pytest.approx(13.0)
    assert math.degrees(by_device.heading_rad) == pytest.approx(6.0)
    assert told == []


def test_a_backfilled_fix_does_not_move_the_variation() -> None:
    """Where the boat was an hour ago says nothing of the heading of now."""
    reader = Reader(NO_VARIATION, lambda told: None)
    fixes = {lat: Fix(sensor="gps1", t_ns=0, lat_deg=lat, lon_deg=-52.0) for lat in (47.0, 47.15)}
    reading = Heading(sensor="compass1", t_ns=0, heading_mag_deg=10.0)
    reader.read(dated_frame(5, fixes[47.15]))
    before = reader.true_heading(reading)
    reader.read(dated_frame(1, fixes[47.0]))
    assert reader.true_heading(reading) == before
    reader.read(dated_frame(6, fixes[47.0]))
    assert reader.true_heading(reading) != before
