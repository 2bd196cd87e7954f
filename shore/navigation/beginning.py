"""The first state of a filter, from the first position and heading."""

from typing import Final

import numpy as np

from common.units import NS_PER_S
from shore.navigation.filters import FilterFacts
from shore.navigation.measurements import Position, TrueHeading
from shore.navigation.models import FREE_NOISE, Array

UNKNOWN_SPEED_M_S: Final = 1.5
"""1-sigma of each velocity when the receiver gives none: a small craft at low speed."""
KNOWN_SPEED_M_S: Final = 0.5
"""1-sigma of each velocity taken from SOG and COG."""


def first_state(t_ns: int, position: Position, heading: TrueHeading, facts: FilterFacts) -> tuple[Array, Array]:
    """State (5,) and covariance (5, 5) at `t_ns`, not before either measurement.

    The older of the two is carried forward: the position with its velocity, the heading as a random walk.
    """
    age_s = (t_ns - position.t_ns) / NS_PER_S
    v_east, v_north = position.velocity_m_s or (0.0, 0.0)
    speed_sigma = KNOWN_SPEED_M_S if position.velocity_m_s else UNKNOWN_SPEED_M_S
    place = (position.east_m + v_east * age_s, position.north_m + v_north * age_s)
    drift = (speed_sigma * age_s) ** 2
    heading_age_s = (t_ns - heading.t_ns) / NS_PER_S
    component = "heading" if f"{heading.sensor}.heading" in facts.channels else "course"
    variances = [
        facts.channels[f"{position.sensor}.east"].initial_variance + drift,
        facts.channels[f"{position.sensor}.north"].initial_variance + drift,
        speed_sigma**2,
        speed_sigma**2,
        facts.channels[f"{heading.sensor}.{component}"].initial_variance
        + float(FREE_NOISE.yaw_rate) ** 2 * heading_age_s,
    ]
    return np.array([*place, v_east, v_north, heading.heading_rad]), np.diag(np.array(variances))


def missing(position: Position | None, heading: TrueHeading | None, has_compass: bool) -> str:
    """What a start still waits for, in words."""
    heading_words = "a heading" if has_compass else f"a course over ground (no compass, {_COURSE_WORDS})"
    return " and ".join(words for found, words in ((position, "a GPS fix"), (heading, heading_words)) if found is None)


_COURSE_WORDS: Final = "2 kn or more"
