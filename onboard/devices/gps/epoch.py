"""GNSS epoch assembly: the sentences of one UTC time (`epoch_times` says which), and the Fix they make together."""

from dataclasses import dataclass, field
from datetime import date
from typing import Final

from common.messages import Fix
from common.units import M_S_PER_KN, NS_PER_MS
from onboard.devices.gps.epoch_times import Stamp, rank_of
from onboard.devices.gps.sentences import Gga, Gll, Gsa, Gst, Rmc, Timed, Untimed, Vtg, Zda
from onboard.devices.nmea_fields import DAY_MS, Position, tod_step_ms

QUIET_NS: Final = 150 * NS_PER_MS
"""Quiet time on the port after which an epoch is complete, ns."""
COURSE_ABOVE_KN: Final = 1.0
"""Least speed of a course, kn: below it receivers freeze or invent the course."""
HELD_STEPS: Final = 2.0
"""Number of steps of the last latitude digit, see `RepeatWatch`."""
HELD_WITHOUT_SPEED_MS: Final = 10_000
FINE_STEP_M: Final = 0.5

_FIRST_DAY: Final = date(1970, 1, 1)
_QUALITY_OF_MODE: Final = {"E": 6, "M": 7, "S": 8}

EpochReading = Timed | Untimed


@dataclass(slots=True)
class Epoch:
    """What has come so far.

    Receivers repeat GGA, GNS and GSA under the talker of each constellation: the first counts, unless it has no
    position (GSA: no fix) and a later one has.
    """

    t_ns: int
    """Boat time of arrival of the first byte, ns."""
    last_ns: int
    """Boat time of arrival of the last byte so far, ns."""
    stamp: Stamp | None = None
    """UTC time of day: that of the sentence that leads, of several the most finely written."""
    seen: set[str] = field(default_factory=set)
    """Address (talker and formatter) of each sentence so far."""
    gga: Gga | None = None
    gns: Gga | None = None
    rmc: Rmc | None = None
    gll: Gll | None = None
    vtg: Vtg | None = None
    gsa: Gsa | None = None
    paired: bool = False
    """True once the ClockPair of the epoch is out."""

    def add(self, address: str, reading: EpochReading, stamp: Stamp | None) -> None:
        """Take a sentence in; `address` is talker and formatter (`GPGGA`), `stamp` its time if it has one."""
        name = address[2:].lower()
        before = getattr(self, name)
        if before is None or (not _has_solution(before) and _has_solution(reading)):
            setattr(self, name, reading)
        self.seen.add(address)
        if stamp is not None and (self.stamp is None or _precedence(stamp) > _precedence(self.stamp)):
            self.stamp = stamp

    @property
    def tod_ms(self) -> int | None:
        """UTC time of day, ms."""
        return None if self.stamp is None else self.stamp.tod_ms

    @property
    def rules_time(self) -> bool:
        """Whether a ZDA beside it gives no time: it has one itself, or the receiver says that it is not valid."""
        return self.stamp is not None or self.status_valid is False

    @property
    def status_valid(self) -> bool | None:
        """RMC status, else GLL status."""
        if self.rmc is not None and self.rmc.status_valid is not None:
            return self.rmc.status_valid
        return None if self.gll is None else self.gll.status_valid

    @property
    def position(self) -> Position | None:
        """GGA or GNS with a quality above 0, else RMC, else GLL."""
        graded = self.graded
        if graded is not None and graded.position is not None:
            return graded.position
        for reading in (self.rmc, self.gll):
            if reading is None or reading.position is None or reading.status_valid is None:
                continue
            if reading.status_valid or graded is None or graded.quality != 0:
                return reading.position
        return None

    @property
    def graded(self) -> Gga | None:
        """The sentence that says how good the fix is: GGA, else GNS; one with a position before one without."""
        if self.gga is None or (self.gga.position is None and self.gns is not None and self.gns.position is not None):
            return self.gns
        return self.gga

    @property
    def fix_quality(self) -> int | None:
        """GGA's or GNS's; without them what the mode of RMC or GLL says of estimated, manual and simulated fixes."""
        if self.graded is not None:
            return self.graded.quality
        mode = next((reading.mode for reading in (self.rmc, self.gll) if reading is not None and reading.mode), "")
        return _QUALITY_OF_MODE.get(mode)

    @property
    def speed_and_course(self) -> tuple[float | None, float | None]:
        """SOG in kn and COG in degrees true from RMC, else VTG; no course below `COURSE_ABOVE_KN`.

        None at all without a position: receivers fill in 0.0.
        """
        if self.position is None:
            return None, None
        for reading in (self.rmc, self.vtg):
            if reading is None or reading.sog_kn is None or reading.mode == "N":
                continue
            moving = reading.sog_kn >= COURSE_ABOVE_KN
            return reading.sog_kn, reading.cog_true_deg if moving else None
        return None, None

    def utc_ns(self, zda: Zda | None) -> int | None:
        """UTC: the epoch's time of day on the date of its own RMC (status A), else of `zda`, a recent one.

        The date goes with the time beside it, which may be on the other side of midnight. A receiver under status V
        sends a default date. None in a leap second too, which POSIX time cannot name.
        """
        if self.tod_ms is None or self.tod_ms >= DAY_MS:
            return None
        dated = self.rmc if self.rmc is not None and self.rmc.status_valid and self.rmc.date is not None else zda
        if dated is None or dated.date is None:
            return None
        then_ms = self.tod_ms if dated.tod_ms is None else dated.tod_ms
        day_ms = (dated.date - _FIRST_DAY).days * DAY_MS
        return (day_ms + then_ms + tod_step_ms(then_ms, self.tod_ms)) * NS_PER_MS


