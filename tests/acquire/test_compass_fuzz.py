"""Damaged TCM2, HMR3000 and KVH lines, fixed seed: nothing raises, nothing wrong is accepted, every line is counted.

The reader here shares no code with the drivers: it cuts the text itself and computes with fractions.
"""

import math
import random
from collections import Counter
from dataclasses import fields
from fractions import Fraction
from functools import reduce
from operator import xor

import pytest

from common.framer import Measurement
from common.messages import Attitude, Heading
from onboard.devices import Accepted, Ignored, Line, Outcome, PortDecoder, Rejected, make_driver
from tests.acquire.mutations import DIGITS, FEW_OR_MANY, exact
from tests.acquire.sentences import S, compass, sealed

TCM2 = [
    "C328.3P28.4R-12.4X55.11Y12.33Z-18.43T22.3E001",
    "C309.8P4.0R-2.9T25.1",
    "C0.4P-12.0R7.5X-3.00Y20.50Z44.10T-3.5",
    "P4.2R-2.6T25.1",
    "C310.2E400",
]
HPR = [
    "PTNTHPR,354.9,N,5.2,N,0.2,N",
    "PTNTHPR,12.0,M,-5.2,N,-10.2,O",
    "PTNTHPR,200.1,N,0.0,N,0.0,N",
]
KVH = ["%0012,-034,1234", "%-123,0034,0007", "%123.4", "$HCHDM,123.4,M", "$HCHDM,003.4,M,"]
NASTY = "0123456789.-,CPRXYZTENMOLPA%$*! \x00\xff"


def angle(text: str, limit: int) -> Fraction:
    """Degrees with a decimal within +-limit."""
    assert "." in text
    assert abs(exact(text)) <= limit
    return exact(text)


def direction(text: str) -> Fraction:
    assert angle(text, 360) >= 0
    return exact(text) % 360


def holds(data: bytes) -> str:
    """The text between `$` and `*`, the checksum being right; bytes that are no text may stand before the `$`."""
    start = data.rindex(b"$")
    body, mark, digits = data[start + 1 :].partition(b"*")
    assert mark
    assert len(digits) == 2
    assert reduce(xor, body, 0) == int(digits, 16)
    return body.decode("ascii")


def tcm2_says(data: bytes) -> dict[str, Fraction | float | str]:
    rest = holds(data)
    said: dict[str, Fraction | float | str] = {}
    groups: dict[str, str] = {}
    for tag in "CPRXYZTE":
        if rest[:1] == tag:
            length = next((n for n, letter in enumerate(rest[1:], 1) if letter in "CPRXYZTE" and tag != "E"), len(rest))
            groups[tag], rest = rest[1:length], rest[length:]
    assert not rest
    if "C" in groups:
        said["heading_mag_deg"] = direction(groups["C"])
    for tag, name, limit in (("P", "pitch_deg", 90), ("R", "roll_deg", 180)):
        if tag in groups:
            said[name] = angle(groups[tag], limit)
    axes = [exact(groups[tag]) for tag in "XYZ" if tag in groups]
    if len(axes) == 3:
        said["field_ut"] = math.sqrt(sum(axis * axis for axis in axes))
    if "T" in groups and -40 <= exact(groups["T"]) <= 70:
        said["temperature_c"] = exact(groups["T"])
    if groups.get("E", "000") != "000":
        assert len(groups["E"]) == 3
        assert set(groups["E"]) <= set("0123456789ABCDEF")
        assert groups["E"][2] not in "234567ABCDEF"
        said["warning"] = "E" + groups["E"]
    if "C" not in groups:
        said = {name: value for name, value in said.items() if name in ("pitch_deg", "roll_deg", "warning")}
    return said


