"""Control socket of the daemon (Unix socket): root and the daemon's own user can ask it on the board itself.

`control.sock` in the runtime directory; one line of JSON asks (`{"do": "status"}`, at most 4 kB), one line answers:
`{"ok": true, ...}` or `{"ok": false, "what": ..., "where": ..., "cure": ...}`. Several requests may follow each other.
"""

import asyncio
import json
import logging
import os
import select
import socket
import struct
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from common.errors import WayfixError
from onboard.journal import Journal

log = logging.getLogger(__name__)

Handler = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]
"""Fields of the request -> fields of the answer; raises WayfixError."""

NAME: Final = "control.sock"
REQUEST_BYTES: Final = 4_096
ANSWER_BYTES: Final = 2**20
MAX_CONNECTIONS: Final = 16
"""Most connections that ask nothing; for one more the oldest of them goes."""
IDLE_S: Final = 30.0
"""Time-out of an idle connection, s: one that asks nothing for this long is closed."""
GONE_S: Final = 0.5
"""Interval of the checks whether the client still waits, s."""
DEFAULT_RUNTIME: Final = Path("/run/wayfix")
"""The runtime directory that deploy/wayfix-onboard.service sets with RuntimeDirectory=."""
_CREDENTIALS: Final = struct.Struct("3i")


@dataclass(frozen=True, slots=True)
class Lasting:
    """A request whose answer is of use only while its client waits for it."""

    handler: Handler
    gone: Callable[[], None]
    """Called when the client went away before the answer."""


class Control:
    """The socket in the daemon's loop. A fault of the socket is an event, and the daemon goes on."""

    def __init__(
        self,
        directory: Path | None,
        handlers: Mapping[str, Handler | Lasting],
        journal: Journal,
    ) -> None:
        """directory: where the socket is made; None = no socket."""
        self._file = None if directory is None else directory / NAME
        self._handlers = handlers
        self._journal = journal
        self._connections: set[asyncio.Task[None]] = set()
        self._idle: dict[asyncio.Task[None], None] = {}
        """Those that ask nothing now, the longest first."""
        self.tried = asyncio.Event()
        """Set once the socket answers, or cannot be made."""

    async def run(self) -> None:
        """Answer requests until cancelled."""
        server = await self._open()
        self.tried.set()
        try:
            await asyncio.Event().wait()
        finally:
            for connection in self._connections:
                connection.cancel()
            if server is not None and self._file is not None:
                server.close()
                with suppress(OSError):
                    self._file.unlink()

    async def _open(self) -> asyncio.Server | None:
        if self._file is None:
            return None
        try:
            listener = _listener(self._file)
            return await asyncio.start_unix_server(self._serve, sock=listener, limit=REQUEST_BYTES)
        except OSError as error:
            reason = f"{self._file}: {error.strerror or error}"
            self._journal.tell("control-unusable", reason=reason)
            return None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        try:
            if not _permitted(writer):
                return
            if len(self._idle) >= MAX_CONNECTIONS:
                oldest = next(iter(self._idle))
                del self._idle[oldest]
                oldest.cancel()
            self._connections.add(task)
            self._idle[task] = None
            while line := await asyncio.wait_for(reader.readline(), IDLE_S):
                self._idle.pop(task, None)
                await _send(writer, await self._answer(line, writer))
                self._idle[task] = None
        except ValueError:  # readline: longer than the limit
            with suppress(OSError):
                await _send(writer, _refusal(WayfixError(f"a request has at most {REQUEST_BYTES} bytes", NAME)))
        except (OSError, asyncio.CancelledError):  # TimeoutError too; nobody waits for this task
            return
        finally:
            self._connections.discard(task)
            self._idle.pop(task, None)
            writer.close()

    async def _answer(self, line: bytes, writer: asyncio.StreamWriter) -> dict[str, Any]:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict) or not isinstance(request.get("do"), str):
            return _refusal(WayfixError("a request is one line of JSON like {'do': 'status'}", NAME))
        handler = self._handlers.get(request["do"])
        if handler is None:
            return _refusal(WayfixError("no such request", NAME, f"there are {', '.join(sorted(self._handlers))}"))
        fields = {name: value for name, value in request.items() if name != "do"}
        try:
            if isinstance(handler, Lasting):
                return {"ok": True, **await _while_heard(handler, fields, writer)}
            return {"ok": True, **await handler(fields)}
        except WayfixError as error:
            return _refusal(error)
        except Exception:  # whatever was asked, the daemon lives
            log.exception("request %s failed", request["do"])
            return _refusal(WayfixError("the daemon failed at it", NAME, "read its log and report this"))


def has_terminal() -> bool:
    """Whether this process has a controlling terminal.

    With one, SIGHUP says that it was closed and ends a daemon in the foreground; without one (systemd) it asks to read
    the allow list again.
    """
    try:
        os.close(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC))
    except OSError:
        return False
    return True


def text_of(fields: Mapping[str, Any], name: str, longest: int = 256) -> str:
    """A text of a request; raises WayfixError."""
    value = fields.get(name)
    if not isinstance(value, str) or not 1 <= len(value) <= longest:
        raise WayfixError(f"{name} must be a text of 1 to {longest} characters", NAME)
    return value


