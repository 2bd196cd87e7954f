"""Backfill: missing frames and bounded runs, read from the store beside the loop, in turn for every client.

Which frame is next for a client, and whether there is room for it, is `onboard.link.send_order`.
All clients together get so many bytes a second of it, so that a station that fills a day's gap does not starve the
radio, the card and the processor of the frames that are made now.
"""

import asyncio
from collections.abc import Callable, Collection
from typing import Final

from common import link_messages as session
from common.clock import boottime_ns
from common.errors import CodecError
from common.units import NS_PER_S
from onboard.link.bounded_run import InOrder
from onboard.link.client_leases import Session
from onboard.spool import Batch, Run, Spool

EMPTY_READ_BYTES: Final = 4_096
LEAST_READ_BYTES: Final = 1_024
"""What a read counts in the rate limit, bytes, when it finds no frame, and at least: a client may ask for frames that
nobody has, or for single ones."""
READ_BYTES: Final = 16_384
"""Most bytes read in one turn, so that a client with a large window gets no more of them than the others."""

Send = Callable[[Session, list[bytes]], bool]
"""Sends a message of some parts to a client; False = it cannot be sent now."""
End = Callable[[Session, str], None]


class Filling:
    """Works for all sessions in turn; `wake` it when a lease or a frame came."""

    def __init__(self, store: Spool, send: Send, end: End, bytes_per_s: int) -> None:
        self._store = store
        self._send = send
        self._end = end
        self._bytes_per_s = bytes_per_s
        self._woken = asyncio.Event()
        self._earned = 0.0
        self._earned_at_ns = boottime_ns()

    def wake(self) -> None:
        """Something may have to be sent."""
        self._woken.set()

    async def run(self, sessions: Callable[[], Collection[Session]]) -> None:
        """Serve all sessions until cancelled."""
        while True:
            await self._woken.wait()
            self._woken.clear()
            busy = True
            while busy:
                busy = False
                for client in list(sessions()):
                    busy |= await self._serve(client)

    async def _serve(self, client: Session) -> bool:
        """A turn of one client; True when it may have another at once."""
        if client.connection is None or client.is_ended:
            return False
        if client.in_order is not None:
            return await self._serve_run(client, client.in_order)
        return await self._serve_missing(client)

    async def _serve_missing(self, client: Session) -> bool:
        order = client.order
        gap = order.next_missing()
        if gap is None:
            return False
        own = self._store.runs()[-1]
        last = min(gap.last, own.next_seq - 1) if gap.boot_id == own.boot_id else gap.last
        if gap.first > last:  # not made yet
            order.passed(gap.boot_id, gap.last)
            return True
        batch = await self._read(gap.boot_id, gap.first, last, min(order.fill_room, READ_BYTES))
        order.not_held(gap.boot_id, batch.gone)
        for seq, data in batch.frames:
            if not order.wants(gap.boot_id, seq):  # a newer lease came meanwhile
                continue
            header = session.pack("frame", boot_id=gap.boot_id, seq=seq)
            if not order.has_room(len(data), fill=True) or not self._send(client, [header, data]):
                return False
            order.sent_missing(gap.boot_id, seq, len(data))
        order.passed(gap.boot_id, gap.last if batch.next_seq is None else batch.next_seq - 1)
        return True

    async def _serve_run(self, client: Session, place: InOrder) -> bool:
        while place.unsent:
            header, data = place.unsent[0]
            if not client.order.has_room(len(data), fill=False):
                return False
            if not self._send(client, [session.pack("frame", **header), data]):
                return False
            place.unsent.popleft()
            client.order.sent(len(data))
        if place.is_complete:
            self._end(client, "all frames sent")
            return False
        try:
            held = self._where(place)
        except CodecError as error:
            self._end(client, _too_large(error))
            return False
        if held is None:
            self._end(client, "frames of an earlier start of the daemon are not held any more")
            return False
        if place.seq >= held.next_seq:
            return False
        batch = await self._read(place.boot_id, place.seq, held.next_seq - 1, READ_BYTES)
        fault = await asyncio.to_thread(_take, place, batch)  # to merge 60 s of frames takes a tenth of a second
        if fault is None or client.in_order is not place:
            return True
        self._end(client, fault)
        return False

    def _where(self, place: InOrder) -> Run | None:
        """The start whose frames come next; None = it is lost."""
        runs = self._store.runs()
        for index, run in enumerate(runs):
            if run.boot_id == place.boot_id:
                if place.seq < run.next_seq or index == len(runs) - 1:
                    return run
                place.next_start(runs[index + 1].boot_id)
                return runs[index + 1]
        return None

    async def _read(self, boot_id: str, first: int, last: int, max_bytes: int) -> Batch:
        """Read from the store, once the rate limit allows it."""
        now_ns = boottime_ns()
        self._earned += self._bytes_per_s * (now_ns - self._earned_at_ns) / NS_PER_S
        self._earned, self._earned_at_ns = min(self._earned, self._bytes_per_s / 4), now_ns
        if self._earned < 0.0:
            await asyncio.sleep(-self._earned / self._bytes_per_s)
        batch = await asyncio.to_thread(self._store.read, boot_id, first, last, max_bytes)
        found_bytes = sum(len(data) for _, data in batch.frames)  # whether they can be sent or not
        self._earned -= max(LEAST_READ_BYTES, found_bytes) if found_bytes else EMPTY_READ_BYTES
        return batch


def _take(place: InOrder, batch: Batch) -> str | None:
    """Put frames into the run; returns why it cannot go on."""
    try:
        for seq, data in batch.frames:
            if seq != place.seq:
                break
            place.take(data)
            if place.is_complete:
                return None
    except CodecError as error:
        return _too_large(error)
    if any(first <= place.seq <= last for first, last in batch.gone):
        return f"frame {place.seq} is not held any more"
    return None


def _too_large(error: CodecError) -> str:
    return f"a frame of this period is too large ({error.what}); ask for a shorter one"
