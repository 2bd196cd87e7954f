"""Initial alignment: position, heading and the biases of the IMU. Until all are known, not all of an estimate is valid.

A boat without compass, or below the speed at which a course shows its heading, has a valid position all the same.
A heading once known is lost again above its limit; biases are awaited once and stay known (a latch, no hysteresis).
"""

import math
from typing import Final

from shore.navigation.filters import FilterState
from shore.navigation.measurements import FirstHeading, Position
from shore.navigation.motion_model import speed_ahead
from shore.navigation.state_space import HEADING
from shore.navigation.tilt_leak import lift

HEADING_KNOWN_DEG: Final = 10.0
"""Below this 1-sigma the heading counts as known; beyond it, it is lost again."""
TURN_KNOWN_DEG_S: Final = 0.3
"""1-sigma of the gyro's bias from which on it counts as settled: 3 deg in ten seconds without compass."""
ACCEL_KNOWN_M_S2: Final = 0.1
"""1-sigma of an accelerometer's bias from which on it counts as settled: 5 m in ten seconds without GPS."""

SILENT_AFTER_S: Final = 3.0
"""The biases of an inertial unit that has been silent for this time are not waited for."""

NOISE: Final = "noise of the sensors"
"""What is waited for before anything is valid; the rest is about the heading, and how long it holds without sensors."""

Waiting = tuple[str, ...]
"""What is not known yet, in words for people; empty = the whole estimate is valid."""


def before_start(position: Position | None, heading: FirstHeading | None, has_compass: bool) -> Waiting:
    """What a filter lacks to be started."""
    # A boat without compass takes its first heading from the course over ground.
    heading_words = "heading" if has_compass else "heading (2 kn or more: no compass)"
    return tuple(words for found, words in ((position, "position"), (heading, heading_words)) if found is None)


def aligned_parts(waiting: Waiting) -> tuple[str, ...]:
    """The parts of a started filter's estimate that are valid: `position` (with the velocity), `heading`."""
    if NOISE in waiting:
        return ()
    return ("position",) if waiting else ("position", "heading")


class Alignment:
    """Follows one filter. Biases are awaited once: later their doubt rises and falls with the boat's motion."""

    def __init__(self) -> None:
        self._is_settled = False

    def waiting(self, state: FilterState) -> Waiting:
        """What the estimate of a started filter still lacks."""
        is_measured = state.trust is None or not state.trust.is_provisional
        is_settled = self._is_settled or _biases_are_settled(state)
        self._is_settled = is_measured and is_settled
        is_known = math.sqrt(state.P[HEADING, HEADING]) < math.radians(HEADING_KNOWN_DEG)
        stages = (is_measured, NOISE), (is_known, "heading"), (is_settled, "IMU biases")
        return tuple(words for is_passed, words in stages if not is_passed)

    def begin_again(self) -> None:
        """The filter was reset."""
        self._is_settled = False


def _biases_are_settled(state: FilterState) -> bool:
    """The doubt of what the biases add up to at this speed: at a steady one bias and tilt leak look the same."""
    space, x, P = state.space, state.x, state.P
    gyro, fwd, stb, leak = space.places[:4]
    if state.trust is not None:  # what is set aside is not waited for
        axes, turns = state.trust.axes, state.trust.turns
        if state.trust.way.blind_s > SILENT_AFTER_S:
            return True
        fwd, leak = (None, None) if axes[0].is_off else (fwd, leak)
        stb = None if axes[1].is_off else stb
        gyro = None if turns.gyro_wrong_since_ns is not None else gyro
    weights = ((fwd, 1.0), (leak, float(lift(speed_ahead(space, x)))))
    forward = {place: weight for place, weight in weights if place is not None}
    fwd_variance = sum(a * b * float(P[i, j]) for i, a in forward.items() for j, b in forward.items())
    return (
        fwd_variance < ACCEL_KNOWN_M_S2**2
        and (stb is None or float(P[stb, stb]) < ACCEL_KNOWN_M_S2**2)
        and (gyro is None or float(P[gyro, gyro]) < math.radians(TURN_KNOWN_DEG_S) ** 2)
    )
