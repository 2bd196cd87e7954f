"""Levelling: gravity is taken out of accelerations by the roll and pitch that the same unit gives."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Final, NamedTuple

from common.messages import Attitude, ImuBlock
from common.units import NS_PER_S, STANDARD_GRAVITY_M_S2

LARGEST_AGE_NS: Final = NS_PER_S // 4
"""An attitude holds for samples that are no farther from it: waves turn a hull by some degrees in that time."""


class _Tilt(NamedTuple):
    t_ns: int
    fwd_m_s2: float
    """What a unit at rest shows of gravity on its forward axis."""
    stb_m_s2: float


_time: Final = attrgetter("t_ns")


def levelled(block: ImuBlock, attitudes: Sequence[Attitude]) -> ImuBlock:
    """The block without gravity; samples without an attitude near them stay as they are.

    attitudes: those of the unit, roll starboard down +, pitch bow up +. A unit shows the specific force f = a - g:
    forward a + g sin(pitch), starboard a - g sin(roll) cos(pitch). Running sums keep their gravity: what the roll was
    in a gap of the frames is not known.
    """
    tilts = sorted(tilt for each in attitudes if (tilt := _tilt(each)) is not None)
    if not tilts:
        return block
    fwd, stb = list(block.accel_fwd_m_s2), list(block.accel_stb_m_s2)
    for i, t_ns in enumerate(block.sample_t_ns):
        place = bisect_left(tilts, t_ns, key=_time)
        near = min(tilts[max(0, place - 1) : place + 1], key=lambda tilt: abs(tilt.t_ns - t_ns))
        if abs(near.t_ns - t_ns) <= LARGEST_AGE_NS:
            fwd[i] -= near.fwd_m_s2
            stb[i] -= near.stb_m_s2
    return replace(block, accel_fwd_m_s2=tuple(fwd), accel_stb_m_s2=tuple(stb))


def _tilt(attitude: Attitude) -> _Tilt | None:
    if attitude.roll_deg is None or attitude.pitch_deg is None:
        return None
    roll, pitch = math.radians(attitude.roll_deg), math.radians(attitude.pitch_deg)
    fwd, stb = math.sin(pitch), -math.sin(roll) * math.cos(pitch)
    return _Tilt(attitude.t_ns, STANDARD_GRAVITY_M_S2 * fwd, STANDARD_GRAVITY_M_S2 * stb)
