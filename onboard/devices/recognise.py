"""Device identification: what comes on this port? Known models by what their drivers make of the lines; others by form.

`recognised` asks the drivers. `stranger` names what no driver reads: binary protocols (`common.framings`),
sentences and text (`onboard.devices.foreign_text`). Both need several frames or lines. What is left is noise, and
nothing but a wrong baud rate or a bad wire makes that. Pure.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from common.boat_config import ROLES, SensorTable
from common.framer import Measurement
from common.framings import NO_DRIVER, frames_in
from common.units import NS_PER_S
from common.visible_lines import is_text, shown
from onboard.devices.driver import COMPANIONS, Accepted, Line
from onboard.devices.foreign_text import TextSeen, cure_of, maker_of, text_seen
from onboard.devices.nmea_sentence import address, check_sentence
from onboard.devices.port_decoder import PortDecoder
from onboard.devices.registry import MODELS, make_driver
from onboard.devices.unknown_frames import unknown_mark

SAMPLE_BYTES: Final = 4_096
"""Number of bytes of a port, the newest, that are enough to recognise what comes."""
LEAST_LINES: Final = 2
"""Number of lines of one kind that are no accident."""
LEAST_SHARE: Final = 0.1
"""Share of the bytes that a protocol has where it is what comes."""
WANTED: Final = {
    "gps": "turn on GGA and RMC",
    "compass": "turn on HDG, HDM or HDT",
    "ais": "turn on VDM",
    "radar": "turn on TTM or TLL",
}
"""Role -> what an NMEA device is to send."""
HEADINGS: Final = frozenset(
    {"THS", "HPR", "PASHR", "PTNL,AVR", "PSAT,HPR", "PFEC,GPatt", "PTNTHTM", "PTNTHPR", "PHTRO"}
)
"""Sentences of heading receivers and compasses."""
_NAMED: Final = 5


@dataclass(frozen=True, slots=True)
class Stranger:
    """What comes in place of what is wanted."""

    what: str
    """What comes, as the beginning of a sentence."""
    cure: str
    """What a person does about it."""

    def __str__(self) -> str:
        return f"{self.what}: {self.cure}" if self.cure else self.what


NOISE: Final = Stranger("none readable: wrong baud rate?", "")
"""Bytes that are neither text nor packets of a protocol."""
LEAST_NOISE_BYTES: Final = 16


@dataclass(slots=True)
class Heard:
    """What sensors made of lines, by sensor id."""

    accepted: Counter[str] = field(default_factory=Counter)
    """Number of accepted lines of each sensor."""
    measured: Counter[str] = field(default_factory=Counter)
    """Number of measurements of each sensor, companions left out."""

    def measure(self, measurements: Iterable[Measurement]) -> None:
        """Count what came of one line, or of a pause."""
        self.measured.update(item.sensor for item in measurements if not isinstance(item, COMPANIONS))


def heard_by(tables: Iterable[SensorTable], lines: Sequence[Line]) -> Heard:
    """What these sensors, together on one port, make of the lines: the first that claims a line has it."""
    drivers = [make_driver(table) for table in tables]
    decoder = PortDecoder(drivers)
    heard = Heard()
    for line in lines:
        if not any(driver.claims(line) for driver in drivers):
            continue
        heard.measure(decoder.flush(line.t_ns))
        outcome = decoder.feed(line)
        if isinstance(outcome, Accepted):
            heard.accepted[outcome.sensor] += 1
            heard.measure(outcome.measurements)
    if lines:
        heard.measure(decoder.flush(lines[-1].t_ns + NS_PER_S))
    return heard


def accepted_by_model(lines: Sequence[Line]) -> dict[tuple[str, str], int]:
    """Good lines by (role, model), in the order of `MODELS`, each model by itself; those without any are left out."""
    counts = {}
    for role, model in MODELS:
        table = SensorTable(id=f"{role}1", port="", role=role, model=model)
        counts[role, model] = heard_by([table], lines).accepted[table.id]
    return {key: count for key, count in counts.items() if count}


def recognised(lines: Iterable[Line]) -> tuple[str, str] | None:
    """Role and model whose driver accepts most of these lines, the first in `MODELS` of equals; None = none."""
    counts = accepted_by_model(tuple(lines))
    return max(counts, key=lambda key: counts[key], default=None)


def recognised_by_role(lines: Sequence[Line]) -> dict[str, str]:
    """The model that accepts most of the lines, for each role with good lines, in the order of `ROLES`.

    The first in `MODELS` of equals.
    """
    counts = accepted_by_model(lines)
    best: dict[str, str] = {}
    for role, model in counts:
        if role not in best or counts[role, model] > counts[role, best[role]]:
            best[role] = model
    return {role: best[role] for role in ROLES if role in best}


def stranger(table: SensorTable, data: bytes, unclaimed: Sequence[Line]) -> Stranger | None:
    """What comes on the port of this sensor that is not for it; `None` = not known.

    data: the newest bytes of the port; unclaimed: lines that no sensor of the port takes.
    """
    data = data[-SAMPLE_BYTES:]
    frames, left = frames_in(data)
    binary = [item for item in frames if item.size >= LEAST_SHARE * len(data)]
    names = [item.framing.name for item in binary]
    packets = _packets(table, names, binary[0].framing.cure) if binary else None
    if packets is not None and 4 * len(left) <= len(data):
        return packets
    return (
        _known_lines(table, unclaimed)
        or _sentences(table, text_seen(line.data for line in unclaimed))
        or packets
        or _seven_bits(left)
        or _text(table, left)
        or _no_text(table, left)
    )


def is_whole(data: bytes) -> bool:
    """Whether binary packets stand between whole sentences: a device speaks both, and nothing is damaged."""
    frames, left = frames_in(data[-SAMPLE_BYTES:])
    seen = text_seen(_lines(left))
    return bool(frames) and 10 * seen.damaged <= seen.sentences.total()


def models_of(role: str) -> str:
    """The models of a role, in words."""
    return ", ".join(model for other, model in MODELS if other == role)


def _packets(table: SensorTable, names: Sequence[str], cure: str) -> Stranger:
    """Frames of a binary protocol; no setting makes an inertial unit of what sends NMEA."""
    return Stranger(f"what comes is {' and '.join(names[:2])}", cure if table.role in WANTED else _wanted(table.role))


def _known_lines(table: SensorTable, unclaimed: Sequence[Line]) -> Stranger | None:
    """The lines of a model that is read, or of another talker: another device, or the plugs were swapped."""
    found = recognised(unclaimed)
    if found is None:
        return None
    if found != (table.role, table.model):
        cure = f"take the port of the {table.role}, or correct role and model in the board's file"
        return Stranger(f"lines like those of {' '.join(found)} come; configured: {table.role} {table.model}", cure)
    addresses = {address(line.data) for line in unclaimed}
    talkers = ", ".join(sorted({where[0] for where in addresses if where is not None})[:4])
    wanted = ", ".join(table.talkers) or "all"
    what = f"its lines come from talker {talkers}; configured: {wanted}"
    return Stranger(what, "correct talkers in the board's file")


def _sentences(table: SensorTable, seen: TextSeen) -> Stranger | None:
    """Sentences that came whole and are not read."""
    if seen.sentences.total() < LEAST_LINES or seen.damaged > seen.sentences.total():
        return None
    names = [name for name, _ in seen.sentences.most_common(_NAMED)]
    makers = sorted({maker_of(name) for name in names} - {""})
    said = ", ".join(names) + (f" of {' and '.join(makers)}" if makers else "")
    role = "compass" if table.role == "gps" and set(names) <= HEADINGS else table.role
    return Stranger(f"what comes is {said}, which is not read", _wanted(role))


def _text(table: SensorTable, data: bytes) -> Stranger | None:
    """Clean text of another format. A sensor's own lines, refused for what is in them, are not the question here."""
    seen = text_seen(_lines(data))
    count = seen.formats.total()
    if count < LEAST_LINES or count < seen.sentences.total() + seen.unchecked.total() + 9 * seen.damaged:
        return None
    name, _ = seen.formats.most_common(1)[0]
    what = f"what comes is {name} that no driver reads, like '{shown(seen.example)}'"
    return Stranger(what, cure_of(name) or _wanted(table.role))


