"""The date of a recording: one offset, UTC less boat time, for a whole import.

It is the middle one (median) of most frames, else of most fixes, so that a clock that was wrong for a while does not
date the trip.
"""

from array import array
from collections.abc import Iterable
from statistics import median_low
from typing import Final

from common.messages import Frame

ENOUGH: Final = 6_000
"""So many frames or fixes with a date (ten minutes of frames) tell the UTC of a recording."""


def utc_offset_ns(frames: Iterable[Frame]) -> int | None:
    """UTC less boat time, by most frames, else by most fixes; `None` where there is no date."""
    said, usable, others = array("q"), array("q"), array("q")
    for frame in frames:
        if frame.utc_ns is not None:
            said.append(frame.utc_ns - frame.t0_ns)
        for fix in frame.fixes:
            if fix.utc_ns is not None:
                (usable if fix.usable else others).append(fix.utc_ns - fix.t_ns)
        if max(len(said), len(usable)) >= ENOUGH:
            break
    found = said or usable or others
    return median_low(found) if found else None
