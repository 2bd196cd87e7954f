"""40,000 damaged lines of receivers, compasses and inertial units, fixed seed.

Nothing raises, and nothing is accepted that the text does not say.

The check shares no code with the decoders: it splits the text itself and computes with fractions (`mutations`).
Targets, AIS and the rate gyro: `test_fuzz_traffic.py`.
"""

import math
import random
import re
import time
from datetime import UTC, datetime
from fractions import Fraction

from common.framer import ImuSample, Measurement
from common.messages import Attitude, ClockPair, Fix, Heading
from onboard.devices import Accepted, Ignored, PortDecoder, Rejected, make_driver
from tests.acquire.mutations import FEW_OR_MANY, exact, has_right_checksum, mutate, same, same_angle, time_of_day
from tests.acquire.sentences import compass, gps, imu, line, sealed

BODIES = [
    "GPGGA,120000.000,3747.0873,S,17518.8938,E,1,08,1.1,59.9,M,23.7,M,,0000",
    "GNRMC,120000.000,A,3747.0873,S,17518.8938,E,12.69,181.39,311226,,,A",
    "GNGNS,120000.00,3747.0873,S,17518.8938,E,ADNN,08,1.1,59.9,23.7,,,V",
    "GPVTG,77.52,T,76.1,M,10.004,N,18.5,K,A",
    "GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5",
    "GPGLL,5310.8115,N,00525.7025,W,120000.00,A,A",
    "GPZDA,120000.000,16,04,2026,-02,00",
    "HCHDG,271.1,10.7,E,12.2,W",
    "HCHDM,123.4,M",
    "HCHDT,86.2,T",
]
GNS_QUALITY = {"R": 4, "F": 5, "P": 3, "D": 2, "A": 1, "E": 6, "M": 7, "S": 8, "N": 0}
OPENING = sealed("GPGLL,5000.0000,N,00400.0000,E,120000.000,A,A")


def check_fix(fix: Fix, formatter: str, f: list[str]) -> None:
    f = [*f, *[""] * 20]
    if formatter == "VTG":
        same(fix.sog_kn, f[4], 0, 1000)
        if fix.cog_true_deg is not None:
            same(fix.cog_true_deg, "0" if exact(f[0]) == 360 else f[0], 0, 360)
        return
    if formatter == "GSA":
        assert fix.fix_mode is None or str(fix.fix_mode) == f[1].lstrip("0")
        for value, text in ((fix.pdop, f[14]), (fix.hdop, f[15]), (fix.vdop, f[16])):
            same(value, text, 0.0, 99.0)
        return
    place = {"GGA": 1, "GNS": 1, "RMC": 2, "GLL": 0}[formatter]
    clock = f[4] if formatter == "GLL" else f[0]
    assert fix.tod_ms is None if not clock else fix.tod_ms == time_of_day(clock)
    if fix.lat_deg is not None:
        same_angle(fix.lat_deg, f[place], f[place + 1], 2)
        same_angle(fix.lon_deg, f[place + 2], f[place + 3], 3)
    if formatter == "GGA":
        assert fix.fix_quality is None if not f[5] else fix.fix_quality == exact(f[5])
        check_satellites(fix, f[6])
        same(fix.hdop, f[7], 0, 99)
        same(fix.alt_m, f[8], -12000, 100000)
        assert fix.alt_m is None or f[9] == "M"
        assert fix.fix_quality or fix.lat_deg is None
    elif formatter == "GNS":
        qualities = {GNS_QUALITY[letter] for letter in f[5]}
        assert fix.fix_quality is None if not qualities else fix.fix_quality in qualities
        check_satellites(fix, f[6])
        same(fix.hdop, f[7], 0, 99)
        same(fix.alt_m, f[8], -12000, 100000)
        assert fix.fix_quality or fix.lat_deg is None
    else:
        status = f[1 if formatter == "RMC" else 5]
        bare = formatter == "GLL" and not status and not clock  # before NMEA 2.0
        assert fix.status_valid is None or bare or status in (("A", "D") if fix.status_valid else ("V",))
    if formatter == "RMC":
        same(fix.sog_kn, f[6], 0, 1000)
        if fix.cog_true_deg is not None:
            same(fix.cog_true_deg, "0" if exact(f[7]) == 360 else f[7], 0, 360)
        if fix.utc_ns is not None:
            check_utc(fix.utc_ns, f[0], f[8][:2], f[8][2:4], f[8][4:])


