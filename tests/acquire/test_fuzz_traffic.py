"""20,000 damaged sentences of radar, AIS and rate gyro, fixed seed; and damage of known kind to every sort of line.

Nothing raises, nothing is accepted that the text does not say, and the counters show what was injected.
"""

import random
import re
from collections import Counter
from fractions import Fraction

from common.boat_config import SensorTable
from common.framer import Measurement
from common.messages import AisLine, RadarTarget, RawLine, TurnRate
from onboard.devices import Accepted, Ignored, PortDecoder, Rejected, make_driver
from tests.acquire.mutations import FEW_OR_MANY, exact, has_right_checksum, mutate, same, same_angle, time_of_day
from tests.acquire.sentences import ARDUIMU, compass, gps, imu, line, sealed

SENTENCES = [
    sealed("RATTM,01,0.52,247.9,T,11.3,235.8,T,0.11,-2.7,N,1 (Broadband 4G),T,,135647,M"),
    sealed("RATTM,12,2.5,10.0,R,10.5,20.0,R,1.25,12.5,K,,T,R,101112.50,A"),
    sealed("RATTM,03,0.49,278.2,T,0.0,2.9,T,,24751376.1,S,3,Q,,135624,M"),
    sealed("RATLL,01,5812.6870,N,01131.9502,W,1 (Broadband 4G),134601,T,"),
    b"!" + sealed("AIVDM,1,1,,A,13RlIW?04F1beOVEFLB9bRvH0L0L,0")[1:],
    b"!" + sealed("AIVDM,2,1,3,B,55MwgS`00001L@?;GO0<51@58p@4r0,2")[1:],
    sealed("PWFXG,123456,A,-12345,440"),
    sealed("PWFXG,5050,Z,,441"),
    sealed("PWFXG,5100,S,400000,441"),
]
METRES = {"K": Fraction(1000), "N": Fraction(1852), "S": Fraction("1609.344")}


def port() -> PortDecoder:
    tables = [
        SensorTable(id="ais1", port="p", role="ais"),
        SensorTable(id="radar1", port="p", role="radar"),
        SensorTable(id="gyro1", port="p", role="gyro", model="tinkerkit"),
        gps(),
        compass(),
        imu(),
    ]
    return PortDecoder([make_driver(table) for table in tables])


def scaled(value: float | None, text: str, factor: Fraction) -> None:
    if value is not None:
        assert abs(Fraction(value) - exact(text) * factor) <= Fraction(1, 10**6)


def check_target(found: RadarTarget, formatter: str, f: list[str]) -> None:
    f = [*f, *[""] * 16]
    assert found.number == exact(f[0].strip(" "))
    status, clock = (f[11], f[13]) if formatter == "TTM" else (f[7], f[6])
    assert found.status == {"": None, "L": "lost", "Q": "acquiring", "T": "tracking"}[status]
    assert found.tod_ms is None if not clock else found.tod_ms == time_of_day(clock)
    if formatter == "TLL":
        same_angle(found.lat_deg, f[1], f[2], 2)
        same_angle(found.lon_deg, f[3], f[4], 3)
        assert found.name == (f[5] or None)
        return
    assert found.name == (f[10] or None)
    metres = METRES.get(f[9], Fraction(0))
    scaled(found.range_m, f[1], metres)
    scaled(found.cpa_m, f[7], metres)
    scaled(found.sog_kn, f[4], metres / 1852)
    scaled(found.tcpa_s, f[8], Fraction(60))
    assert (found.range_m is None) == (not f[1])
    assert found.tcpa_s is None or found.cpa_m is not None
    for true_deg, rel_deg, text, letter in (
        (found.bearing_true_deg, found.bearing_rel_deg, f[2], f[3]),
        (found.course_true_deg, found.course_rel_deg, f[5], f[6]),
    ):
        assert true_deg is None or letter == "T"
        assert rel_deg is None or letter == "R"
        wanted = "0" if text and exact(text) == 360 else text
        same(true_deg, wanted, 0, 359.999999999)
        same(rel_deg, wanted, 0, 359.999999999)
    if found.status in ("lost", "acquiring"):
        assert found.sog_kn is found.course_true_deg is found.course_rel_deg is None


