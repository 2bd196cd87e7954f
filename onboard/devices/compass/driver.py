"""NMEA compasses: any of them, Digital Yacht HSC100 and HSC100T, Honeywell HMR3000.

What a model sends is a table of forms in `sentences`; all of them need their checksum. Autonnic, who makes the HSC100's
electronics, can switch the checksum off (or put a serial number in its place): such lines are refused, turn it on.
"""

import re

from common.angles import wrap_deg
from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import Attitude, Heading, TurnRate
from common.units import NS_PER_MS
from onboard.devices import nmea_parser as nmea
from onboard.devices.compass import sentences
from onboard.devices.compass.duplicate_headings import OneSource
from onboard.devices.compass.sentences import AttitudeReading, Forms, HeadingReading, HprReading, TurnReading
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.nmea_sentence import Sentence, address, check_sentence, sentence_of

_OWN = re.compile(rb"\$(PTNT[A-Z]{3}),")
"""Honeywell's own sentences have no talker."""
_ANGLE = re.compile(rb",(?:%s)(?=[,*]|$)" % "|".join(sentences.ANGLE_NAMES).encode(), re.IGNORECASE)


class CompassDriver:
    """One compass; every measurement is valid at the arrival of its line's first byte less the latency.

    Deviation and variation are handed on as sent; nothing is added to the heading here. A device that sends several
    heading sentences for one reading gives one Heading (`OneSource`); the others are accepted without measurement.

    HMR3000: PTNTHPR already has the deviation and variation programmed in the device added, and does not say so. What
    an HDG of the same device shows of them is taken off again, so that the heading is magnetic and the owner's numbers
    win ashore. Without HDG, an HDT with a heading shows that it is true. Do not program a variation into an HMR3000
    that sends PTNTHPR alone.

    HSC100: a fluxgate knows no variation; Autonnic's manual calls the number of its HDT the compass heading too. HDT is
    taken as true, as it says: leave these on HDG, unless the variation was put into the device's heading offset.
    """

    def __init__(self, table: SensorTable, forms: Forms = sentences.NMEA) -> None:
        self.sensor = table.id
        self._forms = forms
        self._talkers = frozenset(table.talkers)
        self._latency_ns = round(table.latency_ms * NS_PER_MS)
        self._headings = OneSource()
        self._turn_rates = OneSource()
        self._attitudes = OneSource()
        self._true_inside = False
        """True while an HDT shows that PTNTHPR is true, and no HDG shows by how much."""
        self._programmed = (0.0, 0.0)
        """Deviation and variation that the last HDG of the device showed, deg, east +."""

    def claims(self, line: Line) -> bool:
        """The model's sentences, of the talkers configured (none = all; a maker's own sentence has no talker).

        Weather stations send XDR too: only one that names a pitch or roll is a compass's.
        """
        talker, formatter = _address(line.data)
        if formatter not in self._forms or (talker and self._talkers and talker not in self._talkers):
            return False
        return formatter != "XDR" or _ANGLE.search(line.data) is not None

    def feed(self, line: Line) -> Outcome:
        """Decode one sentence.

        Beside the reasons of `check_sentence` and `nmea_parser.read`: `empty`, no value in it (the compass calibrates
        itself); `alarm`, the device refuses to give a heading (HMR3000 status letters); `void`, ROT with status V;
        `unit`, also mils or counts in place of degrees; `duplicate`, an XDR that names the same angle twice.
        """
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        talker, formatter = sentence.talker, sentence.formatter
        if not formatter:  # a maker's own
            talker, formatter = _address(line.data)
            sentence = Sentence(talker, formatter, sentence.text)
        reading = nmea.read(sentence, self._forms)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        source, t_ns = talker + formatter, whole_us(line.t_ns - self._latency_ns)
        match reading:
            case HeadingReading():
                measurements = self._heading(source, t_ns, reading)
            case HprReading():
                measurements = self._heading_and_attitude(source, t_ns, reading)
            case TurnReading():
                measurements = self._turn_rate(source, t_ns, reading)
            case AttitudeReading():
                measurements = self._attitude(source, t_ns, reading)
        if measurements is None:
            return Rejected("empty", self.sensor)
        return Accepted(self.sensor, formatter, measurements)

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a heading never waits."""
        return ()

    def _heading(self, source: str, t_ns: int, reading: HeadingReading) -> tuple[Measurement, ...] | None:
        if source == "HCHDG":
            self._programmed = reading.deviation_deg or 0.0, reading.variation_deg or 0.0
            self._true_inside = False
        elif source == "HCHDT":
            self._true_inside = reading.heading_true_deg is not None and not self._programmed[1]
        if reading.heading_mag_deg is None and reading.heading_true_deg is None:
            # An HMR3000 without variation sends HDT for ever empty beside the sentence that is used: no fault.
            return () if self._headings.covers(source, t_ns) else None
        if not self._headings.admits(source, sentences.RANK[source[2:]], t_ns):
            return ()
        heading = Heading(
            sensor=self.sensor,
            t_ns=t_ns,
            heading_mag_deg=reading.heading_mag_deg,
            heading_true_deg=reading.heading_true_deg,
            deviation_deg=reading.deviation_deg,
            variation_deg=reading.variation_deg,
        )
        return (heading,)

    def _heading_and_attitude(self, source: str, t_ns: int, reading: HprReading) -> tuple[Measurement, ...]:
        tilted = reading.pitch_deg is not None or reading.roll_deg is not None
        attitude_used = tilted and self._attitudes.admits(source, sentences.RANK[source], t_ns)
        if self._headings.admits(source, sentences.RANK[source], t_ns):
            deviation_deg, variation_deg = self._programmed
            mag_deg = reading.heading_deg
            if deviation_deg or variation_deg:
                mag_deg = round(wrap_deg(mag_deg - deviation_deg - variation_deg), 6)
            heading = Heading(
                sensor=self.sensor,
                t_ns=t_ns,
                heading_mag_deg=None if self._true_inside else mag_deg,
                heading_true_deg=reading.heading_deg if self._true_inside else None,
                deviation_deg=deviation_deg or None,
                variation_deg=variation_deg or None,
                pitch_deg=reading.pitch_deg,
                roll_deg=reading.roll_deg,
                warning=reading.warning,
            )
            return (heading,)
        if not attitude_used:
            return ()
        pitch_deg, roll_deg = reading.pitch_deg, reading.roll_deg
        return (
            Attitude(sensor=self.sensor, t_ns=t_ns, pitch_deg=pitch_deg, roll_deg=roll_deg, warning=reading.warning),
        )

    def _turn_rate(self, source: str, t_ns: int, reading: TurnReading) -> tuple[Measurement, ...] | None:
        if reading.rate_deg_s is None:
            return None
        if not self._turn_rates.admits(source, 0, t_ns):
            return ()
        return (TurnRate(sensor=self.sensor, t_ns=t_ns, rate_deg_s=reading.rate_deg_s),)

    def _attitude(self, source: str, t_ns: int, reading: AttitudeReading) -> tuple[Measurement, ...] | None:
        if reading.pitch_deg is None and reading.roll_deg is None:
            return None
        if not self._attitudes.admits(source, 0, t_ns):
            return ()
        return (Attitude(sensor=self.sensor, t_ns=t_ns, pitch_deg=reading.pitch_deg, roll_deg=reading.roll_deg),)


def hsc100(table: SensorTable) -> CompassDriver:
    """Digital Yacht HSC100 and HSC100T."""
    return CompassDriver(table, sentences.HSC100)


def hmr3000(table: SensorTable) -> CompassDriver:
    """Honeywell HMR3000."""
    return CompassDriver(table, sentences.HMR3000)


def _address(data: bytes) -> tuple[str, str]:
    """Talker and formatter; of a maker's own sentence no talker and the whole name; both empty = neither."""
    found = address(data)
    if found is not None:
        return found
    own = _OWN.match(sentence_of(data))
    return ("", "") if own is None else ("", own[1].decode("ascii"))
