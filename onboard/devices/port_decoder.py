"""Dispatch (demultiplexing) of one port's lines: each goes to the first driver, in file order, that claims it."""

import logging
import re
from collections import deque
from collections.abc import Sequence
from typing import Final

from common.framer import Measurement
from onboard.devices.driver import Driver, Ignored, Line, Outcome, Rejected
from onboard.devices.foreign_text import name_of
from onboard.devices.nmea_sentence import check_sentence, sentence_of

log = logging.getLogger(__name__)

KEPT: Final = 24
"""Number of unclaimed lines that are kept to find out which device sends them."""

_PRINTABLE = re.compile(rb"[\t -~]*")
_CHECKSUM_AT_END = re.compile(rb".*\*[0-9A-Fa-f]{2}")


class PortDecoder:
    """Lines of one port in, outcomes out. A damaged sentence counts for the sensor whose address it still shows."""

    def __init__(self, drivers: Sequence[Driver]) -> None:
        """Drivers in the order of the configuration file."""
        self.drivers = tuple(drivers)
        self.unclaimed: deque[Line] = deque(maxlen=KEPT)
        """The last lines that no sensor of the port claimed."""
        self._faults_told: set[str] = set()
        self._heard_ns = 0

    def feed(self, line: Line) -> Outcome:
        """What became of the line: every line is accepted, rejected or ignored, never lost. Never raises.

        A fault of ours in a driver is the reason `driver-fault`, once for each sensor in the log: the other lines
        and ports go on.
        """
        self._heard_ns = line.t_ns if line.end_ns is None else line.end_ns
        for driver in self.drivers:
            if driver.claims(line):
                try:
                    return driver.feed(line)
                except Exception as error:
                    return self._fault(driver, line, error)
        self.unclaimed.append(line)
        return _unclaimed(line.data)

    def _fault(self, driver: Driver, line: Line, error: Exception) -> Rejected:
        if driver.sensor not in self._faults_told:
            self._faults_told.add(driver.sensor)
            text = "the driver of %s failed on %r; report this line"
            log.error(text, driver.sensor, line.data, exc_info=error)
        return Rejected("driver-fault", driver.sensor)

    def flush(self, now_ns: int) -> tuple[Measurement, ...]:
        """What all drivers have due at `now_ns`: give `LineSplitter.complete_until(now)`, see `Driver.flush`."""
        return tuple(measurement for driver in self.drivers for measurement in driver.flush(now_ns, self._heard_ns))


def _unclaimed(data: bytes) -> Outcome:
    """Ignored with the sentence's name or `text`, or rejected for no sensor."""
    data = sentence_of(data)
    if not _PRINTABLE.fullmatch(data):
        return Rejected("not-ascii")
    if data[:1] not in (b"$", b"!"):
        # A sentence that lost its start is damage; start-up text and comments of a recording are not.
        return Rejected("not-nmea") if _CHECKSUM_AT_END.fullmatch(data) else Ignored("text")
    sentence = check_sentence(data)
    if isinstance(sentence, str):
        # SiRF and other receivers print their banner as proprietary sentences without checksum.
        is_banner = data.startswith(b"$P") and sentence == "no-checksum"
        return Ignored(name_of(data) or "proprietary") if is_banner else Rejected(sentence)
    return Ignored(name_of(data) or "proprietary")