def check(data: bytes, found: tuple[Measurement, ...]) -> None:
    text = data.decode("ascii")
    f = text.partition("*")[0].split(",")[1:]
    for measurement in found:
        if isinstance(measurement, RadarTarget):
            check_target(measurement, text[3:6], f)
        elif isinstance(measurement, TurnRate):
            assert re.fullmatch("PWFXG,[0-9]+,A,-?[0-9]+,[0-9]+", text[1:-3])
            assert abs(Fraction(measurement.rate_deg_s) - exact(f[2]) / 1000) < Fraction(1, 10**9)
            assert abs(measurement.rate_deg_s) <= 2000
        else:
            assert isinstance(measurement, AisLine | RawLine)
            assert measurement.text == text
        if isinstance(measurement, AisLine):
            assert re.fullmatch("![A-Z0-9]{2}VD[MO],[1-9],[1-9],[0-9]?,[A-Z0-9]?,[0-W`-w]*,[0-5](,[0-9]*)?", text[:-3])


@FEW_OR_MANY
def test_damaged_sentences(count: int) -> None:
    rng = random.Random(20261122)
    counts: Counter[str] = Counter()
    decoder = port()
    for number in range(count):
        original = rng.choice(SENTENCES)
        data = original[:1] + sealed(mutate(rng, original[1:-3].decode()))[1:]
        if number % 2:
            data = data[:-2] + original[-2:]
        outcome = decoder.feed(line(data))
        counts[type(outcome).__name__] += 1
        if isinstance(outcome, Accepted):
            assert has_right_checksum(data)
            # A change of the address may make it another sensor's sentence: that one has its own test.
            if outcome.sensor in ("ais1", "radar1", "gyro1"):
                check(data, outcome.measurements)
        else:
            assert isinstance(outcome, Rejected | Ignored)
    assert counts.total() == count
    assert counts["Accepted"] > count // 20


def test_the_undamaged_sentences_pass_the_same_check() -> None:
    for data in SENTENCES:
        outcome = port().feed(line(data))
        assert outcome == Rejected("saturated", "gyro1") or isinstance(outcome, Accepted)
        check(data, outcome.measurements if isinstance(outcome, Accepted) else ())


def test_counters_equal_what_was_injected() -> None:
    """Every sort of line, whole or damaged in one of four ways: the counters by sensor and reason are the tally."""
    rng = random.Random(3)
    whole = {
        "radar1": SENTENCES[0], "ais1": SENTENCES[4], "gyro1": SENTENCES[6], "imu1": ARDUIMU,
        "compass1": sealed("HCHDG,271.1,10.7,E,12.2,W"), "gps1": sealed("GPVTG,77.52,T,76.1,M,10.004,N,18.5,K,A"),
    }  # fmt: skip
    decoder = port()
    injected: Counter[tuple[str, str]] = Counter()
    counted: Counter[tuple[str, str]] = Counter()
    for _ in range(3000):
        sensor = rng.choice(list(whole))
        data = whole[sensor]
        insult = rng.choice(("none", "flip", "cut", "twice", "garbage"))
        at = rng.randrange(10, len(data) - 4)
        has_checksum = sensor != "imu1"
        if insult == "flip" and has_checksum:
            # The lowest bit of a digit: it stays a character, and the checksum cannot fit.
            at = rng.choice([place for place in range(10, len(data) - 3) if data[place : place + 1].isdigit()])
            data, reason = data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :], "checksum"
        elif insult == "cut":
            data, reason = data[:at], "no-checksum" if has_checksum else "marks"
        elif insult == "twice":
            data, reason = data[:at] + data, "run-together" if has_checksum else "fields"
        elif insult == "garbage":
            data, reason = data[:at] + b"\xf8" + data[at + 1 :], "not-ascii"
        else:
            reason = "accepted"
        if sensor == "imu1" and insult == "twice":
            data, reason = whole[sensor][:-3] + data[at:], "not-a-number"
        injected[sensor, reason] += 1
        outcome = decoder.feed(line(data))
        assert isinstance(outcome, Accepted | Rejected)
        counted[outcome.sensor or "", outcome.reason if isinstance(outcome, Rejected) else "accepted"] += 1
    assert counted == injected
