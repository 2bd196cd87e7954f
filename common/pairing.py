"""Pairing (key exchange): board and station learn each other's public keys, proved by a code a person carries.

    station -> board   {version, nonce, key}
    board -> station   {nonce, key, boat_id}
    station -> board   {proof}   HMAC-SHA256(k, "wayfix-pair-1 shore" T)
    board -> station   {proof}   HMAC-SHA256(k, "wayfix-pair-1 boat" T), after it has put the station on its list

    k = scrypt(code, salt = both nonces, n = 2^14, r = 8, p = 1), T = the first two messages as they were on the wire

A message is MessagePack behind its length (2 bytes, big-endian). Pure: bytes and times in, bytes out. Both sides take
one exchange and are of no use after it; whatever is not exactly what is expected ends it (LinkError) and burns the
code. docs/security.md says why this is enough.
"""

import hashlib
import hmac
from collections.abc import Callable
from typing import Any, Final

import msgpack

from common.errors import CodecError, LinkError, WayfixError
from common.key_list import name_fault
from common.keys import CROCKFORD, KEY_BYTES, crockford
from common.units import NS_PER_S
from common.untrusted_msgpack import unpack_untrusted

VERSION: Final = 1
NONCE_BYTES: Final = 32
PROOF_BYTES: Final = 32
MAX_MESSAGE_BYTES: Final = 1_024
LENGTH_BYTES: Final = 2
CODE_LETTERS: Final = 12
CODE_BITS: Final = 60
OPEN_S: Final = 120
CURE: Final = "ask for a new code: wayfix-onboard pair"
_FOREIGN: Final = "the other side does not speak our pairing"
_SHORE: Final = b"wayfix-pair-1 shore"
_BOAT: Final = b"wayfix-pair-1 boat"
_READ_AS: Final = str.maketrans({"O": "0", "I": "1", "L": "1", "-": None, " ": None})

Stretch = Callable[[str, bytes], bytes]
"""Key derivation: the code and the salt (both nonces) give k."""


def code_of(bits: int) -> str:
    """60 random bits as people read them: XXXX-XXXX-XXXX."""
    return crockford(bits, CODE_LETTERS)


def plain_code(text: str) -> str:
    """A code as typed -> its 12 letters: case, dashes and spaces do not count, O is 0, I and L are 1.

    Raises WayfixError.
    """
    code = text.strip().upper().translate(_READ_AS)
    if len(code) != CODE_LETTERS or any(letter not in CROCKFORD for letter in code):
        what = f"a code has {CODE_LETTERS} letters and digits, like 7Q2M-0XKD-93ZT"
        raise WayfixError(what, "the pairing code", "type it as the board shows it; nothing was sent yet")
    return code


def stretch(code: str, salt: bytes) -> bytes:
    """Make each guess dear: some 50 ms of a core and 16 MiB."""
    return hashlib.scrypt(code.encode("ascii"), salt=salt, n=2**14, r=8, p=1, maxmem=2**26, dklen=32)


def framed(message: bytes) -> bytes:
    """A message as it is on the wire."""
    return len(message).to_bytes(LENGTH_BYTES, "big") + message


def length_of(prefix: bytes) -> int:
    """Bytes of the message that follows; raises LinkError."""
    length = int.from_bytes(prefix, "big")
    if not 1 <= length <= MAX_MESSAGE_BYTES:
        raise LinkError(_FOREIGN, "pairing", CURE)
    return length


