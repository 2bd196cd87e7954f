"""Radar target trackers (ARPA) that send TTM or TLL."""

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import RadarTarget, RawLine
from common.units import NS_PER_MS
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.nmea_sentence import address, check_sentence
from onboard.devices.traffic.sentences import FORMS, TargetReading


class RadarDriver:
    """One radar. TTM and TLL of the same target are two RadarTargets; who wants one joins them by number and time."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._talkers = frozenset(table.talkers)
        self._latency_ns = round(table.latency_ms * NS_PER_MS)

    def claims(self, line: Line) -> bool:
        """TTM and TLL of the talkers configured (none configured = all)."""
        found = address(line.data)
        return found is not None and found[1] in FORMS and (not self._talkers or found[0] in self._talkers)

    def feed(self, line: Line) -> Outcome:
        """One RadarTarget, valid at the arrival of its first byte less the latency, and the RawLine as it came.

        `tod_ms` is the radar's own time. Names longer than 64 characters are cut; the RawLine has them whole. Beside
        the reasons of `check_sentence` and `nmea_parser.read`: `empty` (no place, and not the news of a lost target).
        """
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        reading = nmea.read(sentence, FORMS)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        if reading.is_empty:
            return Rejected("empty", self.sensor)
        target = _target(self.sensor, whole_us(line.t_ns - self._latency_ns), reading)
        raw = RawLine(sensor=self.sensor, t_ns=line.t_ns, text=sentence.text)
        return Accepted(self.sensor, sentence.formatter, (target, raw))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: a target never waits."""
        return ()


def _target(sensor: str, t_ns: int, reading: TargetReading) -> RadarTarget:
    return RadarTarget(
        sensor=sensor,
        t_ns=t_ns,
        number=reading.number,
        range_m=reading.range_m,
        bearing_true_deg=reading.bearing.true_deg,
        bearing_rel_deg=reading.bearing.rel_deg,
        sog_kn=reading.sog_kn,
        course_true_deg=reading.course.true_deg,
        course_rel_deg=reading.course.rel_deg,
        cpa_m=reading.cpa_m,
        tcpa_s=reading.tcpa_s,
        lat_deg=None if reading.position is None else reading.position.lat_deg,
        lon_deg=None if reading.position is None else reading.position.lon_deg,
        name=reading.name,
        status=reading.status,
        tod_ms=reading.tod_ms,
    )
