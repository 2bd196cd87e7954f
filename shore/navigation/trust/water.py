"""The water around a real boat (no-sideslip constraint): speed athwart, the way, a heading from the course."""

import math
from typing import Final

import numpy as np

from shore.navigation.motion_model import speed_ahead
from shore.navigation.sailing import Sailing
from shore.navigation.state_space import HEADING, V_EAST, V_NORTH
from shore.navigation.trust.memory import Engine, Vessel
from shore.navigation.trust.turns import COURSE_FROM_M_S

DOUBTFUL_RAD: Final = math.radians(45.0)
"""Nothing is known of the water while the heading is doubtful by more."""
LEEWAY_S: Final = 60.0
"""Time for which wind and waves push to the same side, s."""
SURGE_S: Final = 15.0
"""Time for which a boat is faster or slower than its way, s: turns."""
SLIDE: Final = 2.0
"""Speed athwart in a turn, over speed x yaw rate, s."""
WAY_MEMORY_S: Final = 200.0
LEAST_SURGE_M_S: Final = 0.05
EVERY_S: Final = 1.0 - 1e-6
"""Ten steps of 0.1 s are a second, whatever their rounding."""
QUIET_S: Final = 3.0
"""Without a fix for this time, nothing is learned of how the boat keeps its way."""
LEAST_SPEED_M_S: Final = 0.5
COURSE_DOUBT_RAD: Final = 0.15
"""Doubt of a heading that is taken from the course, beside the current's: leeway, a boat that sheers."""


def known_water(boat: Vessel, engine: Engine, dt_s: float) -> None:
    """No speed athwart through the water, and the way that the thrust keeps up."""
    trust, (space, x, P) = engine.trust, engine.gaussian
    way = trust.way._replace(pending_s=0.0)
    doubt = float(P[HEADING, HEADING])
    if boat.leeway_m_s <= 0.0 or doubt > DOUBTFUL_RAD**2 or trust.is_provisional:
        engine.remember(trust._replace(way=way))
        return
    speed = float(speed_ahead(space, x))
    place = space.index("way_m_s")
    if place is not None and way.quiet_s < QUIET_S:
        share = min(1.0, dt_s / WAY_MEMORY_S)
        square = way.square + share * ((speed - float(x[place])) ** 2 - way.square)
        way = way._replace(square=max(square, LEAST_SURGE_M_S**2))
    slide = SLIDE * speed
    rate, slow = way.turn_rad_s, way.slow_turn_rad_s
    pushed = boat.leeway_m_s**2 + (slide * rate) ** 2 + (slide * slow) ** 2
    athwart = 2.0 * LEEWAY_S * pushed / dt_s + 0.5 * speed**2 * doubt
    along = 2.0 * SURGE_S * way.square / dt_s
    engine.remember(trust._replace(way=way))
    engine.fuse_known(Sailing(athwart, along))


def heading_from_course(boat: Vessel, engine: Engine) -> None:
    """Without a known heading the boat goes where its bow points, less the current."""
    space, x, P = engine.gaussian
    trust = engine.trust
    is_unseen = not trust.compasses and trust.way.blind_s > QUIET_S
    is_known = float(P[HEADING, HEADING]) <= DOUBTFUL_RAD**2 and not is_unseen
    if is_known or boat.leeway_m_s <= 0.0:
        return
    sigma_v = math.sqrt(max(float(P[V_EAST, V_EAST]), float(P[V_NORTH, V_NORTH])))
    current_east, current_north = space.places[5:7]
    v_east, v_north = float(x[V_EAST]), float(x[V_NORTH])
    if current_east is not None and current_north is not None:
        v_east, v_north = v_east - float(x[current_east]), v_north - float(x[current_north])
    speed = math.hypot(v_east, v_north)
    if math.hypot(float(x[V_EAST]), float(x[V_NORTH])) < max(COURSE_FROM_M_S, 4.0 * sigma_v) or speed < LEAST_SPEED_M_S:
        return
    heading = math.atan2(v_east, v_north)
    sin, cos = math.sin(heading), math.cos(heading)
    fresh, F, Q = x.copy(), np.eye(space.size), np.zeros((space.size, space.size))
    fresh[HEADING] = heading
    F[HEADING] = 0.0
    F[HEADING, V_EAST], F[HEADING, V_NORTH] = cos / speed, -sin / speed
    if current_east is not None and current_north is not None:
        F[HEADING, current_east], F[HEADING, current_north] = -cos / speed, sin / speed
    Q[HEADING, HEADING] = COURSE_DOUBT_RAD**2 + (boat.leeway_m_s / speed) ** 2
    engine.recast(fresh, F, Q)
