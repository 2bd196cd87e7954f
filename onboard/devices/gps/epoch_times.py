"""Epoch membership by UTC time of day: the period is learned, and sentences with a clock of their own only follow.

A burst seldom carries one time to the millisecond: GLL may have whole seconds, one sentence .999 beside the .00 of
another, or the time of its transmission; a plotter repeats the receiver's sentences later, or in local time. So

- times that differ by less than half of the receiver's period are one, and so are times of which the coarser is the
  finer one cut or rounded;
- GGA, GNS and RMC of a satellite talker lead; the same of other talkers (II) follow them, and GLL follows all. A kind
  leads while no better one has had a position for 10 s. A follower joins the epoch of its time. A GLL of a later time
  is doubted until a leader of a time still later confirms it, if it came near its time (old receivers send RMC and GLL
  of alternate seconds); what else has another time is set aside;
- a leader with the time and the place of an epoch of the last 10 s is a repetition (a plotter's).
"""

from collections import deque
from collections.abc import Iterable
from enum import Enum, auto
from typing import Final, NamedTuple

from common.units import NS_PER_MS, NS_PER_S
from onboard.devices.nmea_fields import tod_step_ms

SATELLITE_TALKERS: Final = frozenset({"GP", "GL", "GA", "GN", "GB", "BD", "GQ", "QZ", "GI", "GS"})
UNLEARNED_MS: Final = 100
"""Period before one is learned, ms: at 10 Hz two epochs stay two, and times 0.05 s apart are one."""
LEADS_NS: Final = 10 * NS_PER_S
"""Time for which a kind of sentence leads after its last position, ns."""
REPEATED_MS: Final = 10_000
"""So far behind the epoch before a time is a repetition, ms; one further behind is a clock that was set."""
EARLY: Final = 1 / 3
LATE: Final = 0.45
"""A follower that is right comes no earlier than after a third of the time that its own time has gone on, and no later
than this share of the time between two leaders after it. So wide, because of lines without times of arrival only their
number is known."""
_LONGEST_STEP_MS: Final = 10_000
_STEPS: Final = 5
_LEAST_STEPS: Final = 3
"""From fewer steps no period is learned: the first ones may have gaps."""
_PLACES: Final = 64


class Place(Enum):
    """A sentence of another time than the newest epoch's opens one, waits for a leader, or is set aside."""

    OPENS = auto()
    DOUBTED = auto()
    ASIDE = auto()


class Stamp(NamedTuple):
    """A time of day as a sentence gives it."""

    tod_ms: int
    step_ms: int
    """How finely it is written, ms: 1000 without decimals."""
    rank: int
    """Rank of the sentence (`rank_of`)."""
    t_ns: int
    """Boat time of its arrival, ns."""


