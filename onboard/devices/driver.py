"""Driver interface: lines in, outcomes out; bad input is an outcome with a reason, never an exception.

A driver is pure: it takes a line and its time, returns values, reads no clock, opens nothing.
"""

from dataclasses import dataclass
from typing import Final, Protocol

from common.framer import Measurement
from common.messages import ClockPair, RawLine

COMPANIONS: Final = (RawLine, ClockPair)
"""What comes along with a measurement and is none itself: not counted in a sensor's rate."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a port, line end removed."""

    t_ns: int
    """Boat time of the chunk that brought the line's first byte, ns."""
    data: bytes
    end_ns: int | None = None
    """Boat time of the chunk that brought the line's end: 0.17 s later at 4800 baud; `None` = as `t_ns`."""


@dataclass(frozen=True, slots=True)
class Accepted:
    """A good line of `sensor`.

    `kind` names it for the counters (`GGA`, `HDG`, `ArduIMU`); a line that only adds to an epoch still open (GGA before
    RMC) is accepted with no measurement of its own yet.
    """

    sensor: str
    kind: str
    measurements: tuple[Measurement, ...] = ()
    unchecked: bool = False
    """True where nothing shows that the line came whole (`optional_checksum`)."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """A bad line: `reason` is a short fixed word of the counters (`checksum`, `range`, `not-a-number`, ...)."""

    reason: str
    sensor: str | None = None
    """Sensor that the line counts for; `None` where the line shows no sensor of the port."""


@dataclass(frozen=True, slots=True)
class Ignored:
    """A well-formed line that no sensor needs (GSV, start-up text, another talker); counted apart from rejects."""

    kind: str


Outcome = Accepted | Rejected | Ignored


class Driver(Protocol):
    """One sensor's decoder. One object for each `[[sensor]]`, living as long as the daemon."""

    sensor: str

    def claims(self, line: Line) -> bool:
        """Is this line this sensor's business? Shape, talker and formatter only; the checksum is not looked at yet."""
        ...

    def feed(self, line: Line) -> Outcome:
        """Decode one claimed line. Never raises."""
        ...

    def flush(self, now_ns: int, heard_ns: int) -> tuple[Measurement, ...]:
        """What is due at `now_ns` without another line: a GPS epoch that nothing has followed for 150 ms.

        `now_ns` is the time up to which all lines are known (`LineSplitter.complete_until`): a sentence takes 0.17 s
        to arrive at 4800 baud, and while it does the port is not quiet. `heard_ns` is when the last line of the port
        ended, of any device: another device's sentences may stand between those of one epoch.
        """
        ...
