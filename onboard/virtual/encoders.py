"""Device encoders of the virtual boat: a reading as bytes, and the values that a driver reads back from them."""

from dataclasses import dataclass
from typing import Final

from common.boat_config import SensorTable
from common.framer import ImuSample, Measurement
from common.messages import Fix, Heading
from common.simulation.readings import FixReading, HeadingReading, ImuReading, Reading
from onboard.devices import Accepted, Line, make_driver
from onboard.devices.encoder import Surroundings
from onboard.devices.registry import make_encoder

Values = dict[str, float | int | None]

_TABLES: Final = {
    FixReading: SensorTable(id="gps1", port="gps", role="gps"),
    HeadingReading: SensorTable(id="compass1", port="compass", role="compass", model="hsc100"),
    ImuReading: SensorTable(id="imu1", port="imu", role="imu", model="arduimu"),
}
_VALUES: Final = {
    Fix: ("lat_deg", "lon_deg", "sog_kn", "cog_true_deg", "utc_ns"),
    Heading: ("heading_mag_deg",),
    ImuSample: ("accel_fwd_m_s2", "accel_stb_m_s2", "yaw_rate_deg_s"),
}
_LONG_AFTER_NS: Final = 10**12


@dataclass(frozen=True, slots=True)
class Encoded:
    """One measurement as bytes: one line, or all sentences of a receiver's epoch."""

    data: bytes
    kind: str
    """Class name of the measurement a decoder makes of it."""
    values: Values
    """What a decoder can get back, under the names of `common.messages`."""


class BoatEncoders:
    """The three devices of the virtual boat."""

    def __init__(self, around: Surroundings) -> None:
        self._encoders = {kind: make_encoder(table, around) for kind, table in _TABLES.items()}

    def encode(self, t_s: float, reading: Reading) -> Encoded:
        """Hand the reading to the device that makes such readings."""
        encoder = self._encoders.get(type(reading))
        if encoder is None:
            raise TypeError(f"this boat has no device for a {type(reading).__name__}")
        data = encoder.encode(t_s, reading)
        measurement = _read(_TABLES[type(reading)], data)
        values = {name: getattr(measurement, name) for name in _VALUES[type(measurement)]}
        return Encoded(data, type(measurement).__name__, values)


def _read(table: SensorTable, data: bytes) -> Fix | Heading | ImuSample:
    """The measurement in the lines of one reading."""
    driver = make_driver(table)
    found: list[Measurement] = []
    for line in data.splitlines():
        outcome = driver.feed(Line(0, line))
        found += outcome.measurements if isinstance(outcome, Accepted) else ()
    found += driver.flush(_LONG_AFTER_NS, 0)
    return next(item for item in found if isinstance(item, Fix | Heading | ImuSample))
