"""40,000 damaged lines, fixed seed: nothing raises, and nothing is accepted that the text does not say.

The check shares no code with the decoders: it splits the text itself and computes with fractions.
"""

import random
import time
from datetime import UTC, datetime
from fractions import Fraction

from common.messages import Attitude, ClockPair, Fix, Heading
from onboard.devices import Accepted, Ignored, ImuSample, Measurement, PortDecoder, Rejected, make_driver
from tests.acquire.sentences import compass, gps, imu, line, sealed

COUNT = 20_000
BODIES = [
    "GPGGA,120000.000,3747.0873,S,17518.8938,E,1,08,1.1,59.9,M,23.7,M,,0000",
    "GNRMC,120000.000,A,3747.0873,S,17518.8938,E,12.69,181.39,311226,,,A",
    "GPVTG,77.52,T,76.1,M,10.004,N,18.5,K,A",
    "GPGSA,A,3,17,28,06,01,30,20,26,13,,,,,1.8,1.1,1.5",
    "GPGLL,5310.8115,N,00525.7025,W,120000.00,A,A",
    "GPZDA,120000.000,16,04,2026,-02,00",
    "HCHDG,271.1,10.7,E,12.2,W",
    "HCHDM,123.4,M",
    "HCHDT,86.2,T",
]
OPENING = sealed("GPGLL,5000.0000,N,00400.0000,E,120000.000,A,A")
NASTY = [
    "", "nan", "inf", "-inf", "1_0.5", "1e5", "9" * 400, "-1", "+1", " 1", "0x10", ".", "1.", ".5", "--1", "٣", "1,1",
    "6000.0", "9000.0001", "8960.0", "18000.1", "360.0", "999999", "000000", "235960", "240000", "310226", "N", "S",
    "E", "W", "M", "V", "A", "Q", "n",
]  # fmt: skip
DIGITS = set("0123456789")


def exact(text: str) -> Fraction:
    """The number a strict reader finds; anything else fails the test that asked."""
    whole, point, part = text.removeprefix("-").partition(".")
    assert whole, text
    assert set(whole) <= DIGITS, text
    assert not point or (part and set(part) <= DIGITS), text
    return Fraction(text)


def same(value: float | None, text: str, low: float, high: float) -> None:
    """`value`, unless missing, is what `text` says, and in range."""
    if value is None:
        return
    assert low <= value <= high
    assert abs(Fraction(value) - exact(text)) <= Fraction(1, 10**9)


def same_angle(value: float | None, text: str, sign: str, degree_digits: int) -> None:
    if value is None:
        assert not text
        return
    assert sign in (("N", "S") if degree_digits == 2 else ("E", "W"))
    assert len(text.partition(".")[0]) == degree_digits + 2
    minutes = exact(text[degree_digits:])
    assert 0 <= minutes < 60
    wanted = (exact(text[:degree_digits]) + minutes / 60) * (-1 if sign in "SW" else 1)
    assert abs(Fraction(value) - wanted) <= Fraction(1, 10**11)
    assert abs(value) <= (90 if degree_digits == 2 else 180)


def time_of_day(text: str) -> int:
    whole, _, part = text.partition(".")
    assert len(whole) == 6
    assert set(whole + part) <= DIGITS
    hour, minute, second = int(whole[:2]), int(whole[2:4]), int(whole[4:])
    assert hour < 24
    assert minute < 60
    assert second < 60 or whole == "235960"
    return (hour * 3600 + minute * 60 + second) * 1000 + int((part + "000")[:3])


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
    place = {"GGA": 1, "RMC": 2, "GLL": 0}[formatter]
    clock = f[4] if formatter == "GLL" else f[0]
    assert fix.tod_ms is None if not clock else fix.tod_ms == time_of_day(clock)
    if fix.lat_deg is not None:
        same_angle(fix.lat_deg, f[place], f[place + 1], 2)
        same_angle(fix.lon_deg, f[place + 2], f[place + 3], 3)
    if formatter == "GGA":
        assert fix.fix_quality is None if not f[5] else fix.fix_quality == exact(f[5])
        assert fix.satellites is None if not f[6] else fix.satellites == exact(f[6])
        same(fix.hdop, f[7], 0, 99)
        same(fix.alt_m, f[8], -12000, 100000)
        assert fix.alt_m is None or f[9] == "M"
        assert fix.fix_quality or fix.lat_deg is None
    else:
        assert fix.status_valid is None or f[1 if formatter == "RMC" else 5] == ("A" if fix.status_valid else "V")
    if formatter == "RMC":
        same(fix.sog_kn, f[6], 0, 1000)
        if fix.cog_true_deg is not None:
            same(fix.cog_true_deg, "0" if exact(f[7]) == 360 else f[7], 0, 360)
        if fix.utc_ns is not None:
            check_utc(fix.utc_ns, f[0], f[8][:2], f[8][2:4], "20" + f[8][4:])


def check_utc(utc_ns: int, clock: str, day: str, month: str, year: str) -> None:
    midnight = datetime(int(year), int(month), int(day), tzinfo=UTC)
    assert utc_ns == int(midnight.timestamp()) * 10**9 + time_of_day(clock) * 10**6


def check_heading(heading: Heading, formatter: str, f: list[str]) -> None:
    value = heading.heading_true_deg if formatter == "HDT" else heading.heading_mag_deg
    assert value is not None
    assert (heading.heading_true_deg is None) == (formatter != "HDT")
    same(value, "0" if exact(f[0]) == 360 else f[0], 0, 359.999999999)
    if formatter == "HDG":
        for angle, text, side in ((heading.deviation_deg, f[1], f[2]), (heading.variation_deg, f[3], f[4])):
            if angle is None:
                assert not text
            else:
                assert side in ("E", "W")
                same(-angle if side == "W" else angle, text, 0, 180)


