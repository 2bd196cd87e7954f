"""TinkerKit rate gyro read by an Arduino, in the line of our own sketch (`deploy/arduino/`, which documents it too).

    $PWFXG,<millis>,<status>,<rate>,<samples>*hh

`millis`: milliseconds since the Arduino started, wraps at 2^32. `status`: Z zeroing (no rate yet), A measured,
S saturated. `rate`: yaw rate in milli-degrees a second, whole number, + clockwise seen from above (bow to starboard);
empty while zeroing. `samples`: how many conversions the rate is the mean of. Checksum as in every sentence.

The time of a TurnRate is the arrival of its line less the latency: `millis` is not on the boat's clock and is only
checked for its form.
"""

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import TurnRate
from common.units import NS_PER_MS
from onboard.devices import nmea_fields as fields
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings, sealed
from onboard.devices.nmea_fields import FieldFault
from onboard.devices.nmea_parser import Form, Text
from onboard.devices.nmea_sentence import check_sentence

if TYPE_CHECKING:
    from common.simulation.readings import TurnRateReading

NAME: Final = "PWFXG"
LARGEST_RATE_MDEG_S: Final = 2_000_000
"""The chip's full scale is 1500 deg/s."""

_FULL_SCALE_MDEG_S: Final = 1_500_000
"""Rate beyond which the sketch calls the module that is not amplified saturated."""
_SAMPLES: Final = 440
"""Conversions of the sketch in the 50 ms of a line."""

_ADDRESS = re.compile(rb"\$PWFXG(?:[,*]|$)")
_WHOLE = re.compile(r"-?[0-9]{1,10}")


@dataclass(frozen=True, slots=True)
class GyroReading:
    """One line; `rate_mdeg_s` is `None` while the sketch measures its zero."""

    status: str
    rate_mdeg_s: int | None


def _whole(text: str, low: int, high: int) -> int:
    if not _WHOLE.fullmatch(text):
        raise FieldFault("not-a-number" if text else "fields")
    if not low <= int(text) <= high:
        raise FieldFault("range")
    return int(text)


def _gyro(text: Text) -> GyroReading:
    status = fields.letter(text("status"), "ZAS", "status")
    if status is None or (status == "Z") != (text("rate") == ""):
        raise FieldFault("fields")
    _whole(text("millis"), 0, 2**32 - 1)
    _whole(text("samples"), 1, 65_535)
    if status == "Z":
        return GyroReading(status, None)
    limit = LARGEST_RATE_MDEG_S if status == "A" else 2**31
    return GyroReading(status, _whole(text("rate"), -limit, limit))


FORMS: Final[dict[str, Form[GyroReading]]] = {NAME: Form(4, 4, _gyro, ("millis", "status", "rate", "samples"))}


class TinkerKitDriver:
    """One gyro: a TurnRate for each measured line."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._latency_ns = round(table.latency_ms * NS_PER_MS)

    def claims(self, line: Line) -> bool:
        """Claims the sentences `$PWFXG`."""
        return _ADDRESS.match(line.data) is not None

    def feed(self, line: Line) -> Outcome:
        """Decode one line; a zeroing line is accepted without a measurement.

        Beside the reasons of `check_sentence`: `fields` (their number; no status, or a rate that does not go with it),
        `status`, `not-a-number`, `range`, `saturated`.
        """
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        if not self.claims(line):
            return Rejected("formatter", self.sensor)
        # A maker's own sentence has no formatter of three letters; its whole address stands in for it.
        reading = nmea.read(replace(sentence, formatter=NAME), FORMS)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        if reading.status == "S":
            return Rejected("saturated", self.sensor)
        if reading.rate_mdeg_s is None:
            return Accepted(self.sensor, NAME)
        t_ns = whole_us(line.t_ns - self._latency_ns)
        rate = TurnRate(sensor=self.sensor, t_ns=t_ns, rate_deg_s=reading.rate_mdeg_s / 1000.0)
        return Accepted(self.sensor, NAME, (rate,))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a rate never waits."""
        return ()


class TinkerKitEncoder:
    """The sketch after its zeroing, with the module that is not amplified: it measures up to 1500 deg/s."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        """Nothing of the two is in the line."""

    def encode(self, t_s: float, reading: "TurnRateReading") -> bytes:
        """One line; the Arduino starts at t = 0."""
        rate_mdeg_s = round(reading.rate_deg_s * 1000.0)
        status = "A" if abs(rate_mdeg_s) <= _FULL_SCALE_MDEG_S else "S"
        return sealed(f"{NAME},{round(t_s * 1000.0) % 2**32},{status},{rate_mdeg_s},{_SAMPLES}")
