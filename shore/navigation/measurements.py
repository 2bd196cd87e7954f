"""Measurement models: what a sensor measured, which number a state expects instead, lever arm included.

Each kind is one class that says its scalars, its rank among those of the same time, and whether filters can start from
it; `Reader` makes them of the messages of a frame, in metres on the local tangent plane and true headings in radians.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple, Protocol

from common.angles import heading_rad
from common.boat_config import BoatConfig, SensorTable
from common.events import event
from common.geodesy import LocalPlane
from common.messages import Event, Fix, Frame, Heading
from common.units import M_S_PER_KN
from shore.navigation.kalman import Row
from shore.navigation.magnetic_variation import Variation
from shore.navigation.motion_model import body_to_plane
from shore.navigation.numbers import Array, Number, part, sin_cos, wrapped
from shore.navigation.state_space import EAST, HEADING, NORTH, StateSpace

FARTHEST_M: Final = 20_000.0
"""A fix beyond this distance from the origin is not used."""
COURSE_FROM_KN: Final = 1.0
"""SOG and COG of a fix give the velocity from this speed on."""
STILL_KN: Final = 0.3
"""Below this SOG a fix without COG says that the boat lies still."""
LEAST_HDOP: Final = 0.8
COURSE_AS_HEADING_FROM_KN: Final = 2.0
"""Without a compass, COG stands for the heading from this speed on."""


class Scalar(NamedTuple):
    """One measured number beside the state that expects it: what a scalar update needs."""

    row: Row
    """Derivative of the expected number by the state."""
    innovation: Number
    """Innovation: measured - expected, m or rad; an angle is wrapped."""
    channel: str
    """Channel whose R it has: `gps1.east`, ..."""
    measured: Number
    """What was measured, whatever the state expected, m or rad."""


class PseudoScalar(NamedTuple):
    """The same for a number that nothing measured."""

    x: Array
    """State (..., n) that expects it; not the one that was given where that is known to have changed."""
    row: Row
    innovation: Number
    variance: float
    """R, which no rule adapts."""


Lever = tuple[float, float]
"""Lever arm: where an antenna is, (forward, starboard) of the boat's reference point, m."""
Part = Callable[[StateSpace, Array, Lever | None], Scalar]
"""One component of a measurement: (states, x (..., n), lever arm of its sensor) -> its scalar. It is called with the
state into which the components before it are fused."""
PseudoPart = Callable[[StateSpace, Array], PseudoScalar | None]
"""One component of a pseudo-measurement, called likewise; `None` where it is about a state that the filter lacks."""


def is_angle(channel: str) -> bool:
    """True for a channel in rad, which a wrong yaw rate disturbs; the others are along the axes of the plane."""
    return channel.endswith((".heading", ".course"))


class Seeds(NamedTuple):
    """The newest measurements that a filter can start from."""

    position: "Position | None" = None
    heading: "FirstHeading | None" = None


class Measurement(Protocol):
    """What a sensor measured at one time. One more kind of it is one more class like those below."""

    @property
    def t_ns(self) -> int:
        """Boat time of the measurement."""
        ...

    @property
    def sensor(self) -> str:
        """Id of the sensor, as in the configuration."""
        ...

    @property
    def rank(self) -> int:
        """Place among measurements of the same time, above 0; a synchronous step takes the newest of each rank."""
        ...

    @property
    def parts(self) -> tuple[Part, ...]:
        """Components in the order in which they are fused; their errors are independent."""
        ...

    def seed(self, seeds: Seeds) -> Seeds:
        """What filters can start from once this is measured too."""
        ...


class PseudoMeasurement(Protocol):
    """What is fused though nothing measured it."""

    @property
    def parts(self) -> tuple[PseudoPart, ...]:
        """Components in the order in which they are fused."""
        ...


