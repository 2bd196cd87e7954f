"""NMEA sentences without checksum: a driver that takes them too (`checksum = "optional"`), for whatever model.

Some receivers and compasses send none, or have it switched off. **The risk**: a changed digit cannot be seen. What can
be guarded is: once the device has sent a sentence with a right checksum, the same sentence without one has lost it; and
one with fewer fields than that sentence had before is cut.
"""

import re
from collections import Counter
from dataclasses import replace
from typing import Final

from common.framer import Measurement
from onboard.devices.driver import Accepted, Driver, Line, Outcome, Rejected
from onboard.devices.nmea_sentence import PADDING, checksum, sentence_of

UNCHECKED: Final = "without checksum"
"""Mark behind the kind of a sentence that was taken without checksum."""
_NAME: Final = re.compile(rb"[$!](?:[A-Z0-9]{5,8}(?=,)|[A-Z])")
"""How a sentence is known: by its address, or a maker's own word (`$C309.8P4.0`) by its letter."""


class OptionalChecksum:
    """Gives its driver such sentences with the checksum that they should have; they are counted apart."""

    def __init__(self, driver: Driver) -> None:
        self.sensor = driver.sensor
        self._driver = driver
        self._checked: set[bytes] = set()
        """Names of sentences that came with a right checksum."""
        self._fields: Counter[bytes] = Counter()
        """Name of a sentence -> most fields so far."""

    def claims(self, line: Line) -> bool:
        """As its driver."""
        return self._driver.claims(line)

    def feed(self, line: Line) -> Outcome:
        """As its driver; a sentence without checksum is accepted with `UNCHECKED` behind its kind.

        Reasons: those of the driver; `no-checksum` and `fields` see the module.
        """
        sentence = sentence_of(line.data)
        found = _NAME.match(sentence)
        if found is None or b"*" in sentence:
            outcome = self._driver.feed(line)
            if found is not None and isinstance(outcome, Accepted):
                self._checked.add(found[0])
            return outcome
        name = found[0]
        if name in self._checked:
            return Rejected("no-checksum", self.sensor)
        before, sentence = line.data[: len(line.data) - len(sentence)], sentence.rstrip(PADDING)
        fields = sentence.count(b",")
        if fields < self._fields[name] and name[3:] != b"XDR":  # which has as many groups as there is to say
            return Rejected("fields", self.sensor)
        outcome = self._driver.feed(replace(line, data=b"%b%b*%02X" % (before, sentence, checksum(sentence[1:]))))
        if not isinstance(outcome, Accepted):
            return outcome
        self._fields[name] = max(fields, self._fields[name])
        return replace(outcome, kind=f"{outcome.kind} {UNCHECKED}", unchecked=True)

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        """As its driver."""
        return self._driver.flush(now_ns, heard_ns)
