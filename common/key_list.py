"""Trust store (allow list, known boats): text files in which a line is `KEY WORD NAME`, the key in Z85.

    # a comment (no key begins with a hash: it would be beyond 2^32)
    rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7 read,command bridge laptop

What is not such a line is named and trusted in nothing, but kept when the file is written again. Pure: text to text.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from common.keys import raw_key

MAX_NAME: Final = 64


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of such a file."""

    key: str
    word: str
    name: str

    @property
    def line(self) -> str:
        """The line as it stands in the file."""
        return f"{self.key} {self.word} {self.name}"


def name_fault(name: str) -> str | None:
    """Why this cannot stand at the end of a line, or None."""
    if not 1 <= len(name) <= MAX_NAME or not name.isprintable() or name != " ".join(name.split()):
        return f"a name must be 1 to {MAX_NAME} printable characters without spaces at its ends or two in a row"
    if raw_key(name) is not None:
        return "a name must not be a key"
    return None


def entries_of(text: str, word_fault: Callable[[str], str | None]) -> tuple[list[Entry], list[str]]:
    """Sound lines in order, and a sentence for each other one. word_fault: what is wrong with a WORD, or None."""
    entries, faults = [], []
    for number, line in enumerate(text.split("\n"), 1):
        if _is_comment(line):
            continue
        entry = entry_of(line)
        fault = "is not KEY WORD NAME" if entry is None else word_fault(entry.word)
        if entry is None or fault is not None:
            faults.append(f"line {number} {fault}: skipped")
        else:
            entries.append(entry)
    return entries, faults


def entry_of(line: str) -> Entry | None:
    """The entry a line holds; None for anything else."""
    parts = line.rstrip().split(None, 2)
    if len(parts) != 3 or raw_key(parts[0]) is None or not parts[1].isprintable():
        return None
    return None if name_fault(parts[2]) else Entry(*parts)


def with_entry(text: str, entry: Entry, replaced: Sequence[str] = ()) -> str:
    """The file with this line at its end instead of any of the same key, or of the keys `replaced`."""
    kept = without(text, (entry.key, *replaced))
    return f"{kept}{entry.line}\n"


def without(text: str, keys: Sequence[str]) -> str:
    """The file without lines that begin with one of these keys, sound or not."""
    lines = [line for line in text.split("\n") if _is_comment(line) or line.split(None, 1)[0] not in keys]
    kept = "\n".join(lines)
    return kept if not kept or kept.endswith("\n") else f"{kept}\n"


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")
