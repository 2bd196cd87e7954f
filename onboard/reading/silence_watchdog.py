"""Watchdog of one sensor, a state machine: does it deliver, is it silent or missing, and which change is news.

There is one automaton for each sensor. The port moves it: it OPENED, or it was LOST. The clock moves it: each look at
the sensor finds it FRESH (a good line came after the port's last opening, and within stale-after, which follows the
configured rate), OVERDUE (none came for longer than the limit of silence), or STALE (neither). The lines do not move
it: a good line is remembered with its time, and the next look judges it.

    MISSING --OPENED--> WAITING --FRESH*--> DELIVERING --STALE--> LATE --OVERDUE*--> OUTAGE --FRESH*--> DELIVERING
                                                 ^                  |
                                                 `------FRESH-------'
    * with an event. LOST leads from every state to MISSING, OVERDUE* from every other state to OUTAGE.

People see three states (`SHOWN`): WAITING, LATE and OUTAGE are all "silent". They differ in what was said last: nothing
since the port was lost, that the sensor delivers, that it is silent. So every outage is one event, its end is one, and
a shorter pause is none (hysteresis). The limit is five learned periods and at least stale-after, so that a sensor
slower than its configuration is no event for each of its samples. A port that is opened without a loss ends no silence,
but what came before says nothing of what is plugged in now: DELIVERING becomes LATE.

Every step is a row of `TABLE`; a pair that has no row changes nothing. Two rules are in the code: how a look becomes
one of its three inputs (`_input`), and that an event sensor (AIS, radar) is FRESH while its port is open, and says
nothing, unless it is misread: what comes is nothing that it can use. A new state changes the picture, `State`, `TABLE`
and `SHOWN` together, and `SENSOR_STATES` of `common.messages` where people see the state by a word of its own.
"""

from enum import Enum, auto
from typing import Final

from onboard.reading.rhythm import Rhythm

PERIODS: Final = 5
"""Number of learned periods after which a silence is an outage."""


class State(Enum):
    """The states of the automaton."""

    MISSING = auto()
    """The port is closed."""
    WAITING = auto()
    """The port is open, and nothing has been said of the sensor since."""
    DELIVERING = auto()
    LATE = auto()
    """The sensor delivered, no good line comes any more, and that is not yet worth an event."""
    OUTAGE = auto()
    """It has been said that the sensor is silent."""


class Input(Enum):
    """What moves the automaton."""

    OPENED = auto()
    LOST = auto()
    FRESH = auto()
    STALE = auto()
    OVERDUE = auto()


TABLE: Final[dict[tuple[State, Input], tuple[State, str | None]]] = {
    (State.MISSING, Input.OPENED): (State.WAITING, None),
    (State.WAITING, Input.LOST): (State.MISSING, None),
    (State.WAITING, Input.FRESH): (State.DELIVERING, "sensor-delivering"),
    (State.WAITING, Input.OVERDUE): (State.OUTAGE, "sensor-silent"),
    (State.DELIVERING, Input.LOST): (State.MISSING, None),
    (State.DELIVERING, Input.OPENED): (State.LATE, None),
    (State.DELIVERING, Input.STALE): (State.LATE, None),
    (State.DELIVERING, Input.OVERDUE): (State.OUTAGE, "sensor-silent"),
    (State.LATE, Input.LOST): (State.MISSING, None),
    (State.LATE, Input.FRESH): (State.DELIVERING, None),
    (State.LATE, Input.OVERDUE): (State.OUTAGE, "sensor-silent"),
    (State.OUTAGE, Input.LOST): (State.MISSING, None),
    (State.OUTAGE, Input.FRESH): (State.DELIVERING, "sensor-delivering"),
}
"""Transition table: (state, input) -> the next state, and the code of the event that goes with the step."""

SHOWN: Final = {
    State.MISSING: "missing",
    State.WAITING: "silent",
    State.DELIVERING: "delivering",
    State.LATE: "silent",
    State.OUTAGE: "silent",
}
"""Word of `SENSOR_STATES` that people see for each state."""


class Delivery:
    """The automaton of one sensor. All times are boat times, ns."""

    def __init__(self, periodic: bool, stale_ns: int, started_ns: int) -> None:
        """periodic: silence is a fault; stale_ns: age at which the newest value of the sensor is stale, ns."""
        self.stale_ns = stale_ns
        self.last_good_ns: int | None = None
        self.rhythm = Rhythm(stale_ns)
        self.is_misread = False
        """True while lines come and an event sensor can use none of them; its monitor sets it."""
        self._periodic = periodic
        self._opened_ns = started_ns
        self.state = State.MISSING
        """Where the last step led; between two looks `state_at` knows better."""

    @property
    def is_missing(self) -> bool:
        """True while the port is closed."""
        return self.state is State.MISSING

    @property
    def has_delivered(self) -> bool:
        """True when a good line has come since the port's last opening."""
        return self.last_good_ns is not None and self.last_good_ns >= self._opened_ns

    def good(self, t_ns: int) -> None:
        """A good line came at `t_ns`."""
        self.last_good_ns = t_ns
        self.rhythm.line(t_ns)

    def opened(self, t_ns: int) -> None:
        """The port was opened at `t_ns`."""
        self._opened_ns = t_ns
        self._step(Input.OPENED)

    def lost(self) -> None:
        """The port was lost, or cannot be opened: what comes back may be another device."""
        self.rhythm.forget()
        self._step(Input.LOST)

    def look(self, now_ns: int) -> str | None:
        """One step by the clock: the code of the event that is due with it."""
        was_silent = self.state is State.OUTAGE
        code = self._step(self._input(now_ns))
        return code if self._periodic or was_silent or self.state is State.OUTAGE else None

    def state_at(self, now_ns: int) -> State:
        """The state to which a look at `now_ns` would lead; the automaton stays where it is."""
        return self._next(self._input(now_ns))[0]

    def quiet_ns(self, now_ns: int) -> int:
        """Time since the last good line or the port's last opening, whichever came later."""
        return now_ns - max(self.last_good_ns or 0, self._opened_ns)

    def limit_ns(self) -> int:
        """How long a silence may be before it is an outage."""
        return max(self.stale_ns, PERIODS * (self.rhythm.period_ns or 0))

    def _input(self, now_ns: int) -> Input:
        if not self._periodic:
            return Input.OVERDUE if self.is_misread else Input.FRESH
        if self.has_delivered and self.quiet_ns(now_ns) <= self.stale_ns:
            return Input.FRESH
        return Input.OVERDUE if self.quiet_ns(now_ns) > self.limit_ns() else Input.STALE

    def _next(self, moved_by: Input) -> tuple[State, str | None]:
        return TABLE.get((self.state, moved_by), (self.state, None))

    def _step(self, moved_by: Input) -> str | None:
        self.state, code = self._next(moved_by)
        return code
