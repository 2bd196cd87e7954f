"""Pairing port (key exchange) of the board: open for two minutes and one client, on request of a person on board.

The exchange itself is `common.pairing.Board`; here are socket, clock and the list that the station is put on.
"""

import asyncio
import re
import secrets
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from common import pairing
from common.clock import boottime_ns
from common.errors import LinkError, WayfixError
from common.key_list import name_fault
from common.keys import fingerprint, key_text, raw_key
from onboard.journal import Journal
from onboard.link.allow_list import COMMAND, READ, AllowList

MESSAGE_S: Final = 10.0
"""Time-out of one message, s: a client that sends nothing for this long has failed."""
_ENDPOINT: Final = re.compile(r"tcp://(?P<host>\[.+\]|[^\[\]:]+):(?P<port>\d+)")


@dataclass(frozen=True, slots=True)
class Request:
    """What the person on the board asks for."""

    port: int | None = None
    """TCP port of the pairing; None = the link's port + 1, 0 = any free one."""
    command: bool = False
    """True = the station may command too."""
    name: str | None = None
    """Name on the allow list; None = the name that the key has, or station-1, station-2, ..."""


@dataclass(frozen=True, slots=True)
class Opened:
    """A port that waits for a station."""

    code: str
    port: int
    seconds: int = pairing.OPEN_S


def place_of(endpoint: str) -> tuple[str | None, int]:
    """The link's endpoint in full -> host (None = every address, IPv6 too) and port for pairing; raises WayfixError."""
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:
        raise WayfixError("no pairing beside this address", endpoint, "bind the link to tcp://ADDRESS:PORT")
    host = match["host"].strip("[]").replace("*", "0.0.0.0")  # noqa: S104 - as the link does
    return None if host == "::" else host, int(match["port"]) + 1


@dataclass(slots=True)
class _Pairing:
    """One code, and what became of it."""

    board: pairing.Board
    request: Request
    outcome: asyncio.Future[tuple[bool, str]]
    """Set once: whether a station was put on the list, and a sentence."""
    exchange: asyncio.Task[None] | None = None
    """The running exchange with the one client; None = no client has come."""
    accepted: bool = False
    """True once the client has proved that it knows the code; nothing stops the exchange after that."""
    ends: list[Callable[[], None]] = field(default_factory=list)


