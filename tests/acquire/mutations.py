"""Damage to sentences, and a strict reader that shares no code with the decoders: it computes with fractions."""

import random
from fractions import Fraction
from functools import reduce
from operator import xor

import pytest

FEW_OR_MANY = pytest.mark.parametrize("count", [2_000, pytest.param(20_000, marks=pytest.mark.slow)])
"""So many damaged sentences, the first of them the same in both tiers."""
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


def has_right_checksum(data: bytes) -> bool:
    """Of one sentence, no tag block before it."""
    try:
        wanted = int(data[-2:].decode("ascii"), 16)
    except ValueError:
        return False
    return data[-3:-2] == b"*" and reduce(xor, data[1:-3], 0) == wanted


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
