"""PNI TCM2, TCM2.5, TCM2.6 compasses, and what sends the same words (OceanServer OS500).

`$C<heading>P<pitch>R<roll>X<Bx>Y<By>Z<Bz>T<temperature>E<code>*hh`: order fixed, any group may be switched off, the
checksum is NMEA's. Heading, pitch and roll in degrees with one decimal, pitch + front edge up, roll + right edge down;
field in microtesla (user manual of the TCM2.5/2.6, pages 12-14 and 19). The device may instead send NMEA: `$HCHDM`.

Leave the device at degrees, Celsius and magnetic north. Mils are recognised (they have no decimal) and refused. The
line does not say whether its heading was turned to true north, nor whether 60 is Celsius or Fahrenheit: it is taken as
magnetic, and as Celsius.

The encoder has field and temperature switched off, and pitch or roll where the reading has none.
"""

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import Attitude, Heading
from common.units import NS_PER_MS
from onboard.devices import nmea_fields as fields
from onboard.devices.compass import sentences
from onboard.devices.compass.driver import CompassDriver
from onboard.devices.compass.encoder import magnetic_deg
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings, fixed, sealed
from onboard.devices.nmea_fields import FieldFault
from onboard.devices.nmea_sentence import address, check_sentence, sentence_of

if TYPE_CHECKING:
    from common.simulation.readings import HeadingReading

FIELD_LIMIT_UT: Final = 1000.0
"""Largest magnetic field on each axis, microtesla; the device saturates at a tenth of it."""
TEMPERATURES_C: Final = (-40.0, 70.0)
"""The device's own range; a value outside is in Fahrenheit, or wrong, and is left out."""
_OUT_OF_RANGE: Final = 0x002 | 0x004
"""Bits of the error code: inclinometer and magnetometer out of range. The manual says to disregard the angles then."""

_SHAPE = re.compile(rb"\$[CPRXYZTE]-?[0-9]")
_GROUPS = re.compile(
    r"\$" + "".join(rf"(?:{tag}([0-9.-]*))?" for tag in "CPRXYZT") + r"(?:E([0-9A-F]{3}))?\*[0-9A-Fa-f]{2}"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """One output word; `None` = not in it."""

    heading_mag_deg: float | None
    pitch_deg: float | None
    roll_deg: float | None
    field_ut: float | None
    temperature_c: float | None
    warning: str | None


class Tcm2Driver:
    """One TCM2: a Heading for each word that has one, else an Attitude."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._latency_ns = round(table.latency_ms * NS_PER_MS)
        self._nmea = CompassDriver(table, sentences.TCM2)

    def claims(self, line: Line) -> bool:
        """Claims the device's own words, and HDM of the talkers configured."""
        own = _SHAPE.match(sentence_of(line.data)) is not None and address(line.data) is None
        return own or self._nmea.claims(line)

    def feed(self, line: Line) -> Outcome:
        """Decode one line.

        Beside the reasons of `check_sentence`: `fields` (a group unknown, twice or out of order), `not-a-number`,
        `range`, `unit` (an angle without decimal: mils), `alarm` (inclinometer or magnetometer out of range), `empty`
        (neither heading nor attitude in it). Another error code, such as E001 for a magnetic anomaly nearby, is the
        warning of the measurement.
        """
        if self._nmea.claims(line):
            return self._nmea.feed(line)
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        try:
            word = read_word(sentence.text)
        except FieldFault as fault:
            return Rejected(fault.reason, self.sensor)
        t_ns = whole_us(line.t_ns - self._latency_ns)
        if word.heading_mag_deg is not None:
            return Accepted(self.sensor, "TCM2", (_heading(self.sensor, t_ns, word),))
        if word.pitch_deg is None and word.roll_deg is None:
            return Rejected("empty", self.sensor)
        return Accepted(self.sensor, "TCM2", (_attitude(self.sensor, t_ns, word),))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a heading never waits."""
        return ()


class Tcm2Encoder:
    """`$C309.8P4.0R-2.9*hh`, with `E001` before the star where the device notices a distortion."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:  # noqa: ARG002  its word has no talker
        self._variation_deg = around.variation_deg

    def encode(self, t_s: float, reading: "HeadingReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """One output word, degrees to a tenth: without a decimal they would be mils."""
        angles = (("C", magnetic_deg(reading, self._variation_deg)), ("P", reading.pitch_deg), ("R", reading.roll_deg))
        groups = "".join(f"{tag}{fixed(value, 1)}" for tag, value in angles if value is not None)
        return sealed(f"{groups}E001" if reading.disturbed else groups)


def read_word(text: str) -> Word:
    """Read `$...*hh`, its checksum being right.

    Raises FieldFault; `alarm` only for a word that is good otherwise.
    """
    match = _GROUPS.fullmatch(text)
    if match is None:
        raise FieldFault("fields")
    heading, pitch, roll, *strengths, temperature, code = match.groups()
    heading_deg = _angle(heading, 0.0, 360.0)
    word = Word(
        heading_mag_deg=0.0 if heading_deg == 360.0 else heading_deg,
        pitch_deg=_angle(pitch, -sentences.PITCH_LIMIT_DEG, sentences.PITCH_LIMIT_DEG),
        roll_deg=_angle(roll, -sentences.ROLL_LIMIT_DEG, sentences.ROLL_LIMIT_DEG),
        field_ut=_strength([_value(axis, -FIELD_LIMIT_UT, FIELD_LIMIT_UT) for axis in strengths]),
        temperature_c=_temperature(temperature),
        warning=None if code in (None, "000") else f"E{code}",
    )
    if code and int(code, 16) & _OUT_OF_RANGE:
        raise FieldFault("alarm")
    return word


def _value(text: str | None, low: float, high: float) -> float | None:
    """`None` = the group is switched off; a letter without a number is a fault."""
    if text is None:
        return None
    value = fields.number(text, low, high)
    if value is None:
        raise FieldFault("not-a-number")
    return value


def _angle(text: str | None, low: float, high: float) -> float | None:
    value = _value(text, low, high)
    if text is not None and "." not in text:
        raise FieldFault("unit")
    return value


def _temperature(text: str | None) -> float | None:
    value = _value(text, -1000.0, 1000.0)
    return None if value is None or not TEMPERATURES_C[0] <= value <= TEMPERATURES_C[1] else value


def _strength(axes: list[float | None]) -> float | None:
    """Microtesla; `None` too where all three are 0, which no place on earth has."""
    known = [axis for axis in axes if axis is not None]
    return (math.hypot(*known) or None) if len(known) == 3 else None


def _heading(sensor: str, t_ns: int, word: Word) -> Heading:
    return Heading(
        sensor=sensor,
        t_ns=t_ns,
        heading_mag_deg=word.heading_mag_deg,
        pitch_deg=word.pitch_deg,
        roll_deg=word.roll_deg,
        field_ut=word.field_ut,
        temperature_c=word.temperature_c,
        warning=word.warning,
    )


def _attitude(sensor: str, t_ns: int, word: Word) -> Attitude:
    return Attitude(sensor=sensor, t_ns=t_ns, pitch_deg=word.pitch_deg, roll_deg=word.roll_deg, warning=word.warning)
