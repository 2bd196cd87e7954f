"""NMEA GNSS receivers (BU-353-S4, u-blox and others): one Fix for each receiver epoch.

Position from GGA, else GNS, RMC, GLL; SOG and COG from RMC, else VTG; mode and dilutions from GSA; date from the
epoch's own RMC, else from the last ZDA; sigmas from GST. One antenna with the talkers GP, GL, GA and GN is one sensor.
`assembly` and `epoch_times` say which sentences are one epoch.

ZDA is a clock: some receivers send the time of its transmission, GPS time, or the time of seconds to come. It neither
opens nor closes an epoch, and gives a time of day only where there are no epochs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import ClockPair, RawLine
from common.units import NS_PER_MS
from onboard.devices import nmea_parser as nmea
from onboard.devices.driver import Accepted, Ignored, Line, Outcome, Rejected
from onboard.devices.gps.assembly import RECENT_NS, Assembly
from onboard.devices.gps.epoch import QUIET_NS, Epoch, RepeatWatch, fix_of
from onboard.devices.gps.epoch_times import Stamp
from onboard.devices.gps.sentences import FORMS, Gsa, Gst, Rmc, Timed, Vtg, Zda
from onboard.devices.nmea_sentence import address, check_sentence

BURST_FORMATTERS: Final = frozenset({"GSV", "GBS", "GRS", "DTM", "TXT", "MSS", "ALM"})
"""Sentences of the same burst that are not decoded. They keep the epoch open: at 4800 baud a GSV group puts 0.45 s
between the GGA and the RMC of one epoch."""

BUSY_NS: Final = 400 * NS_PER_MS
"""Time after which an epoch is complete, ns, even where other devices leave the port no quiet."""
_CLOCK_MODES: Final = frozenset({"A", "D", "F", "P", "R"})
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
        self._epochs = Assembly()
        self._gst: Gst | None = None
        """The last GST: an epoch of the same UTC takes it when it closes, and never waits for one."""
        self._zda: HeardZda | None = None
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
        self._epochs.ended(line.t_ns if line.end_ns is None else line.end_ns)
        return outcome

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        """The Fix of an epoch after 150 ms of quiet on the port, or 400 ms without a sentence of the receiver."""
        last_ns = self._epochs.last_ns
        if now_ns - max(last_ns, heard_ns) < QUIET_NS and now_ns - last_ns < BUSY_NS:
            return ()
        return (*self._fixes(self._epochs.quiet(now_ns)), *self._pair_of_zda_alone())

    def _decode(self, line: Line) -> Outcome:
        sentence = check_sentence(line.data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        kind = sentence.formatter
        if kind in BURST_FORMATTERS:
            return Ignored(kind)
        reading = nmea.read(sentence, FORMS)
        if isinstance(reading, str):
            return Rejected(reading, self.sensor)
        raw = RawLine(sensor=self.sensor, t_ns=line.t_ns, text=sentence.text)
        name = sentence.talker + kind
        match reading:
            case Gst():
                self._gst = reading
            case Zda():
                self._zda = self._zda if reading.date is None else HeardZda(reading, line.t_ns)
            case Vtg() | Gsa():
                self._epochs.wait(name, reading, line)
            case _:
                epoch, complete = self._epochs.join(name, reading, line.t_ns)
                if epoch is None:
                    return Accepted(self.sensor, f"{kind} {ASIDE}", (raw,))
                return Accepted(self.sensor, kind, (*self._fixes(complete), raw, *self._pair_of_rmc(epoch, reading)))
        return Accepted(self.sensor, kind, (raw,))

    def _fixes(self, complete: Iterable[Epoch]) -> Iterator[Measurement]:
        for epoch in complete:
            zda = self._zda_near(epoch.t_ns)
            held = self._watch.held(epoch.position, epoch.tod_ms, epoch.speed_and_course[0])
            yield fix_of(epoch, self.sensor, self._valid_ns(epoch.t_ns), held=held, gst=self._gst, zda=zda)
            yield from self._pair_of_zda(epoch)

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
        last, tod_ms = self._epochs.closed, zda.reading.tod_ms
        is_near = last is not None and zda.t_ns - last.t_ns < RECENT_NS
        if tod_ms is None or (is_near and last is not None and last.rules_time):
            return ()
        return self._pair(Epoch(zda.t_ns, zda.t_ns, Stamp(tod_ms, 1, 0, zda.t_ns)), zda.reading)

    def _zda_near(self, t_ns: int) -> Zda | None:
        """The last ZDA, if it came within 10 s of that time."""
        zda = self._zda
        return None if zda is None or abs(zda.t_ns - t_ns) >= RECENT_NS else zda.reading

    def _valid_ns(self, t_ns: int) -> int:
        return whole_us(t_ns - self._latency_ns)
