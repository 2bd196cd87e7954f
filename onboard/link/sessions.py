"""Flow control for each client (leases, window): which frames are on their way and which to send next. Pure.

    newest frame first (behind the last fix), then missing ranges oldest first, never more than the client's window on
    the way.

The board believes nothing but the newest lease. Bytes on their way are those sent on this connection less those the
client has received since its first lease on it; a frame counts as lost again when the client has received what was
sent after it and still misses it.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from common.link_messages import LEASE_S, FrameRange, Lease
from common.units import NS_PER_S
from onboard.link.bounded_run import InOrder
from onboard.spool import Run

LEASE_NS: Final = int(LEASE_S * NS_PER_S)
FILL_SHARE: Final = 0.5
"""Share of the window for missing frames: a new frame always finds room."""
MAX_GONE: Final = 64
"""Most ranges that one answer reports as gone."""


def gone_of(missing: Sequence[FrameRange], held: Sequence[Run]) -> list[FrameRange]:
    """What of the missing ranges the board does not hold; frames that are not made yet are not gone."""
    by_boot = {run.boot_id: run for run in held}
    own = held[-1].boot_id if held else None
    gone = []
    for item in missing:
        run = by_boot.get(item.boot_id)
        if run is None:
            gone.append(item)
            continue
        if item.first < run.first_seq:
            gone.append(FrameRange(item.boot_id, item.first, min(item.last, run.first_seq - 1)))
        if item.boot_id != own and item.last >= run.next_seq:
            gone.append(FrameRange(item.boot_id, max(item.first, run.next_seq), item.last))
    return gone


class Pace:
    """Token bucket, for events and work that a client causes: so many at once, then so many a second."""

    def __init__(self, at_once: int, per_s: float) -> None:
        self._at_once = at_once
        self._per_s = per_s
        self._left = float(at_once)
        self._t_ns = 0

    def allows(self, t_ns: int) -> bool:
        """Whether one more may be at `t_ns`; it counts then."""
        self._left = min(self._at_once, self._left + max(0, t_ns - self._t_ns) / NS_PER_S * self._per_s)
        self._t_ns = max(t_ns, self._t_ns)
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(slots=True)
class Session:
    """One client. `key` is its public key, None on an open board."""

    name: str
    key: str | None
    lease: Lease
    expires_ns: int = 0
    connection: bytes | None = None
    """Routing id of the connection that brought the newest lease; None = it broke."""
    live_next: int = 0
    """The first frame of this start that was not sent as newest."""
    owed: deque[tuple[int, bytes, bytes]] = field(default_factory=lambda: deque(maxlen=1))
    """The last frame with a fix that found no room (seq, header, data); sent before the newest, unless it was."""
    frames_sent: int = 0
    gone: list[FrameRange] = field(default_factory=list)
    """Ranges that were missing on the board when it read; the next answer reports them."""
    wanted: deque[FrameRange] = field(default_factory=deque)
    """Missing ranges without the frames that are on their way."""
    in_order: InOrder | None = None
    """Position of a bounded run; None = the client has asked for none."""
    is_ended: bool = False
    """True once `end` is sent: the client is not served any more, unless it comes back over a new connection."""
    _sent: int = 0
    _base: int = 0
    _on_the_way: deque[tuple[int, str, int]] = field(default_factory=deque)
    """Each frame that fills a gap and is on its way: bytes sent when it was out, boot_id, seq."""

    def renew(self, lease: Lease, connection: bytes, now_ns: int, frame_period_ns: int) -> None:
        """Take a newer lease; a first one on a new connection finds nothing on the way."""
        if connection != self.connection:
            self.connection = connection
            self._sent, self._base = 0, lease.received
            self._on_the_way.clear()
            self.in_order, self.is_ended = None, False
        if lease.run is None:
            self.in_order = None
        elif self.in_order is None or self.in_order.asked.period_s != lease.run.period_s:
            self.in_order = InOrder(lease.run, frame_period_ns)
        self.lease = lease
        self.expires_ns = now_ns + LEASE_NS
        arrived = lease.received - self._base
        while self._on_the_way and self._on_the_way[0][0] <= arrived:
            self._on_the_way.popleft()
        self.gone.clear()
        self._want(lease.missing)

    def broke(self) -> None:
        """The connection is gone; the client is expected back until its lease ends."""
        self.connection = None
        self.wanted.clear()

    @property
    def on_the_way(self) -> int:
        """Bytes that are on their way."""
        return max(0, self._sent - (self.lease.received - self._base))

    def has_room(self, size: int, *, fill: bool) -> bool:
        """Whether a frame of `size` bytes may be sent now; one frame always may when nothing is on the way."""
        window = int(self.lease.window * (FILL_SHARE if fill else 1.0))
        return self.connection is not None and (self.on_the_way == 0 or self.on_the_way + size <= window)

    @property
    def fill_room(self) -> int:
        """Bytes of missing frames that may be read now; 0 = none."""
        if self.connection is None:
            return 0
        return max(0, int(self.lease.window * FILL_SHARE) - self.on_the_way)

    def sent_newest(self, seq: int, size: int) -> None:
        """The newest frame is out."""
        self.live_next = seq + 1
        self.frames_sent += 1
        self._sent += size

    def sent_missing(self, boot_id: str, seq: int, size: int) -> None:
        """A missing frame is out."""
        self.frames_sent += 1
        self._sent += size
        self._on_the_way.append((self._sent, boot_id, seq))
        self.passed(boot_id, seq)

    def sent_in_order(self, size: int) -> None:
        """A frame of a bounded run is out."""
        self.frames_sent += 1
        self._sent += size

    def wants(self, boot_id: str, seq: int) -> bool:
        """Whether this is among the frames still to be sent again."""
        return any(item.boot_id == boot_id and item.first <= seq <= item.last for item in self.wanted)

    def passed(self, boot_id: str, seq: int) -> None:
        """Frames up to `seq` of the range that is being filled are sent or gone."""
        while self.wanted and self.wanted[0].boot_id == boot_id and self.wanted[0].last <= seq:
            self.wanted.popleft()
        if self.wanted and self.wanted[0].boot_id == boot_id and self.wanted[0].first <= seq:
            self.wanted[0] = FrameRange(boot_id, seq + 1, self.wanted[0].last)

    def not_held(self, boot_id: str, ranges: Sequence[tuple[int, int]]) -> None:
        """The board looked and has none of these."""
        room = MAX_GONE - len(self.gone)
        self.gone += [FrameRange(boot_id, first, last) for first, last in ranges[:room]]

    def _want(self, missing: Sequence[FrameRange]) -> None:
        self.wanted.clear()
        for item in missing:
            first = item.first
            on_the_way = sorted(
                seq for _, boot_id, seq in self._on_the_way if boot_id == item.boot_id and first <= seq <= item.last
            )
            for seq in on_the_way:
                if first < seq:
                    self.wanted.append(FrameRange(item.boot_id, first, seq - 1))
                first = seq + 1
            if first <= item.last:
                self.wanted.append(FrameRange(item.boot_id, first, item.last))
