"""The honest start (initialisation): once the noise of the sensors is known, a filter starts once more with it."""

from typing import Final

import numpy as np

from common.units import NS_PER_S
from shore.navigation.noise.own_scatter import PRIOR_WEIGHT
from shore.navigation.numbers import wrapped
from shore.navigation.state_space import HEADING, wrong_with_compass
from shore.navigation.trust.fixes import from_fixes, fuse_velocity
from shore.navigation.trust.memory import Engine, Vessel, compass_sigma

RIPE: Final = PRIOR_WEIGHT + 5.5
"""Weight of a scatter after six differences: from then on the noise of a sensor is known."""
LONGEST_NS: Final = 10 * NS_PER_S
"""A start waits no longer for the noise of its sensors."""


def start_again_when_due(boat: Vessel, engine: Engine, gps: str) -> None:
    """After a fix of a receiver: start once more if the noise is known, or has been waited for long enough."""
    trust = engine.trust
    if not trust.is_provisional:
        return
    receiver = trust.receivers[gps]
    assert trust.started_ns is not None
    assert receiver.newest is not None
    channels = [f"{gps}.east", f"{gps}.north", *(f"{each}.heading" for each in trust.compasses)]
    known = [engine.scatter_of(channel) for channel in channels]
    is_ripe = all(each is not None and each[1] >= RIPE for each in known)
    if not is_ripe and receiver.newest.t_ns - trust.started_ns < LONGEST_NS:
        return
    space, first = trust.first.space, trust.first
    x, P = first.x.copy(), first.P.copy()
    x[HEADING], P[HEADING, :], P[:, HEADING] = engine.gaussian.x[HEADING], 0.0, 0.0
    P[HEADING, HEADING] = first.P[HEADING, HEADING]
    newest = max(trust.compasses.items(), key=lambda item: item[1].t_ns, default=None)
    if newest is not None:
        compass, turned = newest
        heading = float(wrapped(turned.heading_rad + trust.tally.turned_rad - turned.by_gyro_rad))
        x[HEADING], P[HEADING, HEADING] = heading, compass_sigma(engine, compass) ** 2
        wrong_with_compass(space, P, compass, heading)
    engine.remember(trust._replace(is_provisional=False))
    engine.recast(x, np.zeros_like(P), P)
    from_fixes(boat, engine, gps)
    fuse_velocity(engine, receiver, None, receiver.newest)
