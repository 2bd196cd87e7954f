"""Fault diagnosis in words: why a sensor does not deliver, from counts and times. Pure functions, each a sentence."""

from collections import Counter
from dataclasses import dataclass
from typing import Final

from common.units import NS_PER_S
from onboard.devices.recognise import NOISE, Stranger

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
    hint: Stranger | None
    """Whose lines they are; `None` = not known."""


@dataclass(frozen=True, slots=True)
class Why:
    """Why a sensor does not deliver, in words."""

    what: str
    cure: str = ""
    """What to do about it; "" = no more than for any silence."""

    def __str__(self) -> str:
        return f"{self.what}: {self.cure}" if self.cure else self.what


_CURES: Final = {
    "empty": "the device has no value yet, or is being calibrated",
    "unit": "set the device to degrees",
    "alarm": "the device itself says that its values are wrong",
    "void": "the device itself says that its values are not valid yet",
}
"""Reason of rejection -> what to do; the others blame wire and baud rate."""


def instead_of_its_lines(came: Instead) -> Why:
    """What came in place of a sensor's lines."""
    bad = came.rejected
    if came.hint is NOISE and not came.flooded and not came.readable:
        return Why(f"{came.size} bytes came, {NOISE.what}")
    if came.hint is not None and came.hint is not NOISE:
        return Why(came.hint.what, came.hint.cure)
    if came.flooded:
        what = "more than the port's byte budget: no whole line of this sensor is left of them"
        return Why(f"{came.size} bytes came, {what}")
    if came.size < SHORTEST_SILENT_BYTES and not bad and not came.readable:
        return Why(f"{came.size} bytes came, no whole line yet")
    if not bad and not came.readable:
        return Why(f"{came.size} bytes came, no whole line in them")
    if not came.readable and 2 * bad["not-ascii"] >= bad.total():
        return Why(f"{came.size} bytes came, {NOISE.what}")
    if bad and bad["no-checksum"] == bad.total():
        return Why(f"{bad.total()} lines without checksum came", 'checksum = "optional" at this sensor takes them')
    if bad:
        ((most, _), *_) = counts = bad.most_common(4)
        reasons = ", ".join(f"{reason} {number}" for reason, number in counts)
        return Why(f"{bad.total()} bad lines came, no good one: {reasons}", _CURES.get(most, ""))
    return Why(f"{came.size} bytes came, no line of this sensor: wrong port or talker?")


def silent(age_ns: int | None, slow_period_ns: int | None, came: Instead) -> Why:
    """Why a periodic sensor is silent.

    age_ns: time since its last good line, `None` = there was none; slow_period_ns: its learned period, where that is
    longer than configured.
    """
    if came.size:
        return instead_of_its_lines(came)
    if age_ns is None:
        return Why("nothing received yet")
    text = f"nothing received for {age_ns / NS_PER_S:.0f} s"
    if slow_period_ns is None:
        return Why(text)
    return Why(f"{text}; it sends every {slow_period_ns / NS_PER_S:.3g} s, slower than configured")


def quiet(quiet_ns: int, came: Instead) -> str | None:
    """For how long an event sensor has been quiet; `None` while that is nothing unusual."""
    if quiet_ns < QUIET_NS:
        return None
    text = f"quiet for {quiet_ns // NS_PER_S} s"
    return f"{text}; {instead_of_its_lines(came)}" if came.size else text
