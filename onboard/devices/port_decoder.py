"""All sensors of one port: each line goes to the first driver, in file order, that claims it."""

import re
from collections.abc import Sequence

from onboard.devices.base import Driver, Ignored, Line, Measurement, Outcome, Rejected
from onboard.devices.sentence import address, check_sentence

_PRINTABLE = re.compile(rb"[\t -~]*")
_CHECKSUM_AT_END = re.compile(rb".*\*[0-9A-Fa-f]{2}")


class PortDecoder:
    """Lines of one port in, outcomes out. A damaged sentence counts for the sensor whose address it still shows."""

    def __init__(self, drivers: Sequence[Driver]) -> None:
        """Drivers in the order of the configuration file."""
        self.drivers = tuple(drivers)

    def feed(self, line: Line) -> Outcome:
        """What became of the line: every line is accepted, rejected or ignored, never lost. Never raises."""
        for driver in self.drivers:
            if driver.claims(line):
                return driver.feed(line)
        return _unclaimed(line.data)

    def flush(self, now_ns: int) -> tuple[Measurement, ...]:
        """What all drivers have due at `now_ns`: give `LineSplitter.complete_until(now)`, see `Driver.flush`."""
        return tuple(measurement for driver in self.drivers for measurement in driver.flush(now_ns))


def _unclaimed(data: bytes) -> Outcome:
    """Ignored with a kind from a small set (counters are kept by it), or rejected for no sensor."""
    if not _PRINTABLE.fullmatch(data):
        return Rejected("not-ascii")
    if data[:1] not in (b"$", b"!"):
        # A sentence that lost its start is damage; start-up text and comments of a recording are not.
        return Rejected("not-nmea") if _CHECKSUM_AT_END.fullmatch(data) else Ignored("text")
    sentence = check_sentence(data)
    if isinstance(sentence, str):
        # SiRF and other receivers print their banner as proprietary sentences without checksum.
        return Ignored("proprietary") if data.startswith(b"$P") and sentence == "no-checksum" else Rejected(sentence)
    found = address(data)
    return Ignored("proprietary" if found is None else found[1])