class EpochTimes:
    """What the times of one receiver have shown so far. Addresses are talker and formatter (`GPGGA`)."""

    def __init__(self) -> None:
        self._last_ms: dict[str, int] = {}
        self._steps: dict[str, deque[int]] = {}
        self.period_ms: float = UNLEARNED_MS
        """The receiver's period, ms: that of its quickest sentence."""
        self._led: dict[int, int] = {}
        """Rank -> boat time of the last position of that rank, ns."""
        self._leader: Stamp | None = None
        """The last time of a leader with a position."""
        self._places: deque[tuple[int, str]] = deque(maxlen=_PLACES)
        """Times and places of the last sentences."""
        self._confirmed: dict[str, bool] = {}
        """Address of a follower -> whether its time fitted in when last compared."""

    def learn(self, address: str, tod_ms: int) -> None:
        """Take note of a time; the period of an address is the least of its last five steps, for lines are lost."""
        step_ms = tod_step_ms(self._last_ms.get(address, tod_ms), tod_ms)
        self._last_ms[address] = tod_ms
        if 0 < step_ms <= _LONGEST_STEP_MS:
            steps = self._steps.setdefault(address, deque(maxlen=_STEPS))
            is_known = len(steps) == _STEPS and steps[0] == step_ms
            steps.append(step_ms)
            if is_known:
                return  # the same steps as before
            learned = [min(steps) for steps in self._steps.values() if len(steps) >= _LEAST_STEPS]
            self.period_ms = min(learned, default=UNLEARNED_MS)

    def are_one(self, a: Stamp, b: Stamp) -> bool:
        """Whether two times are of one epoch."""
        apart_ms = tod_step_ms(a.tod_ms, b.tod_ms)
        if 2 * abs(apart_ms) < self.period_ms:
            return True
        if a.step_ms == b.step_ms:
            return False
        beyond_ms, step_ms = (apart_ms, a.step_ms) if a.step_ms > b.step_ms else (-apart_ms, b.step_ms)
        # What was cut may have been .999 beside .00; but in steps of a period the next time is the next epoch's.
        most_ms = step_ms if step_ms < self.period_ms else step_ms - 1
        return -step_ms <= 2 * beyond_ms <= 2 * most_ms

    def had_place(self, stamp: Stamp | None, place: str) -> None:
        """Say that a sentence brought a position, as it was written."""
        if stamp is None:
            return
        self._led[stamp.rank] = stamp.t_ns
        self._places.append((stamp.tod_ms, place))
        if self._leads(stamp):
            self._leader = stamp

    def place_of(self, address: str, stamp: Stamp, place: str | None, newest: Stamp) -> Place:
        """What to do with a time that is not that of the newest epoch (see the module); place: as it was written."""
        ahead_ms = tod_step_ms(newest.tod_ms, stamp.tod_ms)
        if self._leads(stamp):
            repeated = -REPEATED_MS <= ahead_ms < 0 and (stamp.tod_ms, place) in self._places
            return Place.ASIDE if repeated else Place.OPENS
        if stamp.rank > 0 or ahead_ms <= 0 or self.are_one(newest, stamp):
            return Place.ASIDE
        is_next = self.is_confirmed(address) and ahead_ms <= REPEATED_MS
        is_late = 2 * (stamp.t_ns - newest.t_ns) >= ahead_ms * NS_PER_MS
        return Place.OPENS if is_next and is_late else Place.DOUBTED

    def _leads(self, stamp: Stamp) -> bool:
        """Whether sentences of that rank make the epochs."""
        return not any(rank > stamp.rank and stamp.t_ns - led_ns < LEADS_NS for rank, led_ns in self._led.items())

    def is_confirmed(self, address: str) -> bool:
        """Whether a leader has shown that the times of a follower are right."""
        return self._confirmed.get(address, False)

    def is_contradicted(self, address: str) -> bool:
        """Whether a leader has shown that the times of a follower are wrong."""
        return self._confirmed.get(address) is False

    def confirms(self, addresses: Iterable[str], follower: Stamp, leader: Stamp) -> bool:
        """Whether a leader that follows the sentences of an epoch shows that their time was right; it is noted."""
        if leader.rank <= follower.rank or self.are_one(follower, leader):
            return False
        is_right = 0 < tod_step_ms(follower.tod_ms, leader.tod_ms) <= REPEATED_MS
        base = self._leader
        if is_right and base is not None and base.t_ns < leader.t_ns:
            came = (follower.t_ns - base.t_ns) / (leader.t_ns - base.t_ns)
            said = tod_step_ms(base.tod_ms, follower.tod_ms) / (tod_step_ms(base.tod_ms, leader.tod_ms) or 1)
            is_right = EARLY * said <= came <= said + LATE
        self._confirmed.update(dict.fromkeys(addresses, is_right))
        return is_right


def rank_of(address: str) -> int:
    """2 = a satellite talker's, 1 = another talker's, 0 = GLL of whatever talker."""
    if address.endswith("GLL"):
        return 0
    return 2 if address[:2] in SATELLITE_TALKERS else 1
