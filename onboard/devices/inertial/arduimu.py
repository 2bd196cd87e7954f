"""ArduIMU V3 (MPU-6000 and HMC5883L), text output of firmware 1.9: `!!!KEY:value,KEY:value***`.

The line has no checksum, so the grammar is strict: both marks, only `KEY:number` between single commas, no key twice,
every value in its range, the six sensor values all or none. A digit lost inside a number still cannot be seen.
Tolerated, because real units send it: one blank after a comma, one comma before the end mark (the switches of the
firmware leave it), and a first `!` lost at the start of a transmission, provided that the rest is whole.
"""

import re
from typing import Final

from common.clock import whole_us
from common.messages import Attitude
from common.sensors import SensorTable
from common.units import NS_PER_MS, STANDARD_GRAVITY_M_S2
from onboard.devices.base import Accepted, Ignored, ImuSample, Line, Measurement, Outcome, Rejected
from onboard.devices.sentence import LONGEST_SENTENCE

GYRO_COUNTS_PER_DEG_S: Final = 16.4
ACCEL_COUNTS_PER_G: Final = 4096.0
HEALTHY: Final = 253.0
"""IMUH of a unit that has nothing to complain of."""

_KEY = re.compile(r"[A-Z][A-Z0-9]{1,3}")
_NUMBER = re.compile(r"-?[0-9]+(?:\.[0-9]+)?")
_VERSION = re.compile(r"[0-9]+(?:\.[0-9]+)*")
_INT16: Final = (-32768.0, 32767.0)
_ANALOG_KEYS: Final = ("AN0", "AN1", "AN2", "AN3", "AN4", "AN5")
"""Gyro x, y, z, accelerometer x, y, z in counts; x forward, y starboard, z down."""
_RANGES: Final = {
    **dict.fromkeys((*_ANALOG_KEYS, "MGX", "MGY", "MGZ"), _INT16),
    "RLL": (-180.0, 180.0),
    "PCH": (-90.0, 90.0),
    "YAW": (-180.0, 180.0),
    "IMUH": (0.0, 255.0),
}
_ATTITUDE_KEYS: Final = frozenset({"RLL", "PCH", "YAW", "MGX", "MGY", "MGZ"})


class ArduImuDriver:
    """One ArduIMU: an ImuSample where the analogs are switched on, an Attitude where the line has any of it."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._latency_ns = round(table.latency_ms * NS_PER_MS)

    def claims(self, line: Line) -> bool:
        """Lines with the start or the end mark; the performance report `PPP...***` is among them."""
        return line.data.startswith(b"!!") or line.data.endswith(b"***")

    def feed(self, line: Line) -> Outcome:
        """Decode one line.

        Reasons: `too-long`, `not-ascii`, `marks` (start or end mark missing), `fields` (not KEY:value, or analogs
        incomplete), `duplicate`, `not-a-number`, `range`. Text without marks, the performance report and lines
        without any key of interest are ignored.
        """
        body = _body(line.data)
        if isinstance(body, Ignored):
            return body
        if body is None:
            return Rejected(_shape_fault(line.data), self.sensor)
        values = _values(body)
        if isinstance(values, str):
            return Rejected(values, self.sensor)
        t_ns = whole_us(line.t_ns - self._latency_ns)
        measurements: list[Measurement] = []
        if not values.keys().isdisjoint(_ANALOG_KEYS):
            if not all(key in values for key in _ANALOG_KEYS):
                return Rejected("fields", self.sensor)
            measurements.append(_sample(self.sensor, t_ns, values))
        elif values.keys().isdisjoint(_ATTITUDE_KEYS):
            return Ignored("ArduIMU")
        if not values.keys().isdisjoint(_ATTITUDE_KEYS) or values.get("IMUH", HEALTHY) != HEALTHY:
            measurements.append(_attitude(self.sensor, t_ns, values))
        return Accepted(self.sensor, "ArduIMU", tuple(measurements))

    def flush(self, now_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a sample never waits."""
        return ()


def _body(data: bytes) -> str | Ignored | None:
    """What stands between the marks; `None` = damaged."""
    if data.startswith(b"PPP"):
        return Ignored("performance")
    if not data.startswith(b"!!") and not data.endswith(b"***"):
        return Ignored("text")
    if len(data) > LONGEST_SENTENCE or not data.isascii() or not data.startswith(b"!!") or not data.endswith(b"***"):
        return None
    return data[3 if data.startswith(b"!!!") else 2 : -3].decode("ascii").removesuffix(",")


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


def _sample(sensor: str, t_ns: int, values: dict[str, float]) -> ImuSample:
    # z points down, so a right-hand turn about it carries the bow to starboard: the sign of ours.
    return ImuSample(
        sensor=sensor,
        t_ns=t_ns,
        accel_fwd_m_s2=values["AN3"] / ACCEL_COUNTS_PER_G * STANDARD_GRAVITY_M_S2,
        accel_stb_m_s2=values["AN4"] / ACCEL_COUNTS_PER_G * STANDARD_GRAVITY_M_S2,
        yaw_rate_deg_s=values["AN2"] / GYRO_COUNTS_PER_DEG_S,
    )


def _attitude(sensor: str, t_ns: int, values: dict[str, float]) -> Attitude:
    health = values.get("IMUH", HEALTHY)
    return Attitude(
        sensor=sensor,
        t_ns=t_ns,
        roll_deg=values.get("RLL"),
        pitch_deg=values.get("PCH"),
        yaw_deg=values.get("YAW"),
        mag_fwd_counts=values.get("MGX"),
        mag_stb_counts=values.get("MGY"),
        mag_down_counts=values.get("MGZ"),
        warning=None if health == HEALTHY else f"IMUH {health:g}",
    )
