"""State machine of the station's link: connection watchdog with back-off, lease renewal, refused handshakes. Pure.

The theory before the code. A link has ONE `LinkState`; six things (`Trigger`) move it, by one table (`TRANSITIONS`):

    state     CONNECT   HEARD    QUIET     REFUSED  MOVE      CLOSE
    NEW       GREETING  -        -         -        -         CLOSED     no connection was asked for yet
    GREETING  GREETING  RUNNING  GREETING  REFUSED  GREETING  CLOSED     `hello` goes out, no board has answered
    RUNNING   GREETING  RUNNING  SILENT    REFUSED  SILENT    CLOSED     the board was heard over this connection
    SILENT    GREETING  RUNNING  SILENT    REFUSED  SILENT    CLOSED     a session; not a word over this connection
    REFUSED   GREETING  RUNNING  REFUSED   REFUSED  REFUSED   CLOSED     no word since somebody refused our handshake
    CLOSED    -         -        -         -        -         CLOSED     for good

"-" cannot happen, and is a fault of the caller (AssertionError). CONNECT, QUIET and MOVE each replace the connection;
no other trigger does. A session lives longer than its connections: HEARD over whichever of them makes it RUNNING again,
because the next lease carries all that the board has to know. So SILENT and REFUSED differ only in what a person reads,
and nothing but the board itself ends a session: another box may have the boat's address for a while.

Rules in the table: which state follows. Rules in code, since they need times and counts:

- QUIET (`watch`): no word for the watchdog's time, neither since the board was heard last nor since the connection was
  opened. Ask only when nothing waits to be read: it may be we who did not look.
- The watchdog doubles at each QUIET of a connection over which nothing was heard, up to a limit; HEARD resets it.
- REFUSED (`judge`): an unknown key or a mismatch at once, a broken handshake only as one of several in a row.
- Asking (`due_ns`): `hello` in GREETING, leases in RUNNING, SILENT and REFUSED. The next one is due at once over a new
  connection, after the greeting and when half a window has come, and earlier than usual after `ask_soon`.
- An alarm (`silent_ns`) counts from the last word, whatever the state: a loss that heals in time is not worth a line.

The times below lean on each other: RENEW < WATCHDOG < alarm (3 s, [limits] link_lost_s) < the board's memory of a lease
(5 s).
"""

from enum import Enum, auto
from typing import Final

from common import link_messages as session
from common.units import NS_PER_MS, NS_PER_S
from shore.link.transport import HandshakeFault

WATCHDOG_NS: Final = 1_500 * NS_PER_MS
"""First limit of the watchdog, ns: six leases without an answer. The case: a radio that is silent for 30 s and comes
back, and an operator who wants a new frame within 3 s. A memory stick that took as long for one sync is why only an
empty connection is judged."""
LONGEST_WATCHDOG_NS: Final = 6_000 * NS_PER_MS
"""Last limit of the watchdog's back-off, ns. The case: a far radio with a round trip of more than 0.2 s. An encrypted
greeting takes some seven round trips, so 1.5 s ended each of them just before it was done, for ever. 6 s carry 0.8
s; 0.5 s is tested."""
RENEW_NS: Final = int(session.RENEW_S * NS_PER_S)
"""Interval of leases, ns: four a second of 150 bytes. The case: 1 Mbit/s shared with the frames, where an
acknowledgement that could be lost stopped the stream after 8 s of outage; the board forgets a station only after
twenty lost leases."""
URGENT_NS: Final = 100 * NS_PER_MS
"""Interval of leases after `ask_soon`, ns: the board's fastest pace. The case: frames come again after an outage and
show a hole to be filled."""
RETRY_NS: Final = 100 * NS_PER_MS
"""Pause where a lease could not be handed over, ns. The case: the daemon is restarted; it is asked as soon as it is
there."""
HELLO_NS: Final = 500 * NS_PER_MS
"""Interval of `hello`, ns. The case: a daemon that is stopped between the handshake and its answer; a single one would
get no answer."""
BROKEN_GREETINGS: Final = 5
"""Number of broken handshakes in a row, at five a second, that are a refusal. The case: a daemon that is stopped amid a
handshake breaks one, and is back soon."""


class LinkState(Enum):
    """Where a link stands; what each means is in the table above."""

    NEW = auto()
    GREETING = auto()
    RUNNING = auto()
    SILENT = auto()
    REFUSED = auto()
    CLOSED = auto()


class Trigger(Enum):
    """What moves a link."""

    CONNECT = auto()
    """The caller wants a session."""
    HEARD = auto()
    """A message of the board came; in `Link.connect` only a greeting counts."""
    QUIET = auto()
    """The watchdog found no word for too long."""
    REFUSED = auto()
    """A handshake failed in a way that another attempt does not mend."""
    MOVE = auto()
    """The boat has another address."""
    CLOSE = auto()
    """The caller is done."""


