"""How a fix is fused (GNSS aiding): what the receiver claims of it, what lasts in its error, its velocity."""

import math
from typing import Final, NamedTuple

import numpy as np

from common.units import NS_PER_S
from shore.navigation.measurements import Position, PseudoPart, PseudoScalar
from shore.navigation.motion_model import body_to_plane
from shore.navigation.noise.own_scatter import POSITION_PRIOR
from shore.navigation.numbers import Array, part
from shore.navigation.state_space import EAST, HEADING, NORTH, UNKNOWN_SPEED_M_S, V_EAST, V_NORTH, StateSpace
from shore.navigation.trust.axes import surprised
from shore.navigation.trust.marks import FixMark, HeadingBlock, onward
from shore.navigation.trust.memory import Engine, Regard, Vessel, error_places, heading_places, put, renew, white_of
from shore.navigation.trust.receiver import (
    SHARE_OF_SPEED,
    SLOW_M_S,
    SLOW_SIGMA_M_S,
    Receiver,
    guarded,
)
from shore.navigation.trust.turns import COURSE_FROM_M_S
from shore.navigation.trust.verdicts import after_mark

LEAST_LASTING: Final = 0.1**2
"""The lasting error is never held for less than this share of the variance that a receiver claims."""
VELOCITY_LASTS_S: Final = 1.0
"""Velocities that are nearer than this share their noise: receivers smooth."""
UNCLAIMED_M: Final = (1.0, 1.0)
"""1-sigma of a fix of which nothing is claimed."""
LINE_NS: Final = 6 * NS_PER_S
"""Fixes of this time make the line from which a filter begins again."""
LONG_LINE_NS, POOR_M2 = 10 * NS_PER_S, 9.0
"""The same of fixes whose white variance is beyond this, m^2."""
BENDS_M, BENDS_M_S = 0.3, 0.4
"""What a boat may be beside that line, m and m/s: it turns, or changes its speed."""


Pair = tuple[float, float]


class Velocity(NamedTuple):
    """A receiver's velocity, which has a variance of its own."""

    east_m_s: float
    north_m_s: float
    variance: float

    @property
    def parts(self) -> tuple[PseudoPart, ...]:
        """East, then north."""
        return self._east, self._north

    def _east(self, _space: StateSpace, x: Array) -> PseudoScalar:
        return PseudoScalar(x, ((V_EAST, 1.0),), self.east_m_s - part(x, V_EAST), self.variance)

    def _north(self, _space: StateSpace, x: Array) -> PseudoScalar:
        return PseudoScalar(x, ((V_NORTH, 1.0),), self.north_m_s - part(x, V_NORTH), self.variance)


def fuse_fix(boat: Vessel, engine: Engine, fix: Position) -> None:
    """Fuse a fix and its velocity, and judge the sensors by it."""
    name = fix.sensor
    receiver = _announced(engine, engine.trust.receivers.get(name) or Receiver(), fix)
    put(engine, name, receiver)
    claimed = receiver.claimed_m
    late_s = max(0.0, -receiver.latency_s)
    _, x, _ = engine.gaussian
    east_m, north_m = fix.east_m + late_s * float(x[V_EAST]), fix.north_m + late_s * float(x[V_NORTH])
    if not receiver.gives_velocity:
        _count_surprise(engine, fix)
    regards = [Regard(POSITION_PRIOR * each**2) for each in claimed]
    engine.fuse_parts(fix._replace(east_m=east_m, north_m=north_m), regards)
    previous = receiver.newest
    receiver = _with_lasting(engine, name, receiver.hears(fix))
    now = _mark(engine, receiver, fix)
    was_wrong = receiver.wrong_since_ns is not None
    receiver = receiver._replace(newest=now)
    white = white_of(engine, name)
    if now.velocity_m_s is not None and not engine.trust.is_provisional:
        receiver = guarded(receiver, now, white)
    put(engine, name, receiver)
    trust = engine.trust
    engine.remember(trust._replace(way=trust.way._replace(quiet_s=0.0)))
    if receiver.wrong_since_ns is not None and not was_wrong:
        from_fixes(boat, engine, name)
    if not engine.trust.is_provisional:
        fuse_velocity(engine, receiver, previous, now)
    after_mark(boat, engine, name, now, white)


