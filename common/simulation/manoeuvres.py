"""Ground truth without a helm (kinematic models): constant velocity and coordinated turns (Scenarios 4.1 and 4.2).

The state of Eq. 4.35 is x = [px, py, vx, vy] (m, m/s; east, north). x(1) of the thesis is t = 0 here.
"""

import math
from dataclasses import dataclass

import numpy as np

from common.simulation.motion import Array, Place, Truth


def constant_velocity(step_s: float) -> Array:
    """F of the Constant Velocity Model, Eq. 4.36, shape (4, 4)."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = step_s
    return F


def coordinated_turn(yaw_rate_rad_s: float, step_s: float) -> Array:
    """F of the Coordinated Turn Model, Eq. 4.40, shape (4, 4); a positive yaw rate is clockwise (bow to starboard).

    As printed, Eq. 4.40 turns the velocity anticlockwise for w > 0 while Eq. 4.41 lets the clockwise heading grow. One
    of them must change its sign: here w of Eq. 4.40 is minus the yaw rate and the heading follows Eq. 4.41.
    """
    w = -yaw_rate_rad_s
    if w == 0.0:
        return constant_velocity(step_s)
    sin, cos = math.sin(w * step_s), math.cos(w * step_s)
    return np.array(
        [
            [1.0, 0.0, sin / w, -(1.0 - cos) / w],
            [0.0, 1.0, (1.0 - cos) / w, sin / w],
            [0.0, 0.0, cos, -sin],
            [0.0, 0.0, sin, cos],
        ]
    )


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn of constant rate, positive clockwise, from one time to another."""

    from_s: float
    until_s: float
    rate_deg_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Manoeuvres:
    """A programme over ground: constant velocity, but for the turns. A speed of 0 is a moored boat."""

    start: Place
    heading_deg: float
    duration_s: float
    speed_m_s: float = 1.0
    turns: tuple[Turn, ...] = ()


def follow(programme: Manoeuvres, step_s: float = 0.05) -> Truth:
    """The programme step by step: each row is F times the one before, so positions lie on the exact arc."""
    heading = math.radians(programme.heading_deg)
    speed = programme.speed_m_s
    state = np.array([*programme.start, speed * math.sin(heading), speed * math.cos(heading)])
    rows = [(*state, heading)]
    for step in range(round(programme.duration_s / step_s)):
        middle_s = (step + 0.5) * step_s
        rate = math.radians(sum(turn.rate_deg_s for turn in programme.turns if turn.from_s < middle_s < turn.until_s))
        state = coordinated_turn(rate, step_s) @ state
        heading += rate * step_s  # Eq. 4.41; Eq. 4.37 on a straight line
        rows.append((*state, heading))
    columns = np.array(rows, dtype=np.float64).T
    return Truth(np.round(np.arange(len(rows)) * step_s, 9), *columns)