class Board:
    """The board's side. `receive` the first message and send what it returns, `receive` the second, then `accept`."""

    def __init__(
        self, code: str, public_key: bytes, boat_id: str, *, nonce: bytes, opened_ns: int, stretch: Stretch = stretch
    ) -> None:
        """public_key: 32 bytes; nonce: 32 random bytes."""
        self._code = code
        self._answer = _packed(nonce=nonce, key=public_key, boat_id=boat_id)
        self._nonce = nonce
        self._stretch = stretch
        self.expires_ns = opened_ns + OPEN_S * NS_PER_S
        self._hello: dict[str, Any] | None = None
        self._told = b""
        self._key: bytes | None = None
        self.burnt: str | None = None
        """Why the code is worth nothing any more; `None` = it is good."""

    def receive(self, message: bytes, now_ns: int) -> bytes | None:
        """The answer to the first message, None to the second, which takes long (scrypt). Raises LinkError."""
        self._check(now_ns)
        try:
            if self._hello is None:
                return self._first(message)
            self._second(message)
            return None
        except LinkError as error:
            self.burn(error.what)
            raise

    def accept(self, now_ns: int) -> tuple[bytes, bytes]:
        """(the station's public key, the answer to send once that is on the list): call it once. Raises LinkError."""
        self._check(now_ns)
        if self._key is None or self._hello is None:
            raise LinkError("nothing is proved", "pairing", CURE)
        self.burn("it was used")
        return self._hello["key"], _packed(proof=_mac(self._key, _BOAT, self._told))

    def burn(self, reason: str) -> None:
        """The code is worth nothing from now on; the first reason stays."""
        self.burnt = self.burnt or reason

    def _check(self, now_ns: int) -> None:
        if now_ns >= self.expires_ns:
            self.burn(f"its {OPEN_S} s are over")
        if self.burnt is not None:
            raise LinkError(f"this code cannot be used: {self.burnt}", "pairing", CURE)

    def _first(self, message: bytes) -> bytes:
        self._hello = _unpacked(message, {"version": int, "nonce": NONCE_BYTES, "key": KEY_BYTES})
        if self._hello["version"] != VERSION:
            raise LinkError(f"the station pairs by version {self._hello['version']}, we by {VERSION}", "pairing", CURE)
        self._told = framed(message) + framed(self._answer)
        return self._answer

    def _second(self, message: bytes) -> None:
        if self._hello is None or self._key is not None:
            raise LinkError("one message too many", "pairing", CURE)
        proof = _unpacked(message, {"proof": PROOF_BYTES})["proof"]
        key = self._stretch(self._code, self._hello["nonce"] + self._nonce)
        if not hmac.compare_digest(proof, _mac(key, _SHORE, self._told)):
            raise LinkError("a wrong code was given", "pairing", CURE)
        self._key = key


class Station:
    """The station's side. Send `hello`, `receive` the answer and send what it returns, `receive` the proof."""

    def __init__(self, code: str, public_key: bytes, *, nonce: bytes, stretch: Stretch = stretch) -> None:
        """Code: as `plain_code` gives it; public_key: 32 bytes; nonce: 32 random bytes."""
        self._code = code
        self._nonce = nonce
        self._stretch = stretch
        self.hello = _packed(version=VERSION, nonce=nonce, key=public_key)
        self._board: dict[str, Any] | None = None
        self._told = b""
        self._key = b""
        self._over = False
        self.proved = False
        """True once the board has proved that it knows the code: its key and boat id may be kept."""

    @property
    def board_key(self) -> bytes:
        """Public key of the board, 32 bytes; to be kept only when `proved`."""
        return bytes(self._board["key"]) if self._board and self.proved else b""

    @property
    def boat_id(self) -> str:
        """Id of the boat; to be kept only when `proved`."""
        return str(self._board["boat_id"]) if self._board and self.proved else ""

    def receive(self, message: bytes) -> bytes | None:
        """Our proof in answer to the first message (takes long: scrypt), None to a right proof. Raises LinkError."""
        if self._over:
            raise LinkError("this exchange is over", "pairing", CURE)
        self._over = True  # unless all is well with this message
        if self._board is not None:
            self._second(message)
            return None
        answer = self._first(message)
        self._over = False
        return answer

    def _first(self, message: bytes) -> bytes:
        board = _unpacked(message, {"nonce": NONCE_BYTES, "key": KEY_BYTES, "boat_id": str})
        if (fault := name_fault(board["boat_id"])) is not None:
            raise LinkError(f"the boat's id cannot be kept: {fault}", "pairing", "change [boat] id on the board")
        self._board = board
        self._told = framed(self.hello) + framed(message)
        self._key = self._stretch(self._code, self._nonce + board["nonce"])
        return _packed(proof=_mac(self._key, _SHORE, self._told))

    def _second(self, message: bytes) -> None:
        proof = _unpacked(message, {"proof": PROOF_BYTES})["proof"]
        if not hmac.compare_digest(proof, _mac(self._key, _BOAT, self._told)):
            raise LinkError("whoever answers there does not know the code", "pairing", CURE)
        self.proved = True


def _mac(key: bytes, label: bytes, told: bytes) -> bytes:
    return hmac.digest(key, label + told, "sha256")


def _packed(**fields: Any) -> bytes:
    return bytes(msgpack.packb(fields, use_bin_type=True))


def _unpacked(message: bytes, shape: dict[str, type | int]) -> dict[str, Any]:
    """A map of exactly these fields, each of this type or so many bytes; raises LinkError."""
    try:
        fields = unpack_untrusted(message, MAX_MESSAGE_BYTES)
    except CodecError:
        fields = None
    if not isinstance(fields, dict) or fields.keys() != shape.keys():
        raise LinkError(_FOREIGN, "pairing", CURE)
    if not all(_fits(fields[name], wanted) for name, wanted in shape.items()):
        raise LinkError(_FOREIGN, "pairing", CURE)
    return fields


def _fits(value: object, wanted: type | int) -> bool:
    if isinstance(wanted, int):
        return isinstance(value, bytes) and len(value) == wanted
    return type(value) is wanted