def _count_surprise(engine: Engine, fix: Position) -> None:
    """Without a velocity, the innovations of the fix along the axes of the boat."""
    trust, (space, x, P) = engine.trust, engine.gaussian
    own = engine.scatter_of(f"{fix.sensor}.east"), engine.scatter_of(f"{fix.sensor}.north")
    if trust.is_provisional or own[0] is None or own[1] is None:
        return
    h = np.zeros((2, space.size))
    h[0, EAST] = h[1, NORTH] = 1.0
    for axis, error in enumerate(error_places(space, fix.sensor)):
        if error is not None:
            h[axis, error] = 1.0
    sin, cos = math.sin(float(x[HEADING])), math.cos(float(x[HEADING]))
    to_body = np.array([[sin, cos], [cos, -sin]])
    S = to_body @ (h @ P @ h.T + np.diag([own[0][0], own[1][0]])) @ to_body.T
    innovation = to_body @ (np.array([fix.east_m, fix.north_m]) - h @ x)
    forward, starboard = (innovation**2 / S.diagonal()).tolist()
    engine.remember(trust._replace(axes=surprised(trust.axes, (forward, starboard))))


def _announced(engine: Engine, receiver: Receiver, fix: Position) -> Receiver:
    """The receiver with what it says of a fix, before that is fused."""
    if receiver.quality != fix.quality and receiver.newest is not None:
        receiver = _other_quality(engine, receiver, fix)
    receiver = receiver._replace(quality=fix.quality, claimed_m=fix.claimed_m or UNCLAIMED_M)
    is_broken, last = receiver.is_broken_by(fix), receiver.newest
    receiver = receiver._replace(interval_ns=fix.t_ns - last.t_ns if last is not None else receiver.interval_ns)
    if is_broken:
        receiver = receiver._replace(marks=(), newest=None)
    return _with_lasting(engine, fix.sensor, receiver)


def _other_quality(engine: Engine, receiver: Receiver, fix: Position) -> Receiver:
    """The receiver says that its fixes are of another quality: what was learned of them is void."""
    engine.forget(fix.sensor)
    claimed = fix.claimed_m or UNCLAIMED_M
    lasting = tuple((1.0 - POSITION_PRIOR) * each**2 for each in claimed)
    space = engine.gaussian.space
    places = [place for place in error_places(space, fix.sensor) if place is not None]
    renew(engine, places, lasting[: len(places)])
    marks = receiver.marks if fix.velocity_m_s is not None else ()
    return receiver._replace(
        lasting_m2=(lasting[0], lasting[1]),
        marks=marks,
        judged_from_ns=fix.t_ns,
        latency_sums=receiver.latency_sums,
    )


def _mark(engine: Engine, receiver: Receiver, fix: Position) -> FixMark:
    trust, (space, x, P) = engine.trust, engine.gaussian
    places = heading_places(space)
    block = HeadingBlock(x[places], P[np.ix_(places, places)])
    course = _course(receiver, fix)
    if course is not None and receiver.newest is not None:
        course = onward(receiver.newest.course_rad, course)
    return FixMark(
        fix.t_ns,
        float(fix.east_m),
        float(fix.north_m),
        fix.velocity_m_s,
        receiver.way_to(fix),
        float(x[HEADING]),
        trust.tally,
        trust.compasses,
        block,
        course,
    )


def fuse_velocity(engine: Engine, receiver: Receiver, previous: FixMark | None, now: FixMark) -> None:
    """Fuse the velocity of the newest fix, unless it is set aside."""
    if now.velocity_m_s is None or not receiver.gives_velocity:
        return
    east, north = now.velocity_m_s
    speed = math.hypot(east, north)
    rate_hz, latency = 1.0, max(0.0, receiver.latency_s)
    if previous is not None and now.t_ns > previous.t_ns:
        rate_hz = NS_PER_S / (now.t_ns - previous.t_ns)
        if latency and previous.velocity_m_s is not None:
            east += latency * rate_hz * (now.velocity_m_s[0] - previous.velocity_m_s[0])
            north += latency * rate_hz * (now.velocity_m_s[1] - previous.velocity_m_s[1])
    sigma2 = (receiver.sigma_m_s**2 + (SHARE_OF_SPEED * speed) ** 2) * (1.0 + 2.0 * latency**2)
    if speed < SLOW_M_S:
        sigma2 = max(sigma2, SLOW_SIGMA_M_S**2)
    engine.fuse_known(Velocity(east, north, sigma2 * max(1.0, rate_hz * VELOCITY_LASTS_S)), has_tail=True)


