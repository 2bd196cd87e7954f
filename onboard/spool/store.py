"""Append-only store of frames as the server sees it: frames go in without waiting and come out by identity."""

import threading
from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common.boat_config import SpoolTable
from common.codec import MAX_FRAME_BYTES
from common.framer import Identity
from onboard.journal import Journal
from onboard.spool.memory_ring import Batch, Gathering
from onboard.spool.segment_index import Run, Shelf, read_from
from onboard.spool.shared_state import SpoolState
from onboard.spool.system_calls import Disk
from onboard.spool.writer import Writer


class Spool:
    """Frames of this start and of earlier ones. Trouble with the disk is an event, memory goes on."""

    def __init__(
        self,
        directory: Path | None,
        identity: Identity,
        table: SpoolTable,
        journal: Journal,
        *,
        about: Mapping[str, Any] | None = None,
        disk: Disk | None = None,
    ) -> None:
        """directory: None = memory only. The journal is used by the constructor, `append` and `poll` only.

        about: `config` and `versions` of the greeting; they stand in every segment: `export` needs no other file.
        """
        self._identity = identity
        self._journal = journal.child("spool")
        self._state = SpoolState()
        self._directory = directory
        self._thread: threading.Thread | None = None
        if directory is not None:
            writer = Writer(directory, identity, table, self._state, about=about or {}, disk=disk or Disk())
            try:
                writer.open()
            except Exception as error:  # a boat must sail
                writer.failed(error)
            self._thread = threading.Thread(target=writer.run, name="spool", daemon=True)
            self._thread.start()
        self.poll()

    def append(self, seq: int, data: bytes) -> None:
        """One new frame; seq rises. Never waits for the disk."""
        with self._state.condition:
            is_storable = self._thread is not None and len(data) <= MAX_FRAME_BYTES
            self._state.keep(seq, data, store=is_storable)
        self.poll()

    def poll(self) -> None:
        """Report what has happened to the disk."""
        while self._state.happened:
            code, evidence = self._state.happened.popleft()
            self._journal.tell(code, **evidence)

    @property
    def synced_seq(self) -> int:
        """The highest frame of this start known to be durable; -1 = none."""
        return self._state.synced_seq

    def newest(self) -> tuple[int, bytes] | None:
        """The newest frame of this start."""
        return self._state.ring.newest

    def runs(self) -> list[Run]:
        """What is held of each start, the oldest first, this one last."""
        state, identity = self._state, self._identity
        with state.condition:
            shelf, newest = state.shelf, state.ring.newest
            firsts = [seq for seq in (state.ring.first_seq, state.waiting.first_seq) if seq is not None]
        firsts += [segment.name.first_seq for segment in shelf.by_boot.get(identity.boot_id, ())[:1]]
        next_seq = 0 if newest is None else newest[0] + 1
        own = Run(identity.boot_id, identity.start_no, min(firsts, default=next_seq), next_seq)
        return [*(run for run in shelf.runs if run.boot_id != identity.boot_id), own]

    def read(self, boot_id: str, first: int, last: int, max_bytes: int) -> Batch:
        """Frames `first` to `last` (both included) of a start; may be called in any thread.

        At least one frame if there is one, even if it is larger than max_bytes. What is not made yet is not gone.
        """
        state = self._state
        if boot_id != self._identity.boot_id:
            found = Gathering(first, last, max_bytes)
            self._from_disk(found, state.shelf, boot_id, last)
            return found.batch()
        with state.condition:
            shelf, newest, oldest = state.shelf, state.ring.newest, state.ring.first_seq
            if newest is None or oldest is None:
                return Batch([], [], None)
            last = min(last, newest[0])
            held = state.waiting.between(first, min(last, oldest - 1), max_bytes)
            held += state.ring.between(max(first, oldest), last, max_bytes)
        found = Gathering(first, last, max_bytes)
        # Whatever is older than all that is in memory was written before, or is gone.
        if self._from_disk(found, shelf, boot_id, held[0][0] - 1 if held else last):
            for seq, data in held:
                if not found.take(seq, data):
                    break
        return found.batch()

    def status(self) -> dict[str, Any]:
        """How the spool is, for people."""
        state = self._state
        with state.condition:
            shelf, waiting_bytes = state.shelf, state.waiting.size
        oldest = next(iter(self.runs()))
        return {
            "directory": None if self._directory is None else str(self._directory),
            "bytes": sum(segment.size for segment in shelf.segments),
            "segments": len(shelf.segments),
            "oldest": {"boot_id": oldest.boot_id, "start_no": oldest.start_no, "seq": oldest.first_seq},
            "synced_seq": state.synced_seq,
            "waiting_bytes": waiting_bytes,
            "dropped": state.dropped,
            "removed": state.removed,
            "fault": state.fault,
        }

    def close(self, deadline_s: float) -> None:
        """Write and sync what waits, for at most so long."""
        with self._state.condition:
            self._state.closing = True
            self._state.condition.notify_all()
        if self._thread is not None:
            self._thread.join(deadline_s)
        self.poll()

    def _from_disk(self, found: Gathering, shelf: Shelf, boot_id: str, last: int) -> bool:
        """Gather frames up to `last`; False when no more fit."""
        held = shelf.by_boot.get(boot_id, [])
        begin = max(0, bisect_right(held, found.at, key=lambda segment: segment.name.first_seq) - 1)
        for segment in held[begin:]:
            if segment.name.first_seq > last or found.at > last:
                break
            for seq, data in read_from(segment, found.at):
                if seq > last:
                    break
                if seq >= found.at and not found.take(seq, data):
                    return False
        return True
