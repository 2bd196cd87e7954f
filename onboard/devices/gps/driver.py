"""NMEA GNSS receivers (BU-353-S4, u-blox and others): one Fix for each receiver epoch.

Position from GGA, else GNS, RMC, GLL; SOG and COG from RMC, else VTG; mode and dilutions from GSA; date from the
epoch's own RMC or ZDA; sigmas from GST. One antenna with the talkers GP, GL, GA and GN is one sensor.

VTG and GSA carry no time, and some receivers send them before the position. They wait for the next sentence with a
time, or for quiet: of the epoch before or of the one after, by the longest pause among them.
"""

from typing import Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import ClockPair, RawLine
from common.units import NS_PER_MS, NS_PER_S
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Ignored, Line, Outcome, Rejected
from onboard.devices.gps.epoch import QUIET_NS, Epoch, RepeatWatch, UntimedLine, epoch_of_each, fix_of
from onboard.devices.gps.sentences import FORMS, Gsa, Gst, Rmc, Timed, Vtg, Zda
from onboard.devices.nmea_sentence import address, check_sentence

BURST_FORMATTERS: Final = frozenset({"GSV", "GBS", "GRS", "DTM", "TXT", "MSS", "ALM"})
"""Sentences of the same burst that are not decoded. They keep the epoch open: at 4800 baud a GSV group puts 0.45 s
between the GGA and the RMC of one epoch."""

BUSY_NS: Final = 400 * NS_PER_MS
"""Time after which an epoch is complete, ns, even where other devices leave the port no quiet."""
_CLOCK_MODES: Final = frozenset({"A", "D", "F", "P", "R"})
RMC_RULES_NS: Final = 10 * NS_PER_S
"""Time after a ClockPair of RMC in which the time of ZDA is not taken, ns: some receivers date ZDA ahead (an AC12 by 2
s)."""


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
            return ()
        self._settle(len(self._waiting))
        return self._close()

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
        name = sentence.talker + sentence.formatter
        if isinstance(reading, Vtg | Gsa):
            self._waiting.append(UntimedLine(name, reading, line.t_ns, line.end_ns or line.t_ns, self._last_ns))
            return Accepted(self.sensor, sentence.formatter, (raw,))
        epoch, due = self._join_timed(name, reading, line.t_ns)
        return Accepted(self.sensor, sentence.formatter, (*due, raw, *self._clock_pair(epoch, reading)))

    def _join_timed(self, name: str, reading: Timed, t_ns: int) -> tuple[Epoch, tuple[Measurement, ...]]:
        """The epoch the sentence went into, and what its coming completed."""
        due: tuple[Measurement, ...] = ()
        # A closed epoch still takes a late sentence: its Fix is out, and a second one would be fused twice.
        epoch = self._open or self._closed
        if epoch is None or not epoch.holds(reading.tod_ms, name, t_ns):
            before = epoch_of_each(self._waiting, self._last_ns, t_ns, open_before=self._open is not None)
            self._settle(before)
            due = self._close()
            first_ns = self._waiting[0].t_ns if self._waiting else t_ns
            epoch = self._open = Epoch(first_ns, t_ns, reading.tod_ms)
        self._settle(len(self._waiting))
        epoch.add(name, reading)
        return epoch, due

    def _settle(self, count: int) -> None:
        """The first `count` of the waiting sentences belong to the open epoch."""
        settled, self._waiting = self._waiting[:count], self._waiting[count:]
        if self._open is not None:
            for line in settled:
                self._open.add(line.name, line.reading)

    def _close(self) -> tuple[Measurement, ...]:
        epoch, self._open = self._open, None
        if epoch is None:
            return ()
        self._closed = epoch if epoch.has_fix else None
        if not epoch.has_fix:
            return ()
        held = self._watch.held(epoch.position, epoch.tod_ms, epoch.speed_and_course[0])
        return (fix_of(epoch, self.sensor, self._valid_ns(epoch), held=held, gst=self._gst),)

    def _clock_pair(self, epoch: Epoch, reading: Timed) -> tuple[ClockPair, ...]:
        """UTC beside the arrival of the epoch's first byte less the latency, from RMC status A or from ZDA.

        Whatever the date is: `onboard.devices.gps.dates` judges it.

        Not the arrival of RMC itself: what stands before it in the burst, GSV groups above all, changes from second to
        second and would move the pair by up to 0.45 s at 4800 baud.
        """
        if epoch.paired or not isinstance(reading, Rmc | Zda) or epoch.status_valid is False:
            return ()
        if isinstance(reading, Rmc) and (not reading.status_valid or (reading.mode or "A") not in _CLOCK_MODES):
            return ()
        utc_ns = epoch.utc_ns
        if reading.date is None or utc_ns is None:
            return ()
        last_ns = self._rmc_paired_ns
        if isinstance(reading, Zda) and last_ns is not None and epoch.t_ns - last_ns < RMC_RULES_NS:
            return ()
        if isinstance(reading, Rmc):
            self._rmc_paired_ns = epoch.t_ns
        epoch.paired = True
        source = "RMC" if isinstance(reading, Rmc) else "ZDA"
        return (ClockPair(sensor=self.sensor, t_ns=self._valid_ns(epoch), utc_ns=utc_ns, source=source),)

    def _valid_ns(self, epoch: Epoch) -> int:
        return whole_us(epoch.t_ns - self._latency_ns)
