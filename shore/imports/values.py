"""Parsers of numbers, angles and times in foreign records. A wrong value raises `Rejected` and nothing else."""

import math
import re
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from common.units import NS_PER_S, NS_PER_US
from shore.imports.line_counts import Rejected

_ISO: Final = re.compile(
    r"([0-9]{4})-([0-9]{2})-([0-9]{2})[T ]([0-9]{2}):([0-9]{2}):([0-9]{2})(?:[.,]([0-9]{1,12}))?"
    r"(Z|[+-][0-9]{2}:?[0-9]{2})?"
)
LATEST_UTC_NS: Final = 4_102_444_800 * NS_PER_S
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def number(record: dict[str, Any], key: str, low: float, high: float) -> float | None:
    """A number of a record, `None` where it is missing or null; raises Rejected for another type or out of range."""
    return in_range(record.get(key), key, low, high)


def in_range(value: object, name: str, low: float, high: float) -> float | None:
    """The value as a float; `None` for `None`; raises Rejected."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Rejected(f"{name}: no number")
    try:
        found = float(value)
    except OverflowError:
        raise Rejected(f"{name}: out of range") from None
    if not low <= found <= high:  # NaN is in no range
        raise Rejected(f"{name}: out of range")
    return found


def direction_deg(record: dict[str, Any], key: str, degrees: float = 1.0) -> float | None:
    """A direction in [0, 360); `degrees` of one unit. Half a turn below 0 and a degree above 360 are taken as meant."""
    found = number(record, key, -180.0 / degrees, 361.0 / degrees)
    if found is None:
        return None
    turned = math.fmod(found * degrees, 360.0)
    return turned if turned >= 0.0 else min(turned + 360.0, math.nextafter(360.0, 0.0))


def signed_deg(record: dict[str, Any], key: str, degrees: float = 1.0) -> float | None:
    """An angle of +-180 degrees."""
    found = number(record, key, -180.0 / degrees - 1e-9, 180.0 / degrees + 1e-9)
    return None if found is None else min(180.0, max(-180.0, found * degrees))


def utc_ns_of(value: object, name: str = "time") -> int | None:
    """ISO 8601 text -> UTC in ns since 1970; `None` for `None`; raises Rejected. Without a zone it is UTC."""
    if value is None:
        return None
    match = _ISO.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        raise Rejected(f"{name}: no ISO 8601")
    *parts, fraction, zone = match.groups()
    year, month, day, hour, minute, second = (int(part) for part in parts)
    leap = second == 60  # as the second after it
    try:
        moment = datetime(year, month, day, hour, minute, 59 if leap else second, tzinfo=UTC)
    except ValueError:
        raise Rejected(f"{name}: no such moment") from None
    since = moment - _EPOCH + timedelta(seconds=int(leap)) - _offset(zone)
    ns = (since.days * 86_400 + since.seconds) * NS_PER_S
    ns += round(int(fraction) * 10 ** (9 - len(fraction))) if fraction else 0
    return within_life(ns - ns % NS_PER_US, name)


def within_life(utc_ns: int, name: str) -> int:
    """A UTC from 1970 to 2099; raises Rejected for any other."""
    if not 0 <= utc_ns < LATEST_UTC_NS:
        raise Rejected(f"{name}: not from 1970 to 2099")
    return utc_ns


def _offset(zone: str | None) -> timedelta:
    if zone in (None, "Z"):
        return timedelta()
    assert zone is not None
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    away = timedelta(hours=hours, minutes=minutes)
    return away if zone[0] == "+" else -away
