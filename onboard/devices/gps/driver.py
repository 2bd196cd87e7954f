"""NMEA GNSS receivers (BU-353-S4, u-blox and others): one Fix for each receiver epoch.

Position from GGA, else GNS, RMC, GLL; SOG and COG from RMC, else VTG; mode and dilutions from GSA; date from the
epoch's own RMC, else from the last ZDA; sigmas from GST. One antenna with the talkers GP, GL, GA and GN is one sensor.

VTG and GSA carry no time, and some receivers send them before the position. They wait for the next sentence with a
time, or for quiet: of the epoch before or of the one after, by the longest pause among them.

ZDA is a clock: some receivers send the time of its transmission, GPS time, or the time of seconds to come. It neither
opens nor closes an epoch, and gives a time of day only where there are no epochs.
"""

from collections import deque
from dataclasses import dataclass
from typing import Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import ClockPair, RawLine
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Ignored, Line, Outcome, Rejected
from onboard.devices.gps.epoch import QUIET_NS, Epoch, RepeatWatch, UntimedLine, epoch_of_each, fix_of, stamp_of
from onboard.devices.gps.epoch_times import EpochTimes, Place, Stamp
from onboard.devices.gps.sentences import FORMS, Gsa, Gst, Rmc, Timed, Vtg, Zda
from onboard.devices.nmea_sentence import address, check_sentence

BURST_FORMATTERS: Final = frozenset({"GSV", "GBS", "GRS", "DTM", "TXT", "MSS", "ALM"})
"""Sentences of the same burst that are not decoded. They keep the epoch open: at 4800 baud a GSV group puts 0.45 s
between the GGA and the RMC of one epoch."""

BUSY_NS: Final = 400 * NS_PER_MS
"""Time after which an epoch is complete, ns, even where other devices leave the port no quiet."""
_CLOCK_MODES: Final = frozenset({"A", "D", "F", "P", "R"})
SAME_TIME_NS: Final = 500 * NS_PER_MS
"""Age after which the same UTC time in a sentence means that the receiver's time stands still, ns."""
RECENT_NS: Final = 10 * NS_PER_S
"""Time for which RMC rules over ZDA, the epochs rule over the time of ZDA, and a ZDA dates epochs, ns: some receivers
date ZDA ahead (an AC12 by 2 s)."""
MOST_DOUBTED: Final = 16
ASIDE: Final = "set aside"
"""Mark behind the kind of a sentence that was read and not used: its time is not that of the epochs (`epoch_times`)."""


@dataclass(slots=True)
class HeardZda:
    """The last ZDA with a date."""

    reading: Zda
    t_ns: int
    """Boat time of its arrival, ns."""
    waits: bool = True
    """No ClockPair is made with it yet."""


