"""Angle arithmetic: the only place where angles are wrapped or subtracted.

Headings run clockwise from true north: [0, 360) at interfaces, (-pi, pi] inside calculations.
A bare `a - b` on two angles anywhere else is a bug.
"""

import math


def wrap_rad(angle_rad: float) -> float:
    """The same direction in (-pi, pi]."""
    wrapped = math.remainder(angle_rad, math.tau)
    return math.pi if wrapped <= -math.pi else wrapped


def wrap_deg(angle_deg: float) -> float:
    """The same direction in [0, 360)."""
    wrapped = angle_deg % 360.0
    # A tiny negative angle rounds up to 360.0 itself in floating point.
    return 0.0 if wrapped >= 360.0 else wrapped


def difference_rad(a_rad: float, b_rad: float) -> float:
    """Difference a - b the short way round, in (-pi, pi]; positive = a lies clockwise of b."""
    return wrap_rad(a_rad - b_rad)


def difference_deg(a_deg: float, b_deg: float) -> float:
    """Difference a - b the short way round, in (-180, 180]; positive = a lies clockwise of b."""
    wrapped = math.remainder(a_deg - b_deg, 360.0)
    return 180.0 if wrapped <= -180.0 else wrapped


def heading_rad(heading_deg: float) -> float:
    """Interface heading (deg) -> calculation heading (rad, (-pi, pi])."""
    return wrap_rad(math.radians(heading_deg))


def heading_deg(heading_rad: float) -> float:
    """Calculation heading (rad) -> interface heading (deg, [0, 360))."""
    return wrap_deg(math.degrees(heading_rad))
