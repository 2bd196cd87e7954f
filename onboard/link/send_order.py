"""Send order of the frames to one client, and how many may be on the way at once (flow control, window). Pure.

1. The newest frame, as soon as it is made: the whole window is for it. One that finds no room is passed over, but not
   one with a fix: the last of those goes before the newest. (Running sums bridge what an IMU said in the frames that
   did not come; nothing bridges a fix.)
2. What the client misses, oldest first, in half of the window: so a new frame always finds room.
3. What the board does not hold any more is not sent: the client is told that it is gone.

The board believes nothing but the newest lease. Bytes on their way are those sent on this connection less those the
client has received since its first lease on it; a frame counts as lost again when the client has received what was
sent after it and still misses it.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from common.link_messages import FrameRange, Lease
from onboard.spool import Run

FILL_SHARE: Final = 0.5
"""Share of the window for missing frames: a new frame always finds room."""
MAX_GONE: Final = 64
"""Most ranges that one answer reports as gone."""


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """A frame of this start as it is sent: the message's header and the frame's bytes."""

    seq: int
    header: bytes
    data: bytes


@dataclass(slots=True)
class SendOrder:
    """What one client is sent next."""

    live_next: int = 0
    """The first frame of this start that was not sent as newest."""
    frames_sent: int = 0
    wanted: deque[FrameRange] = field(default_factory=deque)
    """Missing ranges less what is on its way, oldest first."""
    gone: list[FrameRange] = field(default_factory=list)
    """Ranges found missing on the board while it read; the next answer reports them."""
    _window: int = 0
    _received: int = 0
    """Bytes that arrived on this connection."""
    _base: int = 0
    """Bytes received before its first lease."""
    _sent: int = 0
    """Number of bytes sent on this connection."""
    _on_the_way: deque[tuple[int, str, int]] = field(default_factory=deque)
    """Frames on their way that fill a gap, each as (bytes sent when it was out, boot_id, seq)."""

    def renew(self, lease: Lease, *, is_first: bool) -> None:
        """Take a newer lease; the first one on a new connection finds nothing on the way."""
        if is_first:
            self._sent, self._base = 0, lease.received
            self._on_the_way.clear()
        self._window, self._received = lease.window, lease.received - self._base
        while self._on_the_way and self._on_the_way[0][0] <= self._received:
            self._on_the_way.popleft()
        self.gone.clear()
        self._want(lease.missing)

    def next_live(self, newest: LiveFrame, last_with_fix: LiveFrame | None) -> LiveFrame | None:
        """What goes next of the frames made now: the last with a fix, then the newest; `None` = both are out."""
        frames = (newest,) if last_with_fix is None else (last_with_fix, newest)
        return next((frame for frame in frames if frame.seq >= self.live_next), None)

    def next_missing(self) -> FrameRange | None:
        """The oldest missing range; `None` = none is missing, or there is no room for it now."""
        return self.wanted[0] if self.wanted and self.fill_room else None

    @property
    def on_the_way(self) -> int:
        """Bytes."""
        return max(0, self._sent - self._received)

    def has_room(self, size: int, *, fill: bool) -> bool:
        """Whether a frame of `size` bytes may be sent now; one frame always may when nothing is on the way."""
        window = int(self._window * (FILL_SHARE if fill else 1.0))
        return self.on_the_way == 0 or self.on_the_way + size <= window

    @property
    def fill_room(self) -> int:
        """Bytes for missing frames that may be read now; 0 = none."""
        return max(0, int(self._window * FILL_SHARE) - self.on_the_way)

    def sent(self, size: int) -> None:
        """A frame is out."""
        self.frames_sent += 1
        self._sent += size

    def sent_live(self, frame: LiveFrame) -> None:
        """The newest frame is out, or the last with a fix."""
        self.live_next = frame.seq + 1
        self.sent(len(frame.data))

    def sent_missing(self, boot_id: str, seq: int, size: int) -> None:
        """A missing frame is out."""
        self.sent(size)
        self._on_the_way.append((self._sent, boot_id, seq))
        self.passed(boot_id, seq)

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