_WHILE_OPEN: Final = {
    Trigger.CONNECT: LinkState.GREETING,
    Trigger.HEARD: LinkState.RUNNING,
    Trigger.REFUSED: LinkState.REFUSED,
    Trigger.CLOSE: LinkState.CLOSED,
}
TRANSITIONS: Final[dict[LinkState, dict[Trigger, LinkState]]] = {
    LinkState.NEW: {Trigger.CONNECT: LinkState.GREETING, Trigger.CLOSE: LinkState.CLOSED},
    LinkState.GREETING: {**_WHILE_OPEN, Trigger.QUIET: LinkState.GREETING, Trigger.MOVE: LinkState.GREETING},
    LinkState.RUNNING: {**_WHILE_OPEN, Trigger.QUIET: LinkState.SILENT, Trigger.MOVE: LinkState.SILENT},
    LinkState.SILENT: {**_WHILE_OPEN, Trigger.QUIET: LinkState.SILENT, Trigger.MOVE: LinkState.SILENT},
    LinkState.REFUSED: {**_WHILE_OPEN, Trigger.QUIET: LinkState.REFUSED, Trigger.MOVE: LinkState.REFUSED},
    LinkState.CLOSED: {Trigger.CLOSE: LinkState.CLOSED},
}


class LinkMachine:
    """The state of one link and its deadlines. All times are ns on the caller's clock, which never goes back."""

    def __init__(self, now_ns: int, window: int) -> None:
        """Window: bytes of frames that may be on their way at once."""
        self.state = LinkState.NEW
        self.verdict: HandshakeFault | None = None
        """How the last handshake failed, in the state REFUSED; else None."""
        self.received_bytes = 0
        """Number of bytes of frames received over all connections."""
        self.heard_ns = now_ns
        """When the board was heard last, ns."""
        self._half_window = window // 2
        self._opened_ns = now_ns
        self._watchdog_ns = WATCHDOG_NS
        self._broken_greetings = 0
        self._asked_ns: int | None = None
        """When the last `hello` or lease went over this connection, ns; None = the next is due at once."""
        self._pause_ns = RENEW_NS
        """Pause between this lease and the next, ns."""
        self._leased_bytes = 0
        """Number of received bytes that the last lease reported."""

    @property
    def is_open(self) -> bool:
        """There is a connection, or one is being made."""
        return self.state not in (LinkState.NEW, LinkState.CLOSED)

    def connect(self, now_ns: int) -> None:
        """A session is wanted: the caller opens a connection."""
        self._follow(Trigger.CONNECT)
        self._opened(now_ns)

    def move(self, now_ns: int) -> None:
        """The boat has another address: the caller opens a connection there."""
        self._follow(Trigger.MOVE)
        self._opened(now_ns)

    def watch(self, now_ns: int) -> bool:
        """Nothing waits to be read: is it quiet for too long? True = the caller opens another connection."""
        if now_ns - max(self.heard_ns, self._opened_ns) <= self._watchdog_ns:
            return False
        if self.heard_ns < self._opened_ns:
            self._watchdog_ns = min(2 * self._watchdog_ns, LONGEST_WATCHDOG_NS)
        self._follow(Trigger.QUIET)
        self._opened(now_ns)
        return True

    def heard(self, now_ns: int) -> None:
        """A message of the board came."""
        if self.state is LinkState.GREETING:
            self._asked_ns = None
        self._follow(Trigger.HEARD)
        self.heard_ns = now_ns
        self._broken_greetings = 0
        self._watchdog_ns = WATCHDOG_NS

    def judge(self, verdict: HandshakeFault) -> bool:
        """A handshake failed; True = it is a refusal, False = the next attempt may succeed."""
        self._broken_greetings += verdict is HandshakeFault.BROKEN
        if verdict is HandshakeFault.BROKEN and self._broken_greetings < BROKEN_GREETINGS:
            return False
        self._follow(Trigger.REFUSED)
        self.verdict = verdict
        return True

    def close(self) -> None:
        """The caller closes the connection, if there is one."""
        self._follow(Trigger.CLOSE)

    def due_ns(self, now_ns: int) -> int:
        """When the next `hello` (in GREETING) or lease is due; `now_ns` or before = at once."""
        if self._asked_ns is None:
            return now_ns
        if self.state is LinkState.GREETING:
            return self._asked_ns + HELLO_NS
        is_half_used = self.received_bytes - self._leased_bytes >= self._half_window
        return now_ns if is_half_used else self._asked_ns + self._pause_ns

    def asked(self, now_ns: int) -> None:
        """The `hello` or lease that was due went out."""
        self._asked_ns, self._leased_bytes, self._pause_ns = now_ns, self.received_bytes, RENEW_NS

    def ask_soon(self) -> None:
        """The next lease has something to say: it is due before its time."""
        self._pause_ns = URGENT_NS

    def silent_ns(self, now_ns: int) -> int:
        """How long the board has not been heard."""
        return now_ns - self.heard_ns

    def _follow(self, trigger: Trigger) -> None:
        after = TRANSITIONS[self.state].get(trigger)
        assert after is not None, f"{trigger.name} in {self.state.name}"
        self.state = after
        if after is not LinkState.REFUSED:
            self.verdict = None

    def _opened(self, now_ns: int) -> None:
        self._opened_ns, self._asked_ns = now_ns, None
