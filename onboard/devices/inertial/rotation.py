"""The direction cosine matrix of an ArduIMU (keys EX0..EX8) as roll, pitch and yaw.

Earth axes north, east, down; body axes forward, starboard, down. The matrix R turns body components into earth ones,
`v_earth = R v_body`; EX0..EX8 are its elements row by row, R00 R01 R02 R10 ... R22, as integers of 1e-7.
With yaw psi (clockwise from above), pitch theta (bow up), roll phi (starboard down) and R = Rz(psi) Ry(theta) Rx(phi):

    R20 = -sin(theta)    R21 = cos(theta) sin(phi)    R22 = cos(theta) cos(phi)
    R00 = cos(theta) cos(psi)    R10 = cos(theta) sin(psi)

so theta = -asin(R20), phi = atan2(R21, R22), psi = atan2(R10, R00): the formulae of the firmware (1.9.7, Euler_angles).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

UNITS_PER_ONE: Final = 1e7
LARGEST_ELEMENT: Final = 10_010_000.0
"""Largest element of a matrix as sent (1e-7): a cosine is at most 1, the firmware's renormalisation leaves 1e-3 at
worst."""
_TOLERANCE: Final = 0.01
"""Largest error of a row's length and of the cosine between two rows: ten times what renormalisation leaves, and less
than what a lost digit or sign does to an element that matters."""
_UPRIGHT: Final = 1e-3
"""Limit of cos(pitch) below which roll and yaw cannot be distinguished."""


@dataclass(frozen=True, slots=True)
class Angles:
    """Attitude in degrees; roll and yaw are `None` where the bow points straight up or down."""

    roll_deg: float | None
    pitch_deg: float | None
    yaw_deg: float | None


def angles(elements: Sequence[float]) -> Angles | None:
    """Attitude of nine elements as sent (1e-7); `None` = they are no rotation matrix."""
    rows = [[element / UNITS_PER_ONE for element in elements[start : start + 3]] for start in (0, 3, 6)]
    if not _is_rotation(rows):
        return None
    pitch_deg = -math.degrees(math.asin(max(-1.0, min(1.0, rows[2][0]))))
    if math.hypot(rows[0][0], rows[1][0]) < _UPRIGHT:
        return Angles(None, pitch_deg, None)
    return Angles(
        roll_deg=math.degrees(math.atan2(rows[2][1], rows[2][2])),
        pitch_deg=pitch_deg,
        yaw_deg=math.degrees(math.atan2(rows[1][0], rows[0][0])),
    )


def _is_rotation(rows: Sequence[Sequence[float]]) -> bool:
    """R R^T = 1, and right-handed: the third row is the cross product of the first two, not its opposite."""
    for first in range(3):
        for second in range(first, 3):
            wanted = 1.0 if first == second else 0.0
            if abs(_dot(rows[first], rows[second]) - wanted) > _TOLERANCE:
                return False
    a, b, c = rows
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    return _dot(cross, c) > 0.0


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return sum(x * y for x, y in zip(a, b, strict=True))
