"""Sensor messages of a stressed boat: fixes, headings, inertial samples with their faults (fault injection), as frames.

Messages are made directly, without readings and encoders; `common.framer` cuts frames, as on board.
"""

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from benchmarks.stress_world import Boat, Fault, lasting_error
from common.angles import wrap_deg
from common.framer import Framer, Identity, ImuSample, Measurement, Utc
from common.geodesy import LocalPlane
from common.messages import Attitude, Fix, Frame, Heading
from common.simulation.motion import Array, grid
from common.simulation.sensor_errors import Drift, drift_path
from common.simulation.specific_force import body_motion_3d
from common.simulation.without_ports import START_NS, UTC_START_NS
from common.units import M_S_PER_KN, NS_PER_MS, NS_PER_S, NS_PER_US

PLANE: Final = LocalPlane(45.0, -30.0)
"""The plane of the truth."""
GPS, VELOCITY, COMPASS, IMU, TILT = 3, 4, 5, 6, 7
"""Parts of the world: the generators of the sensors (0 to 2 are those of the truth)."""
_IDENTITY: Final = Identity("stress", "0" * 16, "clock", 1)
Arrival = tuple[float, Measurement]
"""When a measurement is known on board, s, and the measurement."""


def _turned(samples: Array) -> Array:
    """The box is turned by 90 deg: its forward axis looks to starboard."""
    return np.stack((samples[:, 1], -samples[:, 0], samples[:, 2]), axis=1)


IMU_FAULTS: Final[dict[str, Callable[[Array], Array]]] = {
    "zero": np.zeros_like,
    "stuck": lambda samples: np.tile(samples[:1], (len(samples), 1)),
    "upside-down": lambda samples: samples * (1.0, -1.0, -1.0),
    "turned-90": _turned,
    "sign": lambda samples: samples * (1.0, 1.0, -1.0),
    "rad-s": lambda samples: samples * (1.0, 1.0, math.pi / 180.0),
}
"""What becomes of samples (n, 3): forward and starboard m/s^2, yaw deg/s; from the onset on."""


class Fixes:
    """The fixes of a boat: what the receiver measures, before and after rounding."""

    def __init__(self, boat: Boat) -> None:
        world, truth = boat.world, boat.truth
        rng = boat.rng(GPS)
        self._hdop = round(float(rng.uniform(0.8, 1.25)), 2)
        t_s = world.gps_phase_s + grid(float(truth.t_s[-1]) - max(0.0, world.gps_phase_s), world.gps_hz)
        self.t_s = t_s[t_s >= 0.0]
        sky = np.searchsorted([each.from_s for each in world.sky], self.t_s + 1e-6, side="right") - 1
        white, lasting = np.array([(each.white_m, each.lasting_m) for each in world.sky])[sky].T
        self.quality = np.array([each.quality for each in world.sky])[sky]
        if boat.outage is not None:
            self.quality[(self.t_s >= boat.outage[0]) & (self.t_s < boat.outage[1])] = 0
        error = white[:, np.newaxis] * rng.standard_normal((len(self.t_s), 2))
        error += lasting[:, np.newaxis] * lasting_error(rng, self.t_s, world.lasting_s, 2)
        late, now = truth.at(self.t_s - world.position_late_s), truth.at(self.t_s)
        self._place = np.stack((late.east_m, late.north_m), axis=1) + error
        self.error_m = self._place - np.stack((now.east_m, now.north_m), axis=1)
        """Error of each position at its own stamp, (n, 2)."""
        self._velocity = _velocity(boat, self.t_s) if world.has_velocity else None

    def messages(self) -> Iterator[Fix]:
        """In order of time; a void fix has no position."""
        for row, (t_s, quality) in enumerate(zip(self.t_s.tolist(), self.quality.tolist(), strict=True)):
            utc_ms = round((UTC_START_NS + t_s * NS_PER_S) / NS_PER_MS)
            common = {"sensor": "gps1", "t_ns": boat_ns(t_s), "fix_quality": quality, "tod_ms": utc_ms % 86_400_000}
            if not quality:
                yield Fix(**common, status_valid=False)
                continue
            lat_deg, lon_deg = PLANE.to_lat_lon_deg(*self._place[row].tolist())
            sog_kn, cog_deg = (None, None) if self._velocity is None else _over_ground(*self._velocity[row].tolist())
            yield Fix(
                **common,
                status_valid=True,
                satellites=10,
                hdop=self._hdop,
                lat_deg=lat_deg,
                lon_deg=lon_deg,
                sog_kn=sog_kn,
                cog_true_deg=cog_deg,
                utc_ns=utc_ms * NS_PER_MS,
            )


def _velocity(boat: Boat, t_s: Array) -> Array:
    """East and north as measured, (n, 2), m/s."""
    rng, fault = boat.rng(VELOCITY), boat.world.velocity_fault
    seen = boat.truth.at(t_s - boat.world.velocity_late_s)
    velocity = np.stack((seen.v_east_m_s, seen.v_north_m_s), axis=1) + 0.08 * rng.standard_normal((len(t_s), 2))
    towards = rng.uniform(0.0, 2.0 * math.pi)
    if fault is None:
        return velocity
    wrong = _in(fault, t_s)
    if fault.kind == "frozen":
        velocity[wrong] = velocity[wrong][:1]
    else:
        velocity[wrong] += fault.size * np.array([math.sin(towards), math.cos(towards)])
    return velocity