def _no_text(table: SensorTable, data: bytes) -> Stranger | None:
    """What is no text is noise, unless it has the order of a protocol."""
    if len(data) < LEAST_NOISE_BYTES or is_text(data):
        return None
    mark = unknown_mark(data)
    if mark is None:
        return NOISE
    what = f"what comes is packets of a binary protocol that is not known here, each with {mark.hex(' ')} before it"
    return Stranger(what, _wanted(table.role))


def _lines(data: bytes) -> list[bytes]:
    """The whole lines of a piece of a stream."""
    return data.replace(b"\r", b"\n").split(b"\n")[1:-1]


def _seven_bits(data: bytes) -> Stranger | None:
    """Sentences sent with seven bits and parity: the eighth bit of about half the bytes is set."""
    lines = bytes(byte & 0x7F for byte in data).replace(b"\r", b"\n").split(b"\n")
    sound = sum(not isinstance(check_sentence(line), str) and line not in data for line in lines)
    if sound < LEAST_LINES:
        return None
    return Stranger(
        "what comes is sentences with 7 bits and parity", "set the device to 8 bits, no parity, 1 stop bit (8N1)"
    )


def _wanted(role: str) -> str:
    return WANTED.get(role) or f"{NO_DRIVER}; of the role {role} these models are read: {models_of(role)}"
