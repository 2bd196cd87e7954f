"""Fault diagnosis in words: why a sensor does not deliver, from counts and times. Pure functions, each a sentence."""

from collections import Counter
from dataclasses import dataclass
from typing import Final

from common.units import NS_PER_S

QUIET_NS: Final = 30 * NS_PER_S
"""Silence after which an event sensor's reason says for how long it has been quiet, ns."""
SHORTEST_SILENT_BYTES: Final = 512
"""Fewer bytes without a line end may be the beginning of a line."""


@dataclass(frozen=True, slots=True)
class Instead:
    """What a port brought while no good line of one of its sensors came."""

    size: int
    """Number of bytes that came."""
    readable: int
    """Number of lines that came whole, of any sensor, usable or not."""
    rejected: Counter[str]
    """Number of bad lines that count for this sensor, by reason."""
    flooded: bool
    """True when the port is over its byte budget."""
    hint: str | None
    """Whose lines they are, in words; `None` = not known."""


def instead_of_its_lines(came: Instead) -> str:
    """What came in place of a sensor's lines."""
    bad = came.rejected
    if came.hint is not None:
        return came.hint
    if came.flooded:
        return f"{came.size} bytes came, more than the port's byte budget: no whole line of this sensor is left of them"
    if came.size < SHORTEST_SILENT_BYTES and not bad and not came.readable:
        return f"{came.size} bytes came, no whole line yet"
    if not came.readable and 2 * bad["not-ascii"] >= bad.total():
        return f"{came.size} bytes came, none readable: wrong baud rate?"
    if bad and bad["no-checksum"] == bad.total():
        return f'{bad.total()} lines without checksum came: checksum = "optional" at this sensor takes them'
    if bad:
        reasons = ", ".join(f"{reason} {number}" for reason, number in bad.most_common(4))
        return f"{bad.total()} bad lines came, no good one: {reasons}"
    return f"{came.size} bytes came, no line of this sensor: wrong port or talker?"


def silent(age_ns: int | None, slow_period_ns: int | None, came: Instead) -> str:
    """Why a periodic sensor is silent.

    age_ns: time since its last good line, `None` = there was none; slow_period_ns: its learned period, where that is
    longer than configured.
    """
    if came.size:
        return instead_of_its_lines(came)
    if age_ns is None:
        return "nothing received yet"
    text = f"nothing received for {age_ns / NS_PER_S:.0f} s"
    if slow_period_ns is None:
        return text
    return f"{text}; it sends every {slow_period_ns / NS_PER_S:.3g} s, slower than configured"


def quiet(quiet_ns: int, came: Instead) -> str | None:
    """For how long an event sensor has been quiet; `None` while that is nothing unusual."""
    if quiet_ns < QUIET_NS:
        return None
    text = f"quiet for {quiet_ns // NS_PER_S} s"
    return f"{text}; {instead_of_its_lines(came)}" if came.size else text
