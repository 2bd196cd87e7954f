"""Magnetic variation by the World Magnetic Model: the published values, when it is worked out anew, what is told."""

import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from common.boat_config import BoatConfig, BoatTable
from common.messages import Event, Fix, Frame, Heading
from common.units import NS_PER_S
from onboard.devices import Accepted, Line, PortDecoder, make_driver
from shore.navigation.magnetic_variation import Variation, decimal_year
from shore.navigation.measurements import Reader, TrueHeading
from shore.pipeline import Pipeline
from tests.cases import CASES, needs_cases
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


@pytest.mark.parametrize(
    ("year", "lat", "lon", "expected_deg"),
    [(2010.0, 80.0, 0.0, -6.13), (2014.6, 46.2, 6.15, 1.25), (2020.0, 80.0, 0.0, -1.28), (2020.0, -80.0, 240.0, 69.36)],
)
def test_an_older_date_is_that_of_its_own_model(year: float, lat: float, lon: float, expected_deg: float) -> None:
    """Test values of WMM2010 and WMM2020 (NOAA NCEI and BGS); the second is near Geneva, of the case old-log-2014."""
    assert asked(lat, lon, utc_of(year))[0] == pytest.approx(expected_deg, abs=0.02)
    assert [each.evidence["model"] for each in asked(lat, lon, utc_of(year))[1]] == [f"WMM{year // 5 * 5:.0f}"]


@pytest.mark.parametrize(("date", "same_as"), [((2007, 4, 7), 2010.0), ((2031, 5, 1), 2030.0)])
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
    shown_deg = first[-1].estimates[0].heading_true_deg
    assert shown_deg is not None
    assert abs(math.remainder(shown_deg - float(truth_deg), 360.0)) < 1.0
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


HALIFAX = Fix(sensor="gps1", t_ns=0, lat_deg=44.65, lon_deg=-63.57)
"""Variation -15.9 deg."""


def true_degs(config: BoatConfig, variations: list[float | None]) -> tuple[list[float], list[Event]]:
    """True headings of magnetic readings of 101.4 at Halifax, each with a variation of the device."""
    told: list[Event] = []
    reader = Reader(config, told.append)
    readings = [
        Heading(sensor="compass1", t_ns=k, heading_mag_deg=101.4, variation_deg=sent)
        for k, sent in enumerate(variations)
    ]
    _, *found = reader.read(dated_frame(0, HALIFAX, *readings))
    return [math.degrees(one.heading_rad) for one in found if isinstance(one, TrueHeading)], told


def test_the_boats_file_goes_before_the_device_and_the_model() -> None:
    found, told = true_degs(replace(BOAT, boat=BoatTable(id="b", variation_deg=3.0)), [None, -16.0, 0.0])
    assert found == [pytest.approx(104.4)] * 3
    assert told == []


def test_a_boats_file_with_a_variation_of_zero_is_an_answer() -> None:
    assert true_degs(replace(BOAT, boat=BoatTable(id="b", variation_deg=0.0)), [-16.0])[0] == [pytest.approx(101.4)]


def test_the_device_goes_before_the_model_while_the_two_agree() -> None:
    found, told = true_degs(NO_VARIATION, [-16.9, -14.5])
    assert found == [pytest.approx(84.5), pytest.approx(86.9)]
    assert told == []


def test_a_filled_in_zero_is_no_variation() -> None:
    (empty, zero), told = true_degs(NO_VARIATION, [None, 0.0])
    assert empty == zero == pytest.approx(85.5, abs=0.5)
    assert [each.code for each in told] == ["variation-used"]


def test_a_device_far_from_the_model_is_doubted_aloud_and_the_model_is_used() -> None:
    (first, second), told = true_degs(NO_VARIATION, [16.0, 16.0])
    assert first == second == pytest.approx(85.5, abs=0.5)
    assert [each.code for each in told] == ["variation-doubted", "variation-used"]
    assert told[0].evidence["variation_deg"] == 16.0
    assert told[0].level == "warning"


def test_before_a_fix_a_zero_of_the_device_is_nothing_and_any_other_value_is_taken() -> None:
    reader = Reader(NO_VARIATION, lambda told: None)
    reading = Heading(sensor="compass1", t_ns=0, heading_mag_deg=10.0, variation_deg=0.0)
    assert reader.read(dated_frame(0, reading)) == ()
    (found,) = reader.read(dated_frame(1, replace(reading, variation_deg=-4.0)))
    assert isinstance(found, TrueHeading)
    assert math.degrees(found.heading_rad) == pytest.approx(6.0)


def test_where_the_model_is_unsure_a_device_is_not_doubted() -> None:
    """Near the magnetic pole its own doubt is several degrees."""
    told: list[Event] = []
    variation = Variation(told.append)
    variation.see(85.2, 139.0, utc_ns(2026, 6, 1))
    model_deg = variation.east_deg(0, "compass1")
    assert model_deg is not None
    told.clear()
    assert variation.east_deg(0, "compass1", model_deg + 4.0) == model_deg + 4.0
    assert told == []


@pytest.mark.parametrize(("apart_deg", "doubted"), [(4.0, False), (6.0, True)])
def test_while_the_date_is_unknown_a_device_is_doubted_from_five_degrees_on(apart_deg: float, doubted: bool) -> None:
    """A log of 2014 in the Netherlands whose date was not believed: the device said 0.6, the model of 2027 2.9."""
    told: list[Event] = []
    variation = Variation(told.append)
    variation.see(53.2, 5.4, None)
    model_deg = variation.east_deg(0, "compass1")
    assert model_deg is not None
    assert variation.east_deg(0, "compass1", model_deg + apart_deg) == model_deg + (0.0 if doubted else apart_deg)
    assert [each.code for each in told] == ["variation-doubted"] * doubted


@needs_cases
@pytest.mark.parametrize("name", ["hdg-variation-zero", "hdg-no-variation"])
def test_a_compass_at_halifax_has_the_models_variation(name: str) -> None:
    data = (CASES / "board" / f"{name}.nmea").read_bytes().splitlines()
    decoder = PortDecoder([make_driver(table) for table in BOAT.sensor if table.role in ("gps", "compass")])
    found: list[Fix | Heading] = []
    for k, line in enumerate(data):
        outcome = decoder.feed(Line(k * 10**8, line))
        assert isinstance(outcome, Accepted)
        found += [one for one in outcome.measurements if isinstance(one, Fix | Heading)]
    told: list[Event] = []
    read = Reader(NO_VARIATION, told.append).read(dated_frame(0, *found))
    headings = [math.degrees(one.heading_rad) for one in read if isinstance(one, TrueHeading)]
    assert len(headings) == 60
    assert all(heading == pytest.approx(85.5, abs=0.5) for heading in headings)


def test_a_position_of_zero_is_no_measurement_and_is_told_once() -> None:
    told: list[Event] = []
    reader = Reader(BOAT, told.append)
    zero = Fix(sensor="gps1", t_ns=0, lat_deg=0.0, lon_deg=0.0, fix_quality=1, status_valid=True)
    assert not zero.usable
    assert reader.read(dated_frame(0, zero, zero)) == ()
    assert [each.code for each in told] == ["fix-zero"]
    assert replace(zero, lon_deg=1e-6).usable


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