def check_satellites(fix: Fix, text: str) -> None:
    """A fix with 0 satellites has a field that is filled in."""
    if fix.satellites is None:
        assert not text or (exact(text) == 0 and fix.fix_quality)
    else:
        assert fix.satellites == exact(text)


def check_utc(utc_ns: int, clock: str, day: str, month: str, year: str) -> None:
    assert len(year) in (2, 4)
    if len(year) == 2:
        year = ("19" if year >= "80" else "20") + year
    midnight = datetime(int(year), int(month), int(day), tzinfo=UTC)
    assert utc_ns == int(midnight.timestamp()) * 10**9 + time_of_day(clock) * 10**6


def check_heading(heading: Heading, formatter: str, f: list[str]) -> None:
    f = [*f, *[""] * 5]
    value = heading.heading_true_deg if formatter == "HDT" else heading.heading_mag_deg
    assert value is not None
    assert (heading.heading_true_deg is None) == (formatter != "HDT")
    same(value, "0" if exact(f[0]) == 360 else f[0], 0, 359.999999999)
    if formatter == "HDG":
        for angle, text, side in ((heading.deviation_deg, f[1], f[2]), (heading.variation_deg, f[3], f[4])):
            if angle is None:
                assert not text or (exact(text) == 0 and not side)
            else:
                assert side in ("E", "W")
                same(-angle if side == "W" else angle, text, 0 if side == "W" else -180, 180)


def decode(data: bytes) -> tuple[bool, list[Measurement]]:
    """One line, alone after an opening sentence where it needs one: accepted?, and what came of it."""
    decoder = PortDecoder([make_driver(gps()), make_driver(compass())])
    lone = data[3:6] not in (b"VTG", b"GSA")
    if not lone:
        decoder.feed(line(OPENING))
    outcome = decoder.feed(line(data))
    assert isinstance(outcome, Accepted | Rejected | Ignored)
    found = list(outcome.measurements) if isinstance(outcome, Accepted) else []
    return isinstance(outcome, Accepted), [*found, *decoder.flush(10**18)]


def check(data: bytes, found: list[Measurement]) -> None:
    formatter = data[3:6].decode()
    f = data.decode("ascii").partition("*")[0].split(",")[1:]
    for measurement in found:
        if isinstance(measurement, Fix):
            check_fix(measurement, formatter, f)
        elif isinstance(measurement, Heading):
            check_heading(measurement, formatter, f)
        elif isinstance(measurement, ClockPair):
            day = (f[1], f[2], f[3]) if formatter == "ZDA" else (f[8][:2], f[8][2:4], f[8][4:])
            check_utc(measurement.utc_ns, f[0], *day)


@FEW_OR_MANY
def test_damaged_sentences(count: int) -> None:
    rng = random.Random(20260715)
    accepted = 0
    for number in range(count):
        original = rng.choice(BODIES)
        body = mutate(rng, original)
        data = sealed(body)
        if number % 2:
            data = data[:-2] + sealed(original)[-2:]
        good, found = decode(data)
        assert not good or has_right_checksum(data)
        if good:
            accepted += 1
            check(data, found)
    # Far from nothing must get through, or the check above has checked nothing.
    assert accepted > count // 20


def test_the_undamaged_sentences_pass_the_same_check() -> None:
    for body in BODIES:
        good, found = decode(sealed(body))
        assert good
        assert found
        check(sealed(body), found)


IMU_LINES = [
    "!!!VER:1.9,AN0:1,AN1:-2,AN2:164,AN3:4096,AN4:-2048,AN5:4096,RLL:0.01,PCH:0.02,YAW:12.31,IMUH:253,TOW:0***",
    "!!!VER:1.9,RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0***",
    "!!!VER:1.9,MGX:555,MGY:-51,MGZ:139,MGH:2.79,TOW:582655000***",
    "!!!VER:1.8.1,AN0:1.00,AN1:-2.25,AN2:164.50,AN3:4096.00,AN4:-2048.00,AN5:4096.00, ALT:3525,***",
    "!!!EX0:8137976,EX1:-4409696,EX2:3785223,EX3:4698463,EX4:8825641,EX5:180283,EX6:-3420201,EX7:1631759,EX8:9254165***",
    "VER:1.9,RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0***",
    "RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253",
    "RLL:1.12,PCH:-0.07,YAW:-34.03,",
]