def mutate(rng: random.Random, body: str) -> str:
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        parts = body.split(",")
        at = rng.randrange(len(body)) if body else 0
        match rng.randrange(8):
            case 0:
                body = body[:at] + chr(ord(body[at]) ^ 1 << rng.randrange(8)) + body[at + 1 :] if body else body
            case 1:
                body = body[:at] + body[at + rng.randrange(1, 4) :]
            case 2:
                body = body[:at] + rng.choice("0123456789.,-NSEWAV$*! \x00\xff") + body[at:]
            case 3:
                a, b = rng.randrange(len(parts)), rng.randrange(len(parts))
                parts[a], parts[b] = parts[b], parts[a]
                body = ",".join(parts)
            case 4:
                parts[rng.randrange(len(parts))] = ""
                body = ",".join(parts)
            case 5 | 6:
                parts[rng.randrange(len(parts))] = rng.choice(NASTY)
                body = ",".join(parts)
            case _:
                body = body[: at + 1]
    return body.encode("latin-1", "replace").decode("latin-1")


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
            day = (f[1], f[2], f[3]) if formatter == "ZDA" else (f[8][:2], f[8][2:4], "20" + f[8][4:])
            check_utc(measurement.utc_ns, f[0], *day)


def test_damaged_sentences() -> None:
    rng = random.Random(20260715)
    accepted = 0
    for number in range(COUNT):
        original = rng.choice(BODIES)
        body = mutate(rng, original)
        data = sealed(body)
        if number % 2:
            data = data[:-2] + sealed(original)[-2:]
        good, found = decode(data)
        if good:
            accepted += 1
            check(data, found)
    # Far from nothing must get through, or the check above has checked nothing.
    assert accepted > COUNT // 20


def test_the_undamaged_sentences_pass_the_same_check() -> None:
    for body in BODIES:
        good, found = decode(sealed(body))
        assert good
        assert found
        check(sealed(body), found)


IMU_LINES = [
    "!!!VER:1.9,AN0:1,AN1:-2,AN2:164,AN3:4096,AN4:-2048,AN5:-4096,RLL:0.01,PCH:0.02,YAW:12.31,IMUH:253,TOW:0***",
    "!!!VER:1.9,RLL:-15.81,PCH:-47.43,YAW:109.61,IMUH:253,TOW:0***",
    "!!!VER:1.9,MGX:555,MGY:-51,MGZ:139,MGH:2.79,TOW:582655000***",
]


def check_imu(data: bytes, found: tuple[Measurement, ...]) -> None:
    text = data.decode("ascii")
    assert text.startswith("!!")
    assert text.endswith("***")
    pairs = [pair.strip(" ").split(":") for pair in text.strip("!*").split(",") if pair]
    assert all(len(pair) == 2 for pair in pairs), text
    values = dict(pairs)
    assert len(values) == len(pairs), text
    for measurement in found:
        if isinstance(measurement, ImuSample):
            assert all(abs(exact(values[f"AN{n}"])) <= 32768 for n in range(6))
            assert abs(measurement.yaw_rate_deg_s - exact(values["AN2"]) / Fraction("16.4")) < 1e-9
            assert abs(measurement.accel_fwd_m_s2 - exact(values["AN3"]) / 4096 * Fraction("9.80665")) < 1e-9
            assert abs(measurement.accel_stb_m_s2 - exact(values["AN4"]) / 4096 * Fraction("9.80665")) < 1e-9
        elif isinstance(measurement, Attitude):
            check_attitude(measurement, values)


def check_attitude(found: Attitude, values: dict[str, str]) -> None:
    for value, key, limit in (
        (found.roll_deg, "RLL", 180), (found.pitch_deg, "PCH", 90), (found.yaw_deg, "YAW", 180),
        (found.mag_fwd_counts, "MGX", 32768), (found.mag_stb_counts, "MGY", 32768),
        (found.mag_down_counts, "MGZ", 32768),
    ):  # fmt: skip
        assert (value is None) == (key not in values)
        same(value, values.get(key, ""), -limit, limit)
    assert (found.warning is None) == (exact(values.get("IMUH", "253")) == 253)


def test_damaged_arduimu_lines() -> None:
    rng = random.Random(1971)
    driver = make_driver(imu())
    accepted = 0
    for _ in range(COUNT):
        data = mutate(rng, rng.choice(IMU_LINES)).replace("q", ":").encode("latin-1")
        outcome = driver.feed(line(data))
        assert isinstance(outcome, Accepted | Rejected | Ignored)
        if isinstance(outcome, Accepted):
            accepted += 1
            check_imu(data, outcome.measurements)
    assert accepted > COUNT // 20


def test_decoding_costs_far_less_than_two_percent_of_a_core() -> None:
    """10 Hz x 4 GPS sentences, 100 Hz IMU and 20 Hz compass for 5 s of boat time, in CPU time."""
    decoder = PortDecoder([make_driver(gps()), make_driver(compass()), make_driver(imu())])
    load = [line(sealed(body)) for body in BODIES[:4]] * 50 + [line(sealed(BODIES[6]))] * 100
    load += [line(IMU_LINES[0].encode())] * 500
    start = time.process_time()
    for one in load:
        decoder.feed(one)
    assert time.process_time() - start < 5 * 0.02
