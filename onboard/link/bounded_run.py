"""Position of a bounded run (aggregation): every frame in order, merged to its period on an absolute grid. Pure."""

from collections import deque
from typing import Any, Final

from common.codec import MAX_FRAME_BYTES, decode_frame, encode_frame
from common.errors import CodecError
from common.framer import merge
from common.link_messages import BoundedRun
from common.units import NS_PER_S

GATHERED_BYTES: Final = 2 * MAX_FRAME_BYTES
"""Most bytes of board frames that are gathered for one merged frame, which says the same things once."""


class InOrder:
    """Board frames in, frames of the run out (`unsent`: header fields and bytes)."""

    def __init__(self, run: BoundedRun, frame_period_ns: int) -> None:
        """Begin where the client stands. frame_period_ns: period of the board's own frames."""
        period_ns = round(run.period_s * NS_PER_S) if run.period_s is not None else frame_period_ns
        self.asked = run
        self.k = run.k
        self.boot_id, self.seq = run.boot_id, run.seq
        """The next frame of the board to take: its start of the daemon and its number."""
        self.unsent: deque[tuple[dict[str, Any], bytes]] = deque()
        self._period_ns = 0 if period_ns == frame_period_ns else period_ns
        self._gathered: list[bytes] = []
        """Frames of the board as bytes, since decoded ones take ten times as much memory."""
        self._gathered_bytes = 0

    @property
    def is_complete(self) -> bool:
        """True when all m frames are made."""
        return self.asked.m is not None and self.k >= self.asked.m

    def take(self, data: bytes) -> None:
        """Take the board's next frame; raises CodecError when a merged frame passes the limits of one frame."""
        seq, self.seq = self.seq, self.seq + 1
        if self._period_ns == 0:
            self._made(seq, data)
            return
        frame = decode_frame(data)
        if self.k == 0 and not self._gathered and frame.t0_ns % self._period_ns:
            return  # the first one begins on the grid
        self._gathered_bytes += len(data)
        if self._gathered_bytes > GATHERED_BYTES:
            raise CodecError(f"more than {GATHERED_BYTES} bytes")
        self._gathered.append(data)
        if frame.t0_ns // self._period_ns != frame.t1_ns // self._period_ns:
            self._merge()

    def next_start(self, boot_id: str) -> None:
        """The daemon was restarted: what is gathered becomes a shorter frame."""
        if self._gathered:
            self._merge()
        self.boot_id, self.seq = boot_id, 0

    def _merge(self) -> None:
        gathered = [decode_frame(data) for data in self._gathered]
        self._gathered, self._gathered_bytes = [], 0
        self._made(gathered[-1].seq, encode_frame(merge(gathered)))

    def _made(self, seq: int, data: bytes) -> None:
        if not self.is_complete:
            self.k += 1
            self.unsent.append(({"boot_id": self.boot_id, "seq": seq, "k": self.k}, data))
