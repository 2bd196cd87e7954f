"""Shared state of the loop's thread, the writer's and readers; its lock is never held over work on the disk."""

import threading
from collections import deque
from typing import Any, Final

from onboard.spool.memory_ring import FrameList, Item
from onboard.spool.segment_index import Shelf

RING_BYTES: Final = 4 << 20
"""Most bytes of the newest frames in memory."""
QUEUE_BYTES: Final = 8 << 20
"""Most bytes of frames that wait for the disk."""
BATCH_BYTES: Final = 1 << 20


class SpoolState:
    """Everything here is touched with `condition` held; `shelf` may be read without, it is replaced as a whole."""

    def __init__(self) -> None:
        self.condition = threading.Condition()
        self.ring = FrameList()
        self.waiting = FrameList()
        """Frames that are not on the disk yet."""
        self.shelf = Shelf()
        self.synced_seq = -1
        self.dropped = 0
        """Number of frames of this start that never came to the disk, because the queue was full."""
        self.removed = 0
        """Number of segments that were removed to make room."""
        self.fault: str | None = None
        """Why nothing is stored on disk now; None = there is no fault."""
        self.happened: deque[tuple[str, dict[str, Any]]] = deque(maxlen=64)
        """Events that the loop's thread has to report: (code, evidence)."""
        self.closing = False
        self._is_behind = False

    def keep(self, seq: int, data: bytes, *, store: bool) -> None:
        """A new frame: into memory, and into the queue for the disk."""
        self.ring.add(seq, data)
        while self.ring.size > RING_BYTES and len(self.ring) > 1:
            self.ring.drop_first()
        if not store:
            return
        if self.waiting.size + len(data) > QUEUE_BYTES:
            self.dropped += 1
            if not self._is_behind:
                self._is_behind = True
                self.happened.append(("spool-behind", {"seq": seq}))
            return
        self.waiting.add(seq, data)
        self.condition.notify_all()

    def stored(self, last_seq: int) -> None:
        """Frames up to this one are in a file."""
        self.waiting.drop_to(last_seq)
        if self._is_behind and self.waiting.size < QUEUE_BYTES // 2:
            self._is_behind = False
            self.happened.append(("spool-caught-up", {"dropped": self.dropped}))

    def wait_again(self) -> int:
        """What was written is lost: all frames in memory wait for the disk. Returns their number."""
        first = self.waiting.first_seq
        self.waiting.put_back(self.ring.before(2**64 if first is None else first))
        self.synced_seq = -1
        return len(self.waiting)

    def batch(self) -> list[Item]:
        """What waits longest."""
        return self.waiting.between(0, 2**64, BATCH_BYTES)
