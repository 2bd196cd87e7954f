"""Radar target trackers (ARPA) that send TTM or TLL."""

import re
from typing import TYPE_CHECKING, Final

from common.angles import wrap_deg
from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import RadarTarget, RawLine
from common.units import M_S_PER_KN, METRES_PER_NAUTICAL_MILE, NS_PER_MS
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import Surroundings, day_and_clock, fixed, place, sealed
from onboard.devices.nmea_sentence import address, check_sentence
from onboard.devices.traffic.sentences import FORMS, LONGEST_NAME, STATUSES, TargetReading

if TYPE_CHECKING:
    from common.simulation.readings import RadarReading

_LETTERS: Final = {status: letter for letter, status in STATUSES.items()}
_NOT_IN_A_FIELD: Final = re.compile(r"[^ -~]|[!$*,\\^~]")
"""Characters that NMEA 0183 reserves, and those that it has not."""


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


class RadarEncoder:
    """A tracker as of a Simrad 4G: TTM in nautical miles and knots, directions true; TLL where the place is known.

    The closest approach is left empty: a reading does not hold how the boat herself moves. The talker is the
    table's first, else RA.
    """

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        self._around = around
        self._talker = table.talkers[0] if table.talkers else "RA"

    def encode(self, t_s: float, reading: "RadarReading") -> bytes:
        """TTM for range and bearing and for a target without any place, TLL for latitude and longitude, or both."""
        clock = day_and_clock(self._around.utc_ms(t_s))[1][:6]
        number, letter = f"{reading.number:02d}", _LETTERS[reading.status]
        name = _NOT_IN_A_FIELD.sub("", reading.name)[:LONGEST_NAME]
        bodies = []
        has_place = reading.lat_deg is not None and reading.lon_deg is not None
        if reading.range_m is not None or not has_place:
            bodies.append(f"TTM,{number},{_seen(reading)},,,N,{name},{letter},,{clock},M")
        if reading.lat_deg is not None and reading.lon_deg is not None:
            bodies.append(f"TLL,{number},{place(reading.lat_deg, reading.lon_deg, 4)},{name},{clock},{letter},")
        return b"".join(sealed(self._talker + body) for body in bodies)


def _seen(reading: "RadarReading") -> str:
    """Range in nautical miles to a hundredth, bearing; speed in knots, course: to a tenth each."""
    range_nm = None if reading.range_m is None else reading.range_m / METRES_PER_NAUTICAL_MILE
    sog_kn = None if reading.sog_m_s is None else reading.sog_m_s / M_S_PER_KN
    bearing, course = (_direction(value) for value in (reading.bearing_true_deg, reading.course_true_deg))
    return f"{fixed(range_nm, 2)},{bearing},T,{fixed(sog_kn, 1)},{course},T"


def _direction(value_deg: float | None) -> str:
    return "" if value_deg is None else fixed(wrap_deg(round(value_deg, 1)), 1)
