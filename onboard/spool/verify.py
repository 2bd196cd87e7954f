"""Integrity check of a spool, read-only, also while the daemon writes: every byte checked, every lost frame named."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onboard.spool.memory_ring import Item
from onboard.spool.segment_format import END, FRAME, Damage, Record, unpack_header
from onboard.spool.segment_index import Segment, items_of
from onboard.spool.system_calls import LOCK_NAME

_LOCKS = Path("/proc/locks")


def is_being_written(directory: Path) -> bool:
    """Whether a daemon has this spool open. Nothing is locked to find out: that could keep a starting daemon away."""
    try:
        entry = (directory / LOCK_NAME).stat()
        where = f"{os.major(entry.st_dev):02x}:{os.minor(entry.st_dev):02x}:{entry.st_ino}"
        return any("FLOCK" in line and where in line.split() for line in _LOCKS.read_text("ascii").splitlines())
    except OSError:
        return False


def frames_of(held: Iterable[Segment], first: int = 0, last: int = 2**64) -> Iterator[Item]:
    """The frames of one start's segments in order, each once; what cannot be read is left out."""
    expected = first
    for segment in held:
        if segment.name.first_seq > last:
            return
        try:
            data, items = items_of(segment.path, segment.name)
        except OSError:
            continue
        for item in items:
            if not isinstance(item, Damage) and item.flags == FRAME and expected <= item.seq <= last:
                yield item.seq, data[item.body : item.end]
                expected = item.seq + 1


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be."""

    file: str
    what: str
    is_damage: bool
    """False when nothing that was stored is lost."""
    bytes: tuple[int, int] | None = None
    """Offsets [start, end) of a damaged stretch, bytes."""
    lost: tuple[int, int | None] | None = None
    """Numbers [first, last] of lost frames; last None = it is not known how many there were."""

    def __str__(self) -> str:
        text = f"{self.file}: {self.what}"
        if self.bytes is not None:
            text += f", bytes {self.bytes[0]} to {self.bytes[1] - 1}"
        if self.lost is not None:
            first, last = self.lost
            text += f": frames from {first} on" if last is None else f": frames {first} to {last}"
        return text

    def as_record(self, boot_id: str) -> dict[str, Any]:
        """The finding for JSON."""
        return {
            "file": self.file,
            "boot_id": boot_id,
            "what": self.what,
            "damage": self.is_damage,
            "bytes": self.bytes,
            "lost": self.lost,
        }


class Examination:
    """All segments of one start, in order. `findings` and counts are complete after `run`."""

    def __init__(self, held: Sequence[Segment], *, is_live: bool) -> None:
        """is_live: the last segment is being written at this moment."""
        self.frames = 0
        self.bytes = 0
        self.findings: list[Finding] = []
        self._held = held
        self._is_live = is_live
        self._expected = held[0].name.first_seq
        self._bad: Damage | None = None
        self._file = ""
        self._bad_file = ""
        self._no_header = False

    def run(self) -> None:
        """Read all segments."""
        ended = False
        for segment in self._held:
            ended = self._segment(segment, is_last=segment is self._held[-1])
        if self._bad is not None:
            self._find(None)
        elif not ended and not self._is_live:
            what = "not ended in good order (power cut or killed); lost if there were any"
            self.findings.append(Finding(self._file, what, False, lost=(self._expected, None)))

    def _segment(self, segment: Segment, *, is_last: bool) -> bool:
        """Whether it was ended in good order."""
        self._file = segment.path.name
        try:
            data, items = items_of(segment.path, segment.name)
        except FileNotFoundError:  # retention was quicker
            self._expected = max(self._expected, segment.name.first_seq)
            return True
        except OSError as error:
            self._note(f"cannot be read ({error.strerror})")
            return False
        self.bytes += len(data)
        head = unpack_header(data)
        is_new = is_last and self._is_live
        if head is None:
            if not is_new:
                self._note("its header is damaged")
            self._no_header = True
        elif head[0].identity.boot_id != segment.name.boot_id or head[0].first_seq != segment.name.first_seq:
            self._note("its name is not that of its header")
        elif head[0].after_seq >= self._expected:
            self._find(head[0].after_seq + 1)
        else:
            self._close_bad()
        return self._items(items, is_new=is_new)

    def _items(self, items: list[Record | Damage], *, is_new: bool) -> bool:
        ended = False
        for item in items:
            if isinstance(item, Damage):
                if is_new and item is items[-1]:
                    continue  # a frame on its way into the file
                if self._bad is not None:
                    self._close_bad("damaged")
                self._bad, self._bad_file = item, self._file
            elif item.flags in (FRAME, END):
                if item.seq > self._expected:
                    self._find(item.seq, stored=self._bad is not None or self._no_header)
                self._close_bad()
                self._no_header = False
                ended = item.flags == END
                if not ended:
                    self.frames += 1
                    self._expected = max(self._expected, item.seq + 1)
        return ended

    def _find(self, found_seq: int | None, *, stored: bool = True) -> None:
        """Frames from the expected one up to `found_seq` are not there."""
        lost = (self._expected, None if found_seq is None else found_seq - 1)
        if self._bad is not None:
            bad = (self._bad.start, self._bad.end)
            self.findings.append(Finding(self._bad_file, "damaged, lost", True, bytes=bad, lost=lost))
        elif stored:
            self.findings.append(Finding(self._file, "cut before it, or a file is missing; lost", True, lost=lost))
        else:
            self.findings.append(Finding(self._file, "never stored", False, lost=lost))
        self._bad = None
        if found_seq is not None:
            self._expected = found_seq

    def _close_bad(self, what: str = "damaged, no frame is lost") -> None:
        if self._bad is not None:
            bad = (self._bad.start, self._bad.end)
            self.findings.append(Finding(self._bad_file, what, True, bytes=bad))
            self._bad = None

    def _note(self, what: str) -> None:
        self.findings.append(Finding(self._file, what, True))
