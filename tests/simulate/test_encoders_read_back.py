"""Round trip of each model: what its encoder prints, its driver reads, to half a printed digit, and rejects nothing."""

import math
import random
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from common.angles import difference_deg, wrap_deg
from common.boat_config import SensorTable
from common.framer import ImuSample, Measurement
from common.messages import AisLine, Attitude, Fix, Heading, RadarTarget, TurnRate
from common.simulation.readings import (
    AisReading,
    FixReading,
    HeadingReading,
    ImuReading,
    RadarReading,
    Reading,
    TurnRateReading,
)
from common.units import M_S_PER_KN, METRES_PER_NAUTICAL_MILE, NS_PER_S, STANDARD_GRAVITY_M_S2
from onboard.devices import MODELS, Accepted, Line, Surroundings, make_driver, make_encoder
from onboard.devices.driver import COMPANIONS
from onboard.devices.encoder import sealed

MANY, FEWER = 10_000, 2_500
AROUND = Surroundings(1_709_164_799_000_000_000, variation_deg=-12.3)
"""A second before a leap day begins."""
ROUNDING = 1e-9
"""What floating point adds to half a digit."""
COUNTS_PER_G, COUNTS_PER_DEG_S = 4096, 16.4

Drawn = tuple[Reading, Callable[[list[Measurement]], None]]
"""A reading, and what judges the measurements that came of it."""


def near(found: float | None, given: float | None, half_digit: float, *, circle: bool = False) -> None:
    if given is None or found is None:
        assert found is given is None
        return
    error = difference_deg(found, given) if circle else found - given
    assert abs(error) <= half_digit + ROUNDING, (found, given)


def one_of(draw: random.Random, edges: tuple[float, ...], low: float, high: float) -> float:
    """An edge now and then, else anything between."""
    return draw.choice(edges) if draw.random() < 0.2 else draw.uniform(low, high)


def direction(draw: random.Random) -> float:
    return (
        one_of(draw, (0.0, -0.0, 1e-15, 0.04999, 0.05, 359.9499, 359.95, 359.96, 360 - 1e-13, 180.0), 0.0, 360.0) % 360
    )


def angle(draw: random.Random, limit: float, *, maybe: bool = True) -> float | None:
    if maybe and draw.random() < 0.2:
        return None
    return one_of(draw, (-0.0, 0.0, -0.004, -0.005, -0.04, -0.05, 0.05, limit, -limit, limit - 0.04), -limit, limit)


def place(draw: random.Random) -> tuple[float, float]:
    minute = 59.999999 / 60
    lat = one_of(draw, (90.0, -90.0, 0.0, -0.0, -1e-12, 50 + minute, -(49 + minute), 89 + minute), -90.0, 90.0)
    lon = one_of(draw, (180.0, -180.0, 0.0, -1e-12, 4 + minute, -(3 + minute), 179 + minute), -180.0, 180.0)
    # 0, 0 is what devices fill in, and no driver takes it
    return (lat, lon) if abs(lat) + abs(lon) > 1e-6 else (lat, 4.0)


def fix(draw: random.Random) -> Drawn:
    lat, lon = place(draw)
    speed = one_of(draw, (0.0, 0.99 * M_S_PER_KN, M_S_PER_KN, 0.004), 0.0, 40.0)
    course = math.radians(direction(draw))
    moves, claims = draw.random() < 0.9, draw.random() < 0.7
    given = FixReading(
        lat, lon,
        v_east_m_s=speed * math.sin(course) if moves else None,
        v_north_m_s=speed * math.cos(course) if moves else None,
        quality=draw.choice((0, 1, 1, 2, 4, 5)),
        satellites=draw.randrange(1, 41),
        hdop=draw.choice((None, 0.5, 1.1, draw.uniform(0.5, 50.0))),
        sigma_east_m=10 ** draw.uniform(-2.9, 2.9) if claims else None,
        sigma_north_m=10 ** draw.uniform(-2.9, 2.9) if claims else None,
        minute_decimals=draw.choice((4, 5, 7)),
    )  # fmt: skip

    def judge(found: list[Measurement]) -> None:
        (read,) = found
        assert isinstance(read, Fix)
        void = given.quality == 0
        assert (read.fix_quality, read.satellites, read.status_valid) == (given.quality, given.satellites, not void)
        half = 0.5 * 10**-given.minute_decimals / 60
        near(read.lat_deg, None if void else lat, half)
        near(read.lon_deg, None if void else lon, half)
        near(read.hdop, None if void else given.hdop, 0.05)
        near(read.sigma_east_m, None if void else given.sigma_east_m, 0.0005)
        near(read.sigma_north_m, None if void else given.sigma_north_m, 0.0005)
        if void or not moves:
            assert (read.sog_kn, read.cog_true_deg) == (None, None)
            return
        near(read.sog_kn, speed / M_S_PER_KN, 0.005)
        assert read.sog_kn is not None
        # The driver takes no course of a boat that hardly moves.
        near(read.cog_true_deg, math.degrees(course) if read.sog_kn >= 1.0 else None, 0.005, circle=True)

    return given, judge