def _over_ground(v_east: float, v_north: float) -> tuple[float, float]:
    """SOG in kn and COG in deg, each with one decimal as NMEA prints them."""
    sog_kn = round(math.hypot(v_east, v_north) / M_S_PER_KN, 1)
    return sog_kn, wrap_deg(round(wrap_deg(math.degrees(math.atan2(v_east, v_north))), 1))


def _headings(boat: Boat) -> Iterator[Heading]:
    """Magnetic headings where the variation is 0."""
    world, rng = boat.world, boat.rng(COMPASS)
    t_s = grid(float(boat.truth.t_s[-1]), world.compass_hz)
    heading = boat.truth.at(t_s).heading_rad
    phase, side = rng.uniform(0.0, 2.0 * math.pi), math.copysign(1.0, rng.uniform(-1.0, 1.0))
    error = world.compass_deg * rng.standard_normal(len(t_s))
    error += world.compass_lasting_deg * lasting_error(rng, t_s, 60.0)[:, 0]
    error -= world.deviation_deg * np.sin(heading - phase)
    if (fault := world.disturbance) is not None:
        # It rises and falls within a second: iron comes near.
        near_s = np.minimum(t_s - fault.from_s, fault.to_s - t_s)
        error += side * fault.size * np.clip(near_s, 0.0, 1.0)
    shown = np.round(np.degrees(heading) + error, 1)
    for at_s, heading_deg in zip(t_s.tolist(), shown.tolist(), strict=True):
        yield Heading(sensor="compass1", t_ns=boat_ns(at_s), heading_mag_deg=wrap_deg(heading_deg))


def _samples(boat: Boat) -> Iterator[ImuSample]:
    """A consumer unit of 10 Hz: turn-on biases, walks, white noise, a scale error of its gyro."""
    world, rng = boat.world, boat.rng(IMU)
    t_s = grid(float(boat.truth.t_s[-1]), 10.0)
    motion = body_motion_3d(boat.truth)
    force, rate = motion.mean(motion.force_m_s2, t_s), np.degrees(motion.mean(motion.rate_rad_s, t_s))
    t_s = t_s[1:]
    scale = rng.uniform(-0.01, 0.01) if world.gyro_scale is None else world.gyro_scale
    samples = np.stack((force[:, 0], force[:, 1], (1.0 + scale) * rate[:, 2]), axis=1)
    samples += rng.standard_normal(3) * (0.1, 0.1, 0.5)
    samples += drift_path(Drift(1.0), t_s, rng.standard_normal(samples.shape)) * (0.001, 0.001, 0.003)
    samples += rng.standard_normal(samples.shape) * (0.05, 0.05, 0.1)
    if (fault := world.imu_fault) is not None:
        wrong = _in(fault, t_s)
        samples[wrong] = IMU_FAULTS[fault.kind](samples[wrong])
    for at_s, (fwd, stb, yaw) in zip(t_s.tolist(), samples.tolist(), strict=True):
        yield ImuSample("imu1", boat_ns(at_s), fwd, stb, yaw)


def _attitudes(boat: Boat) -> Iterator[Attitude]:
    """Roll and pitch at the middle of each sample of the unit."""
    t_s, rng = grid(float(boat.truth.t_s[-1]), 10.0)[1:], boat.rng(TILT)
    seen = boat.truth.at(t_s - 0.05)
    assert seen.roll_rad is not None
    assert seen.pitch_rad is not None
    angles = np.degrees(np.stack((seen.roll_rad, seen.pitch_rad), axis=1))
    angles += 0.5 * rng.standard_normal(2) + 0.7 * rng.standard_normal(angles.shape)
    for at_s, (roll, pitch) in zip(t_s.tolist(), np.round(angles, 2).tolist(), strict=True):
        yield Attitude(sensor="imu1", t_ns=boat_ns(at_s), roll_deg=roll, pitch_deg=pitch)


def _in(fault: Fault, t_s: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether each time (n,) lies within a fault."""
    inside: np.ndarray[tuple[int], np.dtype[np.bool_]] = (t_s >= fault.from_s) & (t_s < fault.to_s)
    return inside


def frames_of(boat: Boat, fixes: Fixes) -> Iterator[Frame]:
    """Each measurement is in the frame in which it arrives."""
    world = boat.world
    arrivals: list[Arrival] = []
    arrivals += [(t_s + world.gps_arrives_s, fix) for t_s, fix in zip(fixes.t_s, fixes.messages(), strict=True)]
    if world.has_compass:
        arrivals += [(_voyage_s(item.t_ns) + 0.03, item) for item in _headings(boat)]
    if world.has_imu:
        arrivals += [(_voyage_s(item.t_ns) + 0.01, item) for item in _samples(boat)]
    if world.gives_roll:
        arrivals += [(_voyage_s(item.t_ns) + 0.01, item) for item in _attitudes(boat)]
    arrivals.sort(key=lambda arrival: arrival[0])
    config = world.config()
    period_ns = round(NS_PER_S / config.frames.rate_hz)
    framer = Framer(_IDENTITY, [sensor.id for sensor in config.with_role("imu")], START_NS)
    t1_ns = START_NS + period_ns
    for arrival_s, measurement in arrivals:
        while START_NS + arrival_s * NS_PER_S >= t1_ns:
            yield framer.tick(t1_ns, Utc(UTC_START_NS + framer.t0_ns - START_NS, NS_PER_MS, "gnss"), 0, ())
            t1_ns += period_ns
        framer.add(measurement)


def boat_ns(t_s: float) -> int:
    """Boat time of a time of the voyage, whole microseconds."""
    return START_NS + round(t_s * 1e6) * NS_PER_US


def _voyage_s(t_ns: int) -> float:
    return (t_ns - START_NS) / NS_PER_S
