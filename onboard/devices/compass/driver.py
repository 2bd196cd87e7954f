"""Compasses that send HDG, HDM or HDT (HMR3000, KVH C100, HSC100, HSC100T and many others)."""

from common.clock import whole_us
from common.messages import Heading
from common.sensors import SensorTable
from common.units import NS_PER_MS
from onboard.devices import nmea
from onboard.devices.base import Accepted, Line, Measurement, Outcome, Rejected
from onboard.devices.compass.sentences import FORMS
from onboard.devices.sentence import address, check_sentence


class CompassDriver:
    """One compass. Deviation and variation are handed on as sent; nothing is added to the heading here."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._talkers = frozenset(table.talkers)
        self._latency_ns = round(table.latency_ms * NS_PER_MS)

    def claims(self, line: Line) -> bool:
        """HDG, HDM and HDT of the talkers configured (none configured = all)."""
        found = address(line.data)
        return found is not None and found[1] in FORMS and (not self._talkers or found[0] in self._talkers)

    def feed(self, line: Line) -> Outcome:
        """One Heading for each sentence, valid at the arrival of its first byte less the latency.

        Beside the reasons of `check_sentence` and `nmea.read`: `empty`, a sentence without heading (the compass
        calibrates itself, or has raised an alarm).
        """
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        reading = nmea.read(sentence, FORMS)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        if reading.heading_mag_deg is None and reading.heading_true_deg is None:
            return Rejected("empty", self.sensor)
        heading = Heading(
            sensor=self.sensor,
            t_ns=whole_us(line.t_ns - self._latency_ns),
            heading_mag_deg=reading.heading_mag_deg,
            heading_true_deg=reading.heading_true_deg,
            deviation_deg=reading.deviation_deg,
            variation_deg=reading.variation_deg,
        )
        return Accepted(self.sensor, sentence.formatter, (heading,))

    def flush(self, now_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a heading never waits."""
        return ()