class PairingPort:
    """At most one pairing at a time; a new one burns the code of the one before."""

    def __init__(self, allow_list: AllowList, boat_id: str, endpoint: str, journal: Journal) -> None:
        """Endpoint: where the link listens, in full."""
        self._allow_list = allow_list
        self._boat_id = boat_id
        self._endpoint = endpoint
        self._journal = journal.child("link")
        self._newest: _Pairing | None = None

    async def open(self, request: Request) -> Opened:
        """Open the port for two minutes; raises WayfixError."""
        if request.name is not None and (fault := name_fault(request.name)) is not None:
            raise WayfixError(fault, "--name", "give another --name")
        if (fault := name_fault(self._boat_id)) is not None:
            raise WayfixError(fault, "[boat] id", "change it: stations keep the boat's key by its id")
        self.close("another code was asked for")
        code = pairing.code_of(secrets.randbits(pairing.CODE_BITS))
        public_key = raw_key(self._allow_list.public_key.decode("ascii"))
        assert public_key is not None
        nonce = secrets.token_bytes(pairing.NONCE_BYTES)
        board = pairing.Board(pairing.plain_code(code), public_key, self._boat_id, nonce=nonce, opened_ns=boottime_ns())
        loop = asyncio.get_running_loop()
        newest = self._newest = _Pairing(board, request, loop.create_future())
        try:
            port = await self._listen(newest)
        except WayfixError as error:
            self._end(newest, False, error.what)
            raise
        expiry = loop.call_later(pairing.OPEN_S, self._end, newest, False, f"its {pairing.OPEN_S} s are over")
        newest.ends.append(expiry.cancel)
        self._journal.tell("pairing-open", port=port, seconds=pairing.OPEN_S)
        return Opened(code, port)

    async def outcome(self) -> tuple[bool, str]:
        """Wait for the end of the newest pairing: whether a station was put on the list, and a sentence."""
        if self._newest is None:
            return False, "no pairing was asked for"
        return await asyncio.shield(self._newest.outcome)

    def close(self, reason: str) -> None:
        """End a pairing that is open; its code is worth nothing from here on."""
        if self._newest is not None:
            self._end(self._newest, False, reason)

    async def _listen(self, newest: _Pairing) -> int:
        host, port = place_of(self._endpoint)
        try:
            server = await asyncio.start_server(
                lambda reader, writer: self._client(newest, reader, writer),
                host,
                port if newest.request.port is None else newest.request.port,
            )
        except (OSError, OverflowError) as error:
            cure = "give a free port: wayfix-onboard pair --port N, and the same ashore"
            raise WayfixError(f"the pairing port cannot be opened ({error})", self._endpoint, cure) from error
        newest.ends.append(server.close)
        if newest.outcome.done():  # another request came in the meantime
            server.close()
            raise WayfixError("another code was asked for", "pairing", "try again")
        return int(server.sockets[0].getsockname()[1])

    def _end(self, one: _Pairing, paired: bool, text: str) -> None:
        if one.outcome.done() or (one.accepted and not paired and one.exchange is not asyncio.current_task()):
            return
        one.outcome.set_result((paired, text))
        one.board.burn(text)
        for end in one.ends:
            end()
        if one.exchange is not None and one.exchange is not asyncio.current_task():
            one.exchange.cancel()
        if not paired:
            self._journal.tell("pairing-failed", reason=text)

    async def _client(self, one: _Pairing, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """The first client has the exchange, and whatever goes wrong in it ends it; so does a second client."""
        try:
            if one.exchange is not None:
                self._end(one, False, "a second client came")
                return
            one.exchange = asyncio.current_task()
            text = await self._exchange(one, reader, writer)
            self._end(one, True, text)
        except asyncio.CancelledError:  # the pairing ended meanwhile
            pass
        except TimeoutError:
            self._end(one, False, f"the client said nothing for {MESSAGE_S:g} s")
        except (OSError, asyncio.IncompleteReadError):
            self._end(one, False, "the client went away")
        except LinkError as error:
            self._end(one, False, error.what)
        except WayfixError as error:
            self._end(one, False, str(error))
        finally:
            writer.close()

    async def _exchange(self, one: _Pairing, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> str:
        """Put the station on the list; raises LinkError, TimeoutError, OSError, IncompleteReadError, WayfixError."""
        answer = one.board.receive(await _message(reader), boottime_ns())
        writer.write(pairing.framed(answer or b""))
        # scrypt takes 50 ms of a core: not in the loop that polls the sensors.
        await asyncio.to_thread(one.board.receive, await _message(reader), boottime_ns())
        station, proof = one.board.accept(boottime_ns())
        one.accepted = True
        key = key_text(station)
        rights = COMMAND if one.request.command else READ
        name = one.request.name or self._allow_list.name_for(key)
        await asyncio.to_thread(self._allow_list.add, key, name, rights)
        shown = {"name": name, "fingerprint": fingerprint(key), "rights": ",".join(sorted(rights, reverse=True))}
        self._journal.tell("pairing-done", **shown)
        with suppress(OSError):  # a station that is gone by now can be paired again
            writer.write(pairing.framed(proof))
            await asyncio.wait_for(writer.drain(), MESSAGE_S)
        return f"paired with {name}, key {shown['fingerprint']}, rights {shown['rights']}"


async def _message(reader: asyncio.StreamReader) -> bytes:
    """One message; raises LinkError, TimeoutError, OSError, IncompleteReadError."""

    async def read() -> bytes:
        return await reader.readexactly(pairing.length_of(await reader.readexactly(pairing.LENGTH_BYTES)))

    return await asyncio.wait_for(read(), MESSAGE_S)