def stamp_of(address: str, reading: Timed, t_ns: int) -> Stamp | None:
    """The time of a sentence that came at `t_ns`; `None` = the field is empty."""
    return None if reading.tod_ms is None else Stamp(reading.tod_ms, reading.step_ms, rank_of(address), t_ns)


def _precedence(stamp: Stamp) -> tuple[int, int]:
    return stamp.rank, -stamp.step_ms


def _has_solution(reading: EpochReading) -> bool:
    """Only GGA, GNS, RMC, GLL and GSA can be without one."""
    if isinstance(reading, Gsa):
        return reading.fix_mode is not None and reading.fix_mode > 1
    return isinstance(reading, Vtg) or reading.position is not None


@dataclass(frozen=True, slots=True)
class UntimedLine:
    """A sentence without time that waits for its epoch."""

    name: str
    """Address of the sentence: talker and formatter."""
    reading: Untimed
    t_ns: int
    end_ns: int
    before_ns: int
    """Boat time of the end of the receiver's line before it, ns."""


def epoch_of_each(waiting: list[UntimedLine], last_ns: int, next_ns: int, *, open_before: bool) -> int:
    """How many of the waiting lines belong to the epoch before; the others to the one that begins at `next_ns`.

    The longest pause between the lines is the pause between the bursts; of equal ones the last. Without an open epoch
    only what follows each other closely up to `next_ns` belongs to the new one. last_ns: end of the receiver's last
    line, one without decoding (GSV) included.
    """
    if not waiting:
        return 0
    begins = [line.t_ns for line in waiting[1:]] + [next_ns]
    ends = [line.before_ns for line in waiting[1:]] + [last_ns]
    pauses = [waiting[0].t_ns - waiting[0].before_ns, *(b - e for b, e in zip(begins, ends, strict=True))]
    if open_before:
        return max(range(len(pauses)), key=lambda place: (pauses[place], place))
    apart = [place for place, pause in enumerate(pauses) if pause >= QUIET_NS]
    return max(apart, default=0)


def fix_of(epoch: Epoch, sensor: str, t_ns: int, *, held: bool, gst: Gst | None = None, zda: Zda | None = None) -> Fix:
    """The Fix of a complete epoch, valid at `t_ns`; gst, zda: the last that came, of whatever epoch."""
    graded, gsa, position = epoch.graded, epoch.gsa, epoch.position
    sog_kn, cog_true_deg = epoch.speed_and_course
    gsa_hdop = None if gsa is None else gsa.hdop
    if gst is not None and (position is None or gst.tod_ms is None or gst.tod_ms != epoch.tod_ms):
        gst = None
    return Fix(
        sensor=sensor,
        t_ns=t_ns,
        lat_deg=None if position is None else position.lat_deg,
        lon_deg=None if position is None else position.lon_deg,
        alt_m=graded.alt_m if graded is not None and graded.quality and position is not None else None,
        fix_quality=epoch.fix_quality,
        fix_mode=None if gsa is None else gsa.fix_mode,
        status_valid=epoch.status_valid,
        satellites=None if graded is None else graded.satellites,
        hdop=graded.hdop if gsa_hdop is None and graded is not None else gsa_hdop,
        pdop=None if gsa is None else gsa.pdop,
        vdop=None if gsa is None else gsa.vdop,
        sog_kn=sog_kn,
        cog_true_deg=cog_true_deg,
        utc_ns=epoch.utc_ns(zda),
        tod_ms=epoch.tod_ms,
        held=held,
        sigma_east_m=None if gst is None else gst.sigma_east_m,
        sigma_north_m=None if gst is None else gst.sigma_north_m,
    )


class RepeatWatch:
    """Tells a held position from that of a moored boat, which repeats to the digit as well (4 decimals = 0.19 m).

    Held is a position repeated as text
    (1) under the same UTC: the receiver stands still;
    (2) while the receiver's own SOG, at least 1 kn, has carried the boat more than two steps of the last digit since
    the text first came (one and a half are enough to change latitude or longitude on any course; the rest allows for
    an error of SOG);
    (3) where no SOG is sent and a step is below 0.5 m, for 10 s on end: the noise of a receiver that computes afresh
    would have moved it.
    A repeat with SOG below 1 kn is not held.
    """

    def __init__(self) -> None:
        self._text: str | None = None
        self._tod_ms: int | None = None
        self._travelled_m = 0.0
        self._stood_ms = 0

    def held(self, position: Position | None, tod_ms: int | None, sog_kn: float | None) -> bool:
        """Judge the next epoch; epochs without position change nothing."""
        if position is None:
            return False
        before_ms, self._tod_ms = self._tod_ms, tod_ms
        if position.text != self._text:
            self._text, self._travelled_m, self._stood_ms = position.text, 0.0, 0
            return False
        if tod_ms is None or before_ms is None:
            return False
        step_ms = (tod_ms - before_ms) % DAY_MS
        self._stood_ms += step_ms
        if step_ms == 0:
            return True
        if sog_kn is None:
            return self._stood_ms >= HELD_WITHOUT_SPEED_MS and position.step_m < FINE_STEP_M
        if sog_kn < COURSE_ABOVE_KN:
            self._travelled_m = 0.0
            return False
        self._travelled_m += sog_kn * M_S_PER_KN * step_ms / 1000.0
        return self._travelled_m > HELD_STEPS * position.step_m
