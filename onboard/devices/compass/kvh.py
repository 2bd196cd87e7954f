"""KVH C100 compass and its family: NMEA, or KVH's own form.

Own form, magnetic, without checksum: `%AAAA,BBBB,CCCC` = pitch, roll, azimuth in tenths of a degree, four characters
each, a minus among them (GyroTrac; TracVision G4 manual, table G-4); or `%123.4`, the heading alone (C100; its start
character is not confirmed). Check a real C100 against this: what differs is refused as `form`.

NMEA: HDM, HDG, HDT as the family's manuals print them, with a comma too many. Older units send HDM without checksum.

The encoder speaks the own form of a C100, `%123.4` and CR: its fluxgate floats level and measures no tilt.
"""

import re
from typing import TYPE_CHECKING, Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import Heading
from common.units import NS_PER_MS
from onboard.devices.compass import sentences
from onboard.devices.compass.driver import CompassDriver
from onboard.devices.compass.encoder import magnetic_deg
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings

if TYPE_CHECKING:
    from common.simulation.readings import HeadingReading

_TENTHS = rb"([0-9]{4}|-[0-9]{3})"
_OWN = re.compile(rb"%(?:" + _TENTHS + rb"," + _TENTHS + rb",)?([0-9]{4}|[0-9]{3}\.[0-9])")
_BARE = re.compile(rb"\$HCHDM,([0-9]{3}\.[0-9]),M,?")
LONGEST_OWN: Final = 64


class KvhDriver:
    """One KVH compass.

    A line without checksum is taken where it has its one form to the character: number of digits, places of point and
    commas, nothing before or after. **The risk**: a digit changed into another digit cannot be seen, so on a noisy
    cable a heading may be wrong; fault detection ashore is the only guard. Set the unit to NMEA with checksum if it
    has one. An HDM without checksum is taken only until the unit has sent a right checksum: from then on a line
    without one is one that lost it.
    """

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._latency_ns = round(table.latency_ms * NS_PER_MS)
        self._nmea = CompassDriver(table, sentences.KVH)
        self._has_checksum = False

    def claims(self, line: Line) -> bool:
        """Lines with `%`, and HDG, HDM, HDT of the talkers configured."""
        return line.data.startswith(b"%") or self._nmea.claims(line)

    def feed(self, line: Line) -> Outcome:
        """Decode one line: reasons of `CompassDriver.feed`; of KVH's own lines `too-long`, `form` and `range`."""
        if line.data.startswith(b"%"):
            return self._own(line)
        bare = None if self._has_checksum else _BARE.fullmatch(line.data)
        if bare is None:
            outcome = self._nmea.feed(line)
            self._has_checksum |= isinstance(outcome, Accepted)
            return outcome
        return self._heading(line, "HDM", _tenths(bare[1].replace(b".", b"")), None, None)

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a heading never waits."""
        return ()

    def _own(self, line: Line) -> Outcome:
        if len(line.data) > LONGEST_OWN:
            return Rejected("too-long", self.sensor)
        match = _OWN.fullmatch(line.data)
        # With attitude the azimuth is in tenths like the rest, alone it has its point.
        if match is None or (match[1] is None) != (b"." in match[3]):
            return Rejected("form", self.sensor)
        pitch_deg = None if match[1] is None else _tenths(match[1])
        roll_deg = None if match[2] is None else _tenths(match[2])
        return self._heading(line, "KVH", _tenths(match[3].replace(b".", b"")), pitch_deg, roll_deg)

    def _heading(
        self, line: Line, kind: str, heading_deg: float, pitch_deg: float | None, roll_deg: float | None
    ) -> Outcome:
        if heading_deg > 360.0 or abs(pitch_deg or 0.0) > 90.0 or abs(roll_deg or 0.0) > 180.0:
            return Rejected("range", self.sensor)
        heading = Heading(
            sensor=self.sensor,
            t_ns=whole_us(line.t_ns - self._latency_ns),
            heading_mag_deg=0.0 if heading_deg == 360.0 else heading_deg,
            pitch_deg=pitch_deg,
            roll_deg=roll_deg,
        )
        return Accepted(self.sensor, kind, (heading,))


class KvhEncoder:
    """A C100 with KVH's own output: the magnetic heading and nothing else."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:  # noqa: ARG002  its line has no talker
        self._variation_deg = around.variation_deg

    def encode(self, t_s: float, reading: "HeadingReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """One line that CR alone ends."""
        return b"%%%05.1f\r" % magnetic_deg(reading, self._variation_deg)


def _tenths(text: bytes) -> float:
    return int(text) / 10.0