def check_imu(data: bytes, found: tuple[Measurement, ...]) -> None:
    text = data.decode("ascii")
    is_marked = text.startswith(("!!", "VER:", "!VER:")) and text.endswith("***")
    assert is_marked or re.fullmatch(r"RLL:[-.\d]+\.\d\d,PCH:[-.\d]+\.\d\d,YAW:[-.\d]+\.\d\d(,IMUH:\d+)?,?", text)
    pairs = [pair.strip(" ").split(":") for pair in text.strip("!*").split(",") if pair]
    assert all(len(pair) == 2 for pair in pairs), text
    values = dict(pairs)
    assert len(values) == len(pairs), text
    for measurement in found:
        if isinstance(measurement, ImuSample):
            assert all(abs(exact(values[f"AN{n}"])) <= 32768 for n in range(6))
            assert abs(measurement.yaw_rate_deg_s - exact(values["AN2"]) / Fraction("16.4")) < 1e-9
            assert abs(measurement.accel_fwd_m_s2 + exact(values["AN3"]) / 4096 * Fraction("9.80665")) < 1e-9
            assert abs(measurement.accel_stb_m_s2 + exact(values["AN4"]) / 4096 * Fraction("9.80665")) < 1e-9
        elif isinstance(measurement, Attitude):
            check_attitude(measurement, values)


def check_attitude(found: Attitude, values: dict[str, str]) -> None:
    for value, key, limit in (
        (found.mag_fwd_counts, "MGX", 32768), (found.mag_stb_counts, "MGY", 32768),
        (found.mag_down_counts, "MGZ", 32768),
    ):  # fmt: skip
        assert (value is None) == (key not in values)
        same(value, values.get(key, ""), -limit, limit)
    assert (found.warning is None) == (exact(values.get("IMUH", "253")) == 253)
    if "EX0" in values:
        check_matrix(found, values)
        if values.keys().isdisjoint({"RLL", "PCH", "YAW"}):
            return
    for value, key, limit in ((found.roll_deg, "RLL", 180), (found.pitch_deg, "PCH", 90), (found.yaw_deg, "YAW", 180)):
        assert (value is None) == (key not in values)
        same(value, values.get(key, ""), -limit, limit)


def check_matrix(found: Attitude, values: dict[str, str]) -> None:
    """Nine numbers, columns of length one; and the rotation of the angles found is the matrix sent."""
    sent = [float(exact(values[f"EX{n}"])) / 1e7 for n in range(9)]
    for column in range(3):
        assert abs(sum(sent[3 * row + column] ** 2 for row in range(3)) - 1.0) < 0.05
    if values.keys().isdisjoint({"RLL", "PCH", "YAW"}) and found.yaw_deg is not None and found.roll_deg is not None:
        assert found.pitch_deg is not None
        roll, pitch, yaw = (math.radians(angle) for angle in (found.roll_deg, found.pitch_deg, found.yaw_deg))
        assert abs(-math.sin(pitch) - sent[6]) < 0.02
        assert abs(math.cos(pitch) * math.sin(roll) - sent[7]) < 0.02
        assert abs(math.cos(pitch) * math.cos(yaw) - sent[0]) < 0.02


@FEW_OR_MANY
def test_damaged_arduimu_lines(count: int) -> None:
    rng = random.Random(1971)
    driver = make_driver(imu())
    accepted = 0
    for _ in range(count):
        data = mutate(rng, rng.choice(IMU_LINES)).replace("q", ":").encode("latin-1")
        outcome = driver.feed(line(data))
        assert isinstance(outcome, Accepted | Rejected | Ignored)
        # On a shared port the driver sees only what it claims: it must claim all that it would accept.
        assert driver.claims(line(data)) or not isinstance(outcome, Accepted)
        if isinstance(outcome, Accepted):
            accepted += 1
            check_imu(data, outcome.measurements)
    assert accepted > count // 20


def test_the_undamaged_arduimu_lines_pass_the_same_check() -> None:
    for text in IMU_LINES:
        outcome = make_driver(imu()).feed(line(text.encode()))
        assert isinstance(outcome, Accepted)
        assert outcome.measurements
        check_imu(text.encode(), outcome.measurements)


def test_decoding_costs_far_less_than_two_percent_of_a_core() -> None:
    """10 Hz x 4 GPS sentences, 100 Hz IMU and 20 Hz compass for 5 s of boat time, in CPU time."""
    decoder = PortDecoder([make_driver(gps()), make_driver(compass()), make_driver(imu())])
    load = [line(sealed(body)) for body in BODIES[:4]] * 50 + [line(sealed(BODIES[6]))] * 100
    load += [line(IMU_LINES[0].encode())] * 500
    start = time.process_time()
    for one in load:
        decoder.feed(one)
    assert time.process_time() - start < 5 * 0.02
