"""Initialisation: the first state of a filter, x and P, from the first position and heading."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from common.units import NS_PER_S
from shore.navigation.measurements import FirstHeading, Position
from shore.navigation.motion_model import FREE_NOISE, ImuInput, body_to_plane
from shore.navigation.numbers import Array, Number
from shore.navigation.sensor_facts import FilterFacts
from shore.navigation.state_space import EAST, HEADING, NORTH, UNKNOWN_SPEED_M_S, wrong_together, wrong_with_compass

UNKNOWN_HEADING_RAD: Final = math.pi / math.sqrt(3.0)
"""1-sigma of a heading of which nothing is known: all directions are alike."""
KNOWN_SPEED_M_S: Final = 0.5
"""1-sigma of each velocity taken from SOG and COG."""


def first_state(
    t_ns: int, position: Position, heading: FirstHeading | None, facts: FilterFacts, shown: ImuInput | None = None
) -> tuple[Array, Array, dict[int, str]]:
    """State (n,) and covariance (n, n) at `t_ns`, not before either measurement, and what was read from which channel.

    Extra states begin at their priors. The place is that of the boat's reference point: what the antenna's lever makes
    of an error of the heading is in P. The older of the two is carried forward: the position with its velocity, the
    heading as a random walk. Without a heading nothing is known of it. `shown`: mean of the IMU just before; all of
    its acceleration may be bias, so the doubt of the biases is widened by it. A unit that is mounted 10 deg off level
    is then found instead of believed.
    """
    age_s = (t_ns - position.t_ns) / NS_PER_S
    velocity = position.velocity_m_s if position.is_moving else None
    v_east, v_north = velocity or (0.0, 0.0)
    speed_sigma = KNOWN_SPEED_M_S if velocity else UNKNOWN_SPEED_M_S
    place = (position.east_m + v_east * age_s, position.north_m + v_north * age_s)
    drift = (speed_sigma * age_s) ** 2
    psi, heading_variance = (0.0, UNKNOWN_HEADING_RAD**2) if heading is None else _heading_of(t_ns, heading, facts)
    base_variances = (
        facts.channels[f"{position.sensor}.east"].initial_variance + drift,
        facts.channels[f"{position.sensor}.north"].initial_variance + drift,
        speed_sigma**2,
        speed_sigma**2,
        heading_variance,
    )
    read_from = {EAST: f"{position.sensor}.east", NORTH: f"{position.sensor}.north"}
    if heading is not None:
        read_from[HEADING] = heading.channel
    compass = heading.sensor if heading is not None else ""
    x, P = first_of(facts, (*place, v_east, v_north, psi), base_variances, gps=position.sensor, compass=compass)
    if lever := facts.levers.get(position.sensor):
        x, P = _from_antenna(x, P, lever)
    if shown is not None:
        for bias, accel in zip(facts.space.places[1:3], shown[:2], strict=True):
            if bias is not None:
                P[bias, bias] += accel * accel
    return x, P, read_from


def _heading_of(t_ns: int, heading: FirstHeading, facts: FilterFacts) -> tuple[Number, float]:
    """The first heading and its variance at `t_ns`: since it was measured it is a random walk."""
    age_s = (t_ns - heading.t_ns) / NS_PER_S
    wandered = float(FREE_NOISE.yaw_rate) ** 2 * age_s
    return heading.heading_rad, facts.channels[heading.channel].initial_variance + wandered


def first_of(
    facts: FilterFacts, base: Sequence[Number], base_variances: Sequence[float], *, gps: str = "", compass: str = ""
) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n): the thesis' five as given, the extra states at their priors.

    gps, compass: sensors that the place and the heading were read from; they are wrong together with the errors of
    these sensors that are states.
    """
    space = facts.space
    x = np.array([*base, *[0.0] * len(space.extras)])
    P = np.diag(np.array([*base_variances, *(extra.sigma**2 for extra in space.extras)]))
    for place, axis in ((EAST, "east"), (NORTH, "north")):
        wrong_together(space, P, place, f"{gps}_error_{axis}_m", 1.0)
    wrong_with_compass(space, P, compass, base[HEADING])
    return x, P


def _from_antenna(x: Array, P: Array, lever: tuple[float, float]) -> tuple[Array, Array]:
    """The state at the reference point, of one at an antenna (forward, starboard) of it, m.

    Place and heading are wrong together; that covariance is left out, because the opening of a filter exchanges the
    heading's variance alone when it learns R, and P must stay positive then.
    """
    east_m, north_m = body_to_plane(*lever, x[HEADING])
    moved, spread = x.copy(), P.copy()
    moved[EAST] -= east_m
    moved[NORTH] -= north_m
    # the derivative of (east, north) by a clockwise heading is (north, -east)
    slope = np.array([-north_m, east_m])
    spread[EAST : NORTH + 1, EAST : NORTH + 1] += P[HEADING, HEADING] * np.outer(slope, slope)
    return moved, spread
