"""Allow list: which stations may connect, with which rights, and the board's own key.

The list is `allowed-keys` in the state directory, one line for each station: `KEY RIGHTS NAME`, rights `read` or
`read,command` (`common.key_list`). Whatever is doubtful in it lets nobody in.
"""

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.errors import WayfixError
from common.key_list import Entry, entries_of, name_fault, with_entry, without
from common.keys import TRUSTED, own_keys, raw_key, read_own, write_own

READ: Final = frozenset({"read"})
COMMAND: Final = frozenset({"read", "command"})
RIGHTS: Final = {"read": READ, "read,command": COMMAND}
LIST_LIMIT_BYTES: Final = 262_144
_HEADER: Final = "# Stations that may connect: KEY RIGHTS NAME (docs/security.md)\n"


@dataclass(frozen=True, slots=True)
class Allowed:
    """One station of the list."""

    key: str
    """Public key of the station, 40 characters of Z85."""
    name: str
    rights: frozenset[str]


class AllowList:
    """The board's key and its list of stations. `rights_of` never waits; the other methods work on the disk."""

    def __init__(self, state_dir: Path | None) -> None:
        """Raises WayfixError when there is no key of our own that can be trusted."""
        if state_dir is None:
            cure = "give --state DIR, or --open on a network that you trust"
            raise WayfixError("keys need a directory to be kept in", "--state", cure)
        keys = own_keys(state_dir / "secret-key")
        self.public_key = keys.public
        self.secret_key = keys.secret
        self.file = state_dir / "allowed-keys"
        self._lock = threading.Lock()
        self._allowed: dict[str, Allowed] = {}
        self._revoked: set[str] = set()
        """Keys that are still in the file because it could not be written."""
        self.faults = self.reload()
        """What was wrong with the list when it was last read."""

    @property
    def entries(self) -> list[Allowed]:
        """In the order of the list."""
        return list(self._allowed.values())

    def rights_of(self, user_id: str | None) -> frozenset[str] | None:
        """What the station with this public key (Z85) may do; None = it is not on the list."""
        allowed = self._allowed.get(user_id or "")
        return None if allowed is None else allowed.rights

    def reload(self) -> list[str]:
        """Read the list again: what is wrong with it, one sentence each. A list that cannot be read lets nobody in."""
        with self._lock:
            allowed: dict[str, Allowed] = {}
            try:
                entries, faults = _parse(self._text())
            except (OSError, WayfixError) as error:
                entries, faults = [], [f"{_reason(error)}: no station may connect"]
            for entry in entries:
                rights = RIGHTS[entry.word]
                if entry.key in allowed:  # the less is granted
                    rights &= allowed[entry.key].rights
                    faults.append(f"{entry.name}: this key stands there twice, the fewer rights count")
                if entry.key not in self._revoked:
                    allowed[entry.key] = Allowed(entry.key, entry.name, rights)
            self._allowed, self.faults = allowed, faults
            return faults

    def add(self, key: str, name: str, rights: frozenset[str]) -> None:
        """Put a station on the list, or change its line. Raises WayfixError, and then nothing has changed."""
        word = next((word for word, granted in RIGHTS.items() if granted == rights), None)
        if word is None or raw_key(key) is None:
            raise WayfixError("not a key, or no such rights", name, "rights are read or read,command")
        if (fault := name_fault(name)) is not None:
            raise WayfixError(fault, name, "give another --name")
        with self._lock:
            if any(item.name == name and item.key != key for item in self._allowed.values()):
                raise WayfixError("another station has this name", name, "give another --name, or revoke it first")
            try:
                text = self._text() or _HEADER
                write_own(self.file, _bytes(with_entry(text, Entry(key, word, name))))
            except OSError as error:
                cure = "check the disk and the rights of the state directory"
                raise WayfixError(f"the key cannot be kept ({error.strerror})", str(self.file), cure) from error
            self._revoked.discard(key)
            others = {other: item for other, item in self._allowed.items() if other != key}
            self._allowed = {**others, key: Allowed(key, name, rights)}

    def remove(self, name_or_key: str) -> bool:
        """Take a station off the list; False = it is not on it.

        Raises WayfixError when the list cannot be written: then the key is refused all the same, but only for this run.
        """
        with self._lock:
            keys = [item.key for item in self._allowed.values() if name_or_key in (item.key, item.name)]
            if not keys:
                return False
            self._allowed = {key: item for key, item in self._allowed.items() if key not in keys}
            try:
                write_own(self.file, _bytes(without(self._text(), keys)))
            except (OSError, WayfixError) as error:
                self._revoked.update(keys)
                what = f"the key is refused from now on, but the list still has it ({_reason(error)})"
                cure = "remove its line before the daemon starts again"
                raise WayfixError(what, str(self.file), cure) from error
            return True

    def name_for(self, key: str) -> str:
        """The name that a key has, else a free one: station-1, station-2, ..."""
        if key in self._allowed:
            return self._allowed[key].name
        taken = {item.name for item in self._allowed.values()}
        return next(name for name in (f"station-{number}" for number in range(1, len(taken) + 2)) if name not in taken)

    def _text(self) -> str:
        """The list's text, empty without a file. Raises OSError, WayfixError."""
        try:
            data = read_own(self.file, TRUSTED, LIST_LIMIT_BYTES)
        except FileNotFoundError:
            return ""
        return data.decode("utf-8", "surrogateescape")


def _parse(text: str) -> tuple[list[Entry], list[str]]:
    return entries_of(text, lambda word: None if word in RIGHTS else "has rights that are not read or read,command")


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")


def _reason(error: OSError | WayfixError) -> str:
    return error.what if isinstance(error, WayfixError) else str(error.strerror)
