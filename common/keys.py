"""Public keys of the link: CURVE key pairs as ZeroMQ takes them (Z85), key files, fingerprints.

A secret key file is one line: the secret key in 40 characters of Z85. The public key follows from it. Only its owner
may read it; a file that others can read is refused, not repaired: its key may be known to others already.
"""

import os
import re
import stat
import struct
import tempfile
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Final

import zmq
from zmq.utils import z85

from common.atomic_file import sync_directory
from common.errors import WayfixError

KEY_BYTES: Final = 32
CROCKFORD: Final = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
"""Alphabet of base 32 without letters that look like digits."""
FINGERPRINT_LETTERS: Final = 16
SECRET: Final = 0o077
"""Permission bits (mode) that nobody but the owner may have to a secret file."""
TRUSTED: Final = 0o022
"""Permission bits that nobody but the owner may have to a file that says whom to trust; others may read it."""
_Z85: Final = re.compile(r"[0-9a-zA-Z.\-:+=^!/*?&<>()\[\]{}@%$#]{40}")
_SECRET_FILE_BYTES: Final = 256


@dataclass(frozen=True, slots=True)
class KeyPair:
    """Both Z85, 40 bytes each. The secret key is never shown."""

    public: bytes
    secret: bytes = field(repr=False)


_PRIME: Final = 2**255 - 19
_TOP_BIT: Final = 2**255
_SMALL_ORDER: Final = frozenset((
    0, 1, _PRIME - 1, _PRIME, _PRIME + 1,
    0x00B8495F16056286FDB1329CEB8D09DA6AC49FF1FAE35616AEB8413B7C7AEBE0,
    0x57119FD0DD4E22D8868E1C58C45C44045BEF839C55B1D0B1248C50A3BC959C5F,
))  # fmt: skip
"""Points of Curve25519 with which every exchange gives the same, known secret (RFC 7748, section 6.1)."""


def new_keys() -> KeyPair:
    """Draw a pair."""
    return KeyPair(*zmq.curve_keypair())


def raw_key(text: str) -> bytes | None:
    """The 32 bytes of a key in Z85; None for any other text, and for a key with which nobody has a secret."""
    if not _Z85.fullmatch(text):
        return None
    try:
        raw = z85.decode(text.encode("ascii"))
    except (KeyError, ValueError, struct.error):  # five letters beyond 2^32
        return None
    return raw if len(raw) == KEY_BYTES and int.from_bytes(raw, "little") & ~_TOP_BIT not in _SMALL_ORDER else None


def key_text(raw: bytes) -> str:
    """32 bytes -> Z85."""
    return z85.encode(raw).decode("ascii")


def crockford(number: int, letters: int) -> str:
    """The lowest 5 x `letters` bits in groups of four, like `7Q2M-0XKD`."""
    text = "".join(CROCKFORD[number >> 5 * place & 31] for place in reversed(range(letters)))
    return "-".join(text[first : first + 4] for first in range(0, letters, 4))


def fingerprint(public_key: str) -> str:
    """What people compare instead of a public key (Z85): 80 bits of its SHA-256."""
    raw = raw_key(public_key) or public_key.encode("utf-8", "replace")
    return crockford(int.from_bytes(sha256(raw).digest()[:10], "big"), FINGERPRINT_LETTERS)


def own_keys(file: Path) -> KeyPair:
    """The pair whose secret key is in this file, which is made at first use. Raises WayfixError."""
    try:
        return _load(file)
    except FileNotFoundError:
        pass
    except OSError as error:
        raise WayfixError(f"the secret key cannot be read ({error.strerror})", str(file), "check its rights") from error
    try:
        file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        _make(file)
        return _load(file)
    except OSError as error:
        cure = "give a directory that this program may write"
        raise WayfixError(f"no secret key can be made ({error.strerror})", str(file), cure) from error


def read_own(file: Path, forbidden: int, limit_bytes: int) -> bytes:
    """A whole small file that only its owner, this user or root, can have written.

    forbidden: rights that nobody else may have (`SECRET`, `TRUSTED`); a secret must be this user's own.
    Raises WayfixError for a file that is not to be trusted, OSError (FileNotFoundError) for one that cannot be read.
    """
    fd = os.open(file, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe in its place must not hang us
    with os.fdopen(fd, "rb") as stream:
        status = os.fstat(fd)
        if not stat.S_ISREG(status.st_mode):
            raise WayfixError("is no plain file", str(file), "remove it")
        if status.st_uid != os.geteuid() and (forbidden == SECRET or status.st_uid != 0):
            cure = f"it must belong to user number {os.geteuid()}; if you do not know why, remove it and pair again"
            raise WayfixError(f"belongs to user number {status.st_uid}", str(file), cure)
        if status.st_mode & forbidden:
            what = f"others have rights to it (mode {stat.S_IMODE(status.st_mode):04o})"
            known = "whoever read it has your key: remove it and pair again"
            raise WayfixError(what, str(file), known if forbidden == SECRET else "check its lines, then chmod 600 it")
        data = stream.read(limit_bytes + 1)
    if len(data) > limit_bytes:
        raise WayfixError(f"is longer than {limit_bytes} bytes", str(file), "this is no file of ours: remove it")
    return data


def write_own(file: Path, data: bytes) -> None:
    """Replace a file as a whole; only its owner may read it. Raises OSError."""
    part = _written_part(file, data)
    try:
        part.replace(file)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    sync_directory(file.parent)


def _written_part(file: Path, data: bytes) -> Path:
    fd, name = tempfile.mkstemp(prefix=f".{file.name}.", dir=file.parent)  # mode 0600
    part = Path(name)
    try:
        with os.fdopen(fd, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(fd)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part


def _make(file: Path) -> None:
    """Make the key. Of two programs that start at once one makes it and both use it: a link never replaces a file."""
    part = _written_part(file, new_keys().secret + b"\n")
    try:
        os.link(part, file)
        sync_directory(file.parent)
    except FileExistsError:
        pass
    finally:
        part.unlink(missing_ok=True)


def _load(file: Path) -> KeyPair:
    line = read_own(file, SECRET, _SECRET_FILE_BYTES).decode("ascii", "replace")
    secret = line.removesuffix("\n")
    if raw_key(secret) is None:
        cure = "restore it from a copy, or remove it: a new key is made, and everything is to be paired again"
        raise WayfixError("is no secret key (40 characters of Z85)", str(file), cure)
    return KeyPair(zmq.curve_public(secret.encode("ascii")), secret.encode("ascii"))
