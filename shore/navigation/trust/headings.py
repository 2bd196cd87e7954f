"""How a heading is fused (compass deviation and magnetic disturbance): errors of the compass as states; set aside."""

import math
from typing import Final

import numpy as np

from common.units import NS_PER_S
from shore.navigation.measurements import TrueHeading
from shore.navigation.trust.marks import RunningSums, Turned, onward
from shore.navigation.trust.memory import Engine, Regard, Vessel, compass_places, to_prior
from shore.navigation.trust.turns import LONGEST_NS, RETURN_DEG, RETURN_NS

LASTS_S: Final = 0.2
"""Readings of a compass that are nearer than this share their noise."""
LATE_S: Final = 0.1
"""Doubt of a compass' time, s."""
STEADY_RAD_S: Final = math.radians(1.0)
"""A boat that turns by less goes straight."""
SMOOTH_S: Final = 0.3
"""Compass less gyro is a mean over this time for the witnesses of a turn, s."""
GATE2: Final = 16.0
"""Square of the sigmas beyond which a reading is a jump."""
TURN_S: Final = 1.0
"""Without gyro, the yaw rate is the change of a compass over about this time."""


def fuse_heading(boat: Vessel, engine: Engine, reading: TrueHeading) -> None:
    """Fuse a reading of a compass, unless the compass is set aside."""
    trust, space = engine.trust, engine.gaussian.space
    name = reading.sensor
    old = trust.compasses.get(name)
    shown = onward(old.heading_rad if old else None, float(reading.heading_rad))
    turned = _turned(trust.tally, old, shown, reading.t_ns)
    rate_hz = NS_PER_S / max(reading.t_ns - old.t_ns, NS_PER_S // 50) if old else 1.0
    trust = trust._replace(compasses={**trust.compasses, name: turned})
    engine.remember(trust)
    if name in trust.turns.wrong_since_ns and not _comes_back(engine, reading):
        return
    has_gyro = boat.has_gyro and trust.turns.gyro_wrong_since_ns is None
    if not has_gyro and old is not None:
        share = min(1.0, 1.0 / (rate_hz * TURN_S))
        rate = trust.way.turn_rad_s + share * ((shown - old.heading_rad) * rate_hz - trust.way.turn_rad_s)
        trust = trust._replace(way=trust.way._replace(turn_rad_s=rate))
        engine.remember(trust)
    rate = trust.way.turn_rad_s
    # without gyro the heading lags in a turn, and the errors of the compass must not learn the lag
    is_steady = max(abs(rate), abs(trust.way.slow_turn_rad_s)) < STEADY_RAD_S
    errors = compass_places(space, name)
    regard = Regard(
        factor=max(1.0, LASTS_S * rate_hz),
        more=(LATE_S * rate) ** 2 * max(1.0, rate_hz),
        considered=() if has_gyro or is_steady else errors,
    )
    if has_gyro and errors and not trust.is_provisional:
        _open_to_jump(engine, reading, regard)
    engine.fuse_parts(reading, [regard])


def _turned(tally: RunningSums, old: Turned | None, shown_rad: float, t_ns: int) -> Turned:
    """What a compass has turned up to a reading."""
    apart_rad = shown_rad - tally.turned_rad
    if old is not None:
        kept = math.exp(-(t_ns - old.t_ns) / NS_PER_S / SMOOTH_S)
        apart_rad += kept * (old.apart_rad - apart_rad)
    return Turned(shown_rad, tally.turned_rad, tally.covered_s, t_ns, apart_rad)


def _open_to_jump(engine: Engine, reading: TrueHeading, regard: Regard) -> None:
    """A jump of a compass beside a good gyro is an error of the compass, not a turn."""
    space, x, P = engine.gaussian
    row, innovation, channel, _ = reading.parts[0](space, x, None)
    own = engine.scatter_of(channel)
    if own is None:
        return
    h = np.zeros(space.size)
    for place, weight in row:
        h[place] = weight
    S = float(h @ P @ h) + own[0] * regard.factor + regard.more
    if float(innovation) ** 2 > GATE2 * S:
        Q = np.zeros_like(P)
        bias = compass_places(space, reading.sensor)[0]
        Q[bias, bias] = 0.5 * float(innovation) ** 2
        engine.recast(x, np.eye(space.size), Q)


def _comes_back(engine: Engine, reading: TrueHeading) -> bool:
    """A compass that is set aside: whether it is to be taken back."""
    trust, (space, x, _) = engine.trust, engine.gaussian
    name, turns = reading.sensor, trust.turns
    innovation = float(reading.parts[0](space, x, None).innovation)
    agrees = dict(turns.agrees_since_ns)
    if abs(innovation) < math.radians(RETURN_DEG):
        agrees.setdefault(name, reading.t_ns)
    else:
        agrees.pop(name, None)
    is_right = name in agrees and reading.t_ns - agrees[name] >= RETURN_NS
    is_long = reading.t_ns - turns.wrong_since_ns[name] >= LONGEST_NS
    if not is_right and not is_long:
        engine.remember(trust._replace(turns=turns._replace(agrees_since_ns=agrees)))
        return False
    agrees.pop(name, None)
    wrong = {each: since for each, since in turns.wrong_since_ns.items() if each != name}
    turns = turns._replace(wrong_since_ns=wrong, agrees_since_ns=agrees, judged_from_ns=reading.t_ns)
    engine.remember(trust._replace(turns=turns))
    if not is_right:
        to_prior(engine, trust.first, list(compass_places(space, name)))
    return True