class Position(NamedTuple):
    """A usable fix on the local plane."""

    t_ns: int
    sensor: str
    east_m: Number
    north_m: Number
    velocity_m_s: tuple[float, float] | None = None
    """Velocity over ground (east, north), m/s, from SOG and COG; poor below `COURSE_FROM_KN`."""
    course_rad: float | None = None
    """Course over ground, rad, when it may stand for a heading."""
    claimed_m: tuple[float, float] | None = None
    """1-sigma (east, north) that the receiver claims in all, m; `None` = nothing is claimed."""
    quality: int | None = None
    """Quality of the fix in the numbers of GGA."""

    @property
    def is_moving(self) -> bool:
        """Its velocity is fast enough to be one."""
        return self.velocity_m_s is not None and math.hypot(*self.velocity_m_s) >= COURSE_FROM_KN * M_S_PER_KN

    @property
    def rank(self) -> int:
        """Rank of fixes, before headings."""
        return 1

    @property
    def parts(self) -> tuple[Part, ...]:
        """East, then north."""
        return self._east, self._north

    def seed(self, seeds: Seeds) -> Seeds:
        """A filter starts at the newest fix."""
        return seeds._replace(position=self)

    def _east(self, space: StateSpace, x: Array, lever: Lever | None) -> Scalar:
        row: Row = ((EAST, 1.0),)
        expected = part(x, EAST)
        if (error := space.index(f"{self.sensor}_error_east_m")) is not None:
            row = (*row, (error, 1.0))
            expected = expected + part(x, error)
        if lever:
            east_m, north_m = body_to_plane(*lever, part(x, HEADING))
            expected = expected + east_m
            # the derivative of (east, north) by a clockwise heading is (north, -east)
            row = (*row, (HEADING, north_m))
        return Scalar(row, self.east_m - expected, f"{self.sensor}.east", self.east_m)

    def _north(self, space: StateSpace, x: Array, lever: Lever | None) -> Scalar:
        row: Row = ((NORTH, 1.0),)
        expected = part(x, NORTH)
        if (error := space.index(f"{self.sensor}_error_north_m")) is not None:
            row = (*row, (error, 1.0))
            expected = expected + part(x, error)
        if lever:
            east_m, north_m = body_to_plane(*lever, part(x, HEADING))
            expected = expected + north_m
            row = (*row, (HEADING, -east_m))
        return Scalar(row, self.north_m - expected, f"{self.sensor}.north", self.north_m)


class TrueHeading(NamedTuple):
    """A compass reading, corrected to true."""

    t_ns: int
    sensor: str
    heading_rad: Number

    @property
    def rank(self) -> int:
        """Rank of headings, after fixes."""
        return 2

    @property
    def channel(self) -> str:
        """Whose R it has."""
        return f"{self.sensor}.heading"

    @property
    def parts(self) -> tuple[Part, ...]:
        """The heading with the compass' bias and deviation, where those are states."""
        return (self._heading,)

    def seed(self, seeds: Seeds) -> Seeds:
        """A filter starts at the newest heading."""
        return seeds._replace(heading=self)

    def _heading(self, space: StateSpace, x: Array, _lever: Lever | None) -> Scalar:
        slope: Number = 1.0
        errors: Row = ()
        heading = part(x, HEADING)
        expected = heading
        if (bias := space.index(f"{self.sensor}_bias_rad")) is not None:
            errors = ((bias, 1.0),)
            expected = expected + part(x, bias)
        by_sin, by_cos = space.index(f"{self.sensor}_sin_rad"), space.index(f"{self.sensor}_cos_rad")
        if by_sin is not None and by_cos is not None:
            sin, cos = sin_cos(heading)
            B, C = part(x, by_sin), part(x, by_cos)
            errors = (*errors, (by_sin, sin), (by_cos, cos))
            expected = expected + B * sin + C * cos
            slope = 1.0 + B * cos - C * sin
        row: Row = ((HEADING, slope), *errors)
        return Scalar(row, wrapped(self.heading_rad - expected), self.channel, self.heading_rad)


