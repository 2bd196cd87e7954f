"""ArduIMU V3 inertial unit (MPU-6000, HMC5883L), text of firmware 1.9: `!!!KEY:value,KEY:value***`.

The line has no checksum, so the grammar is strict: both marks, only `KEY:number` between single commas, no key twice,
every value in its range, the six sensor values and the nine of the matrix all or none, the matrix a rotation. A digit
lost inside a number still cannot be seen. Tolerated, because real units send it: one blank after a comma, one comma
before the end mark (the switches of the firmware leave it), the first `!` lost at the start of a transmission, and
further ones where the line still begins with its whole `VER:`.

Variants: one puts `;` between the pairs. A fork prints the groups on lines of their own, without any mark: of these
only the attitude group is taken, and only when it is the whole line with two decimals in every angle: a cut line is
one decimal short or a key short.

Attitude comes from RLL, PCH, YAW; without them from the matrix EX0..EX8 (`onboard.devices.inertial.rotation`).
MGH is skipped (degrees in some firmware, radians in other), and so is all of the unit's own receiver (LAT, LON, ALT,
COG, SOG, FIX, SAT, TOW): their units differ by receiver and are not confirmed; the boat's receiver is a sensor of its
own.

Signs of the AN values: gyro + clockwise seen along its axis, so z (down) is + for bow to starboard. The stock firmware
prints the accelerometer as gravity, minus the specific force along forward, starboard, down (its matrix filter wants it
so: `SENSOR_SIGN`, and `AN_OFFSET[5]` keeps 1 g): a level unit at rest has AN5 = +4096, a boat gathering way AN3 < 0.
Altered firmware prints the specific force itself, AN5 = -4096 at rest. A boat floats upright, so AN5 tells which of the
two it is, over the last samples (`SIGN_SAMPLES`); ours is the specific force.

The encoder is the stock firmware with the analogs and the attitude switched on, without magnetometer and receiver.
"""

import math
import re
from typing import TYPE_CHECKING, Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import ImuSample, Measurement
from common.messages import Attitude
from common.units import NS_PER_MS, STANDARD_GRAVITY_M_S2
from onboard.devices.driver import Accepted, Ignored, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings, fixed
from onboard.devices.inertial import rotation
from onboard.devices.inertial.rotation import Angles
from onboard.devices.nmea_sentence import LONGEST_SENTENCE

if TYPE_CHECKING:
    from common.simulation.readings import ImuReading

GYRO_COUNTS_PER_DEG_S: Final = 16.4
ACCEL_COUNTS_PER_G: Final = 4096.0
_COUNTS_PER_M_S2: Final = ACCEL_COUNTS_PER_G / STANDARD_GRAVITY_M_S2
SIGN_SAMPLES: Final = 20
"""Number of samples in a row of the other sign that turn the reading of the accelerometer: a fall off a wave does
not."""
UPRIGHT_COUNTS: Final = 0.5 * ACCEL_COUNTS_PER_G
"""A smaller AN5 says nothing of its sign."""
HEALTHY: Final = 253.0
"""Value of IMUH when the unit reports no fault."""

_ANGLE = r"-?[0-9]{1,3}\.[0-9]{2}"
_ATTITUDE_GROUP = re.compile(rf"RLL:{_ANGLE},PCH:{_ANGLE},YAW:{_ANGLE}(?:,IMUH:[0-9]{{1,3}})?,?")
_ATTITUDE_KEY = re.compile(rb"(?:^|,)(?:RLL|PCH|YAW):")
_KEY = re.compile(r"[A-Z][A-Z0-9]{1,3}")
_NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?")
_VERSION = re.compile(r"[0-9]+(?:\.[0-9]+)*")
_INT16: Final = (-32768.0, 32767.0)
_ANALOG_KEYS: Final = ("AN0", "AN1", "AN2", "AN3", "AN4", "AN5")
"""Gyro x, y, z, accelerometer x, y, z in counts; x forward, y starboard, z down."""
_MATRIX_KEYS: Final = tuple(f"EX{place}" for place in range(9))
"""Direction cosine matrix, row by row."""
_EULER_KEYS: Final = frozenset({"RLL", "PCH", "YAW"})
_RANGES: Final = {
    **dict.fromkeys((*_ANALOG_KEYS, "MGX", "MGY", "MGZ"), _INT16),
    **dict.fromkeys(_MATRIX_KEYS, (-rotation.LARGEST_ELEMENT, rotation.LARGEST_ELEMENT)),
    "RLL": (-180.0, 180.0),
    "PCH": (-90.0, 90.0),
    "YAW": (-180.0, 180.0),
    "IMUH": (0.0, 255.0),
}
_ATTITUDE_KEYS: Final = _EULER_KEYS | {"MGX", "MGY", "MGZ", *_MATRIX_KEYS}


