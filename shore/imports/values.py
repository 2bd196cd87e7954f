"""Parsers of numbers, angles and times in foreign records. A wrong value raises `Rejected` and nothing else."""

import math
from typing import Any

from shore.imports.line_counts import Rejected
from shore.report.iso_time import LATEST_UTC_NS, iso_utc_ns


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
    if not isinstance(value, str):
        raise Rejected(f"{name}: no ISO 8601")
    try:
        return iso_utc_ns(value)
    except ValueError as reason:
        raise Rejected(f"{name}: {reason}") from None


def within_life(utc_ns: int, name: str) -> int:
    """A UTC from 1970 to 2099; raises Rejected for any other."""
    if not 0 <= utc_ns < LATEST_UTC_NS:
        raise Rejected(f"{name}: not from 1970 to 2099")
    return utc_ns
