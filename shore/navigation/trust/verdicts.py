"""Verdicts once a second (fault isolation): axes of the IMU, gyro and compasses are set aside or taken back."""

import math

import numpy as np

from common.units import NS_PER_S
from shore.navigation.numbers import wrapped
from shore.navigation.state_space import HEADING, wrong_with_compass
from shore.navigation.trust.axes import judged
from shore.navigation.trust.marks import FixMark, append
from shore.navigation.trust.memory import (
    Engine,
    Trust,
    Vessel,
    compass_places,
    compass_sigma,
    heading_places,
    put,
    to_prior,
)
from shore.navigation.trust.receiver import SLOW_M_S, Receiver, timed
from shore.navigation.trust.turns import COURSE_FROM_M_S, LARGEST_COURSE_SIGMA_RAD, Turns, Witnesses, looked_at
from shore.navigation.trust.water import heading_from_course


def after_mark(boat: Vessel, engine: Engine, name: str, now: FixMark, white: float) -> None:
    """Once a second: axes, turns, latency; by the first receiver that delivers."""
    receiver = engine.trust.receivers[name]
    marks = append(receiver.marks, now)
    if marks is receiver.marks:
        return
    leads = _leader(engine.trust, now.t_ns) == name
    if leads:
        _judge_axes(engine, receiver, now, white)
        _judge_turns(engine, receiver, now)
    receiver = engine.trust.receivers[name]
    if receiver.gives_velocity and math.hypot(*(now.velocity_m_s or (0.0, 0.0))) > SLOW_M_S:
        receiver = timed(receiver, now, white)
    put(engine, name, receiver._replace(marks=marks))
    heading_from_course(boat, engine)


def _judge_axes(engine: Engine, receiver: Receiver, now: FixMark, white: float) -> None:
    trust, space = engine.trust, engine.gaussian.space
    seen = now if receiver.gives_velocity else now._replace(velocity_m_s=None)
    axes = judged(trust.axes, receiver.marks, seen, sigma_m_s=receiver.sigma_m_s, white_m2=white)
    for k, (old, new) in enumerate(zip(trust.axes, axes, strict=True)):
        if new.is_off and not old.is_off:
            places = space.places[k + 1], space.places[k + 3]
            to_prior(engine, trust.first, [place for place in places if place is not None])
    engine.remember(engine.trust._replace(axes=axes))


def _judge_turns(engine: Engine, receiver: Receiver, now: FixMark) -> None:
    trust, (space, _, P) = engine.trust, engine.gaussian
    if trust.is_provisional:
        return
    gyro = space.places[0]
    sigmas = {name: compass_sigma(engine, name) for name in now.turns}
    gyro_sigma = math.sqrt(float(P[gyro, gyro])) if gyro is not None else 0.0
    noise = Witnesses(sigmas, gyro_sigma, _course_sigma(receiver), trust.waves.gyro_rad_s)
    found = looked_at(trust.turns, receiver.marks, now, noise)
    engine.remember(trust._replace(turns=found.turns))
    for name, doubt in found.doubts.items():
        Q = np.zeros((space.size, space.size))
        Q[HEADING, HEADING] = doubt
        for bias in compass_places(space, name)[:1]:  # either the heading or the compass has moved
            Q[bias, bias] = doubt
            Q[HEADING, bias] = Q[bias, HEADING] = -doubt
        engine.recast(engine.gaussian.x, np.eye(space.size), Q)
    wrong = found.gyro_wrong or (found.compass_wrong[1] if found.compass_wrong else None)
    if wrong is not None:
        _resume(engine, wrong, found.turned_rad)
    if found.gyro_wrong is not None and not found.turns.gyro_proven:
        _by_compass(engine, found.turns)
    if found.gyro_wrong is not None and gyro is not None:
        to_prior(engine, trust.first, [gyro])


def _by_compass(engine: Engine, turns: Turns) -> None:
    """The heading begins with what the newest compass shows, whose errors are as unknown as at the start."""
    trust, (space, x, _) = engine.trust, engine.gaussian
    in_use = {name: each for name, each in trust.compasses.items() if name not in turns.wrong_since_ns}
    if not in_use:
        return
    name, newest = max(in_use.items(), key=lambda item: item[1].t_ns)
    places = heading_places(space)
    fresh, F, Q = x.copy(), np.eye(space.size), np.zeros((space.size, space.size))
    fresh[places], F[places] = 0.0, 0.0
    Q[places, places] = trust.first.P.diagonal()[places]
    fresh[HEADING] = float(wrapped(newest.heading_rad))
    Q[HEADING, HEADING] = compass_sigma(engine, name) ** 2
    wrong_with_compass(space, Q, name, float(fresh[HEADING]))
    engine.recast(fresh, F, Q)


def _resume(engine: Engine, mark: FixMark, turned_rad: float) -> None:
    """The heading and the compasses' errors as they were at a mark, and what was turned since."""
    space, x, _ = engine.gaussian
    places = heading_places(space)
    fresh, F, Q = x.copy(), np.eye(space.size), np.zeros((space.size, space.size))
    fresh[places] = mark.block.x
    fresh[HEADING] = float(wrapped(mark.block.x[0] + turned_rad))
    F[places] = 0.0
    Q[np.ix_(places, places)] = mark.block.P
    Q[HEADING, HEADING] += math.radians(2.0) ** 2 + (0.03 * turned_rad) ** 2
    engine.recast(fresh, F, Q)


def _leader(trust: Trust, t_ns: int) -> str | None:
    """The first receiver in order of their names that delivers."""
    alive = (
        name
        for name, each in sorted(trust.receivers.items())
        if each.newest is not None and t_ns - each.newest.t_ns < 3 * NS_PER_S
    )
    return next(alive, None)


def _course_sigma(receiver: Receiver) -> float | None:
    if not receiver.gives_velocity or receiver.newest is None or receiver.newest.velocity_m_s is None:
        return None
    speed = math.hypot(*receiver.newest.velocity_m_s)
    sigma = 2.0 * receiver.sigma_m_s / max(speed, 1e-3)
    return sigma if speed > COURSE_FROM_M_S and sigma < LARGEST_COURSE_SIGMA_RAD else None
