"""Holes in a trip (missing data): frames that are missing still, lost or not stored, and the one set of words for them.

Status line, the account at the end of a run, its exit code and `wayfix log` have their words from here.
"""

from typing import Any, Final, NamedTuple

from common.words import counted

_MISSING: Final = "missing still: the next `wayfix connect` fetches them"
_LOST: Final = "lost: the boat does not hold them any more, or does not list them"
_NOT_STORED: Final = "not stored: the log had ended, or its file lost them"
_UNKNOWN: Final = "not in this log, which does not say why"


class Holes(NamedTuple):
    """Number of frames that are not here, by why."""

    missing: int = 0
    """They are still to come."""
    lost: int = 0
    """They never come: the boat does not hold them (any more), or does not list their start."""
    not_stored: int = 0
    """They came, and the log does not hold them."""
    unknown: int = 0
    """A log that was not ended, or an older one, does not say which of these."""

    def brief(self) -> str:
        """In some words, for a line: `3 missing, 2 lost`."""
        words = zip(self[1:], ("lost", "not stored", "not here"), strict=True)
        return ", ".join([f"{self.missing:,} missing", *(f"{count:,} {word}" for count, word in words if count)])

    def sentences(self) -> list[str]:
        """A part of a sentence for each kind that there is; none = nothing is missing."""
        kinds = zip(self, (_MISSING, _LOST, _NOT_STORED, _UNKNOWN), strict=True)
        return [f"{counted(count, 'frame')} {'is' if count == 1 else 'are'} {why}" for count, why in kinds if count]

    @property
    def for_good(self) -> bool:
        """True when frames are lost that no later run brings."""
        return self.lost > 0


def count_listed(record: dict[str, Any], word: str) -> int:
    """Number of frames that a record of a log lists under a word (`Ledger.holes_of`)."""
    ranges: list[tuple[str, int, int]] = record[word]
    return sum(last - first + 1 for _, first, last in ranges) + int(record.get(f"{word}_more", 0))