def from_fixes(boat: Vessel, engine: Engine, name: str) -> None:
    """Position, velocity and lasting error begin again from the fixes: the velocity was wrong."""
    space, x, _ = engine.gaussian
    receiver = engine.trust.receivers[name]
    now = receiver.newest
    assert now is not None
    white = white_of(engine, name)
    (east, north), (v_east, v_north), (variance, v_variance) = _line(receiver, now, white)
    fresh = x.copy()
    lever = boat.levers.get(name)
    at_east, at_north = body_to_plane(*(lever or (0.0, 0.0)), float(x[HEADING]))
    fresh[[EAST, NORTH, V_EAST, V_NORTH]] = east - at_east, north - at_north, v_east, v_north
    F = np.eye(space.size)
    Q = np.zeros_like(F)
    for place in (EAST, NORTH, V_EAST, V_NORTH):
        F[place] = 0.0
    Q[V_EAST, V_EAST] = Q[V_NORTH, V_NORTH] = v_variance
    for axis, error in zip((EAST, NORTH), error_places(space, name), strict=True):
        lasting = receiver.lasting_m2[axis]
        Q[axis, axis] = variance + lasting
        if error is not None:
            F[error] = 0.0
            fresh[error] = 0.0
            Q[error, error] = lasting
            Q[axis, error] = Q[error, axis] = -lasting
    engine.recast(fresh, F, Q)


def _line(receiver: Receiver, now: FixMark, white: float) -> tuple[Pair, Pair, Pair]:
    """Place and velocity at the newest fix by a straight line through the last ones; their variances on one axis."""
    since_ns = now.t_ns - (LINE_NS if white < POOR_M2 else LONG_LINE_NS)
    fitted = [*(mark for mark in receiver.marks[-12:] if since_ns <= mark.t_ns < now.t_ns), now]
    if len(fitted) < 3:
        return (now.east_m, now.north_m), (0.0, 0.0), (white, UNKNOWN_SPEED_M_S**2)
    rows = np.array([(1.0, (mark.t_ns - now.t_ns) / NS_PER_S) for mark in fitted])
    places = np.array([(mark.east_m, mark.north_m) for mark in fitted])
    spread = np.linalg.inv(rows.T @ rows)
    (east, north), (v_east, v_north) = (spread @ rows.T @ places).tolist()
    # a boat that turns or changes its speed is not on the line
    variance, v_variance = white * float(spread[0, 0]) + BENDS_M**2, white * float(spread[1, 1]) + BENDS_M_S**2
    return (east, north), (v_east, v_north), (variance, v_variance)


def _with_lasting(engine: Engine, name: str, receiver: Receiver) -> Receiver:
    """What the receiver claims in all, less its white scatter, lasts."""
    velocity = receiver.newest.velocity_m_s if receiver.newest else None
    late_m2 = 0.5 * (receiver.latency_sigma_s * math.hypot(*velocity)) ** 2 if velocity else 0.0
    lasting = []
    for axis, claimed in zip(("east", "north"), receiver.claimed_m, strict=True):
        own = engine.scatter_of(f"{name}.{axis}")
        white = own[0] if own is not None else POSITION_PRIOR * claimed**2
        lasting.append(max(claimed**2 - white, LEAST_LASTING * claimed**2) + late_m2)
    return receiver._replace(lasting_m2=(lasting[0], lasting[1]))


def _course(receiver: Receiver, fix: Position) -> float | None:
    """Course over ground of a fix; `None` = too slow."""
    if fix.velocity_m_s is None or receiver.is_held or receiver.wrong_since_ns is not None:
        return None
    return math.atan2(*fix.velocity_m_s) if math.hypot(*fix.velocity_m_s) > COURSE_FROM_M_S else None
