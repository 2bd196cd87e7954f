"""The first state of a filter, from the first position and heading."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from common.units import NS_PER_S
from shore.navigation.filters import FilterFacts
from shore.navigation.measurements import Course, Position, TrueHeading
from shore.navigation.models import FREE_NOISE, HEADING
from shore.navigation.numbers import Array, Number

UNKNOWN_SPEED_M_S: Final = 1.5
"""1-sigma of each velocity when the receiver gives none: a small craft at low speed."""
KNOWN_SPEED_M_S: Final = 0.5
"""1-sigma of each velocity taken from SOG and COG."""


def first_state(
    t_ns: int, position: Position, heading: TrueHeading | Course, facts: FilterFacts
) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n) at `t_ns`, not before either measurement; extra states begin at their priors.

    The older of the two is carried forward: the position with its velocity, the heading as a random walk.
    """
    age_s = (t_ns - position.t_ns) / NS_PER_S
    v_east, v_north = position.velocity_m_s or (0.0, 0.0)
    speed_sigma = KNOWN_SPEED_M_S if position.velocity_m_s else UNKNOWN_SPEED_M_S
    place = (position.east_m + v_east * age_s, position.north_m + v_north * age_s)
    drift = (speed_sigma * age_s) ** 2
    channel, angle = _angle(heading)
    heading_age_s = (t_ns - heading.t_ns) / NS_PER_S
    base_variances = (
        facts.channels[f"{position.sensor}.east"].initial_variance + drift,
        facts.channels[f"{position.sensor}.north"].initial_variance + drift,
        speed_sigma**2,
        speed_sigma**2,
        facts.channels[channel].initial_variance + float(FREE_NOISE.yaw_rate) ** 2 * heading_age_s,
    )
    return first_of(facts, (*place, v_east, v_north, angle), base_variances)


def first_of(facts: FilterFacts, base: Sequence[Number], base_variances: Sequence[float]) -> tuple[Array, Array]:
    """State (n,) and covariance (n, n): the thesis' five as given, the extra states at their priors."""
    extras = facts.space.extras
    x = np.array([*base, *[0.0] * len(extras)])
    P = np.diag(np.array([*base_variances, *(extra.sigma**2 for extra in extras)]))
    bias = facts.space.index("compass_bias_rad")
    if bias is not None:  # what the compass showed is heading + bias
        P[HEADING, HEADING] += P[bias, bias]
        P[HEADING, bias] = P[bias, HEADING] = -P[bias, bias]
    return x, P


def _angle(heading: TrueHeading | Course) -> tuple[str, Number]:
    """Channel and angle of what gives the first heading."""
    if isinstance(heading, TrueHeading):
        return f"{heading.sensor}.heading", heading.heading_rad
    return f"{heading.sensor}.course", heading.course_rad


def missing(position: Position | None, heading: TrueHeading | Course | None, has_compass: bool) -> str:
    """What a start still waits for, in words."""
    heading_words = "a heading" if has_compass else f"a course over ground (no compass, {_COURSE_WORDS})"
    return " and ".join(words for found, words in ((position, "a GPS fix"), (heading, heading_words)) if found is None)


_COURSE_WORDS: Final = "2 kn or more"