def heading(
    draw: random.Random, *, finest: int = 1, tilt: bool, apart: bool = False, warning: str | None = None
) -> Drawn:
    """tilt: does the device measure it; apart: in measurements of their own; warning: that of a disturbed field."""
    magnetic = direction(draw)
    given = HeadingReading(
        wrap_deg(magnetic + AROUND.variation_deg), angle(draw, 90.0), angle(draw, 180.0),
        angle(draw, 119.0), draw.choice((0, 1, 3)), draw.random() < 0.3,
    )  # fmt: skip
    pitch, roll = (given.pitch_deg, given.roll_deg) if tilt else (None, None)

    def judge(found: list[Measurement]) -> None:
        read, *others = found
        assert isinstance(read, Heading)
        near(read.heading_mag_deg, magnetic, 0.5 * 10 ** -min(given.decimals, finest), circle=True)
        assert read.heading_mag_deg is not None
        assert 0.0 <= read.heading_mag_deg < 360.0
        assert (read.heading_true_deg, read.variation_deg) == (None, None)
        assert read.warning == (warning if given.disturbed else None)
        attitude: Any = read
        if apart:
            rates = [item for item in others if isinstance(item, TurnRate)]
            assert len(rates) == (given.turn_rate_deg_s is not None)
            for rate in rates:
                near(rate.rate_deg_s, given.turn_rate_deg_s, 0.05 / 60)
            others = [item for item in others if item not in rates]
            attitude = others.pop() if pitch is not None or roll is not None else read
        assert not others
        near(attitude.pitch_deg, pitch, 0.05)
        near(attitude.roll_deg, roll, 0.05)

    return given, judge


def imu(draw: random.Random) -> Drawn:
    force, rate = (1e4, -1e4, 78.4, -78.4, 0.0, -0.0, 1e-5), (1e6, -1e6, 1998.0, -1998.0, 0.0, -0.0)
    given = ImuReading(
        one_of(draw, force, -20.0, 20.0), one_of(draw, force, -20.0, 20.0), one_of(draw, rate, -200.0, 200.0),
        draw.uniform(-18.0, -2.0), one_of(draw, rate, -90.0, 90.0), one_of(draw, rate, -90.0, 90.0),
        angle(draw, 180.0), angle(draw, 90.0),
    )  # fmt: skip

    def judge(found: list[Measurement]) -> None:
        sample, attitude = found
        assert isinstance(sample, ImuSample)
        assert isinstance(attitude, Attitude)
        per_count = STANDARD_GRAVITY_M_S2 / COUNTS_PER_G
        for read, meant in (
            (sample.accel_fwd_m_s2, given.accel_fwd_m_s2),
            (sample.accel_stb_m_s2, given.accel_stb_m_s2),
        ):
            near(read, min(32768 * per_count, max(-32767 * per_count, meant)), 0.5 * per_count)
        limit = (-32768 / COUNTS_PER_DEG_S, 32767 / COUNTS_PER_DEG_S)
        near(sample.yaw_rate_deg_s, min(limit[1], max(limit[0], given.yaw_rate_deg_s)), 0.5 / COUNTS_PER_DEG_S)
        near(attitude.roll_deg, given.roll_deg or 0.0, 0.005)
        near(attitude.pitch_deg, given.pitch_deg or 0.0, 0.005)

    return given, judge


def turn_rate(draw: random.Random) -> Drawn:
    given = TurnRateReading(one_of(draw, (1500.0, -1500.0, 0.0, -0.0, -0.0004), -300.0, 300.0))

    def judge(found: list[Measurement]) -> None:
        (read,) = found
        assert isinstance(read, TurnRate)
        near(read.rate_deg_s, given.rate_deg_s, 0.0005)

    return given, judge


SIX_BITS = "0123456789:;<=>?@ABCDEFGHIJKLMNOPQRSTUVW`abcdefghijklmnopqrstuvw"


def ais(draw: random.Random) -> Drawn:
    payload = "".join(draw.choices(SIX_BITS, k=draw.randrange(0, 60)))
    body = f"{draw.choice(('AIVDM', 'AIVDO', 'BSVDM'))},2,{draw.choice('12')},{draw.choice('0129')},A,{payload},0"
    given = AisReading("!" + sealed(body).decode().strip()[1:])

    def judge(found: list[Measurement]) -> None:
        (read,) = found
        assert isinstance(read, AisLine)
        assert read.text == given.sentence

    return given, judge


