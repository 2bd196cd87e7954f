"""Session server of the board's link, over one ROUTER socket (`common.link_messages`, docs/protocol.md).

Every frame goes to the store first. What a client is sent next, and how much, `onboard.link.send_order` decides; the
client says with each lease what it misses (`onboard.link.client_leases`).
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Final

import zmq

from common import link_messages as session
from common.clock import boottime_ns
from common.codec import encode_frame
from common.errors import CodecError, WayfixError
from common.keys import fingerprint
from common.messages import Frame
from common.units import NS_PER_S
from common.versions import LINK_VERSION, SCHEMA_VERSION, version_fault
from common.words import counted
from onboard.journal import Journal
from onboard.link.backfill import Filling
from onboard.link.client_leases import Pace, Session
from onboard.link.router import Router
from onboard.link.send_order import MAX_GONE, LiveFrame, SendOrder, gone_of
from onboard.spool import Spool

log = logging.getLogger(__name__)

MAX_CLIENTS: Final = 32
SESSIONS_OF_KEY: Final = 4
"""Most sessions of one key: one station cannot take every place; on an open board no client has a key."""
NEWS_AT_ONCE: Final = 128
NEWS_PER_S: Final = 2.0
"""Rate limit of events about clients that come, go or are refused, a second: a flood of them fills no frame."""
COMMANDS_AT_ONCE: Final = 10
COMMANDS_PER_S: Final = 2.0
"""Rate limit of the commands of one key, a second."""
GOODBYE_S: Final = 0.3
"""Time in which a key that was removed is sent the reason, s, before its connection is cut."""
READING_COMMANDS: Final = ("status", "raw")
"""Commands that change nothing: the right to read is enough."""
NOT_LISTED: Final = "this station's key is not on the board's list"
CURE_PAIR: Final = "pair again: wayfix-onboard pair on the board, then wayfix pair ashore"

Rights = Callable[[str | None], frozenset[str] | None]
"""Public key of a sender -> what it may do: `read`, `command`; None = it is not on the list."""
Command = Callable[[str, str, str], Awaitable[str]]
"""Called with name, argument and who asks; gives the answer in words, raises WayfixError."""


@dataclass(frozen=True, slots=True)
class Limits:
    """What clients together may ask of the board."""

    clients: int = MAX_CLIENTS
    fill_bytes_per_s: int = 1_000_000
    """Rate limit of missing frames and bounded runs for all clients, bytes/s; new frames are not counted."""


class Server:
    """Answers clients and hands every frame on; `connected` supplies the greeting's fields."""

    def __init__(
        self,
        router: Router,
        store: Spool,
        *,
        connected: Callable[[], dict[str, Any]],
        frame_period_ns: int,
        journal: Journal,
        rights: Rights,
        command: Command | None = None,
        limits: Limits = Limits(),
    ) -> None:
        self._router = router
        self._store = store
        self._connected = connected
        self._journal = journal
        self._rights = rights
        self._command = command
        self._limits = limits
        self._sessions: dict[tuple[str | None, str], Session] = {}
        self._next_seq = 0
        self._boot_id = ""
        self._header = b""
        self._greeting: bytes | None = None
        """Good until the next frame; `None` = none is made yet."""
        self._last_with_fix: LiveFrame | None = None
        self._frame_period_ns = frame_period_ns
        self._filling = Filling(store, self._send, self._end, limits.fill_bytes_per_s)
        self._commands: set[asyncio.Task[None]] = set()
        self._command_paces: dict[str | None, Pace] = {}
        self._news = Pace(NEWS_AT_ONCE, NEWS_PER_S)
        self._stopping: str | None = None
        self.malformed = 0

    @property
    def clients(self) -> int:
        """Number of sessions at this moment."""
        return len(self._sessions)

    def bind(self, address: str) -> str:
        """Bind the socket, see `Router.bind`."""
        return self._router.bind(address)

    async def run(self) -> None:
        """Answer clients until cancelled."""
        self._router.start(self._receive)
        await self._filling.run(self._sessions.values)

    def publish(self, frame: Frame) -> None:
        """Store one new frame and hand it to every session that has room."""
        self._next_seq = frame.seq + 1
        self._greeting = None
        self._boot_id = frame.boot_id
        try:
            data = encode_frame(frame)
        except CodecError as error:
            self._journal.tell("frame-failed", seq=frame.seq, reason=error.what[:200])
            return
        self._store.append(frame.seq, data)
        self._header = session.pack("frame", boot_id=frame.boot_id, seq=frame.seq)
        now_ns = boottime_ns()
        for key, client in list(self._sessions.items()):
            if client.expires_ns < now_ns:
                self._forget(key, "it was not heard of any more")
            else:
                self._send_newest(client)
        if frame.fixes:
            self._last_with_fix = LiveFrame(frame.seq, self._header, data)
        self._filling.wake()

    def reload(self) -> None:
        """The allow list changed: sessions and connections of keys that are no longer on it end at once."""
        for key, client in list(self._sessions.items()):
            if not self._may_read(client.key):
                self._send(client, [session.pack("error", what=NOT_LISTED, cure=CURE_PAIR)])
                self._forget(key, "its key was removed")
        asyncio.get_running_loop().call_later(GOODBYE_S, self._router.cut_unless, self._may_read)

    def _may_read(self, key: str | None) -> bool:
        return "read" in (self._rights(key) or ())

    async def drain(self, deadline_s: float) -> None:
        """Give clients a moment to take the last frames."""
        await _until(lambda: not any(self._is_behind(client) for client in self._sessions.values()), deadline_s)

    async def end_all(self, reason: str, deadline_s: float) -> None:
        """Send `end` to every session and wait for its `bye`: the daemon stops.

        A connection that is closed while something unread has come over it takes along what was sent last.
        """
        self._stopping = reason
        for client in self._sessions.values():
            if not client.is_ended:
                self._end(client, reason)
        await _until(lambda: all(client.connection is None for client in self._sessions.values()), deadline_s)

    def close(self) -> None:
        """Close the socket."""
        self._router.close()

    def _is_behind(self, client: Session) -> bool:
        order = client.order
        waits_for_newest = client.lease.run is None and order.live_next < self._next_seq
        return client.connection is not None and (order.on_the_way > 0 or bool(order.wanted) or waits_for_newest)

    def _receive(self, routing_id: bytes, key: str | None, parts: list[bytes]) -> None:
        try:
            if self._may_read(key):
                self._answer(routing_id, key, session.unpack(parts[0] if len(parts) == 1 else b""))
            else:
                self._reply(routing_id, "error", what=NOT_LISTED, cure=CURE_PAIR)
        except CodecError as error:
            self.malformed += 1
            log.debug("malformed message from %s: %s", routing_id.hex(), error.what)
            self._reply(routing_id, "error", what=error.what, cure="see docs/protocol.md")
        except Exception:  # whatever a stranger sends, the daemon lives
            self.malformed += 1
            if self._news.allows(boottime_ns()):
                log.exception("message from %s not answered", routing_id.hex())

    def _answer(self, routing_id: bytes, key: str | None, message: dict[str, Any]) -> None:
        kind = message["type"]
        if kind == "lease":
            self._lease(routing_id, key, message)
        elif kind == "hello":
            self._hello(routing_id, message)
        elif kind == "command":
            self._start_command(routing_id, key, message)
        elif kind == "bye":
            self._forget((key, str(message.get("session"))), "it said goodbye")
        else:
            self.malformed += 1

    def _hello(self, routing_id: bytes, message: dict[str, Any]) -> None:
        fault = version_fault(message)
        if fault is not None:
            self._reply(routing_id, "error", what=fault, cure="")
            return
        self._greet(routing_id)

    def _greet(self, routing_id: bytes) -> None:
        if self._greeting is None:
            self._greeting = self._new_greeting()
        self._router.send(routing_id, [self._greeting])

    def _new_greeting(self) -> bytes:
        held = self._store.runs()
        unlisted, listed = held[: -session.MAX_RUNS], held[-session.MAX_RUNS :]
        greeting = {
            "schema": SCHEMA_VERSION,
            "link": LINK_VERSION,
            "runs": [[run.boot_id, run.start_no, run.first_seq, run.next_seq] for run in listed],
            "unlisted": [len(unlisted), sum(run.next_seq - run.first_seq for run in unlisted)],
        }
        return session.pack("connected", **greeting, **self._connected())

    def _lease(self, routing_id: bytes, key: str | None, message: dict[str, Any]) -> None:
        received_ns = boottime_ns()
        lease = session.lease_of(message)
        if lease.run is not None and round((lease.run.period_s or 0) * NS_PER_S) % self._frame_period_ns:
            raise CodecError(
                f"period_s must be a multiple of the board's frame period, {self._frame_period_ns / NS_PER_S:g} s"
            )
        client = self._sessions.get((key, lease.session))
        if client is None:
            if self._stopping is not None:
                return
            if "schema" in message and (fault := version_fault(message)) is not None:
                self._reply(routing_id, "error", what=fault, cure="")
                return
            if (refusal := self._refusal(key)) is not None:
                self._reply(routing_id, "error", what=refusal[0], cure=refusal[1])
                return
            client = self._join(routing_id, key, lease, message)
        if lease.boot_id != self._boot_id:
            self._greet(routing_id)
        client.renew(lease, routing_id, received_ns, self._frame_period_ns)
        gone = [*gone_of(lease.missing, self._store.runs()), *client.order.gone]
        self._reply(
            routing_id,
            "alive",
            echo_ns=lease.t_ns,
            rx_ns=received_ns,
            tx_ns=boottime_ns(),
            next_seq=self._next_seq,
            gone=[[item.boot_id, item.first, item.last] for item in gone[:MAX_GONE]],
        )
        self._send_newest(client)
        self._filling.wake()
        if self._stopping is not None and not client.is_ended:
            self._end(client, self._stopping)

    def _refusal(self, key: str | None) -> tuple[str, str] | None:
        """Why there is no place for one more client with this key, and what to do."""
        if len(self._sessions) >= self._limits.clients:
            most = self._limits.clients
            told = f"{counted(most, 'client')} {'is' if most == 1 else 'are'} connected"
            return told, "close another station, or raise --max-clients"
        if key is not None and sum(other == key for other, _ in self._sessions) >= SESSIONS_OF_KEY:
            return f"{SESSIONS_OF_KEY} clients with this key are connected", "close one, or give each its own --keys"
        return None

    def _join(self, routing_id: bytes, key: str | None, lease: session.Lease, message: dict[str, Any]) -> Session:
        name = _printable(message.get("client")) or routing_id.hex()
        client = Session(name, key, lease, order=SendOrder(live_next=self._next_seq))
        self._sessions[key, lease.session] = client
        self._tell_news("client-joined", client=name)
        return client

    def _send_newest(self, client: Session) -> None:
        newest = self._store.newest()
        if newest is None or client.lease.run is not None:
            return
        newest_frame = LiveFrame(newest[0], self._header, newest[1])
        while (frame := client.order.next_live(newest_frame, self._last_with_fix)) is not None:
            has_room = client.order.has_room(len(frame.data), fill=False)
            if not has_room or not self._send(client, [frame.header, frame.data]):
                return
            client.order.sent_live(frame)

    def _end(self, client: Session, reason: str) -> None:
        place = {"boot_id": self._boot_id, "next_seq": self._next_seq}
        end = session.pack("end", sent=client.order.frames_sent, reason=reason, **place)
        client.is_ended = self._send(client, [end])

    def _send(self, client: Session, parts: list[bytes]) -> bool:
        """False = not now."""
        if client.connection is None:
            return False
        failure = self._router.send(client.connection, parts)
        if failure not in (None, zmq.EAGAIN):
            client.broke()
        return failure is None

    def _reply(self, routing_id: bytes, kind: str, **fields: Any) -> None:
        self._router.send(routing_id, [session.pack(kind, **fields)])

    def _forget(self, key: tuple[str | None, str], reason: str) -> None:
        client = self._sessions.pop(key, None)
        if client is not None:
            self._tell_news("client-left", client=client.name, reason=reason)

    def _tell_news(self, code: str, **evidence: str) -> None:
        if self._news.allows(boottime_ns()):
            self._journal.child("link").tell(code, **evidence)

    def _start_command(self, routing_id: bytes, key: str | None, message: dict[str, Any]) -> None:
        request = {"id": session.command_id(message)}
        name, argument = _printable(message.get("name")), message.get("argument") or ""
        if not isinstance(argument, str):
            raise CodecError("argument must be a text")
        needed = "read" if name in READING_COMMANDS else "command"
        if self._command is None or needed not in (self._rights(key) or ()):
            cure = "pair again with the right: wayfix-onboard pair --command"
            self._reply(routing_id, "error", what="this station's key may read, not command", cure=cure, **request)
            who = "anybody" if key is None else fingerprint(key)
            self._tell_news("command-refused", command=name, client=who)
            return
        pace = self._command_paces.setdefault(key, Pace(COMMANDS_AT_ONCE, COMMANDS_PER_S))
        if not pace.allows(boottime_ns()):
            self._reply(routing_id, "error", what="too many commands", cure="wait a second", **request)
            return

        async def work(command: Command) -> None:
            try:
                text = await command(name, argument[: session.MAX_ARGUMENT], key or "anybody")
            except WayfixError as error:
                self._reply(routing_id, "error", what=error.what, cure=error.cure, **request)
            else:
                self._reply(routing_id, "done", text=text, **request)

        task = asyncio.ensure_future(work(self._command))
        self._commands.add(task)
        task.add_done_callback(self._commands.discard)


async def _until(true: Callable[[], bool], deadline_s: float) -> None:
    """Wait until `true()` holds, no longer than the deadline, s."""
    steps = 50
    for _ in range(steps):
        if true():
            return
        await asyncio.sleep(deadline_s / steps)


def _printable(text: object) -> str:
    """The text for an event: its first 32 printable characters; empty for what is no text."""
    return "".join(filter(str.isprintable, text))[:32] if isinstance(text, str) else ""