class Course(NamedTuple):
    """A course over ground that stands for the heading of a boat without compass."""

    t_ns: int
    sensor: str
    heading_rad: Number

    @property
    def rank(self) -> int:
        """Rank of courses, the same as that of headings."""
        return 2

    @property
    def channel(self) -> str:
        """Whose R it has."""
        return f"{self.sensor}.course"

    @property
    def parts(self) -> tuple[Part, ...]:
        """The heading alone."""
        return (self._heading,)

    def seed(self, seeds: Seeds) -> Seeds:
        """A filter starts at the newest heading."""
        return seeds._replace(heading=self)

    def _heading(self, _space: StateSpace, x: Array, _lever: Lever | None) -> Scalar:
        innovation = wrapped(self.heading_rad - part(x, HEADING))
        return Scalar(((HEADING, 1.0),), innovation, self.channel, self.heading_rad)


FirstHeading = TrueHeading | Course
"""What a filter may take its first heading from: it has a `channel` and a `heading_rad`."""


def with_courses(measurements: Iterable[Measurement]) -> Iterator[Measurement]:
    """The measurements of a boat without compass: a fix gives its course as well."""
    for measured in measurements:
        yield measured
        if isinstance(measured, Position) and measured.course_rad is not None:
            yield Course(measured.t_ns, measured.sensor, measured.course_rad)


class Reader:
    """Corrects and converts measurements with the boat's sensor facts; reports each kind of trouble once."""

    def __init__(self, config: BoatConfig, tell: Callable[[Event], None]) -> None:
        self._sensors = {sensor.id: sensor for sensor in config.sensor}
        self._deviations = _deviations(config)
        self._tell = tell
        self.far_in_a_row = 0
        """Number of usable fixes since the last one within `FARTHEST_M`."""
        self._zero: set[str] = set()
        """Receivers that gave the place 0, 0."""
        self._variation = Variation(tell, config.boat.variation_deg)
        self._newest_ns: int | None = None
        self._is_newest = True
        self._utc_ns: int | None = None
        """UTC of the newest frame, ns; `None` = not known."""
        self.plane: LocalPlane | None = None
        """Local tangent plane; it touches the earth at the first usable fix that arrived, `None` before that."""

    def read(self, frame: Frame) -> tuple[Measurement, ...]:
        """The frame's fixes and headings, converted; those of no use are left out."""
        # A backfilled frame says where the boat was, not which variation a heading of now needs.
        self._is_newest = self._newest_ns is None or frame.t1_ns > self._newest_ns
        if self._is_newest:
            self._newest_ns, self._utc_ns = frame.t1_ns, frame.utc_ns
        positions = [self.position(fix) for fix in frame.fixes]
        headings = [self.true_heading(heading) for heading in frame.headings]
        return tuple(measured for measured in (*positions, *headings) if measured is not None)

    def position(self, fix: Fix) -> Position | None:
        """The fix in metres; `None` when void, held, 0, 0, not configured or too far away."""
        if fix.is_zero and fix.sensor not in self._zero:
            self._zero.add(fix.sensor)
            self._tell(event("fix-zero", fix.t_ns, fix.sensor, sensor=fix.sensor))
        if not fix.usable or fix.lat_deg is None or fix.lon_deg is None or not self._is(fix.sensor, "gps"):
            return None
        if not math.isfinite(fix.lat_deg + fix.lon_deg):
            return None
        if self.plane is None:
            self.plane = LocalPlane(fix.lat_deg, fix.lon_deg)
        east_m, north_m = self.plane.to_east_north_m(fix.lat_deg, fix.lon_deg)
        if self._too_far(fix, math.hypot(east_m, north_m)):
            return None
        if self._is_newest:
            self._variation.see(fix.lat_deg, fix.lon_deg, self._utc_ns)
        velocity, course = _motion(fix)
        claimed = claimed_m(fix, self._sensors[fix.sensor])
        return Position(fix.t_ns, fix.sensor, east_m, north_m, velocity, course, claimed, fix.fix_quality)

    def true_heading(self, heading: Heading) -> TrueHeading | None:
        """The true heading: as sent, or magnetic + deviation + variation, both east +.

        Deviation: the boat's table, else the device's. Variation: `Variation`; while nobody knows it the reading is of
        no use.
        """
        if not self._is(heading.sensor, "compass"):
            return None
        true_deg = heading.heading_true_deg
        if true_deg is None and heading.heading_mag_deg is not None:
            variation_deg = self._variation.east_deg(heading.t_ns, heading.sensor, heading.variation_deg)
            if variation_deg is None:
                return None
            deviation_deg = self._deviations.get(heading.sensor, heading.deviation_deg or 0.0)
            true_deg = heading.heading_mag_deg + deviation_deg + variation_deg
        if true_deg is None or not math.isfinite(true_deg):
            return None
        return TrueHeading(heading.t_ns, heading.sensor, heading_rad(true_deg))

    def _is(self, sensor: str, role: str) -> bool:
        return sensor in self._sensors and self._sensors[sensor].role == role

    def _too_far(self, fix: Fix, distance_m: float) -> bool:
        """Make an event, once for each excursion."""
        if distance_m <= FARTHEST_M:
            self.far_in_a_row = 0
            return False
        self.far_in_a_row += 1
        if self.far_in_a_row == 1:
            distance_km = round(distance_m / 1000.0, 1)
            self._tell(event("fix-far", fix.t_ns, fix.sensor, sensor=fix.sensor, distance_km=distance_km))
        return True