def radar(draw: random.Random) -> Drawn:
    """TTM, TLL, or both; a target without a place is a lost one."""
    seen, placed = draw.choice(((True, False), (False, True), (True, True), (False, False)))
    lat, lon = place(draw) if placed else (None, None)
    moves = draw.random() < 0.8
    given = RadarReading(
        draw.randrange(0, 100),
        range_m=one_of(draw, (0.0, 9.25, 9.27), 0.0, 90_000.0) if seen else None,
        bearing_true_deg=direction(draw) if seen else None,
        sog_m_s=one_of(draw, (0.0, 0.02, 0.03), 0.0, 40.0) if moves else None,
        course_true_deg=direction(draw) if moves else None,
        lat_deg=lat, lon_deg=lon,
        status=draw.choice(("tracking", "acquiring", "lost")) if seen or placed else "lost",
        name=draw.choice(("", "A 1", "2 (Broadband 4G)")),
    )  # fmt: skip

    def judge(found: list[Measurement]) -> None:
        targets = [item for item in found if isinstance(item, RadarTarget)]
        assert len(targets) == len(found) == (seen or not placed) + placed
        assert {(item.number, item.status, item.name or "") for item in targets} == {
            (given.number, given.status, given.name)
        }
        if placed:
            tll = targets.pop()
            near(tll.lat_deg, lat, 0.5e-4 / 60)
            near(tll.lon_deg, lon, 0.5e-4 / 60)
        for ttm in targets:
            near(ttm.range_m, given.range_m, 0.005 * METRES_PER_NAUTICAL_MILE)
            near(ttm.bearing_true_deg, given.bearing_true_deg, 0.05, circle=True)
            # The driver believes no speed of a target that is not tracked, and no course of one at rest.
            known = given.status == "tracking" and given.sog_m_s is not None
            near(ttm.sog_kn, given.sog_m_s / M_S_PER_KN if known and given.sog_m_s is not None else None, 0.05)
            near(ttm.course_true_deg, given.course_true_deg if known and ttm.sog_kn else None, 0.05, circle=True)

    return given, judge


DRAWN: dict[tuple[str, str], Callable[[random.Random], Drawn]] = {
    ("gps", "nmea"): fix,
    ("compass", "nmea"): lambda draw: heading(draw, finest=3, tilt=True, apart=True),
    ("compass", "hsc100"): lambda draw: heading(draw, finest=3, tilt=False),
    ("compass", "tcm2"): lambda draw: heading(draw, tilt=True, warning="E001"),
    ("compass", "hmr3000"): lambda draw: heading(draw, tilt=True, warning="heading O"),
    ("compass", "kvh-c100"): lambda draw: heading(draw, tilt=False),
    ("imu", "arduimu"): imu,
    ("gyro", "tinkerkit"): turn_rate,
    ("ais", "nmea"): ais,
    ("radar", "nmea"): radar,
}
"""One row for each model of the registry."""
SLOW = (("gps", "nmea"), ("compass", "nmea"), ("radar", "nmea"))
"""Several long sentences a reading: 0.2 to 0.3 ms each."""


def read_back(table: SensorTable, readings: Iterator[Reading], every_s: float) -> Iterator[list[Measurement]]:
    """The measurements of each reading; a rejected, ignored or unclaimed line fails."""
    encoder, driver = make_encoder(table, AROUND), make_driver(table)
    for number, reading in enumerate(readings):
        t_s = number * every_s
        t_ns = round(t_s * NS_PER_S)
        found: list[Measurement] = []
        data = encoder.encode(t_s, reading)
        assert data.endswith((b"\r\n", b"\r"))
        for text in data.splitlines():
            assert driver.claims(Line(t_ns, text))
            outcome = driver.feed(Line(t_ns, text))
            assert isinstance(outcome, Accepted), (reading, text, outcome)
            found += outcome.measurements
        found += driver.flush(t_ns + NS_PER_S // 2, t_ns)
        yield [item for item in found if not isinstance(item, COMPANIONS)]


def check(role: str, model: str, count: int) -> None:
    draw = random.Random(f"{role} {model}")
    drawn = [DRAWN[role, model](draw) for _ in range(count)]
    table = SensorTable(id=f"{role}1", port="p", role=role, model=model)
    readings = (reading for reading, _ in drawn)
    for (reading, judge), found in zip(drawn, read_back(table, readings, 1.0), strict=True):
        try:
            judge(found)
        except (AssertionError, ValueError) as error:
            raise AssertionError(f"{reading} became {found}") from error


@pytest.mark.parametrize(("role", "model"), DRAWN)
def test_what_a_device_prints_is_what_its_driver_reads(role: str, model: str) -> None:
    check(role, model, FEWER if (role, model) in SLOW else MANY)


@pytest.mark.slow
@pytest.mark.parametrize(("role", "model"), SLOW)
def test_the_same_with_many_readings_where_that_takes_seconds(role: str, model: str) -> None:
    check(role, model, MANY)


def test_every_model_is_read_back() -> None:
    assert list(DRAWN) == list(MODELS)