def hpr_says(data: bytes) -> dict[str, Fraction | float | str]:
    name, heading, *rest = holds(data).split(",")
    assert name == "PTNTHPR"
    heading_letter, pitch, pitch_letter, roll, roll_letter = rest
    said: dict[str, Fraction | float | str] = {"heading_mag_deg": direction(heading)}
    if pitch:
        said["pitch_deg"] = angle(pitch, 90)
    if roll:
        said["roll_deg"] = angle(roll, 180)
    letters = (("heading", heading_letter), ("pitch", pitch_letter), ("roll", roll_letter))
    assert all(letter in ("N", "M", "O", "C") for _, letter in letters)
    warning = ", ".join(f"{what} {letter}" for what, letter in letters if letter != "N")
    return {**said, "warning": warning} if warning else said


def kvh_says(data: bytes) -> dict[str, Fraction | float | str]:
    text = data.decode("ascii")
    if text.startswith("$"):
        assert text.startswith("$HCHDM,")
        assert text[12:] in (",M", ",M,")
        return {"heading_mag_deg": three_digits(text[7:12])}
    assert text.startswith("%")
    parts = text[1:].split(",")
    if len(parts) == 1:
        return {"heading_mag_deg": three_digits(parts[0])}
    pitch, roll, azimuth = parts
    assert {len(part) for part in parts} == {4}
    assert abs(exact(pitch)) <= 900
    assert abs(exact(roll)) <= 1800
    assert 0 <= exact(azimuth) <= 3600
    assert not set("".join(parts)) - DIGITS - {"-"}
    return {
        "heading_mag_deg": exact(azimuth) / 10 % 360,
        "pitch_deg": exact(pitch) / 10,
        "roll_deg": exact(roll) / 10,
    }


def three_digits(text: str) -> Fraction:
    assert text[:3].isdigit()
    assert (len(text), text[3]) == (5, ".")
    return direction(text)


def check(found: tuple[Measurement, ...], said: dict[str, Fraction | float | str]) -> None:
    """Exactly one measurement, with exactly what was said and nothing else."""
    (one,) = found
    assert isinstance(one, Heading if "heading_mag_deg" in said else Attitude)
    values = {field.name: getattr(one, field.name) for field in fields(one) if field.name not in ("sensor", "t_ns")}
    assert {name for name, value in values.items() if value is not None} == set(said)
    for name, value in said.items():
        if isinstance(value, str):
            assert values[name] == value
        else:
            assert abs(Fraction(values[name]) - Fraction(value)) <= Fraction(1, 10**9)


SAYS = {"tcm2": tcm2_says, "hmr3000": hpr_says, "kvh-c100": kvh_says}


def mutate(rng: random.Random, text: str) -> str:
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        at = rng.randrange(len(text)) if text else 0
        match rng.randrange(6):
            case 0:
                text = text[:at] + chr(ord(text[at]) ^ 1 << rng.randrange(8)) + text[at + 1 :] if text else text
            case 1:
                text = text[:at] + text[at + rng.randrange(1, 4) :]
            case 2:
                text = text[:at] + rng.choice(NASTY) + text[at:]
            case 3:
                text = text[:at] + rng.choice(NASTY) + text[at + 1 :]
            case 4:
                text = text[: at + 1]
            case _:
                other = rng.randrange(len(text)) if text else 0
                low, high = min(at, other), max(at, other)
                text = text[:low] + text[high:] + text[low:high]
    return text


def outcomes(model: str, injected: list[bytes]) -> list[Outcome]:
    """Each line to a port with that compass, a fresh one each time: none may stand in for another."""
    found = [
        PortDecoder([make_driver(compass(model=model))]).feed(Line(n * S, data)) for n, data in enumerate(injected)
    ]
    assert all(isinstance(outcome, Accepted | Rejected | Ignored) for outcome in found)
    return found