class GpsDriver:
    """One receiver. Emits Fix, ClockPair (at most one for each epoch) and RawLine."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._talkers = frozenset(table.talkers)
        self._latency_ns = round(table.latency_ms * NS_PER_MS)
        self._open: Epoch | None = None
        self._closed: Epoch | None = None
        self._waiting: list[UntimedLine] = []
        self._gst: Gst | None = None
        """The last GST: an epoch of the same UTC takes it when it closes, and never waits for one."""
        self._zda: HeardZda | None = None
        self._times = EpochTimes()
        self._doubted: deque[Epoch] = deque(maxlen=MOST_DOUBTED)
        """Epochs of a single GLL each that wait for a leader."""
        self._last_ns = 0
        """Boat time of the end of the receiver's last line, ns."""
        self._rmc_paired_ns: int | None = None
        self._watch = RepeatWatch()

    def claims(self, line: Line) -> bool:
        """Sentences of a receiver from the talkers configured (none configured = all)."""
        found = address(line.data)
        if found is None or (self._talkers and found[0] not in self._talkers):
            return False
        return found[1] in FORMS or found[1] in BURST_FORMATTERS

    def feed(self, line: Line) -> Outcome:
        """Take one sentence in; the Fix of an epoch comes with the first sentence of the next, or from `flush`.

        Reasons: those of `check_sentence` and `nmea_parser.read`.
        """
        outcome = self._decode(line)
        self._last_ns = line.t_ns if line.end_ns is None else line.end_ns
        if self._open is not None and not self._waiting:
            # Damaged sentences too are a sign that the burst goes on.
            self._open.last_ns = max(self._open.last_ns, self._last_ns)
        return outcome

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        """The Fix of an epoch after 150 ms of quiet on the port, or 400 ms without a sentence of the receiver."""
        if now_ns - max(self._last_ns, heard_ns) < QUIET_NS and now_ns - self._last_ns < BUSY_NS:
            return ()
        if self._open is None:
            self._waiting.clear()
        self._settle(len(self._waiting))
        return (*self._close(), *self._left_alone(now_ns), *self._pair_of_zda_alone())

    def _decode(self, line: Line) -> Outcome:
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        if sentence.formatter in BURST_FORMATTERS:
            return Ignored(sentence.formatter)
        reading = nmea.read(sentence, FORMS)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        raw = RawLine(sensor=self.sensor, t_ns=line.t_ns, text=sentence.text)
        if isinstance(reading, Gst):
            self._gst = reading
            return Accepted(self.sensor, sentence.formatter, (raw,))
        if isinstance(reading, Zda):
            if reading.date is not None:
                self._zda = HeardZda(reading, line.t_ns)
            return Accepted(self.sensor, sentence.formatter, (raw,))
        name = sentence.talker + sentence.formatter
        if isinstance(reading, Vtg | Gsa):
            self._waiting.append(UntimedLine(name, reading, line.t_ns, line.end_ns or line.t_ns, self._last_ns))
            return Accepted(self.sensor, sentence.formatter, (raw,))
        epoch, due = self._join_timed(name, reading, line.t_ns)
        if epoch is None:
            return Accepted(self.sensor, f"{sentence.formatter} {ASIDE}", (raw,))
        return Accepted(self.sensor, sentence.formatter, (*due, raw, *self._pair_of_rmc(epoch, reading)))

    def _join_timed(self, name: str, reading: Timed, t_ns: int) -> tuple[Epoch | None, tuple[Measurement, ...]]:
        """The epoch the sentence went into, `None` = it is set aside; and what its coming completed."""
        due: tuple[Measurement, ...] = ()
        stamp = stamp_of(name, reading, t_ns)
        if stamp is not None:
            self._times.learn(name, stamp.tod_ms)
        # A closed epoch still takes a late sentence: its Fix is out, and a second one would be fused twice.
        epoch = self._open or self._closed
        if epoch is None or not self._belongs(epoch, name, stamp, t_ns):
            place = Place.OPENS if epoch is None else self._place(epoch, name, reading, t_ns)
            if place is Place.ASIDE:
                return None, ()
            if place is Place.DOUBTED:
                epoch = Epoch(t_ns, t_ns)
                epoch.add(name, reading, t_ns)
                self._doubted.append(epoch)
                return None if self._times.is_contradicted(name) else epoch, ()
            before = epoch_of_each(self._waiting, self._last_ns, t_ns, open_before=self._open is not None)
            self._settle(before)
            due = self._judge_doubted(stamp, t_ns)
            first_ns = self._waiting[0].t_ns if self._waiting else t_ns
            epoch = self._open = Epoch(first_ns, t_ns)
        self._settle(len(self._waiting))
        epoch.add(name, reading, t_ns)
        if reading.position is not None:
            self._times.had_place(stamp, reading.position.text)
        return epoch, due

    def _belongs(self, epoch: Epoch, name: str, stamp: Stamp | None, t_ns: int) -> bool:
        """Does a sentence of that time belong here? One without time (cold start) joins what is still going on."""
        if stamp is None or epoch.stamp is None:
            return name not in epoch.seen and t_ns - epoch.last_ns < QUIET_NS
        if name in epoch.seen:
            return stamp.tod_ms == epoch.tod_ms and t_ns - epoch.t_ns < SAME_TIME_NS
        return self._times.are_one(epoch.stamp, stamp)

    def _place(self, epoch: Epoch, name: str, reading: Timed, t_ns: int) -> Place:
        """What to do with a sentence that does not belong to the newest epoch."""
        stamp = stamp_of(name, reading, t_ns)
        if stamp is None or epoch.stamp is None or t_ns - epoch.t_ns >= RECENT_NS:
            return Place.OPENS
        place = None if reading.position is None else reading.position.text
        return self._times.place_of(name, stamp, place, epoch.stamp)

    def _judge_doubted(self, leader: Stamp | None, t_ns: int) -> tuple[Measurement, ...]:
        """The Fix of the open epoch and those of the doubted ones that a leader confirms; the others are lost."""
        doubted = [epoch for epoch in self._doubted if t_ns - epoch.t_ns < RECENT_NS]
        self._doubted.clear()
        stamp = None if self._open is None else self._open.stamp
        opened_by_follower = stamp is not None and leader is not None and stamp.rank < leader.rank
        # A follower opens one before any leader is known, and once it was confirmed.
        if opened_by_follower and not self._is_confirmed(self._open, leader):
            self._open = None
        due = self._close()
        for epoch in doubted:
            if self._is_confirmed(epoch, leader):
                self._open = epoch
                due += self._close()
        return due

    def _left_alone(self, now_ns: int) -> tuple[Measurement, ...]:
        """Fixes of doubted epochs that no leader has followed for 10 s, if the last that was judged was right."""
        due: tuple[Measurement, ...] = ()
        while self._doubted and now_ns - self._doubted[0].t_ns >= RECENT_NS:
            epoch = self._doubted.popleft()
            if all(map(self._times.is_confirmed, epoch.seen)):
                self._open = epoch
                due += self._close()
        return due

    def _is_confirmed(self, epoch: Epoch | None, leader: Stamp | None) -> bool:
        if epoch is None or epoch.stamp is None or leader is None:
            return False
        return self._times.confirms(epoch.seen, epoch.stamp, leader)

    def _settle(self, count: int) -> None:
        """The first `count` of the waiting sentences belong to the open epoch."""
        settled, self._waiting = self._waiting[:count], self._waiting[count:]
        if self._open is not None:
            for line in settled:
                self._open.add(line.name, line.reading, line.t_ns)

    def _close(self) -> tuple[Measurement, ...]:
        epoch, self._open = self._open, None
        if epoch is None:
            return ()
        self._closed = epoch
        zda = self._zda_near(epoch.t_ns)
        held = self._watch.held(epoch.position, epoch.tod_ms, epoch.speed_and_course[0])
        fix = fix_of(epoch, self.sensor, self._valid_ns(epoch.t_ns), held=held, gst=self._gst, zda=zda)
        return (fix, *self._pair_of_zda(epoch))

    def _pair_of_rmc(self, epoch: Epoch, reading: Timed) -> tuple[ClockPair, ...]:
        """UTC beside the arrival of the epoch's first byte less the latency, from RMC status A.

        Whatever the date is: `onboard.devices.gps.dates` judges it.

        Not the arrival of RMC itself: what stands before it in the burst, GSV groups above all, changes from second to
        second and would move the pair by up to 0.45 s at 4800 baud.
        """
        if epoch.paired or not isinstance(reading, Rmc) or not reading.status_valid or epoch.status_valid is False:
            return ()
        if (reading.mode or "A") not in _CLOCK_MODES or reading.date is None:
            return ()
        self._rmc_paired_ns = epoch.t_ns
        return self._pair(epoch, None)

    def _pair_of_zda(self, epoch: Epoch) -> tuple[ClockPair, ...]:
        """The same for a receiver without RMC, when the epoch is complete: its time on the date of the last ZDA."""
        last_ns, zda = self._rmc_paired_ns, self._zda_near(epoch.t_ns)
        if zda is None or epoch.status_valid is False or (last_ns is not None and epoch.t_ns - last_ns < RECENT_NS):
            return ()
        return () if epoch.paired or epoch.tod_ms is None else self._pair(epoch, zda)

    def _pair(self, epoch: Epoch, zda: Zda | None) -> tuple[ClockPair, ...]:
        utc_ns = epoch.utc_ns(zda)
        if utc_ns is None:
            return ()
        epoch.paired = True
        t_ns, source = self._valid_ns(epoch.t_ns), "RMC" if zda is None else "ZDA"
        return (ClockPair(sensor=self.sensor, t_ns=t_ns, utc_ns=utc_ns, source=source),)

    def _pair_of_zda_alone(self) -> tuple[ClockPair, ...]:
        """UTC of a ZDA beside its arrival, where no epoch has come for 10 s."""
        zda = self._zda
        if zda is None or not zda.waits:
            return ()
        zda.waits = False
        if self._closed is not None and self._closed.tod_ms is not None and zda.t_ns - self._closed.t_ns < RECENT_NS:
            return ()
        tod_ms = zda.reading.tod_ms
        return (
            () if tod_ms is None else self._pair(Epoch(zda.t_ns, zda.t_ns, Stamp(tod_ms, 1, 0, zda.t_ns)), zda.reading)
        )

    def _zda_near(self, t_ns: int) -> Zda | None:
        """The last ZDA, if it came within 10 s of that time."""
        zda = self._zda
        return None if zda is None or abs(zda.t_ns - t_ns) >= RECENT_NS else zda.reading

    def _valid_ns(self, t_ns: int) -> int:
        return whole_us(t_ns - self._latency_ns)
