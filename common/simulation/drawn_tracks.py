"""Random mission profiles (manoeuvre programmes): legs, turns, circles, slaloms, stops, going astern, drifting.

A seed draws the programme, so that no track is learned by heart. A longer programme begins with the shorter one.
"""

from dataclasses import dataclass, field

import numpy as np

from common.simulation.hull import STEP_S, Commands

Step = tuple[float, float, float]
"""How long (s), way asked for (m/s), turn asked for (deg/s, + clockwise)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Habits:
    """How the boats of a scenario are driven."""

    speed_m_s: tuple[float, float]
    turn_deg_s: tuple[float, float]
    """Turn rates are drawn in here, small ones as often as large ones on a logarithmic scale; either side."""
    leg_s: tuple[float, float] = (15.0, 90.0)
    weights: dict[str, float] = field(default_factory=lambda: {"turn": 6.0, "circle": 1.0, "slalom": 1.0})
    """How often each manoeuvre comes between two legs: turn, circle, slalom, stop, astern, drift."""


def programme(rng: np.random.Generator, habits: Habits, count: int) -> Commands:
    """Commands for `count` steps of `STEP_S`: a leg, a manoeuvre, a leg, and so on."""
    kinds = list(habits.weights)
    chances = np.array([habits.weights[kind] for kind in kinds])
    chances /= chances.sum()
    steps: list[Step] = []
    left = count * STEP_S
    while left > -STEP_S:
        speed = rng.uniform(*habits.speed_m_s)
        kind = kinds[int(rng.choice(len(kinds), p=chances))]
        more = [(rng.uniform(*habits.leg_s), speed, 0.0), *_manoeuvre(rng, habits, kind, speed)]
        steps += more
        left -= sum(step[0] for step in more)
    seconds, way, turn = np.array(steps).T
    rows = np.repeat(np.arange(len(seconds)), np.maximum(1, np.round(seconds / STEP_S)).astype(int))[:count]
    return Commands(way[rows], np.radians(turn[rows]))


def _manoeuvre(rng: np.random.Generator, habits: Habits, kind: str, speed: float) -> list[Step]:
    slow, fast = np.log(habits.turn_deg_s)
    rate = float(np.exp(rng.uniform(slow, fast))) * float(rng.choice((-1.0, 1.0)))
    match kind:
        case "turn":
            return [(rng.uniform(20.0, 180.0) / abs(rate), speed, rate)]
        case "circle":
            return [(rng.uniform(360.0, 720.0) / abs(rate), speed, rate)]
        case "slalom":
            angle = rng.uniform(30.0, 90.0) / abs(rate)
            return [(angle, speed, rate * (-1.0) ** k) for k in range(int(rng.integers(3, 7)))]
        case "stop":
            return [(rng.uniform(10.0, 40.0), 0.0, 0.0)]
        case "astern":
            back = -min(speed, rng.uniform(0.3, 0.8))
            return [(rng.uniform(3.0, 6.0), 0.0, 0.0), (rng.uniform(8.0, 25.0), back, 0.3 * rate)]
        case "drift":
            return [(rng.uniform(40.0, 120.0), 0.0, rng.uniform(-0.5, 0.5))]
    raise AssertionError(kind)
