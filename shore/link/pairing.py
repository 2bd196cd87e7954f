"""The station's end of a pairing: one TCP connection to the board's pairing port (`common.pairing.Station`)."""

import secrets
import socket
from typing import Final

from common import pairing
from common.errors import LinkError
from common.keys import key_text, raw_key
from shore.link.known_boats import Boat, Boats

CONNECT_S: Final = 5.0
MESSAGE_S: Final = 10.0


def pair(host: str, port: int, code: str, boats: Boats, address: str) -> Boat:
    """Prove the code to the board, have it proved, and keep the board's key; raises LinkError, WayfixError.

    Code: as `pairing.plain_code` gives it; address: where the boat's link is, kept with the key.
    """
    public_key = raw_key(boats.public_key.decode("ascii"))
    assert public_key is not None
    station = pairing.Station(code, public_key, nonce=secrets.token_bytes(pairing.NONCE_BYTES))
    where = f"{host} port {port}"
    try:
        line = socket.create_connection((host, port), CONNECT_S)
    except (OSError, UnicodeError) as error:
        cure = "is it open on the board (wayfix-onboard pair), and the address right?"
        raise LinkError(f"no pairing there ({getattr(error, 'strerror', None) or error})", where, cure) from error
    with line:
        line.settimeout(MESSAGE_S)
        try:
            line.sendall(pairing.framed(station.hello))
            proof = station.receive(_message(line))
            line.sendall(pairing.framed(proof or b""))
            station.receive(_message(line))
        except OSError as error:
            what = "the board ended the pairing: a wrong code, one that is over, another client, or another version"
            raise LinkError(what, where, pairing.CURE) from error
    boats.remember(station.boat_id, key_text(station.board_key).encode("ascii"), address)
    return Boat(station.boat_id, key_text(station.board_key).encode("ascii"), address)


def _message(line: socket.socket) -> bytes:
    """One message; raises LinkError, OSError (TimeoutError, EOF)."""
    return _exactly(line, pairing.length_of(_exactly(line, pairing.LENGTH_BYTES)))


def _exactly(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = line.recv(count - len(data))
        if not part:
            raise ConnectionError("closed")
        data += part
    return data
