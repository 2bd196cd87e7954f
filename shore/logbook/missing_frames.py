"""Gap detection: which frames are missing from a log because the file lost them or the link never brought them."""

from operator import itemgetter
from typing import Any, Final

import msgpack

from common.messages import UTC_SOURCES, Fix, Frame, Heading, SensorHealth
from common.seqset import SeqSet
from shore.logbook.holes import Holes

_HEAD: Final = {
    "boat_id": str, "boot_id": str, "seq": int, "clock_id": str, "start_no": int, "t0_ns": int, "t1_ns": int,
}  # fmt: skip
_head_of: Final = itemgetter(*_HEAD)
_HEAD_TYPES: Final = tuple(_HEAD.values())
_HEALTH_FIELDS: Final = ("sensor", "state", "reason", "accepted")
_FIX_FIELDS: Final = ("lat_deg", "lon_deg", "fix_quality", "fix_mode", "status_valid", "held")


WORDS: Final = ("lacks", "lacks_more", "lost", "lost_more")
"""Fields in which a log says which frames it lacks still, and which are lost (`Ledger.holes_of`)."""


class Census:
    """Feed it the frames of a log in file order, and where the file lost something."""

    def __init__(self) -> None:
        self.count = 0
        self._begins: dict[str, int] = {}
        """The first frame that should be there, by start of the daemon (boot_id)."""
        self._seen: dict[str, SeqSet] = {}
        self._highest: dict[str, int] = {}
        self._is_after_loss: set[str] = set()
        self._said: dict[str, list[tuple[str, int, int]]] = {}
        """What the station said at the end of the trip: (boot_id, first, last) of the frames that it `lacks`, and that
        are `lost`."""
        self._more = {"lacks": 0, "lost": 0}
        """Number of frames beyond the ranges that it listed."""
        self._holes: dict[str, list[tuple[int, int]]] = {}
        """Ranges [first, last] of the frame numbers that are absent where the file lost something, by boot_id."""

    def expect(self, boot_id: str, next_seq: int) -> None:
        """Take the board's greeting, which gives its next frame."""
        if boot_id not in self._begins:
            self._begins[boot_id] = next_seq
            self._highest[boot_id] = next_seq - 1

    def frame(self, frame: Frame) -> None:
        """Take a frame of the log; a merged one covers several numbers."""
        boot_id, first, last = frame.boot_id, frame.first, max(frame.first, frame.seq)
        self.count += 1
        highest = self._highest.get(boot_id)
        if boot_id in self._is_after_loss:
            self._is_after_loss.discard(boot_id)
            if highest is not None and first > highest + 1:
                self._holes.setdefault(boot_id, []).append((highest + 1, first - 1))
        self._highest[boot_id] = last if highest is None else max(highest, last)
        self._begins[boot_id] = min(first, self._begins.get(boot_id, first))
        self._seen.setdefault(boot_id, SeqSet()).add(first, last)

    def ended(self, record: dict[str, Any]) -> None:
        """Take the words of a station at the end of a session, where it gives them; the last ones hold."""
        for word in {"lacks", "lost"} & record.keys():
            self._said[word] = [(str(boot_id), int(first), int(last)) for boot_id, first, last in record[word]]
            self._more[word] = int(record.get(f"{word}_more", 0))

    def holds(self, frame: Frame) -> bool:
        """True when the log has this frame."""
        return frame.boot_id in self._seen and frame.seq in self._seen[frame.boot_id]

    def file_lost_something(self) -> None:
        """The file lost something between the frame before and the next one."""
        self._is_after_loss |= set(self._begins)

    def holes(self, lost_by_file: int | None, *, is_being_written: bool = False) -> Holes:
        """How many frames are not here, and why. lost_by_file: as the log itself says, where it does."""
        absent = doubtful = 0
        said = [item for ranges in self._said.values() for item in ranges]
        for boot_id in {*self._seen, *(boot_id for boot_id, _, _ in said)}:
            seen = self._seen.get(boot_id, SeqSet())
            wanted = SeqSet((first, last) for name, first, last in said if name == boot_id)
            if seen:
                wanted.add(self._begins[boot_id], self._highest[boot_id])
            gaps = [gap for first, last in wanted for gap in seen.gaps(first, last)]
            absent += sum(last - first + 1 for first, last in gaps)
            holes = self._holes.get(boot_id, ())
            doubtful += sum(max(0, min(a[1], b[1]) - max(a[0], b[0]) + 1) for a in gaps for b in holes)
        in_file = doubtful if lost_by_file is None else lost_by_file
        missing, lost = (self._absent_of(word) + self._more[word] for word in ("lacks", "lost"))
        others = max(0, absent - min(doubtful, in_file) - missing - lost)
        if is_being_written:
            return Holes(missing + others, lost, in_file)
        if len(self._said) == 2:
            return Holes(missing, lost, in_file + others)
        return Holes(missing, lost, in_file, others)

    def _absent_of(self, word: str) -> int:
        """Number of the frames that a station said this of, and that did not come later."""
        gaps = (
            gap for boot_id, *seqs in self._said.get(word, ()) for gap in self._seen.get(boot_id, SeqSet()).gaps(*seqs)
        )
        return sum(last - first + 1 for first, last in gaps)


def light_frame(data: bytes) -> Frame:
    """Who, when and where of a frame, ten times as fast as `decode_frame`: the rest is left out, and hardly checked.

    Raises ValueError, KeyError, TypeError or AttributeError for bytes that are no frame.
    """
    fields = msgpack.unpackb(data, raw=False, strict_map_key=True)
    head, first_seq = _head_of(fields), fields.get("first_seq")
    if tuple(map(type, head)) != _HEAD_TYPES or type(first_seq) not in (int, type(None)):
        raise TypeError("no head of a frame")
    t0_ns, fixes = fields["t0_ns"], fields.get("fixes", ())
    if not all(_is_place(fix.get("lat_deg"), 90.0) and _is_place(fix.get("lon_deg"), 180.0) for fix in fixes):
        raise TypeError("no place on earth")
    return Frame(
        **dict(zip(_HEAD, head, strict=True)),
        first_seq=first_seq,
        **_utc_of(fields),
        fixes=tuple(
            Fix(sensor=fix["sensor"], t_ns=t0_ns, **{name: fix[name] for name in _FIX_FIELDS if name in fix})
            for fix in fixes
        ),
        headings=tuple(Heading(sensor=each["sensor"], t_ns=t0_ns) for each in fields.get("headings", ())),
        health=tuple(
            SensorHealth(t_ns=t0_ns, **{name: report[name] for name in _HEALTH_FIELDS if name in report})
            for report in fields.get("health", ())
        ),
    )


def _utc_of(fields: dict[str, Any]) -> dict[str, Any]:
    utc_ns, source = fields.get("utc_ns"), fields.get("utc_src", "none")
    return {} if type(utc_ns) is not int or source not in UTC_SOURCES else {"utc_ns": utc_ns, "utc_src": source}


def _is_place(value_deg: Any, limit_deg: float) -> bool:
    return value_deg is None or -limit_deg <= value_deg <= limit_deg
