"""Worlds of the stress bench: what is simulated, and the ground truth of the boat of a seed (vectorised simulation).

The hull is that of the studies: legs and turns, an outward slide of 1.05 u r with a lag of 2 s, an outward heel of
0.15 u r rad, waves that move its attitude only. Each part of a world draws from a generator of its own, so two worlds
that differ in one thing share all other errors of a seed.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from common.boat_config import BoatConfig, BoatTable, FramesTable, PortTable, SensorTable
from common.simulation.hull import STEP_S, at_anchor, integral
from common.simulation.motion import Array, Truth, grid
from common.simulation.recurrences import lagged
from common.simulation.sensor_errors import drift_path, gauss_markov
from common.simulation.waves import narrow_band

FOREVER: Final = (60.0, math.inf)
"""The time that is scored where a world names no parts: all after the first minute."""
LEGS: Final = {
    "legs": ((20.0, 30.0, 0.0, 0.6), (60.0, 180.0, 1.0, 1.0)),
    "study": ((60.0, 120.0, 0.25, 0.6), (60.0, 120.0, 0.42, 0.6)),
}
"""Least and most that a track draws: length of a leg (s), angle of a turn (deg), where its rate lies in the range of
the world (0 to 1), what it leaves of the way (1 = all)."""
TOLD_LATE_S: Final = 0.3
"""Latency of a fix that the boat's file states, s."""