class ArduImuDriver:
    """One ArduIMU: an ImuSample where the analogs are switched on, an Attitude where the line has any of it."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._latency_ns = round(table.latency_ms * NS_PER_MS)
        self._as_gravity = 0
        """Samples that showed the accelerometer as gravity, less those that showed it as specific force."""

    def claims(self, line: Line) -> bool:
        """Lines with the start or the end mark, and those without marks that hold an attitude key.

        The performance report `PPP...***` and the start-up text `???Welcome...***` are among the former. A line that
        begins like a sentence (`$`, `!AIVDM`, tag block) is never taken for one without marks.
        """
        if line.data.startswith(b"!!") or line.data.endswith(b"***"):
            return True
        return line.data[:1] not in (b"$", b"!", b"\\") and _ATTITUDE_KEY.search(line.data) is not None

    def feed(self, line: Line) -> Outcome:
        """Decode one line.

        Reasons: `too-long`, `not-ascii`, `marks` (start or end mark missing), `fields` (not KEY:value; analogs or
        matrix incomplete; a line without marks that is not exactly the attitude group), `duplicate`, `not-a-number`,
        `range`, `rotation` (the matrix is none). Other text, the performance report and lines without any key of
        interest are ignored.
        """
        body = _body(line.data)
        if isinstance(body, Ignored):
            return body
        if body is None:
            return Rejected(_shape_fault(line.data), self.sensor)
        values = _values(body)
        if isinstance(values, str):
            return Rejected(values, self.sensor)
        if not all(_all_or_none(keys, values) for keys in (_ANALOG_KEYS, _MATRIX_KEYS)):
            return Rejected("fields", self.sensor)
        has_attitude = not values.keys().isdisjoint(_ATTITUDE_KEYS)
        if not has_attitude and "AN0" not in values:
            return Ignored("ArduIMU")
        t_ns = whole_us(line.t_ns - self._latency_ns)
        measurements: list[Measurement] = []
        if "AN0" in values:
            measurements.append(_sample(self.sensor, t_ns, values, self._accel_sign(values["AN5"])))
        if has_attitude or values.get("IMUH", HEALTHY) != HEALTHY:
            attitude = _attitude(self.sensor, t_ns, values)
            if attitude is None:
                return Rejected("rotation", self.sensor)
            measurements.append(attitude)
        return Accepted(self.sensor, "ArduIMU", tuple(measurements))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a sample never waits."""
        return ()

    def _accel_sign(self, down_counts: float) -> float:
        """-1 where the unit prints gravity (stock firmware), +1 where it prints specific force; see the module."""
        if abs(down_counts) >= UPRIGHT_COUNTS:
            vote = 1 if down_counts > 0 else -1
            self._as_gravity = max(-SIGN_SAMPLES // 2, min(SIGN_SAMPLES // 2, self._as_gravity + vote))
        return -1.0 if self._as_gravity >= 0 else 1.0


class ArduImuEncoder:
    """An ArduIMU V3 with raw counts. `YAW` is its own integral of its gyro from 0; `TOW:0` = no receiver attached."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:  # noqa: ARG002  it knows nothing of the world
        self._yaw_deg = 0.0
        self._t_s: float | None = None

    def encode(self, t_s: float, reading: "ImuReading") -> bytes:
        """One line; the sample covers the interval that ends at `t_s`. An attitude of `None` is printed as level."""
        rates = (reading.roll_rate_deg_s, reading.pitch_rate_deg_s, reading.yaw_rate_deg_s)
        forces = (reading.accel_fwd_m_s2, reading.accel_stb_m_s2, reading.accel_down_m_s2)
        counts = [_counts(rate * GYRO_COUNTS_PER_DEG_S) for rate in rates]
        counts += [_counts(-force * _COUNTS_PER_M_S2) for force in forces]
        if self._t_s is not None:
            turned_deg = counts[2] / GYRO_COUNTS_PER_DEG_S * (t_s - self._t_s)
            self._yaw_deg = math.remainder(self._yaw_deg + turned_deg, 360.0)
        self._t_s = t_s
        analogs = ",".join(f"{key}:{count}" for key, count in zip(_ANALOG_KEYS, counts, strict=True))
        attitude = f"RLL:{fixed(reading.roll_deg or 0.0, 2)},PCH:{fixed(reading.pitch_deg or 0.0, 2)}"
        text = f"!!!VER:1.9,{analogs},{attitude},YAW:{self._yaw_deg:.2f},IMUH:{HEALTHY:.0f},TOW:0***\r\n"
        return text.encode("ascii")


def _counts(value: float) -> int:
    """A 16-bit converter rounds, and saturates."""
    return max(-32768, min(32767, round(value)))


def _body(data: bytes) -> str | Ignored | None:
    """What stands between the marks; `None` = damaged."""
    if data.startswith(b"PPP"):
        return Ignored("performance")
    if data.startswith(b"???"):
        return Ignored("text")
    if len(data) > LONGEST_SENTENCE or not data.isascii():
        return None
    text = data.decode("ascii")
    if not text.startswith("!!") and not text.endswith("***"):
        return _unmarked(text)
    content = text.lstrip("!")
    marks = len(text) - len(content)
    if not text.endswith("***") or (marks < 2 and not content.startswith("VER:")):
        return None
    body = text[min(marks, 3) : -3]
    if ";" in body and "," not in body:
        body = body.replace(";", ",")
    return body.removesuffix(",")


def _unmarked(text: str) -> str | Ignored:
    """The attitude group of the fork that sends no marks; damage to it becomes a body that no reader accepts."""
    if _ATTITUDE_KEY.search(text.encode("ascii")) is None:
        return Ignored("text")
    return text.removesuffix(",") if _ATTITUDE_GROUP.fullmatch(text) else ""


def _shape_fault(data: bytes) -> str:
    if len(data) > LONGEST_SENTENCE:
        return "too-long"
    return "marks" if data.isascii() else "not-ascii"


def _values(body: str) -> dict[str, float] | str:
    """Key -> number of all pairs (VER, which is text, left out), or the reason why the line is refused."""
    values: dict[str, float] = {}
    seen_version = False
    for pair in body.split(","):
        key, colon, text = pair.removeprefix(" ").partition(":")
        if not colon or not _KEY.fullmatch(key):
            return "fields"
        if key == "VER":
            if seen_version:
                return "duplicate"
            if not _VERSION.fullmatch(text):
                return "not-a-number"
            seen_version = True
            continue
        if key in values:
            return "duplicate"
        if not _NUMBER.fullmatch(text):
            return "not-a-number"
        value = float(text)
        limits = _RANGES.get(key)
        if limits is not None and not limits[0] <= value <= limits[1]:
            return "range"
        values[key] = value
    return values


def _all_or_none(keys: tuple[str, ...], values: dict[str, float]) -> bool:
    return values.keys().isdisjoint(keys) or all(key in values for key in keys)


def _sample(sensor: str, t_ns: int, values: dict[str, float], accel_sign: float) -> ImuSample:
    # z points down, so a right-hand turn about it carries the bow to starboard: the sign of ours.
    return ImuSample(
        sensor=sensor,
        t_ns=t_ns,
        accel_fwd_m_s2=accel_sign * values["AN3"] / ACCEL_COUNTS_PER_G * STANDARD_GRAVITY_M_S2,
        accel_stb_m_s2=accel_sign * values["AN4"] / ACCEL_COUNTS_PER_G * STANDARD_GRAVITY_M_S2,
        yaw_rate_deg_s=values["AN2"] / GYRO_COUNTS_PER_DEG_S,
    )


def _attitude(sensor: str, t_ns: int, values: dict[str, float]) -> Attitude | None:
    """`None` = the matrix is no rotation."""
    euler = Angles(values.get("RLL"), values.get("PCH"), values.get("YAW"))
    if "EX0" in values:
        turned = rotation.angles([values[key] for key in _MATRIX_KEYS])
        if turned is None:
            return None
        if values.keys().isdisjoint(_EULER_KEYS):
            euler = turned
    health = values.get("IMUH", HEALTHY)
    return Attitude(
        sensor=sensor,
        t_ns=t_ns,
        roll_deg=euler.roll_deg,
        pitch_deg=euler.pitch_deg,
        yaw_deg=euler.yaw_deg,
        mag_fwd_counts=values.get("MGX"),
        mag_stb_counts=values.get("MGY"),
        mag_down_counts=values.get("MGZ"),
        warning=None if health == HEALTHY else f"IMUH {health:g}",
    )