def runtime_of(given: Path | None, environ: Mapping[str, str]) -> Path:
    """Directory of the running daemon's socket: --runtime, else $RUNTIME_DIRECTORY, else that of the systemd unit."""
    named = environ.get("RUNTIME_DIRECTORY", "").split(":")[0]
    return given or (Path(named) if named else DEFAULT_RUNTIME)


def ask(directory: Path, do: str, timeout_s: float = 10.0, **fields: Any) -> dict[str, Any]:
    """Ask the running daemon; returns the fields of its answer. Raises WayfixError."""
    with asked(directory, do, timeout_s, **fields) as answer:
        return answer()


@contextmanager
def asked(directory: Path, do: str, timeout_s: float = 10.0, **fields: Any) -> Iterator[Callable[[], dict[str, Any]]]:
    """While the daemon has the request: what waits for the fields of its answer. Both raise WayfixError."""
    file = directory / NAME
    request = json.dumps({"do": do, **fields}).encode() + b"\n"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line:
        line.settimeout(timeout_s)
        with _in_words(file, timeout_s):
            line.connect(str(file))
            line.sendall(request)

        def answer() -> dict[str, Any]:
            with _in_words(file, timeout_s):
                return _fields_of(_line_from(line), file)

        yield answer


@contextmanager
def _in_words(file: Path, timeout_s: float) -> Iterator[None]:
    """A fault of the daemon's socket as a WayfixError."""
    try:
        yield
    except (ConnectionResetError, BrokenPipeError) as error:
        raise _silent(file) from error
    except (FileNotFoundError, ConnectionRefusedError) as error:
        cure = "start it, or give its runtime directory with --runtime DIR"
        raise WayfixError("no daemon answers there", str(file), cure) from error
    except PermissionError as error:
        raise WayfixError("not permitted", str(file), "call this as root (sudo) or as the daemon's user") from error
    except TimeoutError as error:
        what = f"the daemon did not answer within {timeout_s:g} s"
        raise WayfixError(what, str(file), "read its log (journalctl -u wayfix-onboard)") from error
    except OSError as error:
        raise WayfixError(f"the daemon cannot be asked ({error.strerror or error})", str(file)) from error


def _silent(file: Path) -> WayfixError:
    cure = "call this as root (sudo) or as the daemon's user, on the board"
    return WayfixError("the daemon gave no answer", str(file), cure)


def _fields_of(answer: bytes, file: Path) -> dict[str, Any]:
    if not answer:
        raise _silent(file)
    try:
        told = json.loads(answer)
        ok = told.pop("ok")
    except (ValueError, AttributeError, KeyError) as error:
        raise WayfixError("what answers there is no daemon of ours", str(file)) from error
    if not ok:
        raise WayfixError(str(told.get("what")), str(told.get("where") or ""), str(told.get("cure") or ""))
    return dict(told)


def _line_from(line: socket.socket) -> bytes:
    """The bytes up to the newline; empty when there is none."""
    answer = b""
    while not answer.endswith(b"\n"):
        part = line.recv(65_536)
        if not part or len(answer) > ANSWER_BYTES:
            return b""
        answer += part
    return answer


def _listener(file: Path) -> socket.socket:
    """A listening socket that only its owner may reach, from its first moment; raises OSError."""
    file.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    _clear(file)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        os.fchmod(listener.fileno(), 0o600)  # before bind: Linux gives this mode, less the umask, to the file
        listener.bind(str(file))
        listener.listen()
    except BaseException:
        listener.close()
        raise
    return listener


def _clear(file: Path) -> None:
    """Remove the socket that a killed daemon left behind; one that still answers stays. Raises OSError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(file))
        except FileNotFoundError:
            return
        except ConnectionRefusedError:
            if not file.is_socket():
                raise
            file.unlink()
            return
    raise OSError(0, "another daemon answers there")


def _permitted(writer: asyncio.StreamWriter) -> bool:
    """Whether the client is root or the daemon's own user; the mode of the file alone is not relied upon."""
    peer = writer.get_extra_info("socket").getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    _, uid, _ = _CREDENTIALS.unpack(peer)
    return uid in (0, os.geteuid())


async def _while_heard(request: Lasting, fields: dict[str, Any], writer: asyncio.StreamWriter) -> dict[str, Any]:
    poll = select.poll()
    poll.register(writer.get_extra_info("socket").fileno(), 0)  # POLLHUP alone: closed both ways, not only for writing
    work, done = asyncio.ensure_future(request.handler(fields)), set[Any]()
    try:
        while not done and not poll.poll(0):
            done, _ = await asyncio.wait({work}, timeout=GONE_S)
        if not done:
            request.gone()
        return await work
    finally:
        work.cancel()


async def _send(writer: asyncio.StreamWriter, answer: dict[str, Any]) -> None:
    writer.write(json.dumps(answer).encode() + b"\n")
    await writer.drain()


def _refusal(error: WayfixError) -> dict[str, Any]:
    return {"ok": False, "what": error.what, "where": error.where, "cure": error.cure}