@FEW_OR_MANY
@pytest.mark.parametrize(("model", "bodies"), [("tcm2", TCM2), ("hmr3000", HPR)])
def test_the_checksum_finds_every_single_damaged_byte(count: int, model: str, bodies: list[str]) -> None:
    """The old checksum over a damaged body: XOR misses damage only where two bytes changed alike."""
    rng = random.Random(f"old {model}")
    good = [sealed(body) for body in bodies]
    injected = []
    for _ in range(count // 4):
        data = bytearray(rng.choice(good))
        at = rng.randrange(1, len(data) - 3)
        data[at] ^= rng.choice([1 << bit for bit in range(8)])
        injected.append(bytes(data))
    found = Counter(
        one.reason if isinstance(one, Rejected) else type(one).__name__ for one in outcomes(model, injected)
    )
    assert found.total() == len(injected)
    high = sum(any(byte & 0x80 for byte in data) for data in injected)
    control = sum(any(byte < 0x20 or byte == 0x7F for byte in data) for data in injected)
    inside = sum(any(mark in data[1:-3] for mark in b"$!*") for data in injected)
    assert found["not-ascii"] == high + control
    assert found["run-together"] == inside
    assert found["checksum"] == len(injected) - high - control - inside


@FEW_OR_MANY
@pytest.mark.parametrize(("model", "bodies"), [("tcm2", TCM2), ("hmr3000", HPR), ("kvh-c100", KVH)])
def test_what_is_accepted_is_what_the_bytes_say(count: int, model: str, bodies: list[str]) -> None:
    """Damage behind a right checksum, or where there is none (KVH)."""
    rng = random.Random(f"new {model}")
    injected = []
    for _ in range(count):
        text = mutate(rng, rng.choice(bodies))
        injected.append(text.encode("latin-1") if model == "kvh-c100" else sealed(text))
    accepted = 0
    found = outcomes(model, injected)
    for data, outcome in zip(injected, found, strict=True):
        if isinstance(outcome, Accepted):
            accepted += 1
            check(outcome.measurements, SAYS[model](data))
    rejected = sum(isinstance(one, Rejected) for one in found)
    ignored = sum(isinstance(one, Ignored) for one in found)
    assert accepted + rejected + ignored == count
    # Enough must get through, or the check above has checked nothing.
    assert accepted > count // 20, accepted


@FEW_OR_MANY
def test_counters_equal_what_was_injected(count: int) -> None:
    """One driver, one fault in each line: so many lines of a kind in, so many of its reason out."""
    rng = random.Random(3)
    faults = {
        "range": lambda: f"C{rng.randrange(3601, 9999) / 10}P1.0",
        "unit": lambda: f"C{rng.randrange(360)}P1.0",
        "fields": lambda: f"R1.0C{rng.randrange(3600) / 10}",
        "not-a-number": lambda: f"C{rng.randrange(360)}.{rng.randrange(10)}.5",
        "alarm": lambda: f"C{rng.randrange(3600) / 10}E00{rng.choice('2467')}",
        "empty": lambda: f"T{rng.randrange(300) / 10}",
        "accepted": lambda: f"C{rng.randrange(3600) / 10}P1.0R2.0",
    }
    port = PortDecoder([make_driver(compass(model="tcm2"))])
    injected: Counter[str] = Counter()
    found: Counter[str] = Counter()
    for number in range(count):
        fault = rng.choice([*faults, "checksum", "no-checksum", "prompt"])
        data = sealed(faults.get(fault, faults["accepted"])())
        if fault == "checksum":
            data = data[:-2] + b"%02X" % (int(data[-2:], 16) ^ rng.randrange(1, 256))
        elif fault == "no-checksum":
            data = data[: -rng.randrange(1, 4)]
        elif fault == "prompt":
            data = b":"
        injected[fault] += 1
        match port.feed(Line(number * S, data)):
            case Accepted():
                found["accepted"] += 1
            case Rejected(reason, "compass1"):
                found[reason] += 1
            case Ignored("text"):
                found["prompt"] += 1
    assert found == injected


def test_the_undamaged_lines_pass_the_same_check() -> None:
    for model, bodies in (("tcm2", TCM2), ("hmr3000", HPR), ("kvh-c100", KVH)):
        for body in bodies:
            data = body.encode() if model == "kvh-c100" else sealed(body)
            (outcome,) = outcomes(model, [data])
            assert isinstance(outcome, Accepted)
            check(outcome.measurements, SAYS[model](data))
