"""What drives a prediction: axes of the IMU in use, adaptive process noise, running sums over what was measured."""

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from shore.navigation.motion_model import FREE_NOISE, ImuInput, InUse, ProcessNoise
from shore.navigation.numbers import Array, Number
from shore.navigation.state_space import HEADING, Gaussian, StateSpace
from shore.navigation.tilt_leak import lift
from shore.navigation.trust.axes import density_of
from shore.navigation.trust.marks import RunningSums
from shore.navigation.trust.memory import Engine, Trust, Vessel, Way, error_places

HEELED: Final = 0.3
"""Noise density of the starboard axis in a turn, over speed x yaw rate: a hull heels."""
TURN_SHARE: Final = 0.03
"""Noise density of the yaw rate over the yaw rate: scale errors."""
FREE_TURN: Final = 0.7
"""Without gyro the heading is so much freer in a turn, sqrt(s) times the yaw rate by the compass: it must not lag."""
ACCEL_HEADING_RAD: Final = math.radians(30.0)
"""Accelerations are of no use while the heading is doubtful by more."""
SLOW_TURN_S: Final = 10.0
WAVES_LAST_S: Final = 3.0
"""What waves make of a gyro lasts so long: roll and pitch beat."""


class PredictionStep(NamedTuple):
    """A prediction that is to be made."""

    before: Gaussian
    ahead_m_s: float
    """Speed through the water along the bow before it."""
    dt_s: float
    imu: ImuInput | None
    """What was measured, in use or not."""


def drives(boat: Vessel, step: PredictionStep, trust: Trust, noise: ProcessNoise) -> tuple[InUse | None, ProcessNoise]:
    """What drives a prediction, and its process noise. `noise`: the configured one."""
    state, imu = step.before, step.imu
    lasting = _lasting(state.space, trust)
    forward, starboard = trust.axes
    free_fwd, free_stb = math.sqrt(forward.free_density2), math.sqrt(starboard.free_density2)
    rate = trust.way.turn_rad_s
    heel = HEELED * boat.heel_left * abs(step.ahead_m_s * rate)
    free_turn = math.hypot(float(FREE_NOISE.yaw_rate), FREE_TURN * rate)
    if imu is None:
        return None, ProcessNoise(free_fwd, math.hypot(free_stb, heel), free_turn, lasting)
    is_blind = float(state.P[HEADING, HEADING]) > ACCEL_HEADING_RAD**2
    fwd: Number | None
    stb: Number | None
    yaw_rate: Number | None
    fwd, stb, yaw_rate = imu
    accel_fwd, accel_stb, turn = (float(each) for each in noise[:3])
    if is_blind or forward.is_off:
        fwd, accel_fwd = None, free_fwd
    else:
        accel_fwd = density_of(forward, accel_fwd)
    if is_blind or starboard.is_off:
        stb, accel_stb = None, free_stb
    else:
        accel_stb = density_of(starboard, accel_stb)
    accel_stb = math.hypot(accel_stb, heel)
    if trust.turns.gyro_wrong_since_ns is not None:
        yaw_rate, turn = None, free_turn
    else:
        by_waves = trust.waves.gyro_rad_s * math.sqrt(2.0 * WAVES_LAST_S)
        turn = math.hypot(max(turn, math.sqrt(trust.turns.density2), by_waves), TURN_SHARE * rate)
    return InUse(fwd, stb, yaw_rate), ProcessNoise(accel_fwd, accel_stb, turn, lasting)


def _lasting(space: StateSpace, trust: Trust) -> Mapping[int, float]:
    """Variance of the lasting error of each receiver, by its place."""
    return {
        place: variance
        for name, receiver in trust.receivers.items()
        for place, variance in zip(error_places(space, name), receiver.lasting_m2, strict=True)
        if place is not None
    }


def passed(boat: Vessel, engine: Engine, step: PredictionStep) -> None:
    """A prediction was made."""
    trust, x = engine.trust, engine.gaussian.x
    imu, dt_s = step.imu, step.dt_s
    tally, waves = trust.tally, trust.waves
    has_gyro = boat.has_gyro and imu is not None
    if imu is not None:
        tally = _counted(tally, step, imu, x, covered_s=dt_s if has_gyro else 0.0)
        waves = waves.then(dt_s, imu)
    way = trust.way
    rate = tally.yaw_rate_rad_s if has_gyro and trust.turns.gyro_wrong_since_ns is None else way.turn_rad_s
    slow = way.slow_turn_rad_s + min(1.0, dt_s / SLOW_TURN_S) * (rate - way.slow_turn_rad_s)
    blind_s = 0.0 if imu is not None else way.blind_s + dt_s
    way = Way(way.pending_s + dt_s, way.quiet_s + dt_s, blind_s, way.square, rate, slow)
    engine.remember(trust._replace(tally=tally, way=way, waves=waves))


def _counted(tally: RunningSums, step: PredictionStep, imu: ImuInput, after: Array, *, covered_s: float) -> RunningSums:
    """The running sums after a prediction, by all axes, in use or not."""
    (space, before_x, _), ahead, dt_s = step[:3]
    gyro, fwd_bias, stb_bias, leak, heel = space.places[:5]
    fwd, stb, yaw_rate = (float(axis) for axis in imu)
    if gyro is not None:
        yaw_rate -= float(before_x[gyro])
    if fwd_bias is not None:
        fwd -= float(before_x[fwd_bias])
    if leak is not None:
        fwd -= float(before_x[leak]) * float(lift(ahead))
    if heel is not None:
        stb -= float(before_x[heel]) * ahead * yaw_rate
    if stb_bias is not None:
        stb -= float(before_x[stb_bias])
    middle = float(before_x[HEADING]) + 0.5 * math.remainder(float(after[HEADING] - before_x[HEADING]), math.tau)
    sin, cos = math.sin(middle), math.cos(middle)
    east, north = dt_s * (sin * fwd + cos * stb), dt_s * (cos * fwd - sin * stb)
    return RunningSums(
        tally.turned_rad + yaw_rate * dt_s,
        tally.gained_east_m_s + east,
        tally.gained_north_m_s + north,
        tally.went_east_m + dt_s * (tally.gained_east_m_s + 0.5 * east),
        tally.went_north_m + dt_s * (tally.gained_north_m_s + 0.5 * north),
        yaw_rate,
        tally.covered_s + covered_s,
    )
