"""Key store of the station (trusted hosts): its own key, and the boats it is paired with.

In `~/.config/wayfix` (or $XDG_CONFIG_HOME/wayfix, $WAYFIX_KEYS, --keys DIR): `secret-key`, and `boats` with a line for
each boat: `KEY ADDRESS BOAT_ID` (`common.key_list`; address `-` = not known).
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from common.errors import WayfixError
from common.key_list import Entry, entries_of, name_fault, with_entry, without
from common.keys import TRUSTED, KeyPair, own_keys, raw_key, read_own, write_own
from shore.link.transport import LinkKeys
from shore.settings.place import config_directory

LIST_LIMIT_BYTES: Final = 262_144
MAX_ADDRESS: Final = 128
_HEADER: Final = "# Boats this station is paired with: KEY ADDRESS BOAT_ID (docs/security.md)\n"


@dataclass(frozen=True, slots=True)
class Boat:
    """A boat we are paired with."""

    boat_id: str
    public_key: bytes
    """Public key of the boat, 40 characters of Z85."""
    address: str | None
    """Address where the boat was last reached; `None` = not known."""


def directory_of(given: Path | None, environ: Mapping[str, str]) -> Path:
    """Directory where keys are kept. Raises WayfixError when it is not given and the user has no home."""
    if given is not None:
        return given
    if named := environ.get("WAYFIX_KEYS"):
        return Path(named)
    return config_directory(environ)


class Boats:
    """Files are read when asked for, so that two programs of one person see the same."""

    def __init__(self, directory: Path | None = None) -> None:
        self.directory = directory_of(directory, os.environ)
        self.file = self.directory / "boats"
        self._keys: KeyPair | None = None

    @property
    def public_key(self) -> bytes:
        """Public key of this station, Z85; made at first use. Raises WayfixError."""
        return self._own().public

    @property
    def secret_key(self) -> bytes:
        """Secret key of this station, Z85. Raises WayfixError."""
        return self._own().secret

    def all(self) -> list[Boat]:
        """Boats in the order of pairing; raises WayfixError when the file cannot be trusted."""
        entries, _ = self._entries()
        return [Boat(item.name, item.key.encode("ascii"), None if item.word == "-" else item.word) for item in entries]

    def faults(self) -> list[str]:
        """Lines that are not a boat's, one sentence each. Raises WayfixError."""
        return self._entries()[1]

    def remember(self, boat_id: str, public_key: bytes, address: str | None = None) -> None:
        """Keep a boat, instead of one with the same id or key; write only what changes. Raises WayfixError."""
        key = public_key.decode("ascii", "replace")
        fault = name_fault(boat_id) or (None if raw_key(key) else "not a key") or _address_fault(address or "-")
        if fault is not None:
            raise WayfixError(fault, boat_id)
        boats = self.all()
        boat = Boat(boat_id, public_key, address)
        if boat in boats:
            return
        former = [item.public_key.decode("ascii") for item in boats if item.boat_id == boat_id]
        self._write(with_entry(self._text() or _HEADER, Entry(key, address or "-", boat_id), former))

    def meant(self, boat_id: str | None, address: str = "ADDRESS") -> list[Boat]:
        """The boat of this id, or all of them; raises WayfixError when there is none."""
        boats = self.all()
        if not boats:
            cure = f"wayfix-onboard pair on the board, then wayfix pair {address} here (or --open on both sides)"
            raise WayfixError("this station is paired with no boat", str(self.directory), cure)
        named = [boat for boat in boats if boat_id in (None, boat.boat_id)]
        if not named:
            known = ", ".join(boat.boat_id for boat in boats)
            raise WayfixError(f"this station is not paired with {boat_id}", "--boat", f"it knows {known}")
        return named

    def choose(self, address: str, boat_id: str | None) -> Boat:
        """The boat meant: of this id, else the one last met at this address, else the only one. Raises WayfixError."""
        boats = self.meant(boat_id, address)
        met = [boat for boat in boats if boat.address == address]
        if len(met) != 1 and len(boats) > 1:
            known = ", ".join(boat.boat_id for boat in boats)
            raise WayfixError("this station knows several boats", address, f"say which with --boat ID: {known}")
        return met[0] if met else boats[0]

    def link_keys(self, boat: Boat | None) -> LinkKeys | None:
        """What the link to this boat needs; None for an open one. Raises WayfixError."""
        return None if boat is None else LinkKeys(self.public_key, self.secret_key, boat.public_key)

    def forget(self, boat_id: str) -> bool:
        """Drop a boat; False = it is not known. Raises WayfixError."""
        keys = [boat.public_key.decode("ascii") for boat in self.all() if boat.boat_id == boat_id]
        if keys:
            self._write(without(self._text(), keys))
        return bool(keys)

    def _own(self) -> KeyPair:
        if self._keys is None:
            self._keys = own_keys(self.directory / "secret-key")
        return self._keys

    def _entries(self) -> tuple[list[Entry], list[str]]:
        """Sound entries. A key or an id that is there twice counts for none: the right line is not known."""
        entries, faults = entries_of(self._text(), _address_fault)
        names, keys = [item.name for item in entries], [item.key for item in entries]
        sound = [item for item in entries if names.count(item.name) == 1 and keys.count(item.key) == 1]
        twice = dict.fromkeys(item.name for item in entries if item not in sound)
        return sound, faults + [f"{name} or its key stands there twice: skipped" for name in twice]

    def _text(self) -> str:
        try:
            return read_own(self.file, TRUSTED, LIST_LIMIT_BYTES).decode("utf-8", "surrogateescape")
        except FileNotFoundError:
            return ""
        except OSError as error:
            raise WayfixError(f"cannot be read ({error.strerror})", str(self.file), "check its rights") from error

    def _write(self, text: str) -> None:
        try:
            self.directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_own(self.file, text.encode("utf-8", "surrogateescape"))
        except OSError as error:
            cure = "check the disk and the rights of this directory, or give --keys DIR"
            raise WayfixError(f"the boat's key cannot be kept ({error.strerror})", str(self.file), cure) from error


def _address_fault(address: str) -> str | None:
    if not 1 <= len(address) <= MAX_ADDRESS or not address.isascii() or " " in address or not address.isprintable():
        return f"has an address that is not 1 to {MAX_ADDRESS} characters without spaces"
    return None
