r"""AIS receivers and transponders: sentences VDM (others) and VDO (own ship), checked and handed on as they came.

    !AIVDM,parts,part,sequence,channel,payload,fill*hh

Nothing is assembled or altered here: every part of a message is an AisLine of its own, decoded ashore. The check goes
as far as a part alone allows. Kept, because real receivers send it: any talker (AI, AB, BS, ...), no sequence number,
one on a message of a single part, no channel or a digit for it, a further number at the end (a chart plotter's), an
empty payload (a message without content, `!AIVDM,1,1,,B,,0*25`: the shore passes over it).

An NMEA 4 tag block before the sentence (`\s:station,c:time*hh\!AIVDM,...`) must have a right checksum of its own; it
is left out of the AisLine, whose text is the sentence. Its time is not used: the line's arrival is on the boat's clock.
"""

import re
from typing import TYPE_CHECKING, Final

from common.boat_config import SensorTable
from common.clock import whole_us
from common.framer import Measurement
from common.messages import AisLine
from common.units import NS_PER_MS
from onboard.devices.driver import Accepted, Line, Outcome, Rejected
from onboard.devices.encoder import LINE_END, Surroundings
from onboard.devices.nmea_sentence import LONGEST_SENTENCE, address, check_sentence, checksum

if TYPE_CHECKING:
    from common.simulation.readings import AisReading

FORMATTERS: Final = frozenset({"VDM", "VDO"})

_TAG_BLOCK = re.compile(rb"\\([ -)+-\[\]-~]*)\*([0-9A-Fa-f]{2})\\")
_FIELDS = re.compile(r"!\w{5},([1-9]),([1-9]),[0-9]?,[A-Z0-9]?,([^,]*),[0-5](?:,[0-9]*)?")
"""Parts, part, sequence, channel, payload, fill, a further number."""
_PAYLOAD = re.compile(r"[0-W`-w]*")
"""The 64 characters that stand for six bits each."""


class AisDriver:
    """One AIS receiver."""

    def __init__(self, table: SensorTable) -> None:
        self.sensor = table.id
        self._talkers = frozenset(table.talkers)
        self._latency_ns = round(table.latency_ms * NS_PER_MS)

    def claims(self, line: Line) -> bool:
        """VDM and VDO of the talkers configured (none configured = all), with or without a tag block."""
        found = address(_split(line.data)[1])
        return found is not None and found[1] in FORMATTERS and (not self._talkers or found[0] in self._talkers)

    def feed(self, line: Line) -> Outcome:
        """One AisLine for each sentence, stamped with the arrival of its first byte less the latency.

        Beside the reasons of `check_sentence`: `tag-block` (its checksum or form), `formatter` (neither VDM nor VDO),
        `start` (`$` instead of `!`), `fields` (their number, parts, sequence, channel or fill), `payload` (a character
        that stands for no six bits).
        """
        block, data = _split(line.data)
        if len(line.data) > LONGEST_SENTENCE:
            return Rejected("too-long", self.sensor)
        if block is not None and not _is_whole(block):
            return Rejected("tag-block", self.sensor)
        sentence = check_sentence(data)
        if isinstance(sentence, str):
            return Rejected(sentence, self.sensor)
        if sentence.formatter not in FORMATTERS:
            return Rejected("formatter", self.sensor)
        fault = _fault(sentence.text)
        if fault is not None:
            return Rejected(fault, self.sensor)
        t_ns = whole_us(line.t_ns - self._latency_ns)
        ais = AisLine(sensor=self.sensor, t_ns=t_ns, text=sentence.text)
        return Accepted(self.sensor, sentence.formatter, (ais,))

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:  # noqa: ARG002  part of the Driver interface
        """Nothing: parts are not waited for."""
        return ()


class AisEncoder:
    """A receiver prints the sentence that came over the air."""

    def __init__(self, table: SensorTable, around: Surroundings) -> None:
        """Nothing of the two is in the sentence."""

    def encode(self, t_s: float, reading: "AisReading") -> bytes:  # noqa: ARG002  part of the Encoder interface
        """The sentence and its line end."""
        return reading.sentence.encode("ascii") + LINE_END


def _split(data: bytes) -> tuple[bytes | None, bytes]:
    r"""Tag block, both its backslashes included, or `None`; and the sentence."""
    if not data.startswith(b"\\"):
        return None, data
    end = data.find(b"\\", 1)
    return (None, data) if end < 0 else (data[: end + 1], data[end + 1 :])


def _is_whole(block: bytes) -> bool:
    match = _TAG_BLOCK.fullmatch(block)
    return match is not None and checksum(match[1]) == int(match[2], 16)


def _fault(text: str) -> str | None:
    """What is wrong with a sentence whose checksum is right."""
    if not text.startswith("!"):
        return "start"
    match = _FIELDS.fullmatch(text[:-3])
    if match is None or match[2] > match[1]:
        return "fields"
    return None if _PAYLOAD.fullmatch(match[3]) else "payload"
