"""NMEA sentences without checksum: a driver that takes them too (`checksum = "optional"`), for whatever model.

Some receivers and compasses send none, or have it switched off. **The risk**: a changed digit cannot be seen. What can
be guarded is: once the device has sent a sentence with a right checksum, the same sentence without one has lost it; and
one with fewer fields than that sentence had before is cut.
"""

from collections import Counter
from dataclasses import replace
from typing import Final

from common.framer import Measurement
from onboard.devices.driver import Accepted, Driver, Line, Outcome, Rejected
from onboard.devices.nmea_sentence import PADDING, address, checksum, sentence_of

UNCHECKED: Final = "without checksum"
"""Mark behind the kind of a sentence that was taken without checksum."""


class OptionalChecksum:
    """Gives its driver such sentences with the checksum that they should have; they are counted apart."""

    def __init__(self, driver: Driver) -> None:
        self.sensor = driver.sensor
        self._driver = driver
        self._checked: set[tuple[str, str]] = set()
        """Addresses that came with a right checksum."""
        self._fields: Counter[tuple[str, str]] = Counter()
        """Address -> most fields so far."""

    def claims(self, line: Line) -> bool:
        """As its driver."""
        return self._driver.claims(line)

    def feed(self, line: Line) -> Outcome:
        """As its driver; a sentence without checksum is accepted with `UNCHECKED` behind its kind.

        Reasons: those of the driver; `no-checksum` and `fields` see the module.
        """
        sentence = sentence_of(line.data)
        found = address(line.data)
        if found is None or b"*" in sentence:
            outcome = self._driver.feed(line)
            if found is not None and isinstance(outcome, Accepted):
                self._checked.add(found)
            return outcome
        if found in self._checked:
            return Rejected("no-checksum", self.sensor)
        before, sentence = line.data[: len(line.data) - len(sentence)], sentence.rstrip(PADDING)
        fields = sentence.count(b",")
        if fields < self._fields[found] and found[1] != "XDR":  # which has as many groups as there is to say
            return Rejected("fields", self.sensor)
        outcome = self._driver.feed(replace(line, data=b"%b%b*%02X" % (before, sentence, checksum(sentence[1:]))))
        if not isinstance(outcome, Accepted):
            return outcome
        self._fields[found] = max(fields, self._fields[found])
        return replace(outcome, kind=f"{outcome.kind} {UNCHECKED}", unchecked=True)

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        """As its driver."""
        return self._driver.flush(now_ns, heard_ns)
