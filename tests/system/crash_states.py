"""What a power cut may leave of recorded calls (crash consistency): on a journalling file system, and on one without.

What was synced stays, its name too once the directory was. Of the rest a journal keeps the names in their order, and a
file system without one (FAT, ext2) any of them; data may be gone, torn or zeros.
"""

import os
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tests.system.file_shim import Call

NAMES: Final = ("create", "rename", "unlink", "mkdir")
KINDS: Final = ("all", "ordered", "zeroed", "least", "journal", "unordered")
"""Everything came through; names did, and of the data what was synced; the same with zeros for the rest; only what was
synced; names up to any moment since the last sync, data as it comes; any of the names, data as it comes."""


DRAWN: Final = ("journal", "unordered")


@dataclass(slots=True)
class State:
    """A directory as it may be found."""

    kind: str
    after: int
    """Number of calls that had been made."""
    names: dict[str, bytes] = field(default_factory=dict)
    directories: set[str] = field(default_factory=set)

    def put(self, root: Path, place: Path) -> Path:
        """Write it to a directory; returns that."""
        place.mkdir(parents=True)
        for path in sorted(self.directories):
            (place / os.path.relpath(path, root)).mkdir(parents=True, exist_ok=True)
        for path, content in self.names.items():
            file = place / os.path.relpath(path, root)
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        return place

    @property
    def key(self) -> int:
        """The same for states that are the same."""
        return hash(tuple(sorted(self.names.items())))


class _Data:
    """Contents of the files after so many calls, and what of them is durable."""

    def __init__(self, calls: Sequence[Call]) -> None:
        self.now: dict[int, bytearray] = {}
        self.synced: dict[int, bytes] = {}
        for call in calls:
            content = self.now.setdefault(call.inode, bytearray())
            if call.op == "write":
                content.extend(bytes(max(0, call.offset - len(content))))
                content[call.offset : call.offset + len(call.data)] = call.data
            elif call.op == "truncate":
                del content[call.offset :]
                content.extend(bytes(call.offset - len(content)))
            elif call.op == "sync":
                self.synced[call.inode] = bytes(content)

    def left(self, inode: int, how: str, draw: random.Random) -> bytes:
        now, synced = bytes(self.now.get(inode, b"")), self.synced.get(inode, b"")
        same = next(
            (at for at, (a, b) in enumerate(zip(now, synced, strict=False)) if a != b), min(len(now), len(synced))
        )
        match how if how in {"all", "synced", "zeros"} else draw.choice(("all", "synced", "zeros", "torn")):
            case "all":
                return now
            case "synced":
                return synced
            case "zeros":
                return now[:same] + bytes(len(now) - same)
        cut = draw.randint(same, len(now))
        return now[:cut] + bytes(draw.choice((0, len(now) - cut)))


def _names(calls: Sequence[Call]) -> tuple[dict[str, int], set[str]]:
    """Names and directories after these calls; what has lost what it stands on is left out."""
    names: dict[str, int] = {}
    directories: set[str] = set()
    for call in calls:
        if call.op == "create":
            names[call.path] = call.inode
        elif call.op == "unlink":
            names.pop(call.path, None)
        elif call.op == "rename" and call.path in names:
            names[call.target] = names.pop(call.path)
        elif call.op == "mkdir":
            directories.add(call.path)
    return names, directories


def durable_names(calls: Sequence[Call]) -> list[Call]:
    """The calls on names that no power cut undoes: their directory was synced behind them."""
    last = {call.path: at for at, call in enumerate(calls) if call.op == "sync"}
    return [
        call for at, call in enumerate(calls)
        if call.op in NAMES and last.get(str(Path(call.target or call.path).parent), -1) > at
    ]  # fmt: skip


def state(calls: Sequence[Call], kind: str, draw: random.Random) -> State:
    """One state after all these calls."""
    data = _Data(calls)
    made = [call for call in calls if call.op in NAMES]
    kept = made
    if kind == "least":
        kept = durable_names(calls)
    elif kind == "journal":
        last = max((at for at, call in enumerate(calls) if call.op == "sync"), default=-1)
        kept = [call for call in calls[: draw.randint(last + 1, len(calls))] if call.op in NAMES]
    elif kind == "unordered":
        sure = {id(call) for call in durable_names(calls)}
        kept = [call for call in made if id(call) in sure or draw.random() < 0.5]
    how = {"all": "all", "ordered": "synced", "zeroed": "zeros", "least": "synced"}.get(kind, "any")
    names, directories = _names(kept)
    contents = {path: data.left(inode, how, draw) for path, inode in names.items()}
    return State(kind, len(calls), contents, directories)


def states(calls: Sequence[Call], count: int, seed: int) -> Iterator[State]:
    """So many states that differ, of moments all over the record: each kind at each, then the drawn kinds again."""
    draw, seen = random.Random(seed), set[int]()
    for kinds in (KINDS, *[DRAWN] * 10):
        for moment in draw.sample(range(1, len(calls) + 1), len(calls)):
            for kind in kinds:
                found = state(calls[:moment], kind, draw)
                if found.key not in seen:
                    seen.add(found.key)
                    yield found
            if len(seen) >= count:
                return
