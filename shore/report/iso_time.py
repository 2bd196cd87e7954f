"""Parser of ISO 8601 times."""

import re
from datetime import UTC, datetime, timedelta
from typing import Final

from common.units import NS_PER_S, NS_PER_US

_ISO: Final = re.compile(
    r"([0-9]{4})-([0-9]{2})-([0-9]{2})[T ]([0-9]{2}):([0-9]{2})(?::([0-9]{2})(?:[.,]([0-9]{1,12}))?)?"
    r"\s?(Z|UTC|[+-][0-9]{2}:?[0-9]{2})?"
)
_BASIC: Final = re.compile(
    r"([0-9]{4})([0-9]{2})([0-9]{2})T([0-9]{2})([0-9]{2})([0-9]{2})(?:[.,]([0-9]{1,12}))?(Z|[+-][0-9]{2}:?[0-9]{2})?"
)
"""The basic format: 20260512T100800Z."""
LATEST_UTC_NS: Final = 4_102_444_800 * NS_PER_S
"""The year 2100, ns since 1970."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


def iso_utc_ns(text: str) -> int:
    """UTC of a text in whole us, as ns since 1970; without a zone it is UTC. Raises ValueError with the reason."""
    match = _ISO.fullmatch(text.strip()) or _BASIC.fullmatch(text.strip())
    if match is None:
        raise ValueError("no ISO 8601")
    *parts, fraction, zone = match.groups()
    year, month, day, hour, minute, second = (int(part or 0) for part in parts)
    leap = second == 60  # as the second after it
    try:
        moment = datetime(year, month, day, hour, minute, 59 if leap else second, tzinfo=UTC)
    except ValueError:
        raise ValueError("no such moment") from None
    since = moment - _EPOCH + timedelta(seconds=int(leap)) - _offset(zone)
    ns = (since.days * 86_400 + since.seconds) * NS_PER_S
    ns += round(int(fraction) * 10 ** (9 - len(fraction))) if fraction else 0
    if not 0 <= ns < LATEST_UTC_NS:
        raise ValueError("not from 1970 to 2099")
    return ns - ns % NS_PER_US


def _offset(zone: str | None) -> timedelta:
    if zone in (None, "Z", "UTC"):
        return timedelta()
    assert zone is not None
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    away = timedelta(hours=hours, minutes=minutes)
    return away if zone[0] == "+" else -away
