"""Service notification (sd_notify, watchdog) and logging to the journal: the only importer of systemd.

With systemd-python the log has journal fields (SENSOR=, CODE=); without it the notify datagram is our own and systemd
takes each line's priority from a `<N>` prefix. Away from systemd nothing is sent and the log is plain.
"""

import logging
import os
import socket
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Final

from common.clock import boottime_ns
from common.units import NS_PER_US

PROGRAM: Final = "wayfix-onboard"
FEEDS_PER_INTERVAL: Final = 4
"""Feeds of the watchdog in one interval: a tick of up to a quarter may come in between, and half is kept."""
SEND_S: Final = 0.5
"""Time-out of a send while the supervisor's queue is full, s."""
_PRIORITY: Final = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
_FIELDS: Final = ("sensor", "code")
"""Attributes of a log record (`extra=`) that become journal fields of the same name in capitals."""


class Notifier:
    """The connection to the supervisor (sd_notify); without a supervisor it does nothing."""

    def __init__(self, send: Callable[[str], object] | None, watchdog_ns: int | None = None) -> None:
        """send: takes one datagram's text; watchdog_ns: it kills after this time without a feed, None = no watchdog."""
        self._send = send
        self._feed_ns = None if watchdog_ns is None else watchdog_ns // FEEDS_PER_INTERVAL
        self._fed_ns: int | None = None
        self._status = ""

    def ready(self) -> None:
        """Report that the ports are polled and the socket is bound."""
        self._tell("READY=1")

    def status(self, text: str) -> None:
        """One line for `systemctl status`, sent when it changes."""
        if text != self._status:
            self._status = text
            self._tell(f"STATUS={text}")

    def watchdog(self) -> None:
        """Feed the watchdog: everything lives at this moment. Call it often: it is sent when due, by the real clock."""
        if self._feed_ns is None:
            return
        now_ns = boottime_ns()
        if self._fed_ns is None or now_ns - self._fed_ns >= self._feed_ns:
            self._fed_ns = now_ns
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """Report that the daemon ends in good order."""
        self._tell("STOPPING=1")

    def _tell(self, text: str) -> None:
        if self._send is not None:
            with suppress(OSError):  # a supervisor that does not listen is no reason to stop sailing
                self._send(text)


def notifier(environ: Mapping[str, str]) -> Notifier:
    """The notifier for this process' environment."""
    address = environ.get("NOTIFY_SOCKET")
    if not address:
        return Notifier(None)
    return Notifier(_sender(address), watchdog_ns(environ, os.getpid()))


def watchdog_ns(environ: Mapping[str, str], pid: int) -> int | None:
    """The watchdog's interval; None when there is none for this process."""
    if environ.get("WATCHDOG_PID", str(pid)) != str(pid):
        return None
    try:
        interval_us = int(environ.get("WATCHDOG_USEC", "0"))
    except ValueError:
        return None
    return interval_us * NS_PER_US if interval_us > 0 else None


def _sender(address: str) -> Callable[[str], object]:
    try:
        from systemd.daemon import notify
    except ImportError:
        return _datagrams(address)
    send: Callable[[str], object] = notify
    return send


def _datagrams(address: str) -> Callable[[str], object]:
    """One datagram for each message, as sd_notify(3) sends them; a first `@` is an abstract address."""
    where = "\0" + address[1:] if address.startswith("@") else address

    def send(text: str) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as line:
            line.settimeout(SEND_S)
            line.sendto(text.encode(), where)

    return send


def in_journal(environ: Mapping[str, str], fd: int = 2) -> bool:
    """True when this descriptor is the journal's stream; JOURNAL_STREAM alone is inherited past a redirection."""
    try:
        status = os.fstat(fd)
    except OSError:
        return False
    return environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


def log_handler(environ: Mapping[str, str]) -> logging.Handler:
    """Where log lines go: the journal with fields, stderr with `<N>` prefixes, or plain stderr."""
    if in_journal(environ):
        with suppress(ImportError):
            return _journal_handler()
        handler: logging.Handler = logging.StreamHandler()
        handler.setFormatter(PrefixFormatter("%(message)s"))
        return handler
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter(f"{PROGRAM}: %(message)s"))
    return handler


def program_name(environ: Mapping[str, str]) -> str:
    """The name before a sentence of refusal on stderr; in the journal with an error's priority."""
    return f"<{_PRIORITY[logging.ERROR]}>{PROGRAM}" if in_journal(environ) else PROGRAM


class PrefixFormatter(logging.Formatter):
    """`<N>` before every line, which systemd strips and takes for the priority."""

    def format(self, record: logging.LogRecord) -> str:
        """All lines of the record, a traceback's too: each one is an entry of the journal."""
        prefix = f"<{_priority(record)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines())


class JournalHandler(logging.Handler):
    """Each record is one journal entry with fields; `send` is systemd's `journal.send`."""

    def __init__(self, send: Callable[..., object]) -> None:
        super().__init__()
        self._send = send
        self.setFormatter(logging.Formatter("%(message)s"))

    def emit(self, record: logging.LogRecord) -> None:
        """Send one entry."""
        try:
            self._send(self.format(record), **journal_fields(record))
        except Exception:
            self.handleError(record)


def journal_fields(record: logging.LogRecord) -> dict[str, str | int]:
    """Journal fields of a record. SENSOR= and CODE= are there when the record is an event."""
    fields: dict[str, str | int] = {
        "PRIORITY": str(_priority(record)),
        "SYSLOG_IDENTIFIER": PROGRAM,
        "LOGGER": record.name,
        "CODE_FILE": record.pathname,
        "CODE_LINE": record.lineno,
        "CODE_FUNC": record.funcName or "",
    }
    return fields | {name.upper(): str(getattr(record, name)) for name in _FIELDS if hasattr(record, name)}


def _journal_handler() -> JournalHandler:
    from systemd.journal import send

    return JournalHandler(send)


def _priority(record: logging.LogRecord) -> int:
    return _PRIORITY.get(record.levelno, 6)