def _deviations(config: BoatConfig) -> dict[str, float]:
    """Sensor -> deviation that the board's file states, deg, east +.

    Where the file stated none, the configuration in older logs has 0: at every sensor, receivers too.
    """
    is_old = any(sensor.deviation_deg == 0.0 for sensor in config.sensor if sensor.role != "compass")
    stated = {sensor.id: sensor.deviation_deg for sensor in config.sensor if sensor.deviation_deg is not None}
    return {sensor: value for sensor, value in stated.items() if value or not is_old}


def claimed_m(fix: Fix, sensor: SensorTable) -> tuple[float, float]:
    """1-sigma (east, north) of a fix, m: what the receiver says (GST), else by its quality times HDOP.

    An HDOP below 0.8 is no promise: receivers that count every satellite they see state 0.5.
    """
    if fix.sigma_east_m is not None and fix.sigma_north_m is not None:
        return fix.sigma_east_m, fix.sigma_north_m
    by_quality = {2: sensor.sigma_dgps_m, 4: sensor.sigma_rtk_m, 5: sensor.sigma_float_m}
    usual_m = sensor.sigma_m if fix.fix_quality is None else by_quality.get(fix.fix_quality) or sensor.sigma_m
    sigma_m = usual_m * (1.0 if fix.hdop is None else max(fix.hdop, LEAST_HDOP))
    return sigma_m, sigma_m


def _motion(fix: Fix) -> tuple[tuple[float, float] | None, float | None]:
    """Velocity (east, north) in m/s, and course in rad where the speed is high enough for one."""
    if fix.sog_kn is None or not math.isfinite(fix.sog_kn):
        return None, None
    if fix.cog_true_deg is None or not math.isfinite(fix.cog_true_deg):
        # a receiver at rest leaves the course out
        return ((0.0, 0.0), None) if fix.sog_kn < STILL_KN else (None, None)
    course, speed = heading_rad(fix.cog_true_deg), fix.sog_kn * M_S_PER_KN
    velocity = speed * math.sin(course), speed * math.cos(course)
    return velocity, course if fix.sog_kn >= COURSE_AS_HEADING_FROM_KN else None