@dataclass(frozen=True, slots=True)
class Sky:
    """What a receiver has from a time on."""

    from_s: float
    white_m: float
    """1-sigma of the white part on each axis, m."""
    lasting_m: float = 0.0
    """1-sigma of the Gauss-Markov part on each axis, m."""
    quality: int = 1
    """As in GGA; 0 = the fixes are void."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """Something that is wrong in a time: `kind` is a name of `stress_messages`."""

    kind: str
    from_s: float = 0.0
    to_s: float = math.inf
    size: float = 0.0
    """How much, in the unit of the sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """What is simulated. Equal worlds and seeds give equal boats."""

    track: str = "legs"
    """`legs`, drawn; `study`, those of the studies' cases; `anchor`, or `rest`."""
    speed_m_s: float = 1.5
    """Through the water; negative = astern."""
    turn_deg_s: tuple[float, float] = (3.0, 12.0)
    current_m_s: float = 0.0
    """Constant, in a direction that is drawn."""
    waves_deg: float = 4.0
    """Amplitude of the roll; the pitch has 5/12 of it."""
    heel_s2_m: float = 0.15
    """Outward heel for each u r, rad/(m/s^2)."""
    gps_hz: float = 1.0
    gps_phase_s: float = 0.0
    """Time of the first fix."""
    gps_arrives_s: float = 0.35
    """How long after its validity a fix is known on board; its stamp is right."""
    sky: tuple[Sky, ...] = (Sky(0.0, 1.5),)
    lasting_s: float = 60.0
    sigma_m: float | None = None
    """What the boat's file states for each axis; `None` = the total of the first sky at HDOP 1."""
    has_velocity: bool = True
    velocity_late_s: float = 0.0
    position_late_s: float = 0.0
    """How much older than its stamp each position is."""
    velocity_fault: Fault | None = None
    has_compass: bool = True
    compass_hz: float = 5.0
    compass_deg: float = 1.0
    """1-sigma of the white part; the file always states 1 deg."""
    compass_lasting_deg: float = 0.0
    """1-sigma of an error that lasts 60 s."""
    deviation_deg: float = 0.0
    """Amplitude of a deviation that goes with the sine of the heading less a drawn one."""
    disturbance: Fault | None = None
    """Magnetic: the compass is off by `size` deg, to a side that is drawn."""
    has_imu: bool = True
    imu_fault: Fault | None = None
    gives_roll: bool = False
    """Whether the unit gives roll and pitch: 0.5 deg of bias and 0.7 deg of noise."""
    gyro_scale: float | None = None
    """Error of the scale factor; `None` = drawn up to 1 % to both sides."""
    outage_s: float = 0.0
    """Length of a time without fixes that begins at a drawn time from 240 to 360 s."""
    parts: tuple[tuple[str, float, float], ...] = (("", *FOREVER),)
    """What is scored: a name and a time each, seconds since the start."""
    at_fixes: bool = False
    """Only estimates at the times of the fixes are scored."""
    any_estimate: bool = False
    """Estimates that are not aligned are scored too: a heading may never be known here."""

    def sigma_total_m(self) -> float:
        """1-sigma of the fixes on each axis that the boat's file states, m."""
        return self.sigma_m or math.hypot(self.sky[0].white_m, self.sky[0].lasting_m)

    def without_imu(self) -> "World":
        """The same boat, which never had an inertial unit."""
        return replace(self, has_imu=False, imu_fault=None)

    def without_velocity(self) -> "World":
        """The same boat, whose receiver sends no SOG and COG."""
        return replace(self, has_velocity=False, velocity_fault=None, velocity_late_s=0.0)

    def config(self) -> BoatConfig:
        """The boat's file."""
        gps = SensorTable(
            id="gps1",
            port="a",
            role="gps",
            rate_hz=self.gps_hz,
            latency_ms=1000.0 * TOLD_LATE_S,
            sigma_m=self.sigma_total_m(),
        )
        compass = SensorTable(id="compass1", port="a", role="compass", rate_hz=self.compass_hz)
        imu = SensorTable(id="imu1", port="a", role="imu", model="arduimu", rate_hz=10.0, trust_tilt=self.gives_roll)
        return BoatConfig(
            boat=BoatTable(id="stress", variation_deg=0.0),
            frames=FramesTable(rate_hz=5.0),
            port=(PortTable(name="a", path="a"),),
            sensor=(gps, *((compass,) if self.has_compass else ()), *((imu,) if self.has_imu else ())),
        )


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn that the helm makes."""

    begin_s: float
    end_s: float
    angle_deg: float


@dataclass(frozen=True, slots=True)
class Boat:
    """What really happens to the boat of a seed."""

    world: World
    seed: int
    truth: Truth
    turns: tuple[Turn, ...] = field(default=())
    outage: tuple[float, float] | None = None

    def rng(self, part: int) -> np.random.Generator:
        """The generator of one part of the world."""
        return np.random.default_rng((self.seed, part))

    def first_turn_from(self, onset_s: float) -> tuple[float, float] | None:
        """When the first turn begins that has passed 20 deg after a time, and when it has; `None` = there is none."""
        for turn in self.turns:
            begin_s = max(turn.begin_s, onset_s)
            if begin_s >= turn.end_s:
                continue
            t_s = np.arange(begin_s, turn.end_s + 3.0, STEP_S)
            heading = self.truth.at(t_s).heading_rad
            passed = np.flatnonzero(np.abs(heading - heading[0]) > math.radians(20.0))
            if passed.size:
                return begin_s, float(t_s[passed[0]])
        return None


def sail(world: World, seed: int, seconds: float) -> Boat:
    """The truth of a boat."""
    t_s = grid(seconds, 1.0 / STEP_S)
    track, sea, rest = (np.random.default_rng((seed, part)) for part in (0, 1, 2))
    drawn = rest.uniform(size=2)
    begin_s = 240.0 + 120.0 * float(drawn[0])
    outage = (begin_s, begin_s + world.outage_s) if world.outage_s else None
    drift = world.current_m_s * np.array([math.sin(2.0 * math.pi * drawn[1]), math.cos(2.0 * math.pi * drawn[1])])
    still = np.zeros_like(t_s)
    turns: tuple[Turn, ...] = ()
    if world.track == "anchor":
        course = at_anchor(track, t_s)
        moves = course.heading_rad, still, still, still
        drift = drift if course.swing_m_s is None else course.swing_m_s
    elif world.track == "rest":
        moves = still + track.uniform(0.0, 2.0 * math.pi), still, still, still
    else:
        rate, way, turns = _legs(track, world, t_s)
        heading = track.uniform(0.0, 2.0 * math.pi) + integral(rate)
        moves = heading, rate, way, lagged(-1.05 * way * rate, STEP_S, 2.0)
    return Boat(world, seed, _afloat(world, sea, t_s, moves, drift), turns, outage)


def _legs(rng: np.random.Generator, world: World, t_s: Array) -> tuple[Array, Array, tuple[Turn, ...]]:
    """Turn rate (rad/s) and way (m/s) at each step, and the turns: each costs up to 40 % of the way."""
    rate, way = np.zeros_like(t_s), np.full_like(t_s, world.speed_m_s)
    turns = []
    at_s = 0.0
    while at_s < t_s[-1]:
        leg_s, angle_deg, share, slow = rng.uniform(*LEGS[world.track])
        side = rng.uniform(-1.0, 1.0)
        rate_deg_s = world.turn_deg_s[0] + share * (world.turn_deg_s[1] - world.turn_deg_s[0])
        begin_s, end_s = at_s + leg_s, at_s + leg_s + angle_deg / rate_deg_s
        turning = (t_s >= begin_s) & (t_s < end_s)
        rate[turning] = math.radians(math.copysign(rate_deg_s, side))
        way[turning] *= slow
        turns.append(Turn(float(begin_s), float(end_s), float(math.copysign(angle_deg, side))))
        at_s = float(end_s)
    return lagged(rate, STEP_S, 0.7), lagged(way, STEP_S, 4.0), tuple(turns)


def _afloat(
    world: World, waves: np.random.Generator, t_s: Array, moves: tuple[Array, Array, Array, Array], drift: Array
) -> Truth:
    """The truth of a hull whose heading (rad), turn rate (rad/s), way and slide (m/s) are given before waves.

    `drift` (2,) or (n, 2): the water's velocity, east and north, m/s.
    """
    heading, rate, way, slide = moves
    peak_hz = waves.uniform(0.15, 0.45)
    roll_deg = world.waves_deg / math.sqrt(2.0)
    roll, pitch, yaw = (
        narrow_band(waves, t_s, math.radians(sigma_deg), hz)
        for sigma_deg, hz in ((roll_deg, peak_hz), (roll_deg * 5.0 / 12.0, peak_hz * 1.1), (roll_deg / 10.0, peak_hz))
    )
    sin, cos = np.sin(heading), np.cos(heading)
    v_east, v_north = sin * way + cos * slide + drift[..., 0], cos * way - sin * slide + drift[..., 1]
    trim_most = math.radians(5.0)
    return Truth(
        t_s,
        integral(v_east),
        integral(v_north),
        v_east,
        v_north,
        heading + yaw,
        roll_rad=roll - world.heel_s2_m * way * rate,
        pitch_rad=pitch + trim_most * np.tanh(0.01 * way * np.abs(way) / trim_most),
    )


def lasting_error(rng: np.random.Generator, t_s: Array, time_s: float, axes: int = 1) -> Array:
    """A Gauss-Markov process of 1-sigma 1 at times (n,), (n, axes)."""
    return drift_path(gauss_markov(1.0, time_s), t_s, rng.standard_normal((len(t_s), axes)))
